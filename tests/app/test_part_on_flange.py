"""The robot holds the part: plan against simulated cell, the same part as with a held tool, programs, refusals."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app import preflight
from counterflex.app.compensation.compensate import compensate
from counterflex.app.inputs import Job, read_job, setting_of
from counterflex.app.proof import simulate
from counterflex.app.proof.judge import judge, reference_of
from counterflex.app.proof.truth import exact_setting, truth_of
from counterflex.app.robot_axes import axes_in
from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.units import DEG, MM, UM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose
from counterflex.path.toolpath import FEED
from counterflex.plan.compensate import plan
from counterflex.robot.elasticity.chain import forward
from counterflex.twin.truth.family import FAMILIES
from counterflex.twin.truth.truth import Truth

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
HELD, STANDING = EXAMPLES / "cells" / "kr300_held_part.toml", EXAMPLES / "cells" / "kr300_d16_small.toml"
SHORT = "G21 G17 G90\nM6 T1\nM3 S13000\nG0 X-12 Y15 Z42\nG1 Z34 F3000\nG1 X24 F1500\nG0 Z60\nM5\nM2\n"
SEED = 211
TOUCHED = 'measured_with = "robot"\ndatum_points_mm = [[0, 0, 0], [9, 0, 0], [0, 9, 0]]'


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("held") / "part.ngc"
    file.write_text(SHORT, encoding="ascii")
    return file


@pytest.fixture(scope="module")
def job(program: Path) -> Job:
    return read_job(program, read_cell(HELD))


def _error_m(job: Job, cell: Cell, truth: Truth, machined: Job) -> float:
    record = simulate.machine(machined, cell, truth)
    return judge(reference_of(job, cell), record, record.stock).variant.path.path.p997_m


def test_the_plan_says_what_the_simulated_cell_does(job: Job) -> None:
    """Deviation in the plateau with the truth's constants: along, across and down, to a tenth of its size."""
    cell = read_cell(HELD)
    truth = truth_of(cell, SEED, FAMILIES["wide"])
    setting = exact_setting(job, cell, truth)
    assert setting.cutter_of(1).runout_m == truth.cutting.runout_m > 0.0
    planned = plan(job.path, job.line_of_motion, cell.stock(), setting)
    record = simulate.machine(job, cell, truth)

    def middle(p: Float, cuts: Bool) -> Bool:
        out: Bool = cuts & (np.abs(p[:, 0] - 15.0 * MM) < 3.0 * MM)
        return out

    on_cell = middle(record.p_part_command, record.engaged & (record.kind == FEED))
    met = (record.p_part_tcp - record.p_part_command)[on_cell].mean(axis=0)
    said = planned.deviation_nominal_part[middle(planned.path.p_part_tcp, planned.cutting)].mean(axis=0)
    assert np.linalg.norm(met) > 500.0 * UM
    assert np.linalg.norm(met[1:] - said[1:]) < 0.1 * np.linalg.norm(met)
    left = planned.deviation_compensated_part[middle(planned.path.p_part_tcp, planned.cutting)].mean(axis=0)
    assert np.linalg.norm(left[1:]) < 0.1 * np.linalg.norm(said)


def test_compensated_it_is_nearer_to_the_program(program: Path, job: Job, tmp_path: Path) -> None:
    cell = read_cell(HELD)
    truth = truth_of(cell, SEED, FAMILIES["wide"])
    done = compensate(program, cell, predict=False)
    (tmp_path / "part.ngc").write_text(next(iter(done.files.values())), encoding="utf-8")
    compensated = read_job(tmp_path / "part.ngc", cell)
    assert _error_m(job, cell, truth, compensated) < 0.7 * _error_m(job, cell, truth, job)


def _stiffer(truth: Truth, share: float) -> Truth:
    """The same cell with that share of its compliances, and a tenth of its friction on the links."""
    bodies = tuple(replace(body, compliance=share * body.compliance) for body in truth.bodies)
    drives = tuple(replace(d, link_friction_nm=tuple(0.1 * f for f in d.link_friction_nm)) for d in truth.drives)
    return replace(truth, bodies=bodies, drives=drives)


def test_the_stiffer_both_the_more_alike_are_the_parts(job: Job, tmp_path: Path) -> None:
    """What differs between the arrangements is what bends: a twentieth of it leaves a twentieth of the difference."""
    text = STANDING.read_text().replace('measured_with = "robot"', 'measured_with = "external"')
    standing = tmp_path / "standing.toml"
    standing.write_text(re.sub(r"datum_points_mm = .*\n", "", text), encoding="utf-8")
    cells = [read_cell(HELD), read_cell(standing)]
    apart = {}
    for share in (1.0, 0.05):
        held, stood = (simulate.machine(job, c, _stiffer(truth_of(c, None), share)).stock.z for c in cells)
        cut = (held < 39.9 * MM) & (stood < 39.9 * MM)
        apart[share] = float(np.median(np.abs(held - stood)[cut]))
    assert apart[1.0] > 300.0 * UM
    assert apart[0.05] < 0.1 * apart[1.0]


def _numbers(text: str, pattern: str) -> list[float]:
    found = re.search(pattern, text)
    assert found is not None, pattern
    return [float(value) for value in found.group(1).split(",")]


def test_the_rapid_module_closes_the_chain_from_flange_to_tool(program: Path) -> None:
    """Flange at the start posture, then the part in it, then the first target, is where the tool stands."""
    cell = read_cell(HELD)
    text = "".join(compensate(program, cell, predict=False, language="rapid").files.values())
    assert ":=[FALSE,[[1500" in text
    assert ":=[TRUE,TRUE," in text
    q = axes_in(cell, "rapid")[0].model(np.array(_numbers(text, r"MoveAbsJ \[\[([^]]*)\]")) * DEG)
    first = _numbers(text, r"MoveL \[\[([^]]*)\]")
    part = _numbers(text, r'wobjdata w_part:=\[TRUE,TRUE,"",\[\[([^]]*)\]')
    tool = _numbers(text, r"tooldata t_part:=\[FALSE,\[\[([^]]*)\]")
    chain = cell.controller_chain
    T_base_flange = forward(chain, q) @ pose.inverse(chain.T_flange_tcp)
    at = pose.transform(
        T_base_flange, np.array(part) * MM + np.array(first) * MM
    )  # the part is not turned in the flange
    assert at == pytest.approx(np.array(tool) * MM, abs=2e-6)


def test_the_krl_program_has_the_tool_as_base_and_the_part_as_tool(program: Path) -> None:
    files = compensate(program, read_cell(HELD), predict=False, language="krl").files
    text = files["part.src"]
    order = [text.index(word) for word in ("$TOOL=BASE_DATA[1]", "$BASE=TOOL_DATA[1]", "$IPO_MODE=#TCP")]
    assert order == sorted(order)
    assert "#BASE" not in text


def test_what_does_not_serve_a_held_part_says_so() -> None:
    with pytest.raises(InputError, match="the robot holds it") as caught:
        setting_of(read_cell(HELD))
    assert "part_on" in str(caught.value)


def _preflight(program: Path, cell: Cell) -> dict[str, dict[str, Any]]:
    return {row["check"]: row for row in preflight.check(program, cell).summary["checks"]}


def test_preflight_sees_what_the_hand_meets(program: Path, tmp_path: Path) -> None:
    """Gripper and blank move against the spindle that stands, and against whatever else stands there."""
    rows = _preflight(program, read_cell(HELD))
    assert rows["robot and spindle to surroundings"]["verdict"] == "ok"
    assert rows["tool to surroundings"]["verdict"] == "ok"
    assert rows["reach"]["verdict"] == "ok"
    post = '[[cell.body]]\nname = "post"\nshape = "box"\nx_mm = 1540\nz_mm = 500\nsize_mm = [20, 20, 1000]\n'
    file = tmp_path / "cell.toml"
    file.write_text(HELD.read_text() + post, encoding="utf-8")
    met = _preflight(program, read_cell(file))["robot and spindle to surroundings"]
    assert met["verdict"] == "fail"
    assert "post" in met["what"]


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ('measured_with = "external"', TOUCHED, "outside"),
        ("[material]", '[[external_axes]]\nname = "E1"\nkind = "linear"\ncarries = "part"\ndirection = [1, 0, 0]\n'
         "at_mm = 0\nmin_mm = 0\nmax_mm = 1\n\n[material]", "no external axis can carry it"),
        ('part_on = "flange"', 'part_on = "hand"', "part_on"),
    ],
)  # fmt: skip
def test_a_cell_file_that_contradicts_itself_is_refused(tmp_path: Path, old: str, new: str, what: str) -> None:
    file = tmp_path / "cell.toml"
    text = HELD.read_text()
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(FileFormatError, match=what):
        read_cell(file)

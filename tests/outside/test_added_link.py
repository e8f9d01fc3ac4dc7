"""A package adds the link of a robot and its simulated controller in its maker's folder: the loop runs on it."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from counterflex.app.compensation.compensate import run as compensate
from counterflex.app.proof import evaluate
from counterflex.app.proof.truth import make_truth
from counterflex.app.run.robot_links import ROBOT_LINKS, LinkOrder, chosen, values_of
from counterflex.app.run.session import RunSettings
from counterflex.app.simulated_cell.cell import LiveSettings
from counterflex.core.errors import FileFormatError, InputError
from counterflex.files.cell.cell import read_cell
from counterflex.files.logs.segments import read_log
from counterflex.twin.plant.force_sensor import force_sensor
from counterflex_lab.reproduce import closed_loop

ROOT = Path(__file__).parents[2]
PROGRAM = ROOT / "examples" / "programs" / "groove.ngc"
ONLINE = (
    '\n[online]\nprotocol = "melfa"\nforce = "scale"\ncorrection_mm = 3\nspeed_mm_s = 40\nacceleration_mm_s2 = 2500\n'
)


@pytest.fixture
def cell(example: Path, tmp_path: Path) -> Path:
    """Cell file that names the link, its truth beside it."""
    assert example
    text = (ROOT / "examples" / "cells" / "kr300_d16_small.toml").read_text(encoding="utf-8")
    file = tmp_path / "cell.toml"
    file.write_text(text, encoding="utf-8")
    truth = make_truth(read_cell(file), 1, tmp_path / "truth.toml")
    bias = force_sensor(truth, 0, "sensor", hose_share=0.0).w_bias
    table = f'\n[sensor]\nsegment = "sensor"\nbias_n = {bias[:3].tolist()}\nbias_nm = {bias[3:].tolist()}\n'
    mass_kg = next(body.mass_kg for body in truth.bodies if body.name == "spindle")
    weighed = text.replace("mass_kg = 75", f"mass_kg = {mass_kg:.4f}")
    assert weighed != text
    file.write_text(weighed + table + ONLINE, encoding="utf-8")
    return file


@pytest.mark.long
def test_run_and_the_simulated_cell_take_the_link_by_the_word_of_the_cell(cell: Path, tmp_path: Path) -> None:
    compensate(PROGRAM, cell, tmp_path / "plan", report=False, programmed_feed=True)
    path_mm = []
    for arm in (False, True):
        loop = RunSettings(cell, plan=tmp_path / "plan" / "plan.parquet", compensated=False, arm=arm)
        twin = LiveSettings(PROGRAM, cell, tmp_path / "truth.toml", hose_share=0.0)
        part, log = tmp_path / f"part{arm}", tmp_path / f"log{arm}"
        summary = closed_loop.run(twin, part, loop, log, sensors=closed_loop.Sensors())
        assert "fault" not in summary["states"]
        assert ("active" in summary["states"]) == arm
        path_mm.append(evaluate.run([part], None)["variants"]["nominal"]["path"]["max_mm"])
        assert set(read_log(log)[1]["files"]) == {"cell", "plan"}
    assert path_mm[0] > 0.6
    assert path_mm[1] < 0.32 * path_mm[0]  # as over RSI: tests/app/run/test_online_run.py


def test_what_the_link_has_no_word_or_key_for_is_refused(cell: Path) -> None:
    text = cell.read_text(encoding="utf-8")

    def opened(more: str) -> None:
        cell.write_text(text + more, encoding="utf-8")
        read = read_cell(cell)
        table = read.tables.online
        assert table is not None
        assert chosen(None, read) == ("melfa", None)
        online = table.settings(read.tables.timing, compensated=False)
        order = LinkOrder(cell=read, online=online, port=0, values=values_of("melfa", read))
        ROBOT_LINKS["melfa"].open(order).close()

    opened("[online.link]\nport = 10001\n")
    with pytest.raises(FileFormatError, match="the melfa protocol has no key speed; it has port, timeout_cycles"):
        opened("[online.link]\nspeed = 1\n")
    with pytest.raises(FileFormatError, match="port of the melfa protocol is a str, expected int"):
        opened('[online.link]\nport = "a"\n')
    with pytest.raises(InputError, match="corrects poses, and nothing else"):
        opened('output = "axes"\n')


def test_the_simulated_side_imports_no_link() -> None:
    source = Path(__file__).parent / "counterflex_example" / "melfa" / "simulated.py"
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert "link" not in {node.module, *(name.name for name in node.names)}

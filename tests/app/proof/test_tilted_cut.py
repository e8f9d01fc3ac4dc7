"""A cut with a tilted tool the whole way: planned in its working plane, written in rotary words, machined, judged."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.compensation import compensate
from counterflex.app.inputs import in_working_plane, read_job
from counterflex.app.proof import prove
from counterflex.app.run.session import RunSettings, open_session
from counterflex.core.errors import InputError, ProgramError
from counterflex.files.cell.cell import read_cell

ROOT = Path(__file__).resolve().parents[3]
CELL = ROOT / "examples" / "cells" / "kr300_bc_table.toml"
TEXT = (ROOT / "examples" / "programs" / "tilted_groove.ngc").read_text(encoding="ascii").replace("Y72", "Y40")


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("tilted") / "tilted.ngc"
    file.write_text(TEXT, encoding="ascii")
    return file


@pytest.fixture(scope="module")
def proof(tmp_path_factory: pytest.TempPathFactory, program: Path) -> tuple[Path, dict[str, Any]]:
    out = tmp_path_factory.mktemp("proof") / "out"
    return out, prove.run(program, CELL, out, seeds=[1], exact=False, workers=1)


def test_less_error_remains_on_the_simulated_cell(proof: tuple[Path, dict[str, Any]]) -> None:
    """As much as of an upright groove (30 % of the largest error), with the planner knowing the catalogue only."""
    before, after = (proof[1]["variants"][name]["path"] for name in ("nominal", "compensated"))
    assert before["p997_mm"] > 0.6
    assert after["p997_mm"] < 0.33 * before["p997_mm"]


def test_the_program_turns_as_planned_and_is_read_again(proof: tuple[Path, dict[str, Any]], program: Path) -> None:
    """B and C carry the correction of the direction; read back, tip and direction are those of the plan."""
    out, _ = proof
    cell = in_working_plane(program, read_cell(CELL))
    text = (out / "compensated" / "tilted.ngc").read_text(encoding="ascii")
    tilts = np.array([float(word) for word in re.findall(r" B([0-9.]+)", text)])
    assert 1e-4 < np.abs(tilts[1:] - 15.0).max() < 0.2
    job = read_job(out / "compensated" / "tilted.ngc", cell)
    off = np.rad2deg(np.arccos(np.clip(job.path.axis_part[:, 2], -1.0, 1.0)))
    assert 0.005 < off.max() < 0.2


def test_the_plan_says_which_frame_it_is_in(proof: tuple[Path, dict[str, Any]]) -> None:
    stored = json.loads((proof[0] / "summary.json").read_text(encoding="utf-8"))
    tilt = np.deg2rad(15.0)
    np.testing.assert_allclose(np.array(stored["working_plane"])[:, 2], [-np.sin(tilt), 0.0, np.cos(tilt)], atol=1e-8)
    with pytest.raises(InputError, match=r"tilted tool cannot be run with online correction"):
        open_session(RunSettings(cell=CELL, plan=proof[0] / "plan.parquet"))


def test_the_same_cut_from_words_of_the_machine(program: Path) -> None:
    """Without G43.4 the words are those of the turned machine, and the path of the tool is the same."""
    cell = read_cell(CELL)
    seen = in_working_plane(program, cell)
    job = read_job(program, seen)
    assert job.words is not None
    assert job.words.machine is not None
    angle, off = np.deg2rad([[0.0, 15.0, 0.0]]), np.array([False])
    lines: list[tuple[str, dict[str, str]]] = []
    for line in TEXT.splitlines():
        values = dict(re.findall(r"([XYZ])([-0-9.]+)", line)) if re.match(r"G[01] [XYZ]", line) else {}
        place = {**(lines[-1][1] if lines else {}), **values}
        lines.append((line, place))
    text = []
    for line, place in lines:
        if re.match(r"G[01] [XYZ]", line):
            p = np.array([[float(place.get(letter, 0.0)) for letter in "XYZ"]]) * 1e-3
            x, y, z = job.words.machine.program_point(p, angle, off)[0] * 1e3
            feed = "".join(re.findall(r" F\d+", line))
            text.append(f"{line[:2]} X{x:.6f} Y{y:.6f} Z{z:.6f}{feed}")
        elif "G43.4" not in line:
            text.append(line)
    plain = program.parent / "plain.ngc"
    plain.write_text("\n".join(text) + "\n", encoding="ascii")
    other = read_job(plain, in_working_plane(plain, cell))
    ends = [np.flatnonzero(np.diff(path.motion, append=path.motion[-1] + 1)) for path in (job.path, other.path)]
    p, q = job.path.p_part_tcp[ends[0]], other.path.p_part_tcp[ends[1]]
    np.testing.assert_allclose(q[1:], p[1:], atol=2e-9)
    feeds = job.path.feed_m_s[ends[0]], other.path.feed_m_s[ends[1]]
    np.testing.assert_allclose(feeds[1], feeds[0], rtol=1e-6)


def test_robot_programs_are_in_the_part_frame(program: Path) -> None:
    """KRL poses stand in the part's frame: the points of the program, the tool leaning by 15 degrees."""
    result = compensate.compensate(program, read_cell(CELL), language="krl", predict=False)
    text = "".join(result.files.values())
    poses = re.findall(r"X ([-\d.]+),Y ([-\d.]+),Z ([-\d.]+),A ([-\d.]+),B ([-\d.]+),C ([-\d.]+)", text)
    assert poses
    values = np.array(poses, dtype=float)
    cut = values[np.abs(values[:, 2] - 34.0) < 1.0]
    assert len(cut) > 5
    np.testing.assert_allclose(cut[:, 0], 20.0, atol=1.5)
    a, b, c = np.deg2rad(cut[:, 3:].T)
    z = np.stack(
        [
            np.cos(a) * np.sin(b) * np.cos(c) + np.sin(a) * np.sin(c),
            np.sin(a) * np.sin(b) * np.cos(c) - np.cos(a) * np.sin(c),
            np.cos(b) * np.cos(c),
        ],
        axis=1,
    )
    tilt = np.deg2rad(15.0)
    np.testing.assert_allclose(-z, np.tile([-np.sin(tilt), 0.0, np.cos(tilt)], (len(z), 1)), atol=5e-3)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("G0 B15 C0", "G0 A15 B15", ("tilted.ngc:7:4", "no rotary axis A", "B C")),
        ("G0 B15 C0", "G0 B115 C0", ("tilted.ngc:7:4", "beyond its limits", "-110 to 110")),
    ],
)
def test_what_cannot_be_cut_is_refused_with_its_line(
    tmp_path: Path, old: str, new: str, expected: tuple[str, ...]
) -> None:
    file = tmp_path / "tilted.ngc"
    file.write_text(TEXT.replace(old, new), encoding="ascii")
    with pytest.raises(ProgramError) as fault:
        compensate.compensate(file, read_cell(CELL), predict=False)
    for piece in expected:
        assert piece in str(fault.value)


def test_other_commands_say_that_the_tool_is_tilted(program: Path) -> None:
    with pytest.raises(ProgramError, match=r"tilted\.ngc:11.*this command takes programs with the tool along z"):
        read_job(program, read_cell(CELL))


def test_the_tool_may_turn_in_the_air(program: Path) -> None:
    """Simultaneous motion off the blank, at a feed: planned with its turning, and written back as it was."""
    file = program.parent / "turning.ngc"
    turning = "G0 X20 Y-70 Z60 B0\nG1 Y-50 Z50 B15 F3000\nG0 Y-12\n"
    file.write_text(TEXT.replace("G0 X20 Y-12 Z60\n", turning).replace("G0 B15 C0", "G0 B0 C0"), encoding="ascii")
    cell = in_working_plane(file, read_cell(CELL))
    tilt = np.deg2rad(15.0)
    assert cell.R_part_plane is not None
    np.testing.assert_allclose(cell.R_part_plane[:, 2], [-np.sin(tilt), 0.0, np.cos(tilt)], atol=1e-12)
    result = compensate.compensate(file, read_cell(CELL), predict=False)
    assert "G1 Y-50 Z50 B15 F3000" in next(iter(result.files.values()))
    plan = result.plan
    turns = np.flatnonzero((plan.path.kind == 1) & (plan.path.axis_part[:, 2] < 0.999))
    assert len(turns) > 40
    assert not plan.volume_m3[turns].any()
    assert np.linalg.norm(np.diff(plan.q[turns], axis=0), axis=1).max() < np.deg2rad(1.0)
    late = TEXT.replace("G0 X20 Y-12 Z60\n", "G0 X20 Y10 Z60 B0\nG1 Z45 B15 F3000\n")
    file.write_text(late, encoding="ascii")
    over = in_working_plane(file, read_cell(CELL))  # there it may touch the blank
    assert over.tool_turns
    assert over.R_part_plane is None
    with pytest.raises(ProgramError, match=r"turning\.ngc:10: the tool cuts in another direction than in the original"):
        read_job(file, cell)

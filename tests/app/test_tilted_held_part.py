"""A tilted tool and a part in the hand: the same motion as an upright tool on a part that is clamped turned."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.app import preflight as checking
from counterflex.app.compensation.compensate import compensate
from counterflex.app.inputs import in_working_plane, read_job, setting_of
from counterflex.app.strategy import entry
from counterflex.app.strategy.entry_text import Moves
from counterflex.files.cell.cell import Cell, read_cell, resolve
from counterflex.geometry import rotation
from counterflex.plan.inputs import part_compliance, solve_joints

EXAMPLES = Path(__file__).parents[2] / "examples"
POINTS = np.array([[20, -12, 60], [20, -12, 42], [20, -12, 36], [20, 30, 36], [35, 40, 36], [35, 40, 60]], dtype=float)
MACHINE = (
    '\n[machine]\n[[machine.axes]]\nword = "B"\nmoves = "table"\ndirection = [0, 1, 0]\nz_mm = -80\nmin_deg = -110\n'
    'max_deg = 110\n[[machine.axes]]\nword = "C"\nmoves = "table"\ndirection = [0, 0, 1]\n'
)


def held(folder: Path) -> Cell:
    text = (EXAMPLES / "cells" / "kr300_held_part.toml").read_text(encoding="utf-8")
    text = text.replace("../", f"{EXAMPLES.as_posix()}/").replace("cell_mm = 0.2", "cell_mm = 0.5")
    (folder / "cell.toml").write_text(text + MACHINE, encoding="utf-8")
    return read_cell(folder / "cell.toml")


def program(folder: Path, points: np.ndarray, b_deg: float) -> Path:
    tilt = f"G0 B{b_deg} C0\nG43.4 H1\n" if b_deg else ""
    place = "X{:.6f} Y{:.6f} Z{:.6f}"
    words = [f"G0 {place}"] * 2 + [f"G1 {place} F1500"] * 3 + [f"G0 {place}"]
    lines = "\n".join(word.format(*p) for word, p in zip(words, points, strict=True))
    file = folder / f"b{b_deg:g}.ngc"
    file.write_text(f"G17 G21 G54 G90 G94\nM6 T1\nM3 S13000\n{tilt}{lines}\nM5\nM30\n", encoding="ascii")
    return file


@pytest.mark.parametrize("b_deg", [15.0, -40.0])
def test_it_moves_and_yields_as_a_part_that_is_clamped_turned(tmp_path: Path, b_deg: float) -> None:
    """Joint angles, and the compliance at the tip in axes of the hand, are the same in both."""
    cell = held(tmp_path)
    upright = program(tmp_path, POINTS, 0.0)
    probe = read_job(program(tmp_path, POINTS, b_deg), cell.with_turning_tool())
    axis = probe.path.axis_part[-1]
    R = rotation.to_zyx(np.eye(3)) * 0.0 + [0.0, np.arctan2(axis[0], axis[2]), 0.0]
    R_turned = rotation.from_zyx(R)
    tilted = program(tmp_path, POINTS @ R_turned.T, b_deg)
    T = cell.part.matrix()
    z, y, x = np.degrees(rotation.to_zyx(T[:3, :3] @ R_turned.T))
    part = cell.part.model_copy(update={"a_deg": float(z), "b_deg": float(y), "c_deg": float(x)})
    turned = resolve(cell.tables.model_copy(update={"part": part}), cell.path)
    found = []
    for file, one in ((upright, cell), (tilted, turned)):
        there = in_working_plane(file, one)
        job = read_job(file, there)
        setting = setting_of(there, job, part_may_be_held=True)
        path = job.machined
        q = solve_joints(path, path.motion, setting).q
        ends = np.flatnonzero(np.append(path.motion[1:] != path.motion[:-1], True))[-len(POINTS) :]
        found.append((q[ends], part_compliance(setting, setting.relative_motion(path), q)[ends]))
    np.testing.assert_allclose(found[1][0], found[0][0], atol=1e-6)
    both = np.kron(np.eye(2), R_turned)
    np.testing.assert_allclose(found[1][1], both @ found[0][1] @ both.T, rtol=1e-5, atol=1e-13)


def test_a_tilted_cut_is_planned_and_checked(tmp_path: Path) -> None:
    cell = held(tmp_path)
    file = EXAMPLES / "programs" / "tilted_groove.ngc"
    done = compensate(file, cell, predict=False)
    assert np.abs(done.plan.correction_part).max() > 1e-4
    rows = {row["check"]: row["verdict"] for row in checking.check(file, cell).summary["checks"]}
    assert "fail" not in rows.values()


def test_entries_of_a_part_in_the_hand_are_rewritten(tmp_path: Path) -> None:
    summary = entry.run(EXAMPLES / "programs" / "pocket_grooves.ngc", held(tmp_path).path, tmp_path / "out", Moves())
    assert [row["kind"] for row in summary["entries"]] == ["run-up", "run-up", "plunge"]
    assert (tmp_path / "out" / "pocket_grooves.ngc").exists()

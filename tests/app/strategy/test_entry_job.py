"""`plan entry`: the same part with less force where cuts begin, and less error on a simulated cell; what is kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.app.inputs import read_job
from counterflex.app.proof import simulate
from counterflex.app.proof.truth import truth_of
from counterflex.app.strategy.entry import differences, force_step, run
from counterflex.app.strategy.entry_text import Moves
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM
from counterflex.files.cell.cell import read_cell
from counterflex.twin.truth.family import FAMILIES

CELL = Path(__file__).parents[2] / "data" / "cells" / "small.toml"
HEAD = "G21 G17 G90 G94\nM6 T1\nG43 H1\nM3 S13000\nG0 Z60\n"
END = "G0 Z60\nM30\n"
PLUNGED = HEAD + "G0 X10 Y15\nG0 Z42\nG1 Z36 F600\nX50 F1500\n" + END
OVER_EDGE = HEAD + "G0 X-12 Y15\nG0 Z42\nG1 Z36 F600\nG1 X50 F1500\n" + END
WALL = "G0 X20 Y16\nG0 Z42\nG1 Z36 F600\nG1 X50 F1500\n"
POST = (
    HEAD
    + (
        "G0 X-3 Y15\nG0 Z42\nG1 Z36 F1500\nG1 X-1\nG2 X-1 Y15 I21\nG0 Z60\n"
        "G0 X-14 Y15\nG0 Z42\nG1 Z36 F600\nG1 X2 F1500\nG2 X2 Y15 I18 J0\n"
    )
    + END
)


def written(folder: Path, text: str) -> Path:
    (folder / "part.ngc").write_text(text, encoding="utf-8")
    return folder / "part.ngc"


def sideways_m(program: Path) -> float:
    cell = read_cell(CELL)
    record = simulate.machine(read_job(program, cell), cell, truth_of(cell, 1001, FAMILIES["wide"]))
    x, y = record.p_part_tcp[record.engaged, :2].T
    near = (x >= 10 * MM) & (x <= 26 * MM)
    return float(np.abs(y[near] - 15 * MM).max())


def test_a_plunged_slot_is_the_same_with_less_force_and_error(tmp_path: Path) -> None:
    source = written(tmp_path, PLUNGED)
    (row,) = run(source, CELL, tmp_path / "out", Moves())["entries"]
    assert row["kind"] == "plunge"
    assert row["peak_force_n"][1] < 0.6 * row["peak_force_n"][0]
    assert row["error_um"][1] < 0.7 * row["error_um"][0]
    soft, cell = tmp_path / "out" / "part.ngc", read_cell(CELL)
    before, after = (simulate.undisturbed(read_job(path, cell), cell) for path in (source, soft))
    np.testing.assert_allclose(after.z, before.z, atol=1e-6)
    assert "\nG1 X50 F1500\n" in soft.read_text(encoding="utf-8")  # it relied on the code of the line before
    assert sideways_m(soft) < 0.7 * sideways_m(source)


def test_a_cut_over_an_edge_is_come_to_in_its_own_direction(tmp_path: Path) -> None:
    """The run-up is that long in the air, and the tool is nearer to its path where the cut begins."""
    source = written(tmp_path, OVER_EDGE.replace("X-12", "X-8.2"))
    (row,) = run(source, CELL, tmp_path / "out", Moves())["entries"]
    assert (row["kind"], row["move"]) == ("run-up", "run-up of 10 mm")
    lines = (tmp_path / "out" / "part.ngc").read_text(encoding="utf-8").splitlines()
    at = lines.index("G1 X50 F1500")
    begin = float(lines[at - 3].split()[1][1:])
    assert lines[at - 1].startswith("G1 X-8.2")
    assert begin == pytest.approx(-18.0, abs=0.6)  # the cutter of 16 mm meets the blank at -8
    with pytest.raises(ProgramError, match="no entry or exit"):
        run(tmp_path / "out" / "part.ngc", CELL, tmp_path / "again", Moves())
    assert not (tmp_path / "again").exists()


def test_an_edge_is_sloped_where_asked_for(tmp_path: Path) -> None:
    source = written(tmp_path, OVER_EDGE)
    (row,) = run(source, CELL, tmp_path / "out", Moves(edges=True))["entries"]
    assert row["kind"] == "edge"
    assert row["peak_force_n"][1] < 0.7 * row["peak_force_n"][0]
    assert row["error_um"][1] < 0.7 * row["error_um"][0]


def test_a_line_straight_at_a_wall_becomes_an_arc(tmp_path: Path) -> None:
    rows = run(written(tmp_path, POST), CELL, tmp_path / "out", Moves())["entries"]
    row = next(row for row in rows if row["kind"] == "wall in")
    assert row["move"] == "arc of 8 mm, 90 deg"
    assert row["force_step_n_per_ms"][1] < 0.6 * row["force_step_n_per_ms"][0]
    assert row["peak_force_n"][1] < 0.8 * row["peak_force_n"][0]
    text = (tmp_path / "out" / "part.ngc").read_text(encoding="utf-8")
    assert "\nG3 X2.0000 Y15.0000 I0.0000 J8.0000 F1500.000\nG2 X2 Y15 I18 J0\n" in text


def test_an_arc_that_would_gouge_is_left_out(tmp_path: Path) -> None:
    slot = OVER_EDGE.replace("X-12", "X-20").removesuffix(END) + "G0 Z60\n"
    with pytest.raises(ProgramError, match="without changing the part.*would cut what the program leaves"):
        run(written(tmp_path, slot + WALL + END), CELL, tmp_path / "out", Moves())
    assert not (tmp_path / "out").exists()


def test_a_wall_is_compared_to_a_cell() -> None:
    before = np.zeros((9, 9))
    before[:, 4:] = 1.0
    shifted, gouged = np.roll(before, 1, axis=1), before.copy()
    shifted[:, 0] = 0.0
    gouged[4, 7] = 0.5
    assert not np.any(differences(before, shifted))
    deeper, higher = differences(before, gouged)
    assert deeper.sum() == 1
    assert deeper[4, 7]
    assert not higher.any()
    assert differences(gouged - 1.0, before)[1].any()


def test_the_force_step_is_that_of_a_ramp_and_of_a_jump() -> None:
    time_s = np.linspace(0.0, 1.0, 1001)
    force = np.zeros((1001, 3))
    force[:, 1] = 100.0 * time_s
    assert force_step(time_s, force) == pytest.approx(100.0, rel=0.02)
    force[:, 1] = np.where(time_s > 0.5, 80.0, 0.0)
    assert force_step(time_s, force) == pytest.approx(80.0 / 0.02, rel=0.02)  # 80 N within the window
    assert force_step(time_s[:1], force[:1]) == 0.0

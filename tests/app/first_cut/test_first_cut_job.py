"""The coupon is what its table says, and the job reads back what a cell does to it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.app.compensation.languages import write
from counterflex.app.first_cut import first_cut
from counterflex.app.first_cut.coupon import coupon
from counterflex.app.inputs import read_job, setting_of
from counterflex.app.prediction_interval import yield_sigma
from counterflex.app.proof import simulate
from counterflex.app.proof.judge import judge, reference_of
from counterflex.app.proof.simulate import undisturbed
from counterflex.app.proof.truth import truth_of
from counterflex.core import atomic
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.units import MM, MRAD
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.summary_file import read_summary
from counterflex.plan.compensate import plan as make_plan
from counterflex.robot.model.description import Play
from counterflex.twin.truth.family import FAMILIES
from counterflex.twin.truth.file import write_truth

CELL = Path(__file__).parents[3] / "examples" / "cells" / "kr300_d16_small.toml"
FEED_MM_MIN, RPM = 1500.0, 13000.0


def cell_with(tmp_path: Path, *changes: tuple[str, str]) -> Path:
    """The cell file with some of its text exchanged."""
    text = CELL.read_text(encoding="utf-8")
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    file = tmp_path / "cell.toml"
    file.write_text(text, encoding="utf-8")
    return file


@settings(max_examples=6)
@given(st.floats(10.0, 20.0), st.floats(0.0, 25.0), st.floats(0.1, 0.45))
def test_each_place_lies_on_a_face_that_the_program_makes(
    tmp_path_factory: pytest.TempPathFactory, diameter: float, more: float, depth: float
) -> None:
    """By the removal of material: it is cut on one side of a wall and stands on the other, and floors have their z."""
    folder, size = tmp_path_factory.mktemp("coupon"), 3.6 * diameter + more
    tool = ("diameter_mm = 16", f"diameter_mm = {diameter:.2f}")
    blank = ("box_max_mm = [60, 60, 40]", f"box_max_mm = [{size:.1f}, {size + 5.0:.1f}, 40]")
    cell = read_cell(cell_with(folder, tool, blank))
    made = coupon(cell, 1, feed_mm_min=FEED_MM_MIN, rpm=RPM, depth_mm=depth * diameter)
    program = folder / "coupon.ngc"
    program.write_text(made.text, encoding="ascii")
    part = undisturbed(read_job(program, cell), cell)
    x, y = part.x_m(), part.y_m()

    def height(p: tuple[float, float]) -> float:
        return float(part.z[np.argmin(np.abs(y - p[1])), np.argmin(np.abs(x - p[0]))])

    for one in made.places:
        px, py, pz = one.p_part
        if one.axis == 2:
            assert height((px, py)) == pytest.approx(pz, abs=1e-6)
            continue
        step = np.eye(2)[one.axis] * 0.4 * MM
        sides = sorted(height((px + s * step[0], py + s * step[1])) for s in (-1.0, 1.0))
        assert sides[0] < pz < sides[1]


def test_a_blank_too_small_or_a_ball_is_refused(tmp_path: Path) -> None:
    small = read_cell(cell_with(tmp_path, ("box_max_mm = [60, 60, 40]", "box_max_mm = [50, 60, 40]")))
    with pytest.raises(InputError, match="too small") as fault:
        coupon(small, 1, feed_mm_min=FEED_MM_MIN, rpm=RPM)
    assert "53 x" in str(fault.value)
    with pytest.raises(InputError, match="deeper than the flutes"):
        coupon(read_cell(CELL), 1, feed_mm_min=FEED_MM_MIN, rpm=RPM, depth_mm=20.0)


def test_a_part_that_the_robot_holds_is_refused_before_it_is_milled(tmp_path: Path) -> None:
    held = CELL.parent / "kr300_held_part.toml"
    with pytest.raises(InputError, match="needs a part that stands"):
        first_cut.propose(held, tmp_path / "coupon", tool=1, feed_mm_min=FEED_MM_MIN, rpm=RPM)
    assert not (tmp_path / "coupon").exists()


@pytest.mark.long
def test_axes_of_the_class_are_written_whether_they_bend_or_not(tmp_path: Path) -> None:
    """The new cell needs no class any more: each axis has a stiffness, what nothing shows is marked as assumed."""
    cell_file = CELL.parent / "irb6640_d16.toml"
    first_cut.propose(cell_file, tmp_path / "coupon", tool=1, feed_mm_min=FEED_MM_MIN, rpm=RPM)
    table = tmp_path / "coupon" / first_cut.TABLE
    header, *rows = table.read_text().splitlines()
    filled = [f"{row}{float(row.split(',')[6]) + 0.1:.3f}" for row in rows]
    table.write_text("\n".join([header, *filled, ""]))
    first_cut.run(tmp_path / "coupon" / first_cut.PROGRAM, cell_file, tmp_path / "out")
    new = read_cell(tmp_path / "out" / "cell.toml")
    assert new.unknown_axes == ()
    named = {value.name.partition(".")[0] for entry in new.tables.identified for value in entry.values}
    assert {f"axis{k}" for k in range(1, 7)} <= named


COARSE = ("cell_mm = 0.2", "cell_mm = 0.5")
"""Columns of the blank: the cell that measures and the one that learns cut the same ones."""


@pytest.fixture(scope="module")
def coarse(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The cell with a coarse blank."""
    return cell_with(tmp_path_factory.mktemp("coarse"), COARSE)


@pytest.fixture(scope="module")
def softer(coarse: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Cell]:
    """Coupon, its table filled in by a cell whose spindle is softer and whose material is harder, and that cell."""
    folder = tmp_path_factory.mktemp("first")
    first_cut.propose(coarse, folder / "coupon", tool=1, feed_mm_min=FEED_MM_MIN, rpm=RPM)
    program, table = folder / "coupon" / first_cut.PROGRAM, folder / "coupon" / first_cut.TABLE
    spindle = ("ry_urad_per_knm = 14925.0", "ry_urad_per_knm = 20000.0")
    changes = COARSE, spindle, ("kc11_n_mm2 = 780", "kc11_n_mm2 = 950")
    truth = read_cell(cell_with(folder, *changes))
    fill_in(table, program, truth)
    return program, table, truth


def fill_in(table: Path, program: Path, truth: Cell, play: tuple[Play | None, ...] | None = None) -> None:
    """Write the coordinates that a cell makes, with its own play or another."""
    job, chain = read_job(program, truth), truth.planning_chain
    setting = setting_of(truth, chain=chain if play is None else replace(chain, play=play))
    plan = make_plan(job.path, job.line_of_motion, truth.stock(), setting)
    places = first_cut._placed(first_cut._read(table, filled=False), plan, truth, 1e-6)
    off = plan.deviation_nominal_part[places.row, places.axis]
    rows = table.read_text().splitlines()
    filled = [f"{row}{float(row.split(',')[6]) + float(d) / MM:.4f}" for row, d in zip(rows[1:], off, strict=True)]
    table.write_text("\n".join([rows[0], *filled, ""]))


@pytest.mark.by_turn
@pytest.mark.parametrize("factor", [0.0, 3.0])
def test_what_axes_lose_is_found(coarse: Path, tmp_path: Path, factor: float) -> None:
    """A cell of the class but for play and friction: none on all axes, or three times as much on the first."""
    first_cut.propose(coarse, tmp_path / "coupon", tool=1, feed_mm_min=FEED_MM_MIN, rpm=RPM)
    program, table = tmp_path / "coupon" / first_cut.PROGRAM, tmp_path / "coupon" / first_cut.TABLE
    cell = read_cell(coarse)
    chain = cell.planning_chain
    play = tuple(
        Play(factor * one.half_band_rad, (factor * one.friction_nm[0],), one.slip_rad)
        if one is not None and (axis == 0 or factor == 0.0)
        else one
        for axis, one in enumerate(chain.play or ())
    )
    fill_in(table, program, cell, play)
    summary = first_cut.run(program, coarse, tmp_path / "out")
    values = read_cell(tmp_path / "out" / "cell.toml").tables.identified[-1].values
    found = {value.name: value for value in values if value.name.endswith(".lost")}
    soft = chain.compliance[chain.torsion, 5]
    assert len(found) == 6
    for axis, one in enumerate(play):
        assert one is not None
        true_mrad = (one.half_band_rad + soft[axis] * sum(one.friction_nm)) / MRAD
        value = found[f"axis{axis + 1}.lost"]
        assert abs(value.value - true_mrad) < 2.5 * value.sigma
    assert summary["left_rms_um"] < summary["planned_rms_um"] / 3.0


def deflections(cell: Cell, program: Path) -> np.ndarray:
    job = read_job(program, cell)
    setting = replace(setting_of(cell), swing_m=0.0)
    plan = make_plan(job.path, job.line_of_motion, cell.stock(), setting, predict=False)
    return plan.deflection_part[:, :3]


@pytest.mark.long
def test_the_new_cell_bends_as_the_measured_one(softer: tuple[Path, Path, Cell], coarse: Path, tmp_path: Path) -> None:
    """Of what the file before is off, less than a third is left: what faces have in common is believed to 6 %."""
    program, _, truth = softer
    summary = first_cut.run(program, coarse, tmp_path / "out")
    known, new = deflections(truth, program), deflections(read_cell(tmp_path / "out" / "cell.toml"), program)
    before = deflections(read_cell(coarse), program)
    size = np.sqrt(np.mean(known**2))
    off = np.sqrt(np.mean((before - known) ** 2))
    assert off > 0.15 * size
    assert np.sqrt(np.mean((new - known) ** 2)) < off / 3.0
    assert summary["left_out_rms_um"] < 0.5 * summary["planned_rms_um"]
    assert summary["far_places"] == []
    assert 0.0 < yield_sigma(read_cell(tmp_path / "out" / "cell.toml")) < yield_sigma(read_cell(coarse))
    assert read_summary(tmp_path / "out" / "summary.json")["places"] == summary["places"]


def test_bad_rows_are_refused_by_their_line(softer: tuple[Path, Path, Cell], coarse: Path, tmp_path: Path) -> None:
    program, table, _ = softer
    rows = table.read_text().splitlines()

    def refused(change: dict[int, str], match: str) -> str:
        bad = tmp_path / "bad.csv"
        bad.write_text("\n".join(change.get(k, row) for k, row in enumerate(rows)) + "\n")
        with pytest.raises((FileFormatError, InputError), match=match) as fault:
            first_cut.run(program, coarse, tmp_path / "out", measured=bad)
        assert not (tmp_path / "out").exists()
        return str(fault.value)

    cells = rows[4].split(",")
    assert "bad.csv:5" in refused({4: ",".join([*cells[:7], f"{float(cells[6]) + 10.0}"])}, "farther from its nominal")
    assert "bad.csv:5" in refused({4: ",".join([*cells[:2], "w", *cells[3:]])}, "no axis")
    assert "bad.csv:5" in refused({4: ",".join([*cells[:7], "3,1,1"])}, "cells")
    elsewhere = [*cells[:3], "30", "30", *cells[5:6], "30", "30.1"]
    assert "bad.csv:5" in refused({4: ",".join(elsewhere)}, "no cut of the program")
    assert "nominal_mm" in refused({4: ",".join([*cells[:6], "30", "30.1"])}, "not that of the place")
    assert "measured_mm" in refused({0: rows[0].replace("measured_mm", "measured")}, "other columns")
    assert "line 4" in refused({4: rows[3]}, "the same place twice")
    refused({k: ",".join([*row.split(",")[:7], ""]) for k, row in enumerate(rows) if k > 8}, "too few")


@pytest.mark.long
def test_a_simulated_coupon_teaches_its_cell(tmp_path: Path) -> None:
    """The faces are met, and the plateau of another program keeps less of its error."""
    first_cut.propose(CELL, tmp_path / "coupon", tool=1, feed_mm_min=FEED_MM_MIN, rpm=RPM)
    program, groove = tmp_path / "coupon" / first_cut.PROGRAM, CELL.parents[1] / "programs" / "groove.ngc"
    cell = read_cell(CELL)
    truth = truth_of(cell, 6, FAMILIES["wide"])
    write_truth(tmp_path / "truth.toml", truth)
    simulate.run(program, CELL, tmp_path / "truth.toml", tmp_path / "part")
    summary = first_cut.run(program, CELL, tmp_path / "out", part=tmp_path / "part")
    assert summary["left_rms_um"] < 0.5 * summary["planned_rms_um"]
    job, left = read_job(groove, cell), []
    for known in (cell, read_cell(tmp_path / "out" / "cell.toml")):
        plan = make_plan(job.path, job.line_of_motion, known.stock(), setting_of(known), predict=False)
        atomic.write_text(tmp_path / groove.name, write(job, plan, known, "gcode")[0][groove.name])
        record = simulate.machine(read_job(tmp_path / groove.name, cell), cell, truth)
        left.append(judge(reference_of(job, cell), record, record.stock).variant.path.plateau.p997_m)
    assert left[1] < 0.7 * left[0]

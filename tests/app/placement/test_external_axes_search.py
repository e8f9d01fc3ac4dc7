"""External axes as a further freedom of the place: a rail and a positioner, through files."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.coarse_bodies import coarse_bodies
from counterflex.app.compensation.compensate import compensate
from counterflex.app.inputs import AS_IT_IS, read_job
from counterflex.app.placement import placement
from counterflex.app.placement.region import ProgramInCell, Wish
from counterflex.cli.arguments import region
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import read_cell

SOURCE = Path(__file__).parents[2] / "data" / "cells" / "small.toml"
SHORT = "G21 G17 G90\nM6 T1\nM3 S13000\nG0 X-12 Y15 Z42\nG0 Z38\nG1 X8 F1500\nG0 Z42\nM5\nM2\n"
RAIL = (
    '\n[[external_axes]]\nname = "E1"\nkind = "linear"\ncarries = "robot"\ndirection = [0, 1, 0]\nat_mm = 100\n'
    "min_mm = -400\nmax_mm = 500\n"
)
TABLE = (
    '\n[[external_axes]]\nname = "E2"\nkind = "turning"\ncarries = "part"\ndirection = [0, 0, 1]\n'
    "origin_mm = [1500, 200, 0]\nat_deg = 0\nmin_deg = -90\nmax_deg = 90\n"
)
FENCE = '\n[[cell.body]]\nname = "fence"\nshape = "box"\nx_mm = -1500\nsize_mm = [20, 4000, 2000]\n'


def written(folder: Path, text: str = RAIL + TABLE + FENCE) -> tuple[Path, Path]:
    (folder / "part.ngc").write_text(SHORT, encoding="ascii")
    (folder / "cell.toml").write_text(SOURCE.read_text(encoding="utf-8") + text, encoding="utf-8")
    return folder / "part.ngc", folder / "cell.toml"


@pytest.mark.long
def test_values_are_chosen_and_everything_follows(tmp_path: Path) -> None:
    """The part stays where it is clamped; the chosen values stand in the cell file and in the KRL program."""
    program, file = written(tmp_path)
    summary = placement.run(program, file, tmp_path / "out", count=64)
    before, after = read_cell(file), read_cell(tmp_path / "out" / "cell.toml")
    values = {axis.name: axis.shown for axis in after.tables.external_axes}
    assert values == {name: summary["chosen"][name] for name in ("E1", "E2")}
    assert -400.0 <= values["E1"] <= 500.0
    assert -90.0 <= values["E2"] <= 90.0
    assert values != {axis.name: axis.shown for axis in before.tables.external_axes}
    assert after.part.matrix() == pytest.approx(before.part.matrix(), abs=1e-12)
    assert summary["chosen"]["error_um"] < summary["present"]["error_um"]
    rows = list(csv.DictReader((tmp_path / "out" / placement.TABLE).read_text().splitlines()))
    assert {"E1_mm", "E2_deg"} <= set(rows[0])
    assert np.ptp([float(row["E1_mm"]) for row in rows]) > 500.0
    krl = compensate(program, after, predict=False, language="krl").files
    start = next(line for text in krl.values() for line in text.splitlines() if "XSTART={" in line)
    assert f"E1 {values['E1']:g}" in start


def test_a_candidate_is_seen_as_the_cell_file_with_its_values(tmp_path: Path) -> None:
    """Frame of the program and bodies on the floor are those of a cell that is read anew."""
    program, file = written(tmp_path)
    _, cell, task = placement.task_of(program, read_cell(file), AS_IT_IS, "both")
    frame = ProgramInCell(cell, task.middle_of_cut)
    place = frame.here.copy()
    np.testing.assert_allclose(frame.seen(place).T_base_standing, cell.T_base_part, atol=1e-12)
    place[4:] = [-300.0 * MM, 25.0 * DEG]
    text = file.read_text(encoding="utf-8").replace("at_mm = 100", "at_mm = -300").replace("at_deg = 0", "at_deg = 25")
    (tmp_path / "there.toml").write_text(text, encoding="utf-8")
    there, seen = read_cell(tmp_path / "there.toml"), frame.at(frame.stand(place))
    np.testing.assert_allclose(seen.T_base_standing, there.T_base_part, atol=1e-12)
    assert task.around is not None
    assert seen.T_base_before is not None
    moved = {body.name: body.T_frame_body for body in task.around.seen_from(seen.T_base_before).bodies}
    for body in coarse_bodies(read_job(program, there), there, there.stock()):
        np.testing.assert_allclose(moved[body.name], body.T_frame_body, atol=1e-9)


@pytest.mark.parametrize(
    ("axes", "told"),
    [
        ({"E5": (0.0, 1.0)}, "no such external axis.*E5.*E1, E2"),
        ({"E1": (0.0, 900.0)}, "E1 cannot go so far.*0 to 900 mm.*-400 to 500 mm"),
        ({"E2": (30.0, -30.0)}, "empty along E2.*30 to -30"),
    ],
)
def test_values_that_an_axis_cannot_have_are_refused(
    tmp_path: Path, axes: dict[str, tuple[float, float]], told: str
) -> None:
    program, file = written(tmp_path)
    with pytest.raises(InputError, match=told):
        placement.run(program, file, tmp_path / "out", wish=Wish(axes=axes))
    assert not (tmp_path / "out").exists()


def test_an_axis_that_is_not_named_stands_still(tmp_path: Path) -> None:
    program, file = written(tmp_path)
    cell = read_cell(file)
    some = Wish(axes={"E2": (-10.0, 10.0)}).region(ProgramInCell(cell, np.zeros(3)))
    assert (some.low[4], some.high[4]) == pytest.approx((0.1, 0.1))
    assert (some.low[5], some.high[5]) == pytest.approx((-10.0 * DEG, 10.0 * DEG))
    assert program.exists()


def test_a_region_is_read_with_axes() -> None:
    assert region(["1,2,3,4,5,6", "E1=0,2000"], "--region") == ((1, 2, 3, 4, 5, 6), {"E1": (0.0, 2000.0)})
    for words in (["E1=1"], ["1,2"], ["E1=0,1", "E1=2,3"], ["E1=a,b"]):
        with pytest.raises(InputError, match="--region"):
            region(words, "--region")

"""A place of the external axes for each operation: against all ways of small cases, and against one place for all."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from counterflex.app import preflight as checking
from counterflex.app.compensation.compensate import compensate
from counterflex.app.inputs import AS_IT_IS, read_job
from counterflex.app.placement import operations_job, placement
from counterflex.app.placement.operations import per_operation
from counterflex.app.placement.region import Wish
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.files.cell.cell import read_cell
from counterflex.files.cell.set_up import text_with_place
from counterflex.plan.placement.operations import cheapest_places, operations_of, sites_of

EXAMPLES = Path(__file__).parents[3] / "examples"
RAIL = (
    '\n[[external_axes]]\nname = "E1"\nkind = "linear"\ncarries = "robot"\ndirection = [0, 1, 0]\nat_mm = 500\n'
    "min_mm = -1500\nmax_mm = 2500\ncoupled = true\n"
)
CUT = "G0 X-12 Y{y}\nG0 Z42\nG1 Z37 F3000\nG1 X10 F1500\nG0 Z80\n"
PROGRAM = "G17 G21 G90 G94\nM6 T1\nM3 S13000\nG0 Z80\n" + "".join(CUT.format(y=y) for y in (40, 1000)) + "M5\nM30\n"


def files(folder: Path, program: str = PROGRAM, length: int = 1040, rail: str = RAIL) -> tuple[Path, Path]:
    """A long plate on a robot that rides along it."""
    text = (EXAMPLES / "cells" / "kr300_d16_small.toml").read_text(encoding="utf-8")
    text = text.replace("../", f"{EXAMPLES.as_posix()}/").replace(
        "max_mm = [60, 60, 40]", f"max_mm = [60, {length}, 40]"
    )
    (folder / "cell.toml").write_text(text.replace("cell_mm = 0.2", "cell_mm = 2") + rail, encoding="utf-8")
    (folder / "part.ngc").write_text(program, encoding="ascii")
    return folder / "part.ngc", folder / "cell.toml"


@pytest.mark.parametrize("seed", range(40))
def test_the_cheapest_way_is_that_of_all_ways(seed: int) -> None:
    draw = np.random.default_rng(seed)
    n, k = int(draw.integers(1, 5)), int(draw.integers(1, 5))
    costs = draw.uniform(size=(n, k))
    costs[draw.uniform(size=costs.shape) < 0.15] = np.inf
    allowed, move = draw.uniform(size=(n - 1, k, k)) < 0.7, float(draw.uniform(0.0, 0.5))

    def total(way: tuple[int, ...]) -> float:
        moves = [
            0.0 if a == b else move if allowed[i, a, b] else np.inf for i, (a, b) in enumerate(itertools.pairwise(way))
        ]
        return float(sum(costs[i, place] for i, place in enumerate(way)) + sum(moves))

    best = min(total(way) for way in itertools.product(range(k), repeat=n))
    found = cheapest_places(costs, allowed, move)
    assert (found is None) == (not np.isfinite(best))
    if found is not None:
        assert total(tuple(found.tolist())) == pytest.approx(best)


@pytest.mark.long
def test_each_operation_stands_where_it_costs_least(tmp_path: Path) -> None:
    """Against every pair of 33 places of the two operations in the posture that was chosen, by the same errors.

    The program that is written has these values, and passes preflight.
    """
    program, file = files(tmp_path)
    given = placement.prepared(program, read_cell(file), AS_IT_IS, "both")
    done = per_operation(
        program, given, Wish().region(given.frame),
        reading=AS_IT_IS, one=None, least_damping=-np.inf,
    )  # fmt: skip
    rows, whole = done.summary["operations"], done.summary["per_operation"]
    operations = operations_of(given.task.path, given.task.cut.weight_m, float(given.cell.stock().z.max()), 20.0 * MM)
    sites = sites_of(given.task, operations, given.stretches)
    errors = np.empty((2, 33))
    for (number, site), (k, value) in itertools.product(enumerate(sites), enumerate(np.linspace(-1.5, 2.5, 33))):
        place = given.frame.here.copy()
        place[4] = value
        errors[number, k] = site.held(given.frame.seen(place), done.branch, done.rotation_rad)[0]
    lengths = np.array([site.length_m for site in sites])

    def mean(of: np.ndarray) -> float:
        return float((lengths @ of**4 / lengths.sum()) ** 0.25)

    assert whole["error_um"] * 1e-6 <= 1.005 * mean(errors.min(axis=1))
    assert whole["error_um"] * 1e-6 < 0.97 * min(mean(column) for column in errors.T)
    assert whole["moves"] == 1
    cell = done.placed_cell(given.cell)
    axis = cell.tables.external_axes[0]
    assert [axis.shown, axis.moves[0][2]] == [row["E1"] for row in rows]
    written = compensate(program, cell, predict=False, language="krl")
    for name, text in written.files.items():
        (tmp_path / name).write_text(text)
    checks = checking.check(tmp_path / "part.src", cell).summary["checks"]
    assert not [row for row in checks if row["verdict"] == "fail"]
    assert read_job(tmp_path / "part.src", cell, may_move=True).places is not None


@pytest.mark.long
def test_a_program_that_no_single_place_reaches(tmp_path: Path) -> None:
    """The two ends of the plate are 5 m apart."""
    long = RAIL.replace("-1500", "-3000").replace("2500", "7500").replace("at_mm = 500", "at_mm = 0")
    program, file = files(tmp_path, PROGRAM.replace("Y1000", "Y5000"), 5040, long)
    summary = operations_job.run(program, file, tmp_path / "out", count=64)
    assert summary["chosen"] is None
    assert "out of reach" in summary["one_place_refused"]
    first, last = (row["E1"] for row in summary["operations"])
    assert last - first > 2000.0
    checks = checking.check(program, read_cell(tmp_path / "out" / "cell.toml")).summary["checks"]
    assert not [row for row in checks if row["verdict"] == "fail"]


def test_what_cannot_be_divided_is_refused(tmp_path: Path) -> None:
    program, file = files(tmp_path, PROGRAM.replace("G0 Z80", "G0 Z45"))
    with pytest.raises(InputError, match=r"one operation.*clearance_mm = 20"):
        operations_job.run(program, file, tmp_path / "out", count=64)
    program, file = files(tmp_path, rail="")
    with pytest.raises(InputError, match="no \\[\\[external_axes\\]\\]"):
        operations_job.run(program, file, tmp_path / "out", count=64)
    assert not (tmp_path / "out").exists()


def test_moves_of_before_are_taken_out_where_one_place_is_chosen(tmp_path: Path) -> None:
    program, file = files(tmp_path)
    moved = "moves_mm = [[106, 1066.253, 900]]\nmoves_at_mm = [[-12, 1000, 80]]\n"
    file.write_text(file.read_text() + moved)
    assert read_job(program, read_cell(file), may_move=True).places is not None
    text = text_with_place(file, {}, "front up noflip", 0.0, tmp_path, None, {"E1": 300.0})
    file.write_text(text)
    assert read_cell(file).tables.external_axes[0].moves == ()
    assert placement.prepared(program, read_cell(file), AS_IT_IS, "both").job.places is None

"""Laws of quoted probabilities: of shares of draws, and of parts that drawn errors of the path leave."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.inputs import read_job, setting_of
from counterflex.app.prediction_interval import foreseen
from counterflex.app.proof.judge import reference_of
from counterflex.app.quote.path_errors import PathErrors, doubts, path_errors, points_of
from counterflex.app.quote.probability import DrawnFeature, QuotedPart, Share
from counterflex.app.quote.remedies import TRACKED, repeated, tracked
from counterflex.core.errors import InputError
from counterflex.core.units import MM, UM
from counterflex.evaluate.feature_finding import Groove
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.plan.compensate import plan as make_plan
from counterflex.plan.plan import Plan

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
NAME = "groove.ngc"


@pytest.fixture(scope="module")
def cell() -> Cell:
    return read_cell(EXAMPLES / "cells/kr300_d16_small.toml")


@pytest.fixture(scope="module")
def drawing(cell: Cell) -> QuotedPart:
    job = read_job(EXAMPLES / "programs" / NAME, cell)
    surface = reference_of(job, cell).surface
    assert surface is not None
    return QuotedPart(job, cell, surface)


@pytest.fixture(scope="module")
def plan(drawing: QuotedPart, cell: Cell) -> Plan:
    job = drawing.job
    return make_plan(job.path, job.line_of_motion, cell.stock(), setting_of(cell), feeds=job.feeds)


@pytest.fixture(scope="module")
def errors(plan: Plan, cell: Cell) -> PathErrors:
    return path_errors(plan, cell, points_of(plan, cell, NAME))


def feature(off_m: np.ndarray, tolerance_m: float) -> DrawnFeature:
    return DrawnFeature("groove 1", "width", 16.0 * MM, tolerance_m, "given", off_m)


def test_gaussian_deviations_are_held_as_the_error_function_says() -> None:
    off = 0.05 * MM + 0.1 * MM * np.random.default_rng(1).standard_normal(20_000)
    for tolerance in (0.02, 0.1, 0.25):
        held = feature(off, tolerance * MM).held()
        true = 0.5 * (
            math.erf((tolerance - 0.05) / 0.1 / math.sqrt(2)) + math.erf((tolerance + 0.05) / 0.1 / math.sqrt(2))
        )
        sigma = math.sqrt(true * (1.0 - true) / len(off))
        assert abs(held.probability - true) < 4.0 * sigma


def test_it_rises_with_the_tolerance_and_falls_with_the_doubt() -> None:
    off = 0.1 * MM * np.random.default_rng(2).standard_normal(500)
    by_tolerance = [feature(off, t * MM).held().probability for t in (0.01, 0.05, 0.1, 0.2, 0.5)]
    by_doubt = [feature(s * off, 0.1 * MM).held().probability for s in (0.2, 0.5, 1.0, 2.0, 5.0)]
    assert by_tolerance == sorted(by_tolerance)
    assert by_doubt == sorted(by_doubt, reverse=True)


def test_no_number_of_draws_makes_it_certain() -> None:
    never, always = Share(0, 400), Share(400, 400)
    assert never.probability == pytest.approx(0.5 / 401.0)
    assert always.probability == pytest.approx(1.0 - never.probability)
    assert 0.0 < never.interval[0] < never.interval[1] < 0.01
    # ten times the draws leave about a root of ten less open
    wide, narrow = (np.ptp(Share(n // 2, n).interval) for n in (100, 1000))
    assert wide / narrow == pytest.approx(math.sqrt(10.0), rel=0.02)


def test_a_shifted_path_shifts_walls_and_floor_by_as_much(drawing: QuotedPart, errors: PathErrors) -> None:
    shift = np.array([[0.03, 0.04, -0.05], [0.0, 0.0, 0.0], [0.0, -0.1, 0.2]]) * MM
    moved = replace(errors, error_m=np.tile(shift[:, None], (1, len(errors.nodes), 1)))
    off = {one.quantity: one.off_m for one in drawing.quoted(moved).features}
    groove = drawing.features[0]
    assert isinstance(groove, Groove)
    run = (groove.end - groove.start)[:2] / np.linalg.norm((groove.end - groove.start)[:2])
    aside = shift[:, :2] @ np.array([-run[1], run[0]])
    assert np.allclose(off["wall left"], aside, atol=0.1 * UM)
    assert np.allclose(off["wall right"], -aside, atol=0.1 * UM)
    assert np.allclose(off["width"], 0.0, atol=0.1 * UM)
    assert np.allclose(off["depth"], -shift[:, 2], atol=0.1 * UM)
    assert np.allclose(off["flatness"], 0.0, atol=0.1 * UM)


def test_the_draws_are_those_of_the_interval(plan: Plan, cell: Cell, errors: PathErrors) -> None:
    # at the nodes in the cut the size across the feed has the distribution that the plan's interval is of
    found = foreseen(plan, cell)
    assert found is not None
    rows = errors.nodes.row
    step = np.diff(plan.path.p_part_tcp, axis=0, prepend=plan.path.p_part_tcp[:1])[rows]
    feed = step / np.maximum(np.linalg.norm(step, axis=1), 1e-12)[:, None]
    own = np.flatnonzero(plan.judged[rows])
    error = errors.error_m[:, own]
    along = np.sum(error * feed[own], axis=2, keepdims=True) * feed[own]
    size = np.quantile(np.linalg.norm(error - along, axis=2), 0.997, axis=1)
    median, low, high = np.quantile(size, [0.5, 0.05, 0.95])
    # nodes are 0.5 mm apart and the interval is taken row by row: peaks at entries differ by a few per cent
    assert median == pytest.approx(found.compensated.median_m, rel=0.1)
    assert low == pytest.approx(found.compensated.low_m, rel=0.1)
    assert high == pytest.approx(found.compensated.high_m, rel=0.1)


def test_less_doubt_of_the_force_leaves_less_scatter(plan: Plan, cell: Cell, errors: PathErrors) -> None:
    points = points_of(plan, cell, NAME)
    less = path_errors(plan, cell, points, kept={"cutting": 0.1})
    assert np.mean(np.var(less.error_m, axis=0)) < 0.5 * np.mean(np.var(errors.error_m, axis=0))
    found = doubts(cell, points)
    assert found["cutting"] > found["stiffness"] > 0.0


def test_a_tolerance_of_what_is_not_cut_or_not_drawn_is_not_looked_at(drawing: QuotedPart, errors: PathErrors) -> None:
    given = {("groove 1", "depth"): 0.1 * MM, ("bore 7", "diameter"): 0.1 * MM, ("groove 1", "roughness"): 0.01 * MM}
    found = replace(drawing, tolerances_m=given).quoted(errors.first(20))
    assert dict(found.not_looked_at) == {
        "diameter of bore 7": "the program cuts no such feature",
        "roughness of groove 1": "no draw informs a tolerance of this kind",
    }
    assert not {"bore 7"} & {one.feature for one in found.features}
    assert next(one for one in found.features if one.quantity == "depth").tolerance_m == 0.1 * MM
    with pytest.raises(InputError, match="none of the tolerances is of what the program makes"):
        replace(drawing, tolerances_m={("bore 7", "diameter"): 0.1 * MM}).quoted(errors.first(20))


def test_all_hold_no_more_often_than_the_one_that_holds_least(drawing: QuotedPart, errors: PathErrors) -> None:
    found = drawing.quoted(errors.first(100))
    each = [one.held().held for one in found.features]
    assert sum(each) - 100 * (len(each) - 1) <= found.all_held.held <= min(each)


def test_a_tracker_takes_back_what_lasts_and_leaves_what_is_quick(errors: PathErrors) -> None:
    few = errors.first(2)
    lasting = replace(few, error_m=np.full_like(few.error_m, 0.1 * MM))
    left = tracked(lasting)
    begins = np.flatnonzero(np.diff(few.nodes.chain, prepend=-1))
    assert np.allclose(left[:, begins], 0.1 * MM)
    seconds = np.ptp(few.plan.path.time_s[few.nodes.row[few.nodes.chain == few.nodes.chain[-1]]])
    if seconds > 1.0:
        assert np.allclose(left[:, -1], TRACKED * 0.1 * MM, rtol=0.05)
    assert np.all(np.abs(left) <= 0.1 * MM)


def test_a_repeated_path_is_the_path_twice(drawing: QuotedPart) -> None:
    path = drawing.job.path
    twice = repeated(path)
    assert len(twice) == 2 * len(path)
    assert np.array_equal(twice.p_part_tcp[len(path) :], path.p_part_tcp)
    assert np.all(np.diff(twice.time_s) >= 0.0)
    assert twice.kind[len(path)] == 0

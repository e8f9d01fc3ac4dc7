"""Arcs of engagement in stability: continuous in the radial width, against the circle in closed form."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM
from counterflex.cutting.coefficients import KienzleLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stability import lobes
from counterflex.cutting.stability.modes import TipModes
from counterflex.cutting.stability.process import process_of_side_cut
from counterflex.cutting.stock import BlankBox, HeightMap
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.stability.criterion import robot_limit
from counterflex.plan.stability.stretches import Stretch, stretches_of

LOW, HIGH = np.array([0.0, 0.0, -0.02]), np.array([0.06, 0.03, 0.0])
CELL_M = 0.5 * MM
SPINDLE = 6000.0 / 60.0 * 2.0 * np.pi
FLAT = Cutter(0.016, flutes=3, flute_length_m=0.035)
BULL = Cutter(0.016, 0.003, flutes=3, flute_length_m=0.035)
ROBOT = TipModes(
    2.0 * np.pi * np.array([9.0, 10.5, 15.0, 33.0, 49.0]),
    np.full(5, 0.1),
    np.array([[0.05, 0.02, -0.03, 0.04, 0.02], [0.02, 0.06, 0.03, -0.05, 0.06], [0.03, -0.02, 0.05, 0.03, 0.01]]),
)


def _path(tips: Float, axis: Float) -> ToolPath:
    n = len(tips)
    step = np.linalg.norm(np.diff(tips, axis=0, prepend=tips[:1]), axis=1)
    return ToolPath(
        tips, np.tile(axis, (n, 1)), np.full(n, FEED), np.full(n, 0.015), np.full(n, SPINDLE), np.cumsum(step / 0.015),
        np.zeros(n, dtype=np.int64), np.ones(n, dtype=np.int64),
    )  # fmt: skip


def _stretches(tips: Float, cutter: Cutter, axis: Float, exact: bool = True) -> list[Stretch]:
    block = BlankBox(LOW, HIGH, np.eye(3))
    stock = HeightMap.from_box(tuple(LOW.tolist()), tuple(HIGH.tolist()), CELL_M)
    return stretches_of(_path(tips, axis), stock, lambda _: cutter, block if exact else None)


def _line(start: Float, end: Float) -> Float:
    return start + np.linspace(0.0, 1.0, 161)[:, None] * (end - start)


def _limit(piece: Stretch, law: KienzleLaw) -> float:
    R = piece.R_part_feed
    return robot_limit(ROBOT, R @ piece.process(law, 3).mean @ R.T, piece.period_s).factor


UP = np.array([0.0, 0.0, 1.0])


@pytest.mark.long
@pytest.mark.parametrize("cutter", [FLAT, BULL], ids=["flat", "bull"])
def test_limits_follow_the_radial_width_within_one_percent(cutter: Cutter, law: KienzleLaw) -> None:
    rng = np.random.default_rng(7)
    for ae in np.concatenate([rng.uniform(0.05, 1.0, 8), rng.uniform(1.0, 15.9, 8)]) * MM:
        for up in (True, False):
            # the blank lies at y > 0: towards +x it is on the left of the feed
            start, end = np.array([-0.012, ae - 0.008, -0.006]), np.array([0.072, ae - 0.008, -0.006])
            pieces = _stretches(_line(start, end) if up else _line(end, start), cutter, UP)
            inside = [piece for piece in pieces if 0.01 < _line(start, end)[piece.row, 0] < 0.05]
            immersion = float(np.arccos(1.0 - ae / 0.008))
            arc = (0.0, immersion) if up else (np.pi - immersion, np.pi)
            feed = inside[0].feed_per_tooth_m
            expected = process_of_side_cut(cutter, law, *arc, 0.006, feed)
            found = inside[len(inside) // 2].process(law, 3)
            if cutter.is_flat:  # the corner of a bull nose meets less of the width
                np.testing.assert_allclose(found.mean, expected.mean, atol=0.01 * np.abs(expected.mean).max())
                R = inside[0].R_part_feed
                limit = robot_limit(ROBOT, R @ expected.mean @ R.T, inside[0].period_s).factor
                assert _limit(inside[len(inside) // 2], law) == pytest.approx(limit, rel=0.01)
            values = np.array([_limit(piece, law) for piece in inside])
            np.testing.assert_allclose(values, values[0], rtol=0.01)  # all along the wall the same


def test_the_second_pass_meets_what_the_first_left(law: KienzleLaw) -> None:
    first = _line(np.array([-0.012, -0.003, -0.006]), np.array([0.072, -0.003, -0.006]))
    back = _line(np.array([0.072, -0.013, -0.006]), np.array([-0.012, -0.013, -0.006]))
    second = _line(np.array([-0.012, -0.003 + 0.00037, -0.006]), np.array([0.072, -0.003 + 0.00037, -0.006]))
    tips = np.concatenate([first, back, second])
    pieces = [p for p in _stretches(tips, FLAT, UP) if p.row > 330 and 0.01 < tips[p.row, 0] < 0.05]
    assert len(pieces) > 10
    immersion = float(np.arccos(1.0 - 0.00037 / 0.008))
    for piece in pieces:
        expected = process_of_side_cut(FLAT, law, 0.0, immersion, 0.006, piece.feed_per_tooth_m)
        np.testing.assert_allclose(piece.process(law, 3).mean, expected.mean, atol=0.01 * np.abs(expected.mean).max())


def test_cells_are_off_by_more_where_the_cut_is_thin(law: KienzleLaw) -> None:
    """What the closed forms are for: booked on cells of 0.5 mm the same walls are off by more than 5 %."""
    worst = 0.0
    for ae in (0.6 * MM, 0.7 * MM, 0.9 * MM):
        tips = _line(np.array([-0.012, ae - 0.008, -0.006]), np.array([0.072, ae - 0.008, -0.006]))
        pair = [_stretches(tips, FLAT, UP, exact) for exact in (True, False)]
        values = [np.median([_limit(p, law) for p in some if 0.01 < tips[p.row, 0] < 0.05]) for some in pair]
        worst = max(worst, abs(values[1] / values[0] - 1.0))
    assert worst > 0.05


def test_a_tilted_tool_meets_what_an_upright_one_meets_in_a_tilted_blank(law: KienzleLaw) -> None:
    """A tool that leans about its feed in a deep block: the slot's own half circle, at the depth along the axis."""
    lean = 20.0 * DEG
    axis = np.array([0.0, np.sin(lean), np.cos(lean)])
    tips = _line(np.array([-0.015, 0.015, -0.008]), np.array([0.075, 0.015, -0.008]))
    pieces = [p for p in _stretches(tips, FLAT, axis) if 0.015 < tips[p.row, 0] < 0.045]
    assert len(pieces) > 5
    for piece in pieces:
        np.testing.assert_allclose(piece.axis_part, axis)
        assert float(piece.direction_part @ axis) == pytest.approx(0.0, abs=1e-12)
        # at the angle phi the flank stands R cos(phi) beside the path: the top is 8 mm / cos less y tan(lean) above it
        depth = 0.008 / np.cos(lean) - 0.008 * np.cos(0.5 * (piece.arcs[:, 0] + piece.arcs[:, 1])) * np.tan(lean) * -1.0
        np.testing.assert_allclose(piece.arcs[:, 2], depth, atol=0.01 * 0.008)
        assert piece.arcs[0, 0] == pytest.approx(0.0, abs=1e-3)
        assert piece.arcs[-1, 1] == pytest.approx(np.pi, abs=1e-3)
        assert _limit(piece, law) > 0.0


def test_limits_are_those_of_the_lobes(law: KienzleLaw) -> None:
    process = process_of_side_cut(FLAT, law, 0.0, 1.2, 0.004, 5e-5)
    grid = lobes.frequencies_for(ROBOT)
    factor, _ = lobes.limits(process.mean, ROBOT.response(grid), grid, np.array([1.0 / 300.0]))
    assert robot_limit(ROBOT, process.mean, 1.0 / 300.0).factor == pytest.approx(float(factor[0]))


def test_every_cell_of_the_examples_that_is_a_box_has_its_box(cell_of: Callable[..., object]) -> None:
    box = cell_of().blank_box()  # type: ignore[attr-defined]
    assert box is not None
    assert np.all(box.high_m > box.low_m)

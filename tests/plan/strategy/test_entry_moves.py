"""Arcs that join a path with its direction, and ramps that leave a slope."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.core.errors import InputError
from counterflex.plan.strategy.entry_moves import arc_in, arc_out, ramp

ANGLES = st.floats(0.1, math.pi)


@given(heading=st.floats(-3.0, 3.0), side=st.sampled_from([-1.0, 1.0]), radius=st.floats(1e-3, 0.1), turn=ANGLES)
def test_arcs_join_with_the_direction_of_the_path(heading: float, side: float, radius: float, turn: float) -> None:
    tangent = np.array([math.cos(heading), math.sin(heading)])
    free, point = side * np.array([-tangent[1], tangent[0]]), np.array([0.1, -0.2])
    into, out = arc_in(point, tangent, free, radius, turn), arc_out(point, tangent, free, radius, turn)
    for arc, other, along in ((into, into.start, -math.sin(turn)), (out, out.end, math.sin(turn))):
        arm = point - arc.centre
        running = np.array([-arm[1], arm[0]]) * (1.0 if arc.left else -1.0) / radius
        np.testing.assert_allclose(running, tangent, atol=1e-9)
        # as far off the wall, and as far along it, as an arc of this angle is
        assert (other - point) @ free == pytest.approx(radius * (1.0 - math.cos(turn)), abs=1e-12)
        assert (other - point) @ tangent == pytest.approx(radius * along, abs=1e-12)
    np.testing.assert_allclose(into.end, point)
    np.testing.assert_allclose(out.start, point)


def test_a_ramp_comes_down_to_the_start_in_even_passes() -> None:
    start, end = np.array([0.01, 0.02, 0.0]), np.array([0.11, 0.02, 0.0])
    points = ramp(start, end, 0.006, math.radians(10.0), 0.002)
    assert len(points) == 6
    np.testing.assert_allclose(points[-1], start, atol=1e-12)
    np.testing.assert_allclose(points[1::2, 2], [0.004, 0.002, 0.0], atol=1e-12)
    np.testing.assert_allclose(points[::2, 0] - start[0], 0.006 / math.tan(math.radians(10.0)))
    np.testing.assert_allclose(points[::2, 2], 0.006)


def test_a_short_line_makes_a_steeper_ramp() -> None:
    start, end = np.zeros(3), np.array([0.01, 0.0, 0.0])
    np.testing.assert_allclose(ramp(start, end, 0.006, math.radians(5.0), 0.01)[0], [0.01, 0.0, 0.006])


@pytest.mark.parametrize(("top", "slope", "step"), [(0.0, 0.1, 0.001), (0.01, 0.0, 0.001), (0.01, 0.1, 0.0)])
def test_bad_ramps_are_refused(top: float, slope: float, step: float) -> None:
    with pytest.raises(InputError):
        ramp(np.zeros(3), np.array([0.1, 0.0, 0.0]), top, slope, step)


def test_bad_arcs_are_refused() -> None:
    x, y = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    with pytest.raises(InputError, match="radius"):
        arc_in(x, x, y, 0.0, 1.0)
    with pytest.raises(InputError, match="angle"):
        arc_out(x, x, y, 1.0, 4.0)

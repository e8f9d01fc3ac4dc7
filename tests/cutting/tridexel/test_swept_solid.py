"""The stretch of a line in the sweep of a cutter, against the signed distance, which is written another way."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from counterflex.core.arrays import Float
from counterflex.cutting.tridexel.swept_solid import distance, stretch, tool_shape

FLAT, BALL, BULL = (0.008, 0.0), (0.005, 0.005), (0.008, 0.003)
TOP_M = 0.03
EXACT_M = 1e-9
"""Distance of an end from the surface; Newton's method ends at 1 pm along the normal."""

_size = st.floats(-0.02, 0.02)
_part = st.floats(-1.0, 1.0)


def _axis(a: float, b: float, c: float) -> Float:
    axis = np.array([a, b, c + 2e-3])
    size = float(np.linalg.norm(axis))
    return np.array([0.0, 0.0, 1.0]) if size < 1e-3 else axis / size


@pytest.mark.parametrize(("radius", "corner"), [FLAT, BALL, BULL], ids=["flat", "ball", "bull"])
@given(
    point=st.tuples(_size, _size, _size),
    step=st.tuples(_size, _size, _size),
    axis=st.tuples(_part, _part, _part),
    along=st.integers(0, 2),
)
@settings(max_examples=150)
def test_a_stretch_is_where_the_distance_is_below_zero(
    radius: float,
    corner: float,
    point: tuple[float, float, float],
    step: tuple[float, float, float],
    axis: tuple[float, float, float],
    along: int,
) -> None:
    shape, motion = tool_shape(radius, corner, TOP_M), np.concatenate([np.zeros(3), step, _axis(*axis)])
    q, line = np.array(point), np.eye(3)[along]

    def off(t: float) -> float:
        x, y, z = q + t * line
        return float(distance(x, y, z, motion, shape)[0])

    first, last = stretch(q, along, motion, shape)
    samples = np.linspace(-0.1, 0.1, 81)
    inside = samples[[off(t) < -1e-8 for t in samples]]
    if last < first:
        assert not inside.size
        return
    # ends lie on the surface; a line that only grazes a face may end anywhere on it
    assert max(abs(off(first)), abs(off(last))) < EXACT_M
    assert off(0.5 * (first + last)) < EXACT_M
    if inside.size:
        assert first <= inside[0]
        assert inside[-1] <= last


def test_a_flat_cutter_moved_along_x_sweeps_a_slot_with_round_ends() -> None:
    shape, motion = tool_shape(0.008, 0.0, TOP_M), np.array([0, 0, 0, 0.05, 0, 0, 0, 0, 1.0])
    y = 0.003
    reach = np.sqrt(0.008**2 - y**2)
    np.testing.assert_allclose(stretch(np.array([0.0, y, 0.001]), 0, motion, shape), [-reach, 0.05 + reach], atol=1e-15)
    np.testing.assert_allclose(stretch(np.array([0.02, 0.0, 0.001]), 1, motion, shape), [-0.008, 0.008], atol=1e-15)
    np.testing.assert_allclose(stretch(np.array([0.02, y, 0.0]), 2, motion, shape), [0.0, TOP_M], atol=1e-15)


def test_a_ball_leaves_the_height_of_its_circle() -> None:
    shape, motion = tool_shape(0.005, 0.005, TOP_M), np.array([0, 0, 0, 0.05, 0, 0, 0, 0, 1.0])
    low, _ = stretch(np.array([0.02, 0.003, 0.0]), 2, motion, shape)
    assert low == pytest.approx(0.005 - np.sqrt(0.005**2 - 0.003**2), abs=1e-15)


def test_a_bull_nose_leaves_its_flat_and_its_corner() -> None:
    shape, motion = tool_shape(0.008, 0.003, TOP_M), np.array([0, 0, 0, 0.05, 0, 0, 0, 0, 1.0])
    low, _ = stretch(np.array([0.02, 0.004, 0.0]), 2, motion, shape)
    assert low == pytest.approx(0.0, abs=1e-9)
    low, _ = stretch(np.array([0.02, 0.007, 0.0]), 2, motion, shape)
    assert low == pytest.approx(0.003 - np.sqrt(0.003**2 - 0.002**2), abs=1e-9)

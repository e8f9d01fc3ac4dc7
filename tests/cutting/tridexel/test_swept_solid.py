"""The stretch of a line in the sweep of a cutter, against many poses of it and the signed distance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.cutting.tridexel.swept_solid import distance, stretch, tool_shape

FLAT, BALL, BULL = (0.008, 0.0), (0.005, 0.005), (0.008, 0.003)
TOP_M = 0.03
TURN_RAD, SHORT, TURNED_M = 0.01, 0.1, 2e-6
"""Turn of a motion at most, its length beside a point's distance, and what a turn may leave out."""
EXACT_M = 1e-9
"""Distance of an end from the surface; Newton's method ends at 1 pm along the normal."""
POSES = 401

_size = st.floats(-0.02, 0.02)
_part = st.floats(-1.0, 1.0)


def _axis(a: float, b: float, c: float) -> Float:
    axis = np.array([a, b, c + 2e-3])
    size = float(np.linalg.norm(axis))
    return np.array([0.0, 0.0, 1.0]) if size < 1e-3 else axis / size


def _off_poses(points: Float, motion: Float, radius: float, corner: float, poses: int) -> Float:
    """Signed distance (n,) m of points (n, 3) to the nearest of many poses of the cutter at rest, from its outline."""
    share = np.linspace(0.0, 1.0, poses)[:, None]
    axis = motion[6:9] + (share - 0.5) * motion[9:12]
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    rest = points[:, None] - share * motion[3:6]
    height = np.sum(rest * axis, axis=2)
    out = np.linalg.norm(rest - height[..., None] * axis, axis=2) - (radius - corner)
    down = corner - height
    rounded = np.hypot(np.maximum(out, 0.0), np.maximum(down, 0.0)) + np.minimum(np.maximum(out, down), 0.0) - corner
    least: Float = np.maximum(rounded, height - TOP_M).min(axis=1)
    return least


def _check(cutter: tuple[float, float], motion: Float, q: Float, along: int) -> None:
    """The ends of a stretch lie on the sweep, none of it is beyond them, and nothing between them is outside."""
    shape, line, turn = tool_shape(*cutter, TOP_M), np.eye(3)[along], float(np.linalg.norm(motion[9:]))
    first, last = stretch(q, along, motion, shape)
    step = max(float(np.linalg.norm(motion[3:6])), TOP_M * turn) / (POSES - 1)
    off = TURNED_M + step  # what lies between two poses, and what a turn leaves out
    samples = np.linspace(-0.06, 0.06, 97)
    if first <= last:
        beyond = np.array([1e-5, 1e-4, 1e-3])
        samples = np.concatenate([samples, first - beyond, last + beyond])
    inside = samples[_off_poses(q + samples[:, None] * line, motion, *cutter, POSES) < -off]
    if last < first:
        assert not inside.size
        return
    assert np.all((first <= inside) & (inside <= last))
    ends = q + np.array([[first], [last], [0.5 * (first + last)]]) * line
    # a face, or a flank, that turns about a line in it cuts on either side of that line and leaves its middle
    middle = 0.5 * turn * max(cutter[0], 0.5 * TOP_M)
    assert np.abs(_off_poses(ends[:2], motion, *cutter, POSES)).max() < off
    assert _off_poses(ends[2:], motion, *cutter, POSES)[0] < off + middle
    assert max(float(distance(end[0], end[1], end[2], motion, shape)[0]) for end in ends[:2]) < EXACT_M + (
        TURNED_M if turn else 0.0
    )


@pytest.mark.parametrize("cutter", [FLAT, BALL, BULL], ids=["flat", "ball", "bull"])
@given(
    point=st.tuples(_size, _size, _size),
    step=st.tuples(_size, _size, _size),
    axis=st.tuples(_part, _part, _part),
    turn=st.tuples(_part, _part, _part),
    along=st.integers(0, 2),
)
@settings(max_examples=60)
def test_a_stretch_is_where_poses_of_the_cutter_are(
    cutter: tuple[float, float],
    point: tuple[float, float, float],
    step: tuple[float, float, float],
    axis: tuple[float, float, float],
    turn: tuple[float, float, float],
    along: int,
) -> None:
    middle = _axis(*axis)
    change = TURN_RAD * (np.array(turn) - np.dot(turn, middle) * middle)
    motion = np.concatenate([np.zeros(3), SHORT * np.array(step), middle, change])
    _check(cutter, motion, np.array(point), along)


@pytest.mark.parametrize("cutter", [FLAT, BALL, BULL], ids=["flat", "ball", "bull"])
@given(
    pointing=st.sampled_from([(0, 0, 1), (0, -1, 0), (1, 0, 0), (0, 1, 0), (0, 0, -1), (0.6, 0, 0.8)]),
    off=st.tuples(_part, _part, _part),
    size=st.sampled_from([0.0, 1e-6, 1e-3, 5e-3]),
    about=st.integers(0, 2),
    turned=st.sampled_from([0.0, 1e-5, 1e-3, 1e-2]),
    place=st.tuples(_part, _part, _part),
    near=st.sampled_from([1e-6, 1e-5, 1e-4, 1e-3]),
    step=st.tuples(_part, _part, _part),
    reach=st.sampled_from([0.0, 1e-4, 2e-3]),
    along=st.integers(0, 2),
)
@example(  # a flat mill that lies and turns about z, a line along z nearly in its end face
    pointing=(0, -1, 0), off=(0, 0, 1), size=1e-3, about=2, turned=1e-2, place=(0.4, 0.1, 0.5), near=1e-5,
    step=(0, 0.3, 0), reach=2e-3, along=2,
)  # fmt: skip
@example(  # the face turns about a diameter, the line runs under a shallow angle to it
    pointing=(0, -1, 0), off=(1, 0, 0.2), size=5e-3, about=2, turned=1e-2, place=(0.1, -0.3, -1.0), near=1e-5,
    step=(0, 0, 0), reach=0.0, along=0,
)  # fmt: skip
@settings(max_examples=60)
def test_a_line_nearly_in_the_end_face_or_along_the_flank(
    cutter: tuple[float, float],
    pointing: tuple[float, float, float],
    off: tuple[float, float, float],
    size: float,
    about: int,
    turned: float,
    place: tuple[float, float, float],
    near: float,
    step: tuple[float, float, float],
    reach: float,
    along: int,
) -> None:
    axis = np.array(pointing) + size * np.array(off)
    axis /= np.linalg.norm(axis)
    one = np.cross(axis, [0.3, 0.4, 0.5])
    one /= np.linalg.norm(one)
    way = reach * np.array(step)
    face = cutter[0] * (place[0] * one + place[1] * np.cross(axis, one)) + near * place[2] * axis
    motion = np.concatenate([np.zeros(3), way, axis, turned * np.cross(np.eye(3)[about], axis)])
    _check(cutter, motion, face + 0.5 * way, along)


def test_a_flat_cutter_moved_along_x_sweeps_a_slot_with_round_ends() -> None:
    shape, motion = tool_shape(0.008, 0.0, TOP_M), np.array([0, 0, 0, 0.05, 0, 0, 0, 0, 1.0, 0, 0, 0])
    y = 0.003
    reach = np.sqrt(0.008**2 - y**2)
    np.testing.assert_allclose(stretch(np.array([0.0, y, 0.001]), 0, motion, shape), [-reach, 0.05 + reach], atol=1e-15)
    np.testing.assert_allclose(stretch(np.array([0.02, 0.0, 0.001]), 1, motion, shape), [-0.008, 0.008], atol=1e-15)
    np.testing.assert_allclose(stretch(np.array([0.02, y, 0.0]), 2, motion, shape), [0.0, TOP_M], atol=1e-15)


def test_a_ball_leaves_the_height_of_its_circle() -> None:
    shape, motion = tool_shape(0.005, 0.005, TOP_M), np.array([0, 0, 0, 0.05, 0, 0, 0, 0, 1.0, 0, 0, 0])
    low, _ = stretch(np.array([0.02, 0.003, 0.0]), 2, motion, shape)
    assert low == pytest.approx(0.005 - np.sqrt(0.005**2 - 0.003**2), abs=1e-15)


def test_a_bull_nose_leaves_its_flat_and_its_corner() -> None:
    shape, motion = tool_shape(0.008, 0.003, TOP_M), np.array([0, 0, 0, 0.05, 0, 0, 0, 0, 1.0, 0, 0, 0])
    low, _ = stretch(np.array([0.02, 0.004, 0.0]), 2, motion, shape)
    assert low == pytest.approx(0.0, abs=1e-9)
    low, _ = stretch(np.array([0.02, 0.007, 0.0]), 2, motion, shape)
    assert low == pytest.approx(0.003 - np.sqrt(0.003**2 - 0.002**2), abs=1e-9)

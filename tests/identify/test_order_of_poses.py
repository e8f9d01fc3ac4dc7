"""Order of poses: as good as trying all orders of a few, far better than as given, and play that always rests alike."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ReachError
from counterflex.identify.design.order import (
    REVERSAL_S,
    STOP_S,
    approach_points,
    order_of_poses,
    travel_s,
    wrong_sides,
)

SPEEDS = np.array([1.8, 1.7, 1.9, 3.0, 2.5, 3.8])
LIMITS = np.stack([-np.full(6, 3.2), np.full(6, 3.2)], axis=1)


def _cost(q: Float, start: Float) -> float:
    way = np.vstack([start, q])
    moves = np.diff(way, axis=0)
    time = np.max(np.abs(moves) / SPEEDS, axis=1)
    return float(np.sum(time + STOP_S * (time > 0)) + REVERSAL_S * np.sum(moves < 0.0))


@pytest.mark.parametrize("seed", range(8))
def test_as_good_as_trying_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q, start = rng.uniform(-1.5, 1.5, (7, 6)), rng.uniform(-1.5, 1.5, 6)
    order = order_of_poses(q, SPEEDS, start=start)
    best = min(_cost(q[list(p)], start) for p in itertools.permutations(range(7)))
    assert sorted(order.tolist()) == list(range(7))
    assert _cost(q[order], start) <= 1.06 * best


def test_shorter_and_fewer_reversals_than_as_given() -> None:
    rng = np.random.default_rng(20)
    q = rng.uniform(-1.5, 1.5, (60, 6))
    order = order_of_poses(q, SPEEDS)
    assert travel_s(q[order], SPEEDS) < 0.8 * travel_s(q, SPEEDS)
    assert wrong_sides(q[order]).sum() < 0.8 * wrong_sides(q).sum()
    short = order_of_poses(q, SPEEDS, reversal_s=0.0)
    assert travel_s(q[short], SPEEDS) < travel_s(q[order], SPEEDS)
    assert wrong_sides(q[order]).sum() < wrong_sides(q[short]).sum()


def test_one_axis_is_swept_in_the_wanted_direction() -> None:
    rng = np.random.default_rng(21)
    q = np.zeros((20, 6))
    q[:, 0] = rng.permutation(np.linspace(-1.0, 1.0, 20))
    up = order_of_poses(q, SPEEDS)
    assert np.all(np.diff(q[up, 0]) > 0.0)
    assert not np.any(wrong_sides(q[up]))
    down = order_of_poses(q, SPEEDS, wanted=np.array([-1.0, 1, 1, 1, 1, 1]))
    assert np.all(np.diff(q[down, 0]) < 0.0)


def test_weightless_axes_do_not_count() -> None:
    rng = np.random.default_rng(22)
    q = rng.uniform(-1.0, 1.0, (30, 6))
    only = np.array([1.0, 0, 0, 0, 0, 0])
    order = order_of_poses(q, SPEEDS, weight=only, reversal_s=5.0)
    assert wrong_sides(q[order])[:, 0].sum() < 0.4 * wrong_sides(q[order_of_poses(q, SPEEDS)])[:, 1:].sum() / 5.0


def test_repeats_stay_together() -> None:
    rng = np.random.default_rng(23)
    poses = rng.uniform(-1.0, 1.0, (6, 6))
    q = np.tile(poses, (4, 1))
    order = order_of_poses(q, SPEEDS)
    which = order % 6
    assert np.sum(np.diff(which) != 0) == 5


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), given_start=st.booleans())
def test_play_always_rests_on_the_wanted_side(seed: int, given_start: bool) -> None:
    """A dead band carried along by the way through the approach points."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.5, 1.5, (12, 6))
    q[rng.random(q.shape) < 0.3] = 0.2
    wanted = rng.choice([-1.0, 1.0], 6)
    start = rng.uniform(-1.5, 1.5, 6) if given_start else None
    points = approach_points(q, LIMITS, start=start, wanted=wanted)
    half = np.deg2rad(0.03)
    link = q[0] - wanted * half if start is None else start + half * rng.uniform(-1.0, 1.0, 6)
    for back, pose in zip(points, q, strict=True):
        for stop in (back, pose):
            link = np.clip(link, stop - half, stop + half)
        assert np.allclose(link, pose - wanted * half, atol=1e-12)
    direct = np.all(points == q, axis=1)
    assert np.all(np.abs(points - q)[~direct] <= np.deg2rad(2.0) + 1e-12)


def test_direct_where_no_axis_turns() -> None:
    q = np.cumsum(np.full((5, 6), 0.3), axis=0)
    assert np.array_equal(approach_points(q, LIMITS), q)
    back = approach_points(q[::-1], LIMITS, start=q[-1] + 0.3)
    assert np.allclose(back, q[::-1] - np.deg2rad(2.0))


def test_refusals() -> None:
    q = np.zeros((3, 6))
    with pytest.raises(InputError, match="speed"):
        order_of_poses(q, np.zeros(6))
    with pytest.raises(InputError, match="side"):
        wrong_sides(q, wanted=np.full(6, 0.5))
    q[1, 3] = -3.19
    with pytest.raises(ReachError, match="axis 4"):
        approach_points(q, LIMITS)

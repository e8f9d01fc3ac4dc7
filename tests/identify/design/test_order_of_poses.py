"""Order of poses: as good as trying all orders of a few, far better than as given, and play that always rests alike."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.identify.design.order import (
    REVERSAL_S,
    STOP_S,
    order_of_poses,
    wrong_sides,
)

SPEEDS = np.array([1.8, 1.7, 1.9, 3.0, 2.5, 3.8])
LIMITS = np.stack([-np.full(6, 3.2), np.full(6, 3.2)], axis=1)


def travel_s(q: Float, speeds_rad_s: Float) -> float:
    """Time of travel through poses (n, 6) rad: of each move the slowest axis at full speed, plus :data:`STOP_S`."""
    moves = np.max(np.abs(np.diff(q, axis=0)) / speeds_rad_s, axis=1)
    return float(np.sum(moves + STOP_S * (moves > 0.0)))


def _cost(q: Float) -> float:
    moves = np.diff(q, axis=0)
    time = np.max(np.abs(moves) / SPEEDS, axis=1)
    return float(np.sum(time + STOP_S * (time > 0)) + REVERSAL_S * np.sum(moves < 0.0))


@pytest.mark.parametrize("seed", range(8))
def test_as_good_as_trying_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.5, 1.5, (7, 6))
    order = order_of_poses(q, SPEEDS)
    best = min(_cost(q[list(p)]) for p in itertools.permutations(range(7)))
    assert sorted(order.tolist()) == list(range(7))
    assert _cost(q[order]) <= 1.06 * best


def test_shorter_and_fewer_reversals_than_as_given() -> None:
    rng = np.random.default_rng(20)
    q = rng.uniform(-1.5, 1.5, (60, 6))
    order = order_of_poses(q, SPEEDS)
    assert travel_s(q[order], SPEEDS) < 0.8 * travel_s(q, SPEEDS)
    assert wrong_sides(q[order]).sum() < 0.8 * wrong_sides(q).sum()


def test_one_axis_is_swept_in_the_wanted_direction() -> None:
    rng = np.random.default_rng(21)
    q = np.zeros((20, 6))
    q[:, 0] = rng.permutation(np.linspace(-1.0, 1.0, 20))
    up = order_of_poses(q, SPEEDS)
    assert np.all(np.diff(q[up, 0]) > 0.0)
    assert not np.any(wrong_sides(q[up]))
    assert np.all(wrong_sides(q[up[::-1]])[1:, 0])


def test_repeats_stay_together() -> None:
    rng = np.random.default_rng(23)
    poses = rng.uniform(-1.0, 1.0, (6, 6))
    q = np.tile(poses, (4, 1))
    order = order_of_poses(q, SPEEDS)
    which = order % 6
    assert np.sum(np.diff(which) != 0) == 5


def test_refusals() -> None:
    q = np.zeros((3, 6))
    with pytest.raises(InputError, match="speed"):
        order_of_poses(q, np.zeros(6))

"""The limiter keeps length, speed and acceleration from every state, and reaches what can be reached."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.signals.limiter import (
    AT_RADIUS,
    NOT_FINITE,
    MotionLimit,
    approach_speed,
    limited_step,
    stopping_distance,
)

T = 4e-3
LIMIT = MotionLimit(2e-3, 20e-3, 1.25)
VECTOR = st.tuples(*[st.floats(-1.0, 1.0)] * 3)
ANY = st.tuples(*[st.floats(allow_nan=True, allow_infinity=True)] * 3)


def norm(x: Float) -> float:
    return float(np.linalg.norm(x))


@settings(max_examples=150)
@given(st.lists(st.tuples(VECTOR, st.integers(1, 60)), min_size=1, max_size=12), st.floats(0.1, 5.0))
def test_from_rest_no_limit_is_ever_broken(moves: list[tuple[tuple[float, ...], int]], reach: float) -> None:
    """Targets that jump at random, inside and outside the radius."""
    y, v, limit = np.zeros(3), np.zeros(3), LIMIT.packed()
    for target, cycles in moves:
        for _ in range(cycles):
            y0, v0 = y.copy(), v.copy()
            limited_step(y, v, np.array(target) * reach * LIMIT.radius, limit, T)
            assert norm(y) <= LIMIT.radius * (1 + 1e-9)
            assert norm(v) <= LIMIT.speed * (1 + 1e-9)
            assert norm(v - v0) <= LIMIT.acceleration * T * (1 + 1e-9)
            np.testing.assert_allclose(y - y0, T * v, atol=1e-18)


@settings(max_examples=200)
@given(VECTOR, VECTOR, st.floats(0.0, 20.0), st.floats(0.0, 20.0), VECTOR)
def test_from_any_state_the_acceleration_holds_and_the_limits_come_back(
    at: tuple[float, ...], speed: tuple[float, ...], far: float, fast: float, target: tuple[float, ...]
) -> None:
    y, v = np.array(at) * far * LIMIT.radius, np.array(speed) * fast * LIMIT.speed
    limit = LIMIT.packed()
    goal = np.array(target) * 0.5 * LIMIT.radius
    for _ in range(6000):
        v0 = v.copy()
        limited_step(y, v, goal, limit, T)
        assert norm(v - v0) <= LIMIT.acceleration * T * (1 + 1e-9)
        assert norm(v) <= max(LIMIT.speed, norm(v0)) * (1 + 1e-9)
        if norm(y - goal) < 1e-9 and norm(v) < 1e-9:
            break
    assert norm(y - goal) < 1e-6


@given(ANY)
def test_a_target_that_is_not_finite_brings_it_to_rest(target: tuple[float, ...]) -> None:
    y, v = np.zeros(3), np.array([10e-3, 0.0, 0.0])
    bad = not all(map(math.isfinite, target))
    for _ in range(10):
        status = limited_step(y, v, np.array(target), LIMIT.packed(), T)
        assert bool(status & NOT_FINITE) == bad
        assert np.all(np.isfinite(y))
        assert np.all(np.isfinite(v))
    if bad:
        assert norm(v) == 0.0
        assert norm(y) <= 10e-3**2 / (2 * LIMIT.acceleration) + 10e-3 * T


@settings(max_examples=200)
@given(VECTOR, st.floats(0.0, 1.0), VECTOR, st.integers(0, 6))
def test_the_first_step_after_a_target_that_is_no_number_keeps_the_acceleration(
    way: tuple[float, ...], share: float, target: tuple[float, ...], cycles: int
) -> None:
    """Braking and setting off again, whatever the speed was: no step of the speed beyond a T."""
    size = norm(np.array(way))
    y, v = np.zeros(3), (np.array(way) / size if size > 0.1 else np.array([1.0, 0.0, 0.0])) * share * LIMIT.speed
    wanted = [np.full(3, math.nan)] * cycles + [np.array(target) * LIMIT.radius] * 60
    for goal in wanted:
        y0, v0 = y.copy(), v.copy()
        limited_step(y, v, goal, LIMIT.packed(), T)
        assert norm(v - v0) <= LIMIT.acceleration * T * (1 + 1e-9)
        np.testing.assert_allclose(y - y0, T * v, atol=1e-18)


def test_a_reachable_target_is_reached_in_the_least_time_and_without_overshoot() -> None:
    y, v, goal = np.zeros(3), np.zeros(3), np.array([1e-3, 0.0, 0.0])
    path = []
    for _ in range(40):
        limited_step(y, v, goal, LIMIT.packed(), T)
        path.append(y[0])
    trapezoid_s = goal[0] / LIMIT.speed + LIMIT.speed / LIMIT.acceleration
    arrived = next(i + 1 for i, x in enumerate(path) if x > goal[0] * 0.999999)
    assert arrived * T <= trapezoid_s + 2 * T
    assert max(path) <= goal[0] * (1 + 1e-12)
    assert path[-1] == pytest.approx(goal[0], rel=1e-12)


def test_a_target_outside_is_said_and_the_radius_is_reached() -> None:
    y, v = np.zeros(3), np.zeros(3)
    for _ in range(500):
        status = limited_step(y, v, np.array([5e-3, 5e-3, 0.0]), LIMIT.packed(), T)
    assert status & AT_RADIUS
    assert norm(y) == pytest.approx(LIMIT.radius, rel=1e-9)


@given(st.floats(1e-9, 1.0), st.floats(0.01, 10.0))
def test_approach_speed_stops_exactly_within_the_distance(distance: float, acceleration: float) -> None:
    v = approach_speed(distance, acceleration, T)
    assert T * v + stopping_distance(v, acceleration, T) == pytest.approx(distance, rel=1e-9)


@pytest.mark.parametrize("bad", [(0.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, math.inf), (math.nan, 1.0, 1.0)])
def test_zero_never_means_unlimited(bad: tuple[float, float, float]) -> None:
    with pytest.raises(InputError, match="limit"):
        MotionLimit(*bad)

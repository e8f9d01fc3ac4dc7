"""Reversals and unloadings: closed forms, the definition on random angles, and pairs with and without load."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.plan.preflight.reversals import (
    LEAST_RAD,
    ReversalEvent,
    event_row,
    reversals,
    turning_points,
    unloadings,
)
from counterflex.robot.elasticity.chain import ElasticChain, jacobian
from counterflex.robot.model import catalog
from counterflex.robot.model.description import Play

HOME = np.radians([0.0, -90.0, 90.0, 0.0, 20.0, 0.0])


@pytest.fixture(scope="module")
def chain() -> ElasticChain:
    return ElasticChain.build(catalog.load("kuka_kr300_r2500_ultra"))


def wave(axis: int, n: int = 201, periods: float = 2.0, size: float = 1e-2) -> Float:
    q = np.tile(HOME, (n, 1))
    q[:, axis] += size * np.sin(2.0 * np.pi * periods * np.linspace(0.0, 1.0, n))
    return q


def test_a_wave_turns_twice_in_a_period() -> None:
    turns = turning_points(wave(2, periods=3.0)[:, 2])
    assert len(turns) == 6
    assert turns[:, 0] / 200 * 3.0 == pytest.approx([0.25, 0.75, 1.25, 1.75, 2.25, 2.75], abs=0.02)


@pytest.mark.parametrize(("size", "count"), [(0.4, 0), (0.6, 9)])
def test_less_than_the_least_angle_is_rounding(size: float, count: int) -> None:
    """A triangle wave whose half-swings are below or above the least angle, on an axis that otherwise stands."""
    angle = size * LEAST_RAD * np.array([(-1.0) ** k for k in range(11)])
    assert len(turning_points(angle)) == count


def test_ripple_on_a_moving_axis_is_no_reversal() -> None:
    t = np.linspace(0.0, 1.0, 1000)
    assert len(turning_points(1e-2 * t + 0.4 * LEAST_RAD * np.sin(500.0 * t))) == 0
    assert len(turning_points(1e-2 * t + 40.0 * LEAST_RAD * np.sin(200.0 * t))) > 10


def test_a_rest_at_the_turn_is_one_turn() -> None:
    angle = np.concatenate([np.linspace(0.0, 1.0, 5), np.ones(4), np.linspace(1.0, 0.0, 5)])
    turns = turning_points(angle)
    assert len(turns) == 1
    assert angle[turns[0, 0]] == 1.0
    assert angle[turns[0, 1]] < 1.0


def by_definition(angle: Float, least: float) -> int:
    """How often a body that the axis drags through a play of width ``least`` is dragged the other way."""
    low, high, directions = angle[0], angle[0], []
    for value in angle:
        if value > high:
            if value - low >= least:
                directions.append(1)
            high, low = value, max(low, value - least)
        elif value < low:
            if high - value >= least:
                directions.append(-1)
            low, high = value, min(high, value + least)
    return sum(a != b for a, b in itertools.pairwise(directions))


@settings(max_examples=80, deadline=None)
@given(st.lists(st.integers(-8, 8), min_size=2, max_size=40))
def test_turns_are_those_of_a_dragged_play(steps: list[int]) -> None:
    """An axis that drags a body through a play of the least angle turns that body round as often."""
    angle = np.cumsum(np.array(steps, dtype=np.float64))
    least = 4.5
    assert len(turning_points(angle, least)) == by_definition(angle, least)


def test_reversals_count_where_the_way_back_cuts(chain: ElasticChain) -> None:
    """The pair: the same motion, material on the way back or not."""
    q = wave(1, periods=0.5)
    w = np.tile([100.0, 0.0, 50.0, 0.0, 0.0, 0.0], (len(q), 1))
    first_half = np.arange(len(q)) < 100
    events = reversals(chain, q, w, ~first_half)
    assert [(event.axis, event.point) for event in events] == [(1, 100)]
    J = jacobian(chain, q[100])
    assert events[0].torque_nm == pytest.approx(abs(float(J[:, 1] @ w[0])), rel=1e-2)
    assert reversals(chain, q, w, first_half) == []
    assert reversals(chain, np.sort(q, axis=0), w, ~first_half) == []


def test_a_force_that_changes_side_unloads_the_axis_without_weight(chain: ElasticChain) -> None:
    """Axis 1 stands upright and bears no weight: a force across it that swings makes its gear change sides."""
    q, n = np.tile(HOME, (100, 1)), 100
    w = np.zeros((n, 6))
    w[:, 1] = 200.0 * np.cos(np.linspace(0.0, 4.0 * np.pi, n) + 0.1)
    cutting = np.ones(n, dtype=np.bool_)
    events = [event for event in unloadings(chain, q, w, cutting) if event.axis == 0]
    assert len(events) == 4
    assert [event for event in unloadings(chain, q, np.abs(w), cutting) if event.axis == 0] == []
    assert unloadings(chain, q, w, ~cutting) == []


def test_weight_keeps_axis_two_loaded_until_the_force_outweighs_it(chain: ElasticChain) -> None:
    q, n = np.tile(np.radians([0.0, -45.0, 90.0, 0.0, 20.0, 0.0]), (50, 1)), 50
    w = np.zeros((n, 6))
    w[25:, 2] = 100.0
    cutting = np.ones(n, dtype=np.bool_)
    assert [event for event in unloadings(chain, q, w, cutting) if event.axis == 2] == []
    w[25:, 2] = 20_000.0
    assert [(e.axis, e.point) for e in unloadings(chain, q, w, cutting) if e.axis == 2] == [(2, 25)]


def test_known_play_is_said_at_the_tool(chain: ElasticChain) -> None:
    q = wave(1, periods=0.5)
    w = np.tile([100.0, 0.0, 50.0, 0.0, 0.0, 0.0], (len(q), 1))
    loose = replace(chain, play=(None, Play(half_band_rad=2e-5), *(None,) * 4))
    (event,) = reversals(loose, q, w, np.ones(len(q), dtype=np.bool_))
    lever = float(np.linalg.norm(jacobian(chain, q[100])[:3, 1]))
    assert event.lost_m == pytest.approx(2.0 * 2e-5 * lever, rel=1e-6)
    row = event_row("reversals in the cut", [event], 0.9 * event.lost_m)
    assert (row.verdict, row.value, row.point) == ("warning", event.lost_m, 100)
    assert event_row("reversals in the cut", [event], 1.1 * event.lost_m).verdict == "ok"


def test_row_names_the_worst() -> None:
    """Of known play the largest lost motion counts; without any its size is not looked at, and the key is named."""
    events = [
        ReversalEvent(2, 7, 10.0, float("nan")),
        ReversalEvent(2, 9, 30.0, float("nan")),
        ReversalEvent(0, 3, 20.0, float("nan")),
    ]
    row = event_row("reversals in the cut", events, 50e-6)
    assert (row.verdict, row.missing, row.point) == ("not looked at", "robot.play", 9)
    assert row.what.startswith("axis 1: 1, axis 3: 2; worst axis 3 at 30 N m")
    mixed = event_row("reversals in the cut", [*events, ReversalEvent(1, 4, 5.0, 60e-6)], 50e-6)
    assert (mixed.verdict, mixed.value, mixed.limit, mixed.point) == ("warning", 60e-6, 50e-6, 4)
    assert event_row("reversals in the cut", [], 50e-6).verdict == "ok"

"""The place on the path while nobody is on the way: found wherever the robot stands, in small steps, from its start."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.runtime.feed_forward_kernel import play_undone
from counterflex.runtime.follow_kernel import (
    PLAN_C,
    PLAN_COLUMNS,
    PLAN_PLAY,
    PLAN_TIME,
    PLAN_W,
    SEEK_ROWS,
    contained_at,
    follow,
    seek,
    wrench_at,
)


def plan_of(points: Float) -> Float:
    plan = np.zeros((len(points), PLAN_COLUMNS))
    plan[:, :3] = points
    return plan


def line(rows: int) -> Float:
    x = 1e-3 * np.arange(rows)
    return np.stack([x, 0.0 * x, 0.0 * x], axis=1)


@pytest.mark.parametrize("row", [0, 399, 400, 1234, 2998])
def test_a_place_anywhere_is_found_after_one_sweep(row: int) -> None:
    plan = plan_of(line(3000))
    place, sweep = np.array([0.0, 0.0]), np.zeros(4)
    calls = int(np.ceil((len(plan) - 1) / SEEK_ROWS))
    for _ in range(calls):
        seek(plan, place, sweep, (row + 0.25) * 1e-3, 0.0, 0.0)
    assert place[0] + place[1] == pytest.approx(row + 0.25)
    assert sweep[0] == 0.0


def test_a_call_looks_at_a_few_rows_only() -> None:
    """Rows that were not its turn may hold anything: the least distance of a call is that of its own rows."""
    plan = plan_of(line(3000))
    place, sweep = np.array([-1.0, 0.0]), np.zeros(4)
    seek(plan, place, sweep, 2.5, 0.0, 0.0)
    assert sweep[0] == SEEK_ROWS
    assert sweep[1] == pytest.approx(2.5 - SEEK_ROWS * 1e-3)
    assert place[0] == -1.0


def test_a_closed_path_is_begun_again_at_its_beginning_pair() -> None:
    """With following alone a program that has come to its end stays there."""
    angle = np.linspace(0.0, 2.0 * np.pi, 800)
    plan = plan_of(0.1 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1))
    place, sweep = np.array([798.0, 1.0]), np.zeros(4)
    assert follow(plan, place, 0.1, 0.0, 0.0, 200) == pytest.approx(0.0, abs=1e-9)
    assert place[0] == 798.0
    for _ in range(2):
        seek(plan, place, sweep, 0.1, 0.0, 0.0)
    assert place[0] == 0.0


def test_a_robot_that_moved_during_a_sweep_is_not_thrown_back() -> None:
    plan = plan_of(line(3000))
    place, sweep = np.array([100.0, 0.0]), np.zeros(4)
    for k in range(16):
        x = 0.1 + 2e-3 * k
        seek(plan, place, sweep, x, 0.0, 0.0)
        follow(plan, place, x, 0.0, 0.0, 200)
        assert 1e-3 * (place[0] + place[1]) == pytest.approx(x)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 0.9])
@pytest.mark.parametrize("lead_s", [0.0, 0.7, -0.4])
def test_force_and_contained_correction_between_two_rows_are_linear(share: float, lead_s: float) -> None:
    """Rows of unequal length: at the time of the place, and some time ahead or behind."""
    rng = np.random.default_rng(5)
    x = np.cumsum(rng.uniform(0.5, 2.0, 12))
    plan = plan_of(np.stack([x, np.zeros(12), np.zeros(12)], axis=1))
    plan[:, PLAN_TIME] = np.cumsum(rng.uniform(0.2, 0.6, 12))
    plan[:, PLAN_W : PLAN_W + 6] = rng.standard_normal((12, 6))
    plan[:, PLAN_C : PLAN_C + 6] = rng.standard_normal((12, 6))
    plan[:, PLAN_PLAY : PLAN_PLAY + 3] = rng.standard_normal((12, 3))
    place, w, c, play = np.array([5.0, share]), np.zeros(6), np.zeros(6), np.zeros(6)
    wrench_at(plan, place, lead_s, PLAN_W, w)
    contained_at(plan, place, c)
    play_undone(plan, place, play)
    now = np.interp(5.0 + share, np.arange(12), plan[:, PLAN_TIME])
    for k in range(6):
        assert w[k] == pytest.approx(np.interp(now + lead_s, plan[:, PLAN_TIME], plan[:, PLAN_W + k]))
        assert c[k] == pytest.approx(np.interp(now, plan[:, PLAN_TIME], plan[:, PLAN_C + k]))
    for k in range(3):
        assert play[k] == pytest.approx(np.interp(now, plan[:, PLAN_TIME], plan[:, PLAN_PLAY + k]))

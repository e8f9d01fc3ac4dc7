"""The place on the path while nobody is on the way: found wherever the robot stands, in small steps, from its start."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import counterflex
from counterflex.core.arrays import Float
from counterflex.core.records import Records, records
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import pose, rotation
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.primitives.localize import (
    SEEK_ROWS,
    contained_at,
    follow,
    seek,
    wrench_at,
)
from counterflex.runtime.settings import OnlineSettings
from counterflex.runtime.state.planned import PLAN
from counterflex.runtime.step.feed_forward import add_play_compensation


def plan_of(points: Float) -> Records:
    plan = records(PLAN, len(points))
    plan["point"] = points
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
    plan["time"] = np.cumsum(rng.uniform(0.2, 0.6, 12))
    plan["wrench"] = rng.standard_normal((12, 6))
    plan["contained"] = rng.standard_normal((12, 6))
    plan["play"] = rng.standard_normal((12, 3))
    place, w, c, play = np.array([5.0, share]), np.zeros(6), np.zeros(6), np.zeros(6)
    wrench_at(plan, place, lead_s, False, w)
    contained_at(plan, place, c)
    add_play_compensation(plan, place, play)
    time: Float = plan["time"]
    now = float(np.interp(5.0 + share, np.arange(12), time))
    for name, found, at in (("wrench", w, now + lead_s), ("contained", c, now), ("play", play[:3], now)):
        rows: Float = plan[name]
        np.testing.assert_allclose(found, [np.interp(at, time, column) for column in rows.T], rtol=1e-6)


def there_and_back(laps: int) -> Float:
    """100 mm along x and back, in steps of 0.25 mm, so often."""
    x = 0.25e-3 * np.arange(401)
    laps_x = np.concatenate([x if lap % 2 == 0 else x[::-1] for lap in range(laps)])
    return np.stack([laps_x, 0.0 * laps_x, 0.0 * laps_x], axis=1)


@pytest.mark.parametrize("before_mm", [1.0, 2.5, 4.0])
@pytest.mark.parametrize("back_mm", [1.5, 3.0, 6.0, 15.0])
def test_a_robot_that_turned_round_while_nothing_came_from_it_is_found(before_mm: float, back_mm: float) -> None:
    """60 ms without a telegram at a turn left the place before it, and 5 mm farther on the loop held: off path."""
    plan = plan_of(there_and_back(2))
    place = np.array([0.0, 0.0])
    for x_mm in np.arange(0.0, 100.0 - before_mm + 1e-9, 0.1):
        follow(plan, place, 1e-3 * x_mm, 0.0, 0.0, 200)
    worst = 0.0
    for x_mm in np.arange(100.0 - back_mm, 40.0, -0.1):
        worst = max(worst, follow(plan, place, 1e-3 * x_mm, 0.0, 0.0, 200))
    assert worst < 2.6e-3
    assert place[0] == pytest.approx(401 + 4 * 60, abs=2)


def test_a_robot_beside_its_path_is_not_taken_to_a_neighbouring_one() -> None:
    """Passes of a pocket lie 1 mm apart: whoever is 2 mm off the present one, rounding a corner, stays on it."""
    x = 0.25e-3 * np.arange(41)
    plan = plan_of(np.stack([np.r_[x, x[::-1]], np.r_[0.0 * x, 0.0 * x + 1e-3], np.zeros(82)], axis=1))
    place = np.array([10.0, 0.0])
    follow(plan, place, 2.6e-3, 2e-3, 0.0, 200)
    assert place[0] == 10.0


def test_a_robot_whose_feed_is_held_keeps_its_place_where_the_path_passes_often_pair() -> None:
    """Ready again in the middle of the fourth lap it was thought to be on the first, and lost when it went on."""
    plan = plan_of(there_and_back(6))
    place, sweep, row = np.array([0.0, 0.0]), np.zeros(4), 3 * 401 + 200
    x = plan["point"][: row + 1, 0]
    for value in x:
        follow(plan, place, value, 0.0, 0.0, 200)
    before = place.copy()
    for _ in range(40):
        seek(plan, place, sweep, x[-1], 0.0, 0.0)
        follow(plan, place, x[-1], 0.0, 0.0, 200)
    np.testing.assert_array_equal(place, before)
    worst = max(follow(plan, place, value, 0.0, 0.0, 200) for value in plan["point"][row : row + 190, 0])
    assert worst < 1e-9
    for _ in range(40):
        seek(plan, place, sweep, 0.0, 0.0, 0.0)  # started anew: the robot stands at the beginning
    assert place[0] == 0.0


@pytest.mark.parametrize("scatter_um", [0.0, 5.0, 15.0, 30.0])
@pytest.mark.parametrize("seed", range(4))
def test_a_robot_that_stands_at_the_corner_of_a_closed_path_is_at_its_beginning(scatter_um: float, seed: int) -> None:
    """A square that runs on over its first side: the last rows are as near as the first, whatever the pose scatters."""
    side = 0.25e-3 * np.arange(240)
    zero, end = 0.0 * side, 0.06 + 0.0 * side
    x = np.concatenate([side, end, 0.06 - side, zero, side[:31]])
    y = np.concatenate([zero, side, end, 0.06 - side, zero[:31]])
    plan = plan_of(np.stack([x, y, 0.0 * x], axis=1))
    place, sweep, rng = np.array([-1.0, 0.0]), np.zeros(4), np.random.default_rng(seed)
    for _ in range(70):
        p = 1e-6 * scatter_um * rng.standard_normal(3)
        if place[0] >= 0.0:
            seek(plan, place, sweep, p[0], p[1], p[2])
        follow(plan, place, p[0], p[1], p[2], 200)
    assert place[0] < 2.0
    worst = max(follow(plan, place, value, 0.0, 0.0, 200) for value in np.arange(0.0, 0.05, 2e-4))
    assert worst < 1e-6


@pytest.mark.parametrize("silent", [1, 2, 3, 4, 7])
def test_nothing_is_looked_for_before_the_first_telegram(silent: int) -> None:
    """A sweep that had begun without a telegram ended at the place of the robot: it was found in lap three."""
    cell = read_cell(Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml")
    points = there_and_back(4) + np.array([0.0, 0.0, 0.3])
    nothing = np.zeros((len(points), 6))
    plan = LoopPlan(points, np.linspace(0.0, 16.0, len(points)), nothing, np.zeros(len(points)), nothing)
    loop = Loop(cell.chain, OnlineSettings(), cell.T_base_part, plan)
    q = np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])
    for _ in range(silent):
        loop.feed(CycleInputs(T_part_tcp=np.eye(4), q=q, elapsed=0))
        loop.run()
    for _ in range(30):
        loop.feed(CycleInputs(T_part_tcp=pose.make(rotation.about_x(np.pi), points[0]), q=q))
        loop.run()
    assert loop.place == 0.0

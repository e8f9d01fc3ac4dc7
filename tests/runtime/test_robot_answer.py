"""What the robot makes of the correction: short, late, ringing or right, by closed forms of its answer (R19)."""

from __future__ import annotations

import numpy as np
import pytest
from tests.runtime.test_plausibility import FORCE, Plant, blend_in

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.runtime.settings import ForceMode
from counterflex.runtime.state.supervisor import Cause, State

RAMPS = (10, 50, 150)
"""Cycles in which the force comes: a step of a plan, an entry, a slow one."""
BEFORE_S = {"none": (0.200, 0.272, 0.284), "negated": (0.192, 0.212, 0.228)}
"""Time from the begin of the correction to the fault with the test of before, the same plant and ramps."""
SHARE = 0.6
"""Of that time that is left; the dead time and lag that the robot may have are most of it."""


def made(P: Float) -> Plant:
    return Plant(None, P=P, force=ForceMode.MEASURED, normal_only=False).ready()


def time_to_fault(plant: Plant, ramp: int) -> tuple[float, float]:
    """Time (s) and size of the correction (m) from its begin to the fault."""
    begun = -1
    for k in range(400):
        state = plant.cycle(FORCE * blend_in(k, ramp))
        size = float(np.linalg.norm(plant.loop.correction[:3]))
        begun = k if begun < 0 and size > 1e-5 else begun
        if state == State.FAULT:
            assert plant.loop.cause == Cause.WRONG_FRAME
            return (k - begun) * 4e-3, size
    raise AssertionError("no fault")


@pytest.mark.parametrize("which", [0, 1, 2])
@pytest.mark.parametrize(("name", "P"), [("none", np.zeros((3, 3))), ("negated", -np.eye(3))])
def test_a_robot_that_does_nothing_or_the_opposite_is_found_in_half_the_time(name: str, P: Float, which: int) -> None:
    seconds, _ = time_to_fault(made(P), RAMPS[which])
    assert seconds <= SHARE * BEFORE_S[name][which]


@pytest.mark.parametrize(("share", "ends"), [(0.5, True), (0.75, False), (1.4, False), (1.45, True)])
def test_a_lasting_part_is_told_within_a_second_with_its_size_and_is_a_fault_beyond_the_limit(
    share: float, ends: bool
) -> None:
    plant = made(share * np.eye(3))
    told = 0
    for k in range(500):
        state = plant.cycle(FORCE * blend_in(k, 25))
        if told == 0 and plant.loop.result.degraded == Cause.ANSWER_SHORT:
            told = k
        if state != State.ACTIVE:
            break
    short_m = abs(1.0 - share) * float(np.linalg.norm(plant.loop.correction[:3]))
    limit_m = plant.loop.settings.plausibility.missing_m
    assert 0 < told <= 250
    assert (short_m > limit_m) == ends
    assert (plant.loop.state == State.FAULT) == ends
    if ends:
        assert plant.loop.cause == Cause.ANSWER_SHORT
    else:
        assert float(np.linalg.norm(plant.loop.tests.missing)) == pytest.approx(short_m, rel=0.1)


def test_a_part_that_comes_back_is_told_no_longer() -> None:
    plant = made(0.75 * np.eye(3))
    for k in range(300):
        plant.cycle(FORCE * blend_in(k, 25))
    assert plant.loop.result.degraded == Cause.ANSWER_SHORT
    plant.P = np.eye(3)
    for _ in range(250):
        plant.cycle(FORCE)
    assert plant.loop.result.degraded == Cause.NONE


@pytest.mark.parametrize("slower", [1.0, 0.7, 0.5])
@pytest.mark.parametrize("dead", [0, 3])
@pytest.mark.parametrize("hz", [0.5, 1.5, 3.0])
def test_a_right_robot_that_answers_later_than_thought_is_left_alone(slower: float, dead: int, hz: float) -> None:
    """Half as fast, and by three cycles later: entries of a force and forces that swing."""
    plant = made(np.eye(3))
    plant.w0 *= slower
    plant.queue = [np.zeros(3)] * (len(plant.queue) + dead)
    for k in range(600):
        swing = FORCE * (0.6 + 0.4 * np.sin(2.0 * np.pi * hz * 4e-3 * k))
        plant.cycle(swing * (k // 150 % 2))
        assert plant.loop.state == State.ACTIVE
        assert plant.loop.result.degraded == Cause.NONE


@pytest.mark.parametrize("size_mm", [0.15, 0.3])
@pytest.mark.parametrize("tau_s", [0.1, 0.2])
def test_a_robot_that_rings_where_it_stopped_is_held_for_the_cause_alone(size_mm: float, tau_s: float) -> None:
    """The force falls silent, the robot stands: its drives take the load up, along its former motion and across."""
    plant = made(np.eye(3))
    small = 0.5 * FORCE
    for _ in range(200):
        plant.cycle(small)
    right = plant.loop.in_effect.copy()
    stands = 0
    for k in range(400):
        silent = k < 60
        stands = stands + 1 if plant.loop.state == State.HOLD else 0
        t = 4e-3 * stands
        ring = size_mm * MM * np.exp(-t / tau_s) * np.array([np.cos(40.0 * t), 0.8, -0.6]) * (stands > 0)
        y, plant.y = plant.y, plant.y + ring
        plant.cycle(small, move=stands == 0, force_age=5 if silent else 0)
        plant.y = plant.y - ring
        assert np.allclose(y, y)
        assert plant.loop.state in (State.ACTIVE, State.HOLD)
        assert plant.loop.cause in (Cause.NONE, Cause.FORCE_STALE)
    assert plant.loop.state == State.ACTIVE
    assert np.linalg.norm(plant.loop.in_effect[:3] - right[:3]) < 0.1 * MM


def test_drives_that_yield_to_a_sudden_load_are_no_missing_answer() -> None:
    """A third of the bending at first, gone with 0.2 s, as drives with an integral part take a load up."""
    plant = made(np.eye(3))
    yielded, load = np.zeros(3), np.zeros(3)
    for k in range(700):
        new = FORCE * (k // 175 % 2)
        bent = plant.deviation - plant.y
        yielded = yielded * np.exp(-4e-3 / 0.2) + 0.2 * (bent - load)
        load = bent
        plant.y = plant.y + yielded
        plant.cycle(new)
        plant.y = plant.y - yielded
        assert plant.loop.state == State.ACTIVE
        assert plant.loop.result.degraded == Cause.NONE

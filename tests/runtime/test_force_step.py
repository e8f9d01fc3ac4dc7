"""A step of the measured force in the cut that neither plan nor speed explains: told while it lasts, acted on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tests.runtime.test_plausibility import CELL, FEED, FORCE, Plant, Q, straight

from counterflex.core.arrays import Float
from counterflex.core.records import records
from counterflex.core.units import MM
from counterflex.files.cell.online import OnlineTable
from counterflex.robot.elasticity.chain import jacobian
from counterflex.runtime.estimator.fusion import Source
from counterflex.runtime.plausibility import kernel as pk
from counterflex.runtime.plausibility.kernel import idle_is_wrong
from counterflex.runtime.plausibility.limits import Plausibility
from counterflex.runtime.settings import ForceMode, ForceOffset
from counterflex.runtime.state.doubts import LIMITS, MEMORY
from counterflex.runtime.state.supervisor import Cause, State

_MODES = (ForceMode.MEASURED, ForceMode.PILOT, ForceMode.SCALE, ForceMode.FUSED)
_WAYS = [sign * row for row in np.eye(3) for sign in (1.0, -1.0)]


def _cut(plant: Plant, force: Float = FORCE) -> Float | None:
    return force if 0.03 < plant.x < 0.17 else None


def _in_the_plateau(mode: ForceMode, reaction: ForceOffset, **options: Any) -> Plant:
    plant = Plant(straight(), force=mode, force_offset=reaction, **options).ready()
    while plant.x < 0.08:
        plant.cycle(_cut(plant))
        assert plant.loop.state == State.ACTIVE
    return plant


def _doubted(plant: Plant) -> bool:
    return bool(plant.loop.result.doubt & pk.DOUBT_OFFSET)


def _suspected(plant: Plant) -> bool:
    return bool(plant.loop.result.doubt & pk.DOUBT_STEP)


def _told(plant: Plant) -> bool:
    return Cause.FORCE_OFFSET in (plant.loop.result.cause, plant.loop.result.degraded)


def _stepped(plant: Plant, step: Float, cycles: int) -> tuple[int, float]:
    """Cycles until the step is told, and how far the correction has gone with it, m."""
    before, told, gone = plant.loop.correction[:3].copy(), -1, 0.0
    for k in range(cycles):
        plant.cycle(FORCE, sensed=FORCE + step)
        told = k + 1 if told < 0 and _told(plant) else told
        gone = max(gone, float(np.linalg.norm(plant.loop.correction[:3] - before)))
    return told, gone


@pytest.mark.by_turn
@pytest.mark.parametrize("way", _WAYS)
@pytest.mark.parametrize("mode", _MODES)
def test_a_step_of_150_n_in_the_cut_is_told_within_200_ms(mode: ForceMode, way: Float) -> None:
    """R17: in each direction, in each mode; and it goes on being told while it lasts."""
    plant = _in_the_plateau(mode, ForceOffset.TELL)
    told, _ = _stepped(plant, 150.0 * way, 250)
    assert 0 < told * 4e-3 <= 0.2
    assert _told(plant)


@pytest.mark.by_turn
@pytest.mark.parametrize("n", [150.0, -150.0])
@pytest.mark.parametrize("reaction", [ForceOffset.PLAN, ForceOffset.HOLD])
@pytest.mark.parametrize("mode", _MODES)
def test_the_correction_does_not_go_with_a_step(mode: ForceMode, reaction: ForceOffset, n: float) -> None:
    """R17, the pair: only told it goes on with it; as set it is held, or goes on as planned. Neither by 0.1 mm."""
    step = np.array([0.0, n, 0.0])
    _, free = _stepped(_in_the_plateau(mode, ForceOffset.TELL), step, 125)
    plant = _in_the_plateau(mode, reaction)
    told, bounded = _stepped(plant, step, 125)
    assert 0 < told * 4e-3 <= 0.2
    holds = reaction == ForceOffset.HOLD and mode != ForceMode.FUSED
    assert plant.loop.state == (State.HOLD if holds else State.ACTIVE)
    assert plant.loop.result.feed_hold == int(holds)
    assert bounded < 0.1 * MM
    if mode == ForceMode.MEASURED:
        assert free > 0.3 * MM


@pytest.mark.by_turn
@pytest.mark.parametrize("way", np.eye(3))
@pytest.mark.parametrize("mode", _MODES)
def test_a_step_of_80_n_is_told(mode: ForceMode, way: Float) -> None:
    """Where plan and speed stay."""
    told, _ = _stepped(_in_the_plateau(mode, ForceOffset.PLAN), 80.0 * way, 125)
    assert 0 < told * 4e-3 <= 0.2


def test_a_force_that_comes_within_half_a_second_is_told() -> None:
    """No step: found by its means a longer time apart. One that takes ten seconds is not."""
    for seconds, told in ((0.5, True), (10.0, False)):
        plant = _in_the_plateau(ForceMode.MEASURED, ForceOffset.TELL)
        seen = False
        for k in range(300):
            plant.cycle(FORCE, sensed=FORCE + np.array([0.0, min(1.0, 4e-3 * k / seconds) * 150.0, 0.0]))
            seen = seen or _told(plant)
        assert seen == told


def test_a_swing_of_the_arm_is_not_followed_and_not_told() -> None:
    """It swings with 150 N at the lowest mode of the cell and rings down; the force is used again behind it."""
    plant = _in_the_plateau(ForceMode.MEASURED, ForceOffset.HOLD)
    suspected = False
    for k in range(150):
        t, w = 4e-3 * k, 2.0 * np.pi * 8.0
        swing = 150.0 * np.exp(-0.1 * w * t) * np.sin(w * t)
        plant.cycle(FORCE, sensed=FORCE + np.array([0.0, swing, 0.0]))
        suspected = suspected or _suspected(plant)
        assert not _doubted(plant)
        assert plant.loop.state == State.ACTIVE
    assert suspected
    assert not _suspected(plant)


@pytest.mark.parametrize("mode", _MODES)
def test_a_missing_cut_is_none(mode: ForceMode) -> None:
    """A tool that is gone, or a hole in the part, and metal again: the measured force is believed."""
    plant = _in_the_plateau(mode, ForceOffset.HOLD)
    for k in range(400):
        plant.cycle(np.zeros(3) if 50 <= k < 150 else FORCE)
        assert not _doubted(plant)
        assert plant.loop.state == State.ACTIVE
        if k == 145 and mode == ForceMode.MEASURED:
            assert np.linalg.norm(plant.loop.correction[:3]) < 0.1 * MM


@pytest.mark.parametrize("factor", [1.0, 1.6])
@pytest.mark.parametrize("mode", _MODES)
def test_a_load_that_comes_later_than_planned_and_slowly_is_none(mode: ForceMode, factor: float) -> None:
    """The blank begins 20 mm behind where the plan has it, and the load rises for 0.5 s, beyond the planned one."""
    plant = Plant(straight(), force=mode, force_offset=ForceOffset.HOLD).ready()
    while plant.x < 0.15:
        rises = min(1.0, max(0.0, (plant.x - 0.05) / (0.5 * FEED)))
        plant.cycle(factor * rises * FORCE if plant.x > 0.05 else None)
        assert not _doubted(plant)
        assert plant.loop.state == State.ACTIVE


def test_a_force_whose_own_cause_is_known_is_not_called_an_offset() -> None:
    """It leaves its range or is invalid: that is the cause, and its samples are not judged."""
    for cause in (Cause.FORCE_SATURATED, Cause.FORCE_INVALID):
        plant = _in_the_plateau(ForceMode.PILOT, ForceOffset.HOLD)
        for _ in range(100):
            plant.cycle(FORCE, sensed=5.0 * FORCE, soft=cause)
            assert not _doubted(plant)


@pytest.mark.parametrize(("real", "told"), [(1.0, False), (0.0, True)])
def test_motor_currents_tell_the_sensor_from_the_process(real: float, told: bool) -> None:
    """A change of the process is in the torque of the axes, one of the sensor's zero is not."""
    plant = _in_the_plateau(ForceMode.PILOT, ForceOffset.HOLD)
    step, seen = np.array([0.0, 300.0, 0.0]), False
    rotation_base_part = CELL.T_base_part[:3, :3]
    jac = jacobian(CELL.chain, Q)
    sources = Source.FORCE | Source.CURRENTS
    rng = np.random.default_rng(1)
    for k in range(150):
        loaded = real * (k >= 60) * step
        torque = jac[:3].T @ (rotation_base_part @ (FORCE + loaded)) + 40.0 + 5.0 * rng.standard_normal(6)
        plant.cycle(FORCE, sensed=FORCE + (k >= 60) * step, torque=torque, sources=sources)
        seen = seen or _doubted(plant)
    assert seen == told


@pytest.mark.parametrize(("swing_n", "wrong"), [(79.0, False), (0.0, True)])
def test_the_inertia_of_a_rapid_is_no_offset(swing_n: float, wrong: bool) -> None:
    """In the air 80 N are explained by 79 kg and 1 m/s2, and by nothing where the tool moves evenly (R17)."""
    limits, memory = records(LIMITS)[0], records(MEMORY)[0]
    Plausibility().pack(limits, 4e-3, (8.0, 0.1))
    measured = np.array([80.0, 0.0, 0.0, 0.0, 10.0, 0.0])
    found = [idle_is_wrong(measured, True, swing_n, limits, memory) for _ in range(200)]
    assert found[-1] == wrong


def test_a_force_that_comes_back_is_used_again() -> None:
    """A hit: with the plan going on meanwhile, the doubt ends 0.1 s behind the filters' memory."""
    plant = _in_the_plateau(ForceMode.PILOT, ForceOffset.PLAN)
    _stepped(plant, np.array([0.0, 150.0, 0.0]), 100)
    assert _doubted(plant)
    _stepped(plant, np.zeros(3), 80)
    assert not _doubted(plant)
    assert plant.loop.state == State.ACTIVE


def test_the_doubt_lasts_through_the_exit_until_the_zero_is_seen_to_be_right() -> None:
    """In the air a sensor that is still off stays doubted; one that shows nothing there is used again."""
    for zero, doubted in ((150.0, True), (0.0, False)):
        plant = _in_the_plateau(ForceMode.PILOT, ForceOffset.PLAN)
        while plant.x < 0.195:
            load = _cut(plant)
            off = 150.0 if plant.x < 0.17 else zero
            plant.cycle(load, sensed=(np.zeros(3) if load is None else load) + np.array([0.0, off, 0.0]))
        assert _doubted(plant) == doubted


def _scaled(factor: float) -> Callable[[Plant, int], Float]:
    return lambda plant, _: factor * (FORCE if 0.03 < plant.x < 0.17 else np.zeros(3))


def _late(plant: Plant, k: int) -> Float:
    """The stock begins 1 mm sooner and ends 1 mm later than planned."""
    return FORCE if 0.029 < plant.x < 0.171 else np.zeros(3)


def _drifting(plant: Plant, k: int) -> Float:
    """20 N in a minute."""
    drifted: Float = _scaled(1.0)(plant, k) + np.array([0.0, 20.0 / 60.0 * 4e-3 * k, 0.0])
    return drifted


@pytest.mark.long
@pytest.mark.parametrize(
    "force", [*(_scaled(f) for f in (0.5, 0.7, 1.0, 1.5, 2.0)), _late, _drifting],
    ids=["x0.5", "x0.7", "x1", "x1.5", "x2", "late", "drift"],
)  # fmt: skip
@pytest.mark.parametrize("programs", ["goes on", "pauses", "overridden"])
def test_what_is_no_step_is_not_told(force: Callable[[Plant, int], Float], programs: str) -> None:
    """Wrong factors of the planned force, entries and exits off by 1 mm, thermal drift; pauses and feed override."""
    plant = Plant(straight(), force=ForceMode.MEASURED, force_offset=ForceOffset.HOLD).ready()
    speed, k = 1.0, 0
    while plant.x < 0.19 and k < 4000:
        k += 1
        aim = 1.0
        if 400 < k < 900:
            aim = {"goes on": 1.0, "pauses": 0.0, "overridden": 0.4}[programs]
        speed += float(np.clip(aim - speed, -0.025, 0.025))  # 0.16 s from full speed to standing
        plant.x -= FEED * 4e-3 * (1.0 - speed)
        f = force(plant, k) * speed**0.7
        plant.cycle(f)
        assert not _doubted(plant), (k, plant.x)
        assert plant.loop.cause != Cause.FORCE_OFFSET


def test_a_corner_is_no_step() -> None:
    """The force turns with the feed, with a factor of 2 between measured and planned."""
    plan = straight()
    turned = FORCE @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    plan.w_tcp_part[plan.p_part[:, 0] > 0.1, :3] *= 0.0
    plan.w_tcp_part[(plan.p_part[:, 0] > 0.1) & (plan.p_part[:, 0] < 0.17), :3] = turned
    plant = Plant(plan, force=ForceMode.MEASURED, force_offset=ForceOffset.HOLD).ready()
    while plant.x < 0.19:
        load = FORCE if plant.x < 0.1 else turned
        plant.cycle(2.0 * load if 0.03 < plant.x < 0.17 else None)
        assert not _doubted(plant)


def test_a_persons_reset_forgets_the_step() -> None:
    """What was held against the force begins anew."""
    plant = _in_the_plateau(ForceMode.PILOT, ForceOffset.PLAN)
    _stepped(plant, np.array([0.0, 150.0, 0.0]), 100)
    plant.cycle(FORCE, sensed=FORCE + np.array([0.0, 150.0, 0.0]), reset=True)
    assert not _doubted(plant)


@pytest.mark.parametrize(
    ("name", "reaction"), [(n, r) for n, r in zip(("hold", "plan", "tell"), (2, 1, 0), strict=True)]
)
def test_the_cell_file_says_what_follows(name: str, reaction: int) -> None:
    """And holds where it says nothing."""
    assert OnlineTable(force_offset=name).force_offset == name  # type: ignore[arg-type]
    assert OnlineTable().force_offset == "hold"
    assert ForceOffset[name.upper()] == reaction


def test_a_force_that_still_rings_after_a_change_of_speed_is_none() -> None:
    """At 0.4 of the speed it rings by 120 N, stands 60 N off for 0.2 s, and comes back: the plan knew nothing of it."""
    plant = _in_the_plateau(ForceMode.MEASURED, ForceOffset.HOLD)
    for k in range(250):
        plant.x -= 0.6 * 4e-3 * FEED
        stands = -60.0 * min(max(k - 25, 0) / 40.0, 1.0, max(120 - k, 0) / 30.0)
        ring = 120.0 * np.exp(-((k - 20.0) ** 2) / 60.0) + stands
        plant.cycle(FORCE, sensed=FORCE + np.array([ring, 30.0 * min(k / 20.0, 1.0), 0.0]))
        assert not _doubted(plant), k
        assert plant.loop.state == State.ACTIVE

"""The designed tracker controller within the step: what is known ahead, and what stands still without a sample."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import counterflex
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.records import as_reals, records
from counterflex.core.units import DEG, MM, UM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.online import ChannelTimingTable, OnlineTable, TimingTable
from counterflex.geometry import pose, rotation
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.settings import Delays, OnlineSettings
from counterflex.runtime.state.memory import PAST, PAST_ROWS, STATE
from counterflex.runtime.state.supervisor import State
from counterflex.runtime.step.feed_forward import rates

CELL: Cell = read_cell(Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml")
Q = np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])
R = rotation.about_x(np.pi)
T = 0.004
FOLLOW = 0.1
TABLE: dict[str, Any] = {
    "force": "none",
    "tracker": "designed",
    "along_feed": True,
    "orientation": True,
    "follow_ms": 100.0,
    "follow_lag_ms": 90.0,
    "tracker_age_ms": 0.0,
    "correction_mm": 4.0,
    "correction_deg": 0.6,
    "speed_mm_s": 80.0,
    "acceleration_mm_s2": 4000.0,
    "undo_lag_mm": 2.0,
}


def chosen(**changes: Any) -> OnlineSettings:
    return OnlineTable(**{**TABLE, **changes}).settings(None, compensated=False, mode=(8.5, 0.1))


def line(undo_play: Float | None = None) -> LoopPlan:
    x = np.linspace(0.0, 0.4, 1601)
    p = np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1)
    return LoopPlan(p, x / 0.01, np.zeros((len(x), 6)), np.zeros(len(x)), np.zeros((len(x), 6)), undo_play=undo_play)


def running(settings: OnlineSettings, plan: LoopPlan | None = None) -> Loop:
    loop = Loop(CELL.chain, settings, CELL.T_base_part, line() if plan is None else plan)
    start = pose.make(R, np.zeros(3))
    for arm, enable in ((False, False), (True, False), (False, True)):
        loop.feed(CycleInputs(T_part_tcp=start, q=Q, T_part_actual=start, arm=arm, enable=enable))
        loop.given.tracker_late = 0.0
        loop.run()
    assert loop.state == State.ACTIVE
    return loop


def cycle(
    loop: Loop, x: float, off: Float | None = None, *, seen: bool = True, age: int = 0, turn: float = 0.0
) -> Float:
    """One cycle at ``x`` with the tool ``off`` and turned about z from where it should be."""
    nominal = pose.make(R, np.array([x, 0.0, 0.0]))
    actual = pose.make(rotation.about_z(turn) @ R, nominal[:3, 3] + (np.zeros(3) if off is None else off))
    loop.feed(
        CycleInputs(T_part_tcp=nominal, q=Q, T_part_actual=actual if seen else None, enable=True, tracker_age=age)
    )
    loop.given.tracker_late = 0.0
    loop.run()
    return loop.correction.copy()


def test_the_lag_is_sent_ahead_at_a_steady_speed() -> None:
    loop = running(chosen())
    for k in range(250):
        correction = cycle(loop, 0.01 * T * k)
    np.testing.assert_allclose(correction[:3], [FOLLOW * 0.01, 0.0, 0.0], atol=2e-9)
    np.testing.assert_allclose(correction[3:], 0.0, atol=1e-12)


def test_without_it_nothing_is_sent_pair() -> None:
    loop = running(chosen(undo_lag=False))
    for k in range(250):
        correction = cycle(loop, 0.01 * T * k)
    np.testing.assert_allclose(correction, 0.0, atol=1e-12)


def test_a_lost_telegram_does_not_show_in_the_speed() -> None:
    loop = running(chosen())
    k = 0
    for n in range(300):
        gone = 2 if n % 7 == 0 else 1
        k += gone
        nominal = pose.make(R, np.array([0.01 * T * k, 0.0, 0.0]))
        loop.feed(CycleInputs(T_part_tcp=nominal, q=Q, T_part_actual=nominal, enable=True, elapsed=gone))
        loop.given.tracker_late = 0.0
        loop.run()
        if n > 250:
            assert loop.correction[0] == pytest.approx(FOLLOW * 0.01, abs=0.02 * UM)


def test_a_fast_program_is_undone_as_far_as_allowed_and_the_sum_stands_still() -> None:
    loop = running(chosen())
    for k in range(120):
        cycle(loop, 0.1 * T * k, np.array([-9e-4, 0.0, 0.0]))
    forward = loop.step_state.known_ahead[:3]
    assert np.linalg.norm(forward) == pytest.approx(2.0 * MM, rel=1e-9)
    before = loop.step_state.tracker_integral[0]
    cycle(loop, 0.1 * T * 120, np.array([-9e-4, 0.0, 0.0]))
    assert loop.step_state.tracker_integral[0] == before


def test_a_steady_deviation_is_summed_up_in_all_six_components() -> None:
    loop = running(chosen())
    off, turn = np.array([20e-6, -30e-6, 10e-6]), 0.001 * DEG
    for _ in range(100):
        cycle(loop, 0.0, off, turn=turn)
    first = loop.step_state.tracker_integral.copy()
    for _ in range(100):
        cycle(loop, 0.0, off, turn=turn)
    gained = (loop.step_state.tracker_integral - first) / 100
    gain = loop.settings.tuning.gain
    np.testing.assert_allclose(gained[:3], -gain * off, rtol=1e-3)
    np.testing.assert_allclose(gained[3:], [0.0, 0.0, -gain * turn], rtol=1e-3, atol=1e-12)


def test_without_a_sample_the_sum_stands_still_and_the_loop_holds() -> None:
    loop = running(chosen())
    off = np.array([0.0, 50e-6, 0.0])
    for _ in range(50):
        cycle(loop, 0.0, off)
    kept = loop.step_state.tracker_integral.copy()
    sent = loop.correction.copy()
    for age in range(1, 40):
        correction = cycle(loop, 0.0, off, seen=False, age=age)
    np.testing.assert_array_equal(loop.step_state.tracker_integral, kept)
    assert loop.state == State.HOLD
    assert np.linalg.norm(correction - sent) < 5e-6


def test_a_pose_that_is_no_number_is_not_remembered() -> None:
    """A fault; but filters over the past must not keep it for ever, or no reset leads out."""
    loop = running(chosen())
    for k in range(20):
        cycle(loop, 0.01 * T * k)
    cycle(loop, np.nan)
    assert loop.state == State.FAULT
    for k in range(20, 40):
        cycle(loop, 0.01 * T * k)
        assert not loop.result.hard
    for name in ("state", "ring"):
        assert np.all(np.isfinite(as_reals(loop.memory[name])))


def test_what_was_summed_up_is_gone_when_the_correction_is_armed_anew() -> None:
    loop = running(chosen(undo_lag=False))
    off = np.array([0.0, 50e-6, 0.0])
    for _ in range(100):
        cycle(loop, 0.0, off)
    assert loop.correction[1] < -10e-6
    start = pose.make(R, np.zeros(3))
    for arm in [False] * 300 + [True]:
        loop.feed(CycleInputs(T_part_tcp=start, q=Q, T_part_actual=start, arm=arm))
        loop.given.tracker_late = 0.0
        loop.run()
    assert loop.state == State.ARMED
    for _ in range(100):
        correction = cycle(loop, 0.0)
    assert int(loop.state) == State.ACTIVE
    np.testing.assert_allclose(correction, 0.0, atol=1e-9)


def test_what_undoes_play_is_sent_unless_the_program_contains_it() -> None:
    against = np.tile(np.array([0.0, -40e-6, 10e-6]), (1601, 1))
    loop = running(chosen(undo_lag=False), line(against))
    for _ in range(60):
        correction = cycle(loop, 0.05)
    np.testing.assert_allclose(correction[:3], against[0], atol=1e-12)
    compensated = replace(chosen(undo_lag=False), compensated=True)
    loop = running(compensated, line(against))
    for _ in range(60):
        correction = cycle(loop, 0.05)
    np.testing.assert_allclose(correction[:3], 0.0, atol=1e-12)


def test_identified_lags_take_the_place_of_those_stated() -> None:
    timing = TimingTable(drive=ChannelTimingTable(dead_time_ms=(4.0, 6.0), lag_ms=70.0))
    found = OnlineTable(**TABLE).settings(timing, compensated=False, mode=None).delays
    assert found.follow_s == pytest.approx(0.075)
    assert found.follow_lag_s == pytest.approx(0.070)


def test_a_lag_longer_than_the_whole_delay_is_refused() -> None:
    with pytest.raises(InputError, match="longer than the whole delay"):
        replace(chosen(), delays=Delays(follow_s=0.05, follow_lag_s=0.06))


def test_speed_and_acceleration_of_a_uniformly_accelerated_pose_are_exact() -> None:
    """``rates`` takes differences; the half span by which they are late is made up for by the acceleration."""
    v, a = np.array([0.02, -0.01, 0.005]), np.array([0.3, 0.2, -0.1])
    turn, spin = 0.4, 0.9  # rad/s, rad/s2 about z

    def place(k: int) -> Float:
        t = k * T
        return pose.make(rotation.about_z(turn * t + 0.5 * spin * t * t) @ R, v * t + 0.5 * a * t * t)

    ring, state = records(PAST, PAST_ROWS), records(STATE)[0]
    for k in range(1, 20):
        ring[k].nominal[:9], ring[k].nominal[9:] = place(k)[:3, :3].reshape(-1), place(k)[:3, 3]
        ring[k].clock = float(k)
    now, state.ring_row, state.clock = ring[19].nominal.copy(), 19, 19.0
    assert rates(ring, now, T, state, np.zeros(6), np.zeros(12))
    rate, second = state.path_rate, state.path_acceleration
    np.testing.assert_allclose(rate[:3], v + a * 19 * T, rtol=1e-9)
    np.testing.assert_allclose(second[:3], a, rtol=1e-7)
    np.testing.assert_allclose(rate[3:], [0.0, 0.0, turn + spin * 19 * T], atol=1e-6)
    np.testing.assert_allclose(second[3:], [0.0, 0.0, spin], atol=1e-4)


@pytest.mark.parametrize("late", [0, 3, 7])
def test_a_stamped_sample_is_held_against_where_the_tool_was_then(late: int) -> None:
    """At 30 mm/s seven cycles are 0.8 mm: a tool that is where it should be has no deviation."""
    loop = running(chosen(undo_lag=False))
    v = 0.03
    for k in range(60):
        seen = pose.make(R, np.array([v * T * max(0, k - late), 0.0, 0.0]))
        loop.feed(CycleInputs(
            T_part_tcp=pose.make(R, np.array([v * T * k, 0.0, 0.0])),
            q=Q, T_part_actual=seen, tracker_late_s=late * T, enable=True,
        ))  # fmt: skip
        loop.run()
    assert loop.state == State.ACTIVE
    assert np.abs(loop.correction[:3]).max() < 1.0 * UM


def test_an_unstamped_late_sample_is_a_deviation_pair() -> None:
    loop = running(chosen(undo_lag=False))
    for k in range(60):
        seen = pose.make(R, np.array([0.03 * T * max(0, k - 7), 0.0, 0.0]))
        nominal = pose.make(R, np.array([0.03 * T * k, 0.0, 0.0]))
        loop.feed(CycleInputs(T_part_tcp=nominal, q=Q, T_part_actual=seen, tracker_late_s=0.0, enable=True))
        loop.run()
    assert np.abs(loop.correction[:3]).max() > 20.0 * UM

"""Replay: recorded inputs give the recorded answers bit for bit; what is changed, missing or repeated is found."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import counterflex
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation
from counterflex.protocols.processes.control_array import REQUESTS, Request
from counterflex.protocols.robot.port import Counters
from counterflex.protocols.session.senses import Sensing
from counterflex.protocols.session.session import OnlineSession, SessionChecks
from counterflex.protocols.session.telegram_watch import WatchSettings
from counterflex.runtime import record_ring as record
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.estimator.fusion import FusionTuning
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.monitoring.events import Event
from counterflex.runtime.plausibility.axis_check import EXACT
from counterflex.runtime.record_ring import COLUMNS, WIDTH, RecordRing
from counterflex.runtime.replay import Gap, Replay
from counterflex.runtime.settings import ForceMode, OnlineSettings, TrackerMode
from counterflex.runtime.state.memory_layout import words_of
from counterflex.runtime.state.supervisor import State
from counterflex.runtime.state_slots import LoopState

CELL: Cell = read_cell(Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml")
Q = np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])
R = rotation.about_x(np.pi)


def plan() -> LoopPlan:
    x = np.linspace(0.0, 0.2, 401)
    w = np.zeros((401, 6))
    w[60:340, :3] = 40.0, 250.0, -60.0
    return LoopPlan(
        np.stack([x, 0.0 * x, 0.0 * x], axis=1), x / 0.025, w, (w[:, 1] > 0).astype(float), np.zeros((401, 6))
    )


def loop(mode: ForceMode = ForceMode.PILOT, tracker: TrackerMode = TrackerMode.OBSERVER, **changes: Any) -> Loop:
    settings = OnlineSettings(force=mode, tracker=tracker, fusion=FusionTuning(mode=(8.0, 0.1)), **changes)
    return Loop(CELL.chain, settings, CELL.T_base_part, plan())


class _Robot:
    """Stands for the link: a robot on a straight path whose telegrams come, are lost, or hold what cannot be."""

    def __init__(self, seed: int, loss: float, nan: float) -> None:
        self.rng = np.random.default_rng(seed)
        self.loss, self.nan = loss, nan
        self.counter, self.elapsed = 1000, 0
        self.restarted = self.empty = self.clamped = False
        self.enable, self.job = False, 0
        self.counters = Counters()
        self.x = 0.0
        self.waited = 1
        self.commanded_is = self.measured_is = EXACT
        self.held = False
        self.sent: list[Float] = []

    def wait(self, _: float) -> bool:
        self.x += 0.0 if self.held else 1e-4
        self.counter += 4
        self.counters.malformed_in_a_row = int(self.rng.random() < 0.003) * 3
        self.enable = self.counter // 4 % 300 > 120
        if self.rng.random() < self.loss:
            self.waited += 1
            self.elapsed = 0
            return False
        self.elapsed, self.waited = self.waited, 1
        return True

    def fill(self, nominal: Float, q: Float) -> None:
        nominal[:] = np.r_[R.reshape(-1), self.x, 2e-6 * self.rng.standard_normal(2)]
        q[:] = Q + 0.01 * self.rng.standard_normal(6)
        if self.rng.random() < self.nan:
            place, bad = int(self.rng.integers(18)), self.rng.choice([np.nan, np.inf, -np.inf])
            (nominal if place < 12 else q)[place % 12] = bad
        self.commanded = nominal.copy()

    def fill_reported(self, pose_: Float) -> bool:
        pose_[:] = self.commanded
        if self.sent:
            pose_[9:] += self.sent[-1][:3]
        return True

    def forget(self) -> None:
        """Nobody is known."""

    def answer(self, correction: Float, *_: object, feed_hold: bool = False, **__: object) -> bool:
        self.held = feed_hold
        self.sent.append(correction.copy())
        return True


class _Force:
    """Stands for the force sensor."""

    def __init__(self, robot: _Robot) -> None:
        self.robot, self.w_sensor = robot, np.zeros(6)
        self.saturated = self.frozen = False
        self.good, self.first = 4, 0
        self.samples = np.zeros((4, 6))

    def drain(self) -> int:
        rng = self.robot.rng
        self.saturated, self.frozen = bool(rng.random() < 0.002), bool(rng.random() < 0.002)
        self.good = 0 if rng.random() < 0.03 else 4
        cutting = 0.03 < self.robot.x < 0.16
        self.w_sensor[:] = np.r_[30.0, 280.0, -70.0, 0.0, 0.0, 0.0] * cutting + rng.standard_normal(6)
        self.samples[:] = self.w_sensor + rng.standard_normal((4, 6))
        self.first += 4
        return self.good


class _Shown:
    """The reading is the process wrench, beyond doubt."""

    doubt = 0

    def __call__(self, _q: Float, w: Float, _age: float) -> Float:
        return w


class _Tracker:
    """Stands for the tracker: noise, pauses, now and then a wrong reflector."""

    def __init__(self, robot: _Robot) -> None:
        self.robot = robot
        self.T_tracker_target = np.eye(4)
        self.time_ns, self.sigma_m = 0, 0.0

    def drain(self) -> bool:
        rng = self.robot.rng
        far = 5e-3 * (rng.random() < 0.005)
        p = np.array([self.robot.x + far, 1e-4, 0.0]) + 2e-5 * rng.standard_normal(3)
        self.T_tracker_target = pose.make(R, p)
        return bool(rng.random() > 0.1)


def recorded(
    chosen: Loop,
    *,
    seed: int = 0,
    cycles: int = 900,
    loss: float = 0.02,
    nan: float = 0.0,
    states: list[LoopState] | None = None,
    sensor: bool = True,
) -> tuple[Float, list[Float]]:
    """Records of a session, prepared as the loop's process prepares it, what was sent to the robot, and states."""
    robot = _Robot(seed, loss, nan)
    ring = RecordRing()
    reader = RecordRing(ring.name)
    control = np.zeros(REQUESTS, dtype=np.int64)
    session = OnlineSession(
        robot,  # type: ignore[arg-type]
        chosen,
        sensing=Sensing(
            force=_Force(robot) if sensor else None,  # type: ignore[arg-type]
            wrench=_Shown(),  # type: ignore[arg-type]
            tracker=_Tracker(robot),  # type: ignore[arg-type]
            T_part_tracker=np.eye(4),
            T_target_tcp=np.eye(4),
        ),
        ring=ring,
        control=control,
        checks=SessionChecks(settle_cycles=5),
        watch=WatchSettings(clock=False),
    )
    session.loop.run()
    session.loop.reset()
    control[Request.ARM] = 1
    try:
        for k in range(cycles):
            session.cycle(0.0)
            if states is not None and (state := reader.states.take()) is not None:
                states.append(state)
            control[Request.STOP] = robot.rng.random() < 0.001
            if k % 10 == 0:
                control[Request.ARM] = 1
            if k % 97 == 0:
                control[Request.RESET] = 1
        return reader.take(), robot.sent
    finally:
        reader.close()
        ring.close()


@settings(max_examples=12)
@given(
    st.integers(0, 2**31),
    st.sampled_from([ForceMode.MEASURED, ForceMode.PILOT, ForceMode.SCALE]),
    st.sampled_from(list(TrackerMode)),
    st.sampled_from([0.0, 0.02, 0.2]),
    st.sampled_from([0.0, 0.003]),
    st.booleans(),
)
def test_a_session_replays_bit_for_bit(
    seed: int, mode: ForceMode, tracker: TrackerMode, loss: float, nan: float, compensated: bool
) -> None:
    """Losses, NaN, saturation, taring, stops and resets: what the loop was given is in the record."""
    rows, _ = recorded(loop(mode, tracker, compensated=compensated), seed=seed, loss=loss, nan=nan)
    replay = Replay(loop(mode, tracker, compensated=compensated))
    for piece in np.array_split(rows, 7):
        replay(piece)
    assert replay.difference is None
    assert (replay.compared, replay.skipped, replay.gaps) == (len(rows), 0, [])


@settings(max_examples=12)
@given(
    st.integers(0, 2**31),
    st.sampled_from([ForceMode.MEASURED, ForceMode.PILOT, ForceMode.SCALE, ForceMode.FUSED]),
    st.sampled_from(list(TrackerMode)),
    st.sampled_from([0.0, 0.003]),
    st.data(),
)
def test_a_replay_from_any_recorded_state_is_the_same_bit_for_bit(
    seed: int, mode: ForceMode, tracker: TrackerMode, nan: float, data: st.DataObject
) -> None:
    """The beginning of the log is missing, or passed over; the loop that replays has a past of its own."""
    tracker = TrackerMode.NONE if mode == ForceMode.FUSED else tracker
    chosen, states = loop(mode, tracker), list[LoopState]()
    chosen.state_cycles = 37
    rows, _ = recorded(chosen, seed=seed, nan=nan, cycles=600, states=states)
    assert len(states) == len(rows) // 37
    cut = data.draw(st.integers(1, len(rows) - 40))
    first = next(state.cycle for state in states if state.cycle >= cut)
    again = loop(mode, tracker)
    recorded(again, seed=seed + 1, cycles=50)
    replay = Replay(again)
    replay(rows[cut:], states)
    assert replay.difference is None
    assert (replay.begun, replay.gaps) == ([first], [Gap(0, cut)])
    assert (replay.compared, replay.skipped) == (len(rows) - first, first - cut)
    chosen_state = data.draw(st.sampled_from(states))
    later = Replay(again, after=chosen_state.cycle)
    later(rows[:300], states)
    later(rows[300:])
    assert later.difference is None
    assert (later.compared, later.skipped, later.gaps) == (len(rows) - chosen_state.cycle, 0, [])


def test_a_state_that_is_not_the_loops_is_found_or_refused() -> None:
    chosen, states = loop(), list[LoopState]()
    chosen.state_cycles = 100
    rows, _ = recorded(chosen, cycles=300, states=states)
    words = states[0].words.copy()
    assert words.size == words_of(chosen.memory).size
    words[0] ^= 1 << 51  # of the correction
    wrong = Replay(loop(), after=100)
    wrong(rows, [replace(states[0], words=words)])
    assert wrong.difference is not None
    assert wrong.difference.cycle == 101
    with pytest.raises(InputError, match="another loop's"):
        Replay(loop(), after=100)(rows, [replace(states[0], words=words[:-1])])


def test_without_a_force_sensor_nothing_is_said_of_a_missing_cut() -> None:
    """Whether a cut is missing can be seen with a sensor only: none that shows nothing is taken for one."""
    for sensor in (True, False):
        rows, _ = recorded(loop(ForceMode.FUSED, TrackerMode.NONE), loss=0.0, cycles=900, sensor=sensor)
        cuts = rows[:, COLUMNS.index("cutting")] > 0.0
        seen = rows[:, COLUMNS.index("event_seen")].astype(int) >> Event.MISSING_CUT & 1 > 0
        assert np.count_nonzero(cuts) > 300
        assert np.any(seen & cuts) == sensor
        assert sensor or not np.any(rows[:, COLUMNS.index("event_new")])


def test_the_recorded_session_corrects() -> None:
    """The property above says something only when correction acts, holds and faults in such sessions."""
    quiet, sent = recorded(loop(), loss=0.0)
    states = set(quiet[:, record.column("out_state")].astype(int))
    assert {State.READY, State.ARMED, State.ACTIVE} <= states
    assert np.linalg.norm(quiet[:, record.RESULTS : record.RESULTS + 3], axis=1).max() > 20e-6
    np.testing.assert_array_equal(np.array(sent), quiet[:, record.RESULTS : record.RESULTS + 6])
    faulty = [recorded(loop(), seed=seed, loss=0.02, nan=0.003)[0] for seed in range(8)]
    assert {State.HOLD, State.FAULT} <= set(np.concatenate(faulty)[:, record.column("out_state")].astype(int))


def test_a_loop_reset_is_as_a_loop_just_made() -> None:
    """Whatever it went through before: also when the first inputs after it are not numbers."""
    used, fresh = loop(), loop()
    recorded(used, nan=0.003)
    used.reset()
    for k in range(40):
        for one in (used, fresh):
            bad = k in (0, 7)
            one.feed(
                CycleInputs(
                    T_part_tcp=pose.make(R, np.array([1e-3 * k, np.nan if bad else 0.0, 0.0])),
                    q=Q,
                    w_tcp_part=np.ones(6),
                )
            )
            one.run()
        assert used.result.tobytes() == fresh.result.tobytes()


@settings(max_examples=25)
@given(st.integers(0, 299), st.integers(record.RESULTS, record.CYCLE - 1))
def test_one_changed_bit_is_found_where_it_is(cycle: int, column: int) -> None:
    rows = reference_rows().copy()
    bits = rows[cycle : cycle + 1, column].view(np.int64)
    bits ^= 1
    replay = Replay(reference_loop())
    replay(rows)
    found = replay.difference
    assert found is not None
    assert (found.cycle, found.column, found.columns) == (cycle + 1, COLUMNS[column], 1)
    assert found.logged == rows[cycle, column]
    assert found.replayed == reference_rows()[cycle, column]
    assert replay.compared == cycle


@cache
def reference_loop() -> Loop:
    return loop()


@cache
def reference_rows() -> Float:
    """300 cycles of such a loop; read only. Not made by the import: that would load all kernels of a session."""
    rows, _ = recorded(loop(), cycles=300)
    return rows


def test_another_setting_is_found() -> None:
    replay = Replay(loop(proportional=0.999))
    replay(reference_rows())
    assert replay.difference is not None
    assert replay.difference.column.startswith(("wanted", "correction"))


def test_a_gap_is_named_and_nothing_after_it_is_claimed() -> None:
    replay = Replay(reference_loop())
    replay(np.delete(reference_rows(), np.arange(100, 130), axis=0))
    assert replay.gaps == [Gap(100, 30)]
    assert (replay.compared, replay.skipped, replay.difference) == (100, 170, None)
    late = Replay(reference_loop())
    late(reference_rows()[12:])
    assert late.gaps == [Gap(0, 12)]
    assert late.compared == 0


def test_after_a_gap_it_begins_again_where_the_loop_did() -> None:
    replay = Replay(reference_loop())
    replay(np.concatenate([reference_rows()[:50], reference_rows()[60:], reference_rows()]))
    assert replay.gaps == [Gap(50, 10)]
    assert (replay.compared, replay.skipped) == (350, 240)
    assert replay.difference is None


def test_the_hash_is_over_what_the_step_is_given() -> None:
    assert loop().sha256() == reference_loop().sha256()
    assert loop(proportional=0.999).sha256() != reference_loop().sha256()
    changed = plan()
    other = Loop(
        CELL.chain, reference_loop().settings, CELL.T_base_part, replace(changed, time_s=changed.time_s * 1.001)
    )
    assert other.sha256() != reference_loop().sha256()


def test_rows_of_another_shape_are_refused() -> None:
    with pytest.raises(InputError, match="shape"):
        Replay(reference_loop())(np.zeros((3, WIDTH - 1)))
    bad = reference_rows().copy()
    bad[3, record.CYCLE] = np.nan
    with pytest.raises(InputError, match="cycle"):
        Replay(reference_loop())(bad)

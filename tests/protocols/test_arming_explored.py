"""Arming explored: every combination of its conditions in a whole session; any one that is missing keeps it from it."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
import pytest

import counterflex
from counterflex.core.arrays import Float
from counterflex.core.records import as_words
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.protocols.processes.control_array import CONTROL, Kept, Life, Panel, Request
from counterflex.protocols.robot.port import Counters
from counterflex.protocols.session.senses import Sensing
from counterflex.protocols.session.session import OnlineSession
from counterflex.protocols.session.standing import SessionChecks
from counterflex.protocols.session.telegram_watch import WatchSettings
from counterflex.runtime import record_ring
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.settings import ForceMode, OnlineSettings
from counterflex.runtime.state.states import Cause, State

CELL: Cell = read_cell(Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml")
SETTLE, JOB, NOW_NS = 50, 7, 10**12
_LATE_ROWS = 125


class Robot:
    """Stands for a controller that stands, and says what it is told."""

    commanded_is = measured_is = 0
    holds_feed = True

    def __init__(self) -> None:
        self.counter, self.elapsed, self.job = 1000, 1, JOB
        self.restarted = self.empty = self.clamped = self.enable = False
        self.counters = Counters()

    def fill(self, nominal: Float, q: Float) -> None:
        nominal[:] = np.r_[np.diag([1.0, -1.0, -1.0]).reshape(-1), np.zeros(3)]
        q[:] = np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])

    def fill_actual(self, _: Float) -> bool:
        return False

    fill_reported = fill_currents = fill_actual

    def answer(self, *_: object, **__: object) -> bool:
        return True

    def forget(self) -> None:
        """Nobody is known."""


class Force:
    """Stands for a sensor without a load."""

    saturated = frozen = False
    first, new, good = -1, 1, 1

    def __init__(self) -> None:
        self.samples, self.w_sensor = np.zeros((1, 6)), np.zeros(6)

    def drain(self) -> int:
        return self.new


class Shown:
    """The reading is the process wrench."""

    doubt = 0

    def __call__(self, _q: Float, w: Float, _age: float) -> Float:
        return w.copy()


class Ring(SimpleNamespace):
    """Counts records; nobody reads them."""

    count = 0


class Session:
    """A session that is ready, and can be brought back to that."""

    def __init__(self, force: ForceMode = ForceMode.MEASURED, plan: LoopPlan | None = None) -> None:
        self.robot, self.force, self.ring = Robot(), Force(), Ring()
        self.control = np.zeros(CONTROL, dtype=np.int64)
        settings = OnlineSettings(force=force, normal_only=False)
        checks = SessionChecks(settle_cycles=SETTLE, job=JOB, hold_without_panel=True, hold_without_log=True)
        self.run: Any = OnlineSession(
            self.robot,  # type: ignore[arg-type]
            Loop(CELL.chain, settings, CELL.T_base_part, plan),
            sensing=Sensing(force=self.force, wrench=Shown()),  # type: ignore[arg-type]
            control=self.control,
            checks=checks,
            watch=WatchSettings(clock=False),
            clock_ns=lambda: NOW_NS,
        )
        self.control[Panel.NS] = self.control[Life.RUN_NS] = NOW_NS
        for _ in range(4 * SETTLE):
            self.cycle()
        assert self.state == State.READY
        self._words = {name: as_words(array).copy() for name, array in self.run.loop.memory.items()}
        self._control, self._watch = self.control.copy(), self.run.watch.records.copy()

    def back(self) -> None:
        """Ready again, everything as it should be."""
        for name, array in self.run.loop.memory.items():
            as_words(array)[:] = self._words[name]
        self.control[:] = self._control
        robot, force, run = self.robot, self.force, self.run
        robot.enable, robot.clamped, robot.job, robot.elapsed, force.new = False, False, JOB, 1, 1
        force.saturated, self.ring.count, run.trouble = False, 0, ""
        run.watch.records[:] = self._watch
        run._tare.accepted, run._tare.refusals, run._senses.now.force_age = True, 0, 0
        run._senses.now.pause = 0.0
        run._now.silent_cycles = 0
        assert self.state == State.READY

    def cycle(self) -> State:
        self.robot.counter += 4
        self.run.handle_cycle(True)
        return self.state

    @property
    def state(self) -> State:
        return State(int(self.run.loop.state))


def _set(place: str, value: Any) -> Callable[[Session], None]:
    def spoil(session: Session) -> None:
        target: Any = session
        *path, name = place.split(".")
        for step in path:
            target = getattr(target, step)
        setattr(target, name, value)

    return spoil


def _word(place: int, value: int) -> Callable[[Session], None]:
    return lambda session: session.control.__setitem__(place, value)


WRONG: Final = {
    "a telegram too few since the last gap": _set("run.watch.now.good", SETTLE - 2),
    "no zero of the force sensor": _set("run._tare.accepted", False),
    "no reading of the force sensor": _set("force.new", 0),
    "a force sensor at its end": _set("force.saturated", True),
    "another job": _set("robot.job", JOB + 1),
    "a controller that clamps": _set("robot.clamped", True),
    "a program that wants it already": _set("robot.enable", True),
    "a stop that was asked for": _word(Request.STOP, 1),
    "no panel": _word(Panel.NS, 0),
    "a panel that fell silent": _word(Panel.NS, NOW_NS - 1_000_000_001),
    "a process of the run that has died": _word(Life.GONE, 1),
    "a starting process that fell silent": _word(Life.RUN_NS, NOW_NS - 80_000_001),
    "the loop's own failure": _set("run.trouble", "failed"),
    "telegrams lost before this one": _set("robot.elapsed", 4),
}
"""By name: how it is brought about, just beyond its limit."""
ALLOWED: Final = {
    "just enough telegrams": _set("run.watch.now.good", SETTLE - 1),
    "a panel that spoke a second ago": _word(Panel.NS, NOW_NS - 1_000_000_000),
    "a starting process that spoke 80 ms ago": _word(Life.RUN_NS, NOW_NS - 80_000_000),
    "a program that says no job": _set("robot.job", 0),
}
"""Likewise at its limit."""


@pytest.fixture(scope="module")
def session() -> Session:
    return Session()


def test_all_is_well_at_every_limit(session: Session) -> None:
    for count in range(len(ALLOWED) + 1):
        for names in itertools.combinations(ALLOWED, count):
            session.back()
            for name in names:
                ALLOWED[name](session)
            session.control[Request.ARM] = 1
            assert session.cycle() == State.ARMED, names


def test_nothing_is_armed_unless_a_person_asks(session: Session) -> None:
    session.back()
    for _ in range(300):
        assert session.cycle() == State.READY


def test_any_combination_of_what_is_wrong_keeps_it_from_arming_and_a_cause_is_told(session: Session) -> None:
    """All 16 383 of them; a request that was not served does not arm later behind a stop."""
    told = ("a telegram too few since the last gap", "a program that wants it already", "a stop that was asked for")
    silent = {*told, "no zero of the force sensor", "no reading of the force sensor", "telegrams lost before this one"}
    for bits in range(1, 1 << len(WRONG)):
        names = [name for k, name in enumerate(WRONG) if bits >> k & 1]
        session.back()
        for name in names:
            WRONG[name](session)
        session.control[Request.ARM] = 1
        state = session.cycle()
        assert state in (State.READY, State.IDLE, State.FAULT), names
        if not set(names) <= silent:
            assert session.run.loop.result.cause != 0, names


@pytest.mark.parametrize("word", ["log trouble", "log late"])
def test_a_log_that_is_not_written_keeps_it_from_arming(session: Session, word: str) -> None:
    session.back()
    run = session.run
    run.ring = session.ring

    def lost() -> bool:
        session.cycle()
        return bool(run.loop.result.soft == Cause.LOG_LOST)

    try:
        assert not lost()
        session.ring.count = _LATE_ROWS
        assert not lost()
        if word == "log late":
            session.ring.count = _LATE_ROWS + 1
        else:
            session.control[Kept.TROUBLE] = 1
        assert lost()
        session.control[Request.ARM] = 1
        assert session.cycle() < State.ARMED
    finally:
        run.ring = None


def test_what_was_asked_for_in_vain_arms_as_soon_as_nothing_is_wrong_but_never_over_a_stop(session: Session) -> None:
    session.back()
    session.robot.clamped = True
    session.control[Request.ARM] = 1
    assert session.cycle() == State.READY
    session.control[Request.STOP] = 1
    session.robot.clamped = False
    for _ in range(5):
        assert session.cycle() == State.READY
    session.control[Request.STOP] = 0
    assert session.cycle() == State.ARMED
    assert session.control[Request.ARM] == 0  # served: it does not arm a second time by itself
    session.control[Request.STOP] = 1
    assert session.cycle() == State.READY
    session.control[Request.STOP] = 0
    for _ in range(5):
        assert session.cycle() == State.READY


# ---- A force sensor that the estimator of all sources does without hides nothing ---------------------------------


@pytest.fixture(scope="module")
def fused() -> Session:
    """A plan is left where there is no force; records are counted."""
    p = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0]])
    plan = LoopPlan(p, np.array([0.0, 1.0]), np.zeros((2, 6)), np.ones(2), np.zeros((2, 6)))
    session = Session(ForceMode.FUSED, plan)
    session.run.ring = session.ring
    return session


HOLDS: Final = {
    "log trouble": (_word(Kept.TROUBLE, 1), Cause.LOG_LOST),
    "log late": (_set("ring.count", record_ring.MOST + 1), Cause.LOG_LOST),
    "no panel": (WRONG["no panel"], Cause.PANEL_LOST),
    "a panel that fell silent": (WRONG["a panel that fell silent"], Cause.PANEL_LOST),
    "a controller that clamps": (WRONG["a controller that clamps"], Cause.CLAMPED_BY_ROBOT),
    "a starting process that fell silent": (WRONG["a starting process that fell silent"], Cause.RUN_LOST),
}
"""By name: how it is brought about, and the cause of the hold."""


@pytest.mark.parametrize("saturated", [False, True])
@pytest.mark.parametrize("name", HOLDS)
def test_a_hold_of_the_session_comes_in_its_cycle_whether_or_not_the_force_is_good(
    name: str, saturated: bool, fused: Session
) -> None:
    fused.back()
    fused.control[Request.ARM] = 1
    assert fused.cycle() == State.ARMED
    fused.robot.enable = True
    fused.force.saturated = saturated
    for _ in range(20):
        assert fused.cycle() == State.ACTIVE
    assert fused.run.loop.result.degraded == (Cause.FORCE_SATURATED if saturated else Cause.NONE)
    spoil, cause = HOLDS[name]
    spoil(fused)
    assert fused.cycle() == State.HOLD
    assert fused.run.loop.result.cause == cause


@pytest.mark.parametrize("name", ["another job", "no panel", "a controller that clamps"])
def test_what_keeps_it_from_arming_is_told_also_behind_a_bad_force(name: str, fused: Session) -> None:
    told = []
    for saturated in (False, True):
        fused.back()
        fused.force.saturated = saturated
        WRONG[name](fused)
        fused.control[Request.ARM] = 1
        for _ in range(20):
            assert fused.cycle() <= State.READY
        told.append(Cause(int(fused.run.loop.result.cause)))
    assert told[0] != Cause.NONE
    assert told == [told[0]] * 2

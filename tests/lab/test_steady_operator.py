"""Who keeps a long run going: on the loop and its supervisor, on the virtual clock; and what its times say."""

from __future__ import annotations

import json
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from counterflex.app.run.operator_requests import Clock, ask
from counterflex.core.errors import Interrupted, OutputError
from counterflex.integrations.kuka.simulated import RsiContext
from counterflex.protocols.processes.control_array import Life, Request
from counterflex.protocols.system.realtime import locked_kb, prepared
from counterflex.protocols.system.signals import heard_when_asked
from counterflex.runtime.state.supervisor import State
from counterflex_lab.composed import endurance
from counterflex_lab.faults.rig import PATIENT, Rig
from counterflex_lab.soak import soak
from counterflex_lab.soak.figures import figures
from counterflex_lab.soak.operator import PATIENCE, SteadyOperator, requested_words
from counterflex_lab.soak.played_program import Phase, PlayedProgram
from counterflex_lab.soak.processes import BLOCK
from counterflex_lab.soak.replay_figures import active, in_standstill, micro
from counterflex_lab.soak.timed_block import NOT_REPORTED, Block, Times


@pytest.mark.parametrize("state", [state.name.lower() for state in State])
def test_what_an_operator_asks_for(state: str) -> None:
    held, free = requested_words(state, feed_hold=True), requested_words(state, feed_hold=False)
    assert free == {"fault": "reset", "ready": "arm"}.get(state, "")
    assert held == ("reset" if state in ("fault", "ready", "idle") else "")


class Kept:
    """A rig whose robot program obeys and is started again, and an operator who looks every half second, or never."""

    def __init__(self, *, attended: bool) -> None:
        self.rig = Rig(force=lambda _: np.array([0.0, 450.0, 0.0]), context=RsiContext(timeout=PATIENT))
        self.program = PlayedProgram(100, again=50, pause=100)
        self.attended = attended
        self.rig.control[Life.MAY_ARM] = 1
        self.operator = SteadyOperator(self.ask)
        self.ends: list[str] = []

    def ask(self, action: str) -> dict[str, Any]:
        clock = Clock(self.rig.clock_ns, lambda _: self.cycle())
        return ask(self.rig.control, action, clock=clock)

    def cycle(self) -> None:
        rig, program = self.rig, self.program
        rig.paused = program.phase == Phase.ENDED
        rig.enable = rig.feed = program.enabled
        rig.cycle()
        robot = rig.robot
        why = program.cycle(
            int(rig.state), answered=not robot.refused, feed_hold=robot.feed_hold, stopped=robot.stopped
        )
        if why:
            self.ends.append(why)
            rig.restart_robot(robot.counter + 60_000)

    def run(self, seconds: float, stalls: tuple[tuple[float, int], ...] = ()) -> float:
        """Some time; the loop's process stands still for some cycles at some times. Returns the share of it active."""
        begin, looked = self.rig.cycle_count, self.rig.cycle_count
        left = list(stalls)
        while (now := self.rig.cycle_count) - begin < seconds / 4e-3:
            if left and now - begin >= left[0][0] / 4e-3:
                _, cycles = left.pop(0)
                self.rig.frozen = True
                for _ in range(cycles):
                    self.cycle()
                self.rig.frozen = False
            if self.attended and now - looked >= 125:
                looked = now
                self.operator.look(self.rig.now_s)
            self.cycle()
        states = self.rig.seen.state[begin:]
        return states.count(State.ACTIVE) / len(states)


@pytest.fixture
def kept(request: pytest.FixtureRequest) -> Iterator[Kept]:
    one = Kept(attended=request.param)
    yield one
    one.rig.close()


STALLS = ((4.0, 5), (9.0, 15), (14.0, 400))
"""s and cycles: a standstill that is a hold, then two that are faults; in the second the robot program is given up."""


@pytest.mark.long
@pytest.mark.parametrize("kept", [True, False], indirect=True)
def test_a_run_goes_on_only_where_an_operator_sees_to_it(kept: Kept) -> None:
    kept.rig.control[Request.ARM] = 1
    share = kept.run(24.0, STALLS)
    seen = kept.rig.seen
    if kept.attended:
        assert share > 0.75
        assert kept.rig.state == State.ACTIVE
        assert kept.operator.counts["reset"] == 2
        resets = [event["cause"] for event in kept.operator.events if event["action"] == "reset"]
        assert resets == ["telegrams_late", "session_restarted"]
        assert kept.ends == ["Stop", "no answer", "Stop"]
    else:
        assert share < 0.4
        assert kept.rig.state == State.FAULT
    # Attended or not: out of a fault only by idle, to active only by armed, and not a step beyond the limit.
    changes = {(a, b) for a, b in zip(seen.state, seen.state[1:], strict=False) if a != b}
    assert {b for a, b in changes if a == State.FAULT} <= {State.IDLE}
    assert {a for a, b in changes if b == State.ACTIVE} <= {State.ARMED, State.HOLD}
    sessions = np.array(seen.session)
    steps = np.linalg.norm(np.diff(np.array(seen.correction_m), axis=0), axis=1)
    same = sessions[1:] == sessions[:-1]
    assert np.max(steps[same]) <= 4 * kept.rig.step_limit_m + 1e-9


def test_events_and_refusals_are_counted() -> None:
    answers: list[dict[str, Any]] = [
        {"state": "fault", "feed_hold": True, "cause": "telegrams_late"},
        {"done": False},
        {"state": "fault", "feed_hold": True, "cause": "telegrams_late"},
        {"done": True},
        {"state": "active", "feed_hold": False, "cause": "none"},
    ]
    asked: list[str] = []

    def ask(action: str) -> dict[str, Any]:
        asked.append(action)
        return answers.pop(0)

    operator = SteadyOperator(ask)
    assert [operator.look(1.0 * k) for k in range(3)] == ["", "reset", ""]
    assert asked == ["status", "reset", "status", "reset", "status"]
    assert dict(operator.counts) == {"reset refused": 1, "reset": 1}
    assert operator.events == [{"seconds": 1.0, "action": "reset", "state": "fault", "cause": "telegrams_late"}]


def test_a_recorder_that_stands_still_for_a_while_is_waited_for() -> None:
    silent = True

    def ask(_: str) -> dict[str, Any]:
        if silent:
            raise OutputError("the run does not answer")
        return {"state": "active", "feed_hold": False, "cause": "none"}

    operator = SteadyOperator(ask)
    for _ in range(PATIENCE - 1):
        operator.look(0.0)
    silent = False
    operator.look(0.0)
    silent = True
    for _ in range(PATIENCE - 1):
        operator.look(0.0)
    with pytest.raises(OutputError, match="does not answer"):
        operator.look(0.0)
    assert operator.counts["no answer"] == 2 * PATIENCE - 1


def block_of(states: list[int], reply: list[float], woken: list[float], **counts: int) -> Block:
    times = Times(len(states))
    for told, answer_s, woken_s in zip(states, reply, woken, strict=True):
        times.add(answer_s, 60e-6 if woken_s < 0.01 else np.nan, 0.0, woken_s, told)
    for name, value in counts.items():
        setattr(times, name, value)
    return times.block(1e-4, 3)


def test_cycles_are_told_apart() -> None:
    ACTIVE, HOLD, lost = int(State.ACTIVE), int(State.HOLD), np.nan
    block = block_of(
        [NOT_REPORTED, ACTIVE, ACTIVE, NOT_REPORTED, NOT_REPORTED, HOLD, ACTIVE, ACTIVE],
        [lost, 2e-4, 2e-4, lost, lost, 3e-4, 2e-4, lost],
        [0.0, 0.0, 0.0, 20e-3, 0.0, 0.0, 0.0, 0.0],
        missed=5,
        paused=2,
        feed_held=1,
    )
    np.testing.assert_array_equal(active(block), np.array([1, 1, 1, 1, 1, 0, 1, 1], dtype=bool))
    np.testing.assert_array_equal(in_standstill(block), np.array([0, 0, 1, 1, 1, 0, 0, 0], dtype=bool))
    minutes: list[dict[str, float]] = [
        {"cycles": 8, "active": 7, "held": 1, "missed": 5, "without_session": 2, "minute": k + 1} for k in (0, 1)
    ]
    columns = ("reply_p50_us", "reply_p99_us", "echo_p50_us", "echo_p99_us")
    minutes = [row | dict.fromkeys(columns, 200.0) for row in minutes]
    memory = ("loop_mb", "recorder_mb", "loop_files", "recorder_files")
    samples = [{"seconds": 5.0 * k, **dict.fromkeys(memory, 10.0 + k)} for k in range(20)]
    found = figures([block, block], minutes, samples)
    assert (found["telegrams"], found["cycles"], found["active_share"]) == (16, 30, round(14 / 30, 4))
    assert (found["unanswered"], found["unanswered_active"]) == (8, 8)
    assert found["standstill"] == {
        "cycles": 6, "missed": 10, "unanswered": 4, "unanswered_active": 4, "longest_ms": 20.0,
    }  # fmt: skip
    assert found["reply_us"]["n"] == 16
    assert found["reply_active_outside_us"]["n"] == 8
    assert found["reply_us"]["p50"] == 300.0  # of 16 the eighth: half of them never came
    assert found["growth_per_hour"]["loop_mb"]["slope"] == pytest.approx(720.0)  # 1 MB in 5 s
    assert found["growth_per_hour"]["reply_p50_us"] is None


def test_no_time_is_no_figure() -> None:
    assert micro(np.zeros(0))["n"] == 0
    assert np.isnan(micro(np.zeros(0))["p50"])
    assert micro(np.array([1e-6, np.nan]))["max"] == np.inf


def test_what_the_system_says_of_a_process() -> None:
    assert locked_kb("Name:\tx\nVmLck:\t    1024 kB\nVmRSS:\t 5 kB\n") == 1024
    assert locked_kb("Name:\tx\n") == 0
    assert locked_kb("VmLck:\tmuch\n") == 0
    nobody = prepared(None)
    assert not nobody.fifo
    assert not nobody.locked


class Pipe:
    """What a cell tells: a block each time, and its end once it was asked to halt."""

    def __init__(self, block: Block, most: int = 1000) -> None:
        self.block, self.most, self.halted, self.told = block, most, threading.Event(), 0
        self.pressed = False

    def poll(self, _: float) -> bool:
        if self.told == 2 and not self.pressed:
            self.pressed = True
            signal.raise_signal(signal.SIGINT)
        return True

    def recv(self) -> Block | None:
        self.told += 1
        return None if self.halted.is_set() or self.told > self.most else self.block


def watched(pipe: Pipe) -> tuple[soak._Watched, list[float]]:
    """What the job keeps of a cell that plays 160 cycles in blocks of 16."""
    told: list[float] = []
    looks: Any = SimpleNamespace(sample=lambda: {"loop_mb": 1.0})
    out = soak._Watched(SteadyOperator(lambda _: {"state": "active", "feed_hold": False, "cause": "none"}))
    watch = soak._Watch(out, looks, pipe, SimpleNamespace(), 160, lambda done, _="": told.append(done))  # type: ignore[arg-type]
    with heard_when_asked() as asked:
        watch.watch(asked, pipe.halted)
    return out, told


def test_a_run_that_is_interrupted_keeps_what_it_has_measured() -> None:
    """An hour ended by Ctrl-C in its last minute had written nothing."""
    block = block_of([State.ACTIVE] * 8, [300e-6] * 8, [0.0] * 8)
    out, _ = watched(Pipe(block))
    assert out.interrupted
    assert len(out.blocks) == 3  # what was on its way, too
    whole, _ = watched(Pipe(block, most=1))
    assert not whole.interrupted
    assert len(whole.blocks) == 1
    assert len(whole.samples) == 1


def test_progress_is_what_the_cell_has_played_not_the_time_that_passed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine that stands still showed 100 %, and more and more time left."""
    now = [0.0]
    monkeypatch.setattr(soak, "time", SimpleNamespace(monotonic=lambda: now[0]))
    block, pipe = block_of([State.ACTIVE] * 8, [300e-6] * 8, [0.0] * 8, paused=8), SimpleNamespace()
    told: list[float] = []
    looks: Any = SimpleNamespace(sample=lambda: {"loop_mb": 1.0})
    out = soak._Watched(SteadyOperator(lambda _: {"state": "active", "feed_hold": False, "cause": "none"}))
    watch = soak._Watch(out, looks, pipe, SimpleNamespace(), 10 * BLOCK, lambda done, _="": told.append(done))  # type: ignore[arg-type]

    def poll(_: float) -> bool:
        now[0] += 6.0
        return now[0] > 3000.0

    pipe.poll, pipe.recv = poll, lambda: None
    watch.watch(lambda: False, threading.Event())
    assert max(told) < 0.13  # one block may have been played since the last one was told, not more
    assert block.paused == 8


def test_hours_of_simulated_time_that_are_interrupted_are_written(tmp_path: Path) -> None:
    """No row was written, and the summary said that a rule was broken."""

    def progress(fraction: float, what: str = "") -> None:
        if fraction > 0.4:
            raise Interrupted("as Ctrl-C")

    done = endurance.run(tmp_path, minutes=0.5, mode="measured", stretch_s=5.0, progress=progress)
    assert done.interrupted
    assert not done.broken
    assert [row["hours"] for row in done.rows[:2]] == [round(k * 5.0 / 3600.0, 4) for k in (1, 2)]
    last = done.rows[-1]
    assert 2990 < last["cycles"] < 3600
    assert last["written"] == last["replayed"] > 2500
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert (summary["interrupted"], len(summary["stretches"])) == (True, len(done.rows))
    assert len((tmp_path / "stretches.csv").read_text(encoding="utf-8").splitlines()) == len(done.rows) + 1


def test_the_first_signal_is_heard_where_the_job_asks_and_the_second_at_once() -> None:
    counted: list[int] = []

    def former(number: int, _: Any) -> None:
        counted.append(number)
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, former)
    try:
        with heard_when_asked() as asked:
            assert not asked()
            signal.raise_signal(signal.SIGINT)
            assert asked()
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is former
    finally:
        signal.signal(signal.SIGINT, before)
    assert counted == [signal.SIGINT] * 2  # who counts them hears of both

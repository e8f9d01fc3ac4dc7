"""A played cell: its robot program, and its telegrams on a clock that stands still for some cycles."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from counterflex.geometry import pose
from counterflex.integrations.kuka.link.config import parse_config
from counterflex.integrations.kuka.link.telegram import answer_writer, robot_reader
from counterflex.integrations.kuka.simulated import FakeRsi, RsiContext
from counterflex.protocols.tracker.telegram import DATAGRAM
from counterflex.twin.devices.path_answer import PathAnswer
from counterflex_lab.soak import recorded_cell
from counterflex_lab.soak.played_program import ACTIVE, ARMED, NO_TAG, PlayedProgram
from counterflex_lab.soak.recorded_cell import ReplayedCell
from counterflex_lab.soak.recorded_pass import SAMPLES, RecordedPass
from counterflex_lab.soak.timed_block import NOT_REPORTED, Block

READY, HOLD, FAULT = 1, 4, 6
PERIOD = 4e-3
GATE = 20
ROWS = 400
CONFIG = (
    "<ROOT><CONFIG><IP_NUMBER>127.0.0.1</IP_NUMBER><PORT>49152</PORT><SENTYPE>Counterflex</SENTYPE></CONFIG>"
    "<SEND><ELEMENTS>"
    + "".join(f'<ELEMENT TAG="DEF_{t}" TYPE="DOUBLE" INDX="INTERNAL"/>' for t in ("RIst", "RSol", "AIPos", "ASPos"))
    + '<ELEMENT TAG="DEF_Delay" TYPE="LONG" INDX="INTERNAL"/><ELEMENT TAG="Enable" TYPE="BOOL" INDX="1"/>'
    + "</ELEMENTS></SEND><RECEIVE><ELEMENTS>"
    + "".join(
        f'<ELEMENT TAG="RKorr.{a}" TYPE="DOUBLE" INDX="{i}" HOLDON="1"/>' for i, a in enumerate("XYZABC", start=1)
    )
    + '<ELEMENT TAG="Stop" TYPE="BOOL" INDX="7" HOLDON="1"/><ELEMENT TAG="FeedHold" TYPE="BOOL" INDX="8" HOLDON="1"/>'
    + '<ELEMENT TAG="State" TYPE="LONG" INDX="9" HOLDON="1"/></ELEMENTS></RECEIVE></ROOT>'
)


def gone_on(program: PlayedProgram, cycles: int, told: int, **given: Any) -> list[str]:
    said = {"answered": True, "feed_hold": False, "stopped": "", **given}
    return [program.cycle(told, **said) for _ in range(cycles)]


def running() -> PlayedProgram:
    program = PlayedProgram(GATE, again=10, pause=5, unanswered=8, uncorrected=6)
    gone_on(program, GATE, ARMED)
    assert program.enabled
    return program


def test_the_program_waits_until_it_is_to_be_corrected() -> None:
    program = PlayedProgram(GATE)
    gone_on(program, 10 * GATE, READY)
    assert not program.enabled
    assert program.place == 0
    gone_on(program, 1, ARMED)
    assert program.enabled
    blind = PlayedProgram(GATE)
    gone_on(blind, GATE - 1, NO_TAG)
    assert not blind.enabled
    gone_on(blind, 1, NO_TAG)
    assert blind.enabled


def test_a_feed_hold_lets_it_stand_on_the_path_and_go_on_from_there() -> None:
    program = running()
    gone_on(program, 30, ACTIVE)
    assert program.place == 30
    gone_on(program, 40, HOLD, feed_hold=True)
    assert (program.place, program.held_cycles) == (30, 40)
    program.go_on(7)  # nobody looked: it still stands
    assert (program.place, program.held_cycles) == (30, 47)
    gone_on(program, 3, ACTIVE)
    assert program.place == 33
    program.go_on(7)
    assert program.place == 40


@pytest.mark.parametrize(
    ("told", "given", "cycles", "why"),
    [
        (FAULT, {"stopped": "Stop"}, 1, "Stop"),
        (ACTIVE, {"answered": False}, 8, "no answer"),
        (READY, {}, 6, "not corrected"),
    ],
)
def test_it_is_ended_and_started_again_at_its_beginning(
    told: int, given: dict[str, Any], cycles: int, why: str
) -> None:
    program = running()
    gone_on(program, 30, ACTIVE)
    assert gone_on(program, cycles, told, **given) == [""] * (cycles - 1) + [why]
    assert program.phase.name == "ENDED"
    gone_on(program, 5, NOT_REPORTED, answered=False)
    assert program.phase.name == "WAITS"
    assert program.place == 0
    gone_on(program, 500, READY)  # it waits for whoever arms it, without any limit
    gone_on(program, 500, FAULT, answered=False)
    assert not program.enabled
    gone_on(program, 1, ARMED)
    assert program.enabled
    assert program.ends == 1


class Clock:
    """Stands for the module ``time``: sleeping advances it, and once it stands still for longer than was asked for."""

    def __init__(self) -> None:
        self.now = 5.0
        self.stalls: dict[int, float] = {}
        self.slept = 0

    def perf_counter(self) -> float:
        return self.now

    monotonic_ns = staticmethod(lambda: 0)

    def sleep(self, seconds: float) -> None:
        self.now += seconds + self.stalls.pop(self.slept, 0.0)
        self.slept += 1


class Answered(ReplayedCell):
    """Its telegrams are answered by the test, 0.2 ms later, and kept with their times."""

    def __init__(self, clock: Clock, **chosen: Any) -> None:
        turns = np.broadcast_to(np.eye(4), (ROWS, 4, 4)).copy()
        turns[:, 0, 3] = 1e-4 * np.arange(ROWS)
        played = RecordedPass(
            T_part_nominal=turns,
            T_part_actual=turns.copy(),
            q_command=np.zeros((ROWS, 6)),
            q_actual=np.zeros((ROWS, 6)),
            w_sensor=np.zeros((ROWS, SAMPLES, 6)),
            p_tracker_target=np.zeros((ROWS, SAMPLES, 3)),
            quat_wxyz=np.broadcast_to(pose.make()[0], (ROWS, SAMPLES, 4)).copy(),
            R_tracker_part=np.eye(3),
        )
        config = parse_config(CONFIG.encode(), "x")
        super().__init__(
            played, FakeRsi(config, RsiContext(timeout=1 << 30)), **({"answer": PathAnswer(0.0, 0.0)} | chosen)
        )
        self.clock, self.writer, self.reader = clock, answer_writer(config), robot_reader(config)
        self.sent: list[tuple[float, int, float, float]] = []
        self.says: dict[str, float] = {"State": ARMED}
        self.silent: set[int] = set()
        self.then: dict[int, dict[str, float]] = {}

    def _await(self, own: Any, asked: float, end: float, answers: Any) -> tuple[bytes | None, float]:  # type: ignore[override]
        if own is self._echo:
            return b"", 60e-6
        if self.sent and self.sent[-1][1] == self.controller.counter:  # asked again within the cycle: nothing came yet
            self.clock.now = max(self.clock.now, end)
            return None, np.nan
        k = len(self.sent)
        self.says |= self.then.pop(k, {})
        named = dict(zip(self.reader.names, self.reader.values, strict=True))
        self.sent.append((asked, self.controller.counter, named["RSol.X"], float(self.controller.enabled)))
        if k in self.silent:
            self.clock.now = max(self.clock.now, end)
            return None, np.nan
        for name, value in self.says.items():
            self.writer.values[self.writer.place(name)] = value
        self.clock.now = asked + 0.2e-3
        assert answers(f"<IPOC>{self.controller.counter}</IPOC>".encode())
        return self.writer.telegram(self.controller.counter), 0.2e-3

    def _telegram(self, commanded: int, row: int) -> bytes:
        data = super()._telegram(commanded, row)
        self.reader.read_bytes(data)
        return data


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    out = Clock()
    monkeypatch.setattr(recorded_cell, "time", out)
    return out


def played(cell: Answered, cycles: int, **chosen: Any) -> list[Block]:
    blocks: list[Block] = []
    cell.run(("127.0.0.1", 9), cycles, on_block=blocks.append, echo=("127.0.0.1", 9), **chosen)
    cell.close()
    return blocks


def keeps_time(cell: Answered) -> None:
    """Counter and time go together, to the lateness that a cycle may have."""
    asked, counter = (np.array([entry[i] for entry in cell.sent]) for i in (0, 1))
    late = asked - asked[0] - 1e-3 * (counter - counter[0])
    assert np.all(np.abs(late) <= 0.5 * PERIOD + 1e-9)


def test_telegrams_come_every_cycle_and_are_timed(clock: Clock) -> None:
    cell = Answered(clock, program=PlayedProgram(GATE))
    first, second, last = played(cell, 100, block=40)
    assert [len(block.reply_s) for block in (first, second, last)] == [40, 40, 20]
    np.testing.assert_allclose(first.reply_s, 0.2e-3)
    np.testing.assert_allclose(first.echo_s, 60e-6)
    np.testing.assert_allclose(np.diff([entry[0] for entry in cell.sent]), PERIOD, atol=1e-9)
    assert {entry[3] for entry in cell.sent[:GATE]} == {0.0}
    assert {entry[3] for entry in cell.sent[GATE:]} == {1.0}
    assert np.ptp([entry[2] for entry in cell.sent[:GATE]]) == 0.0
    np.testing.assert_allclose(np.diff([entry[2] for entry in cell.sent[GATE:]]), 0.1, atol=1e-6)
    np.testing.assert_array_equal(second.reported_state, ARMED)
    assert (last.missed, last.paused, last.held_cycles, last.ended) == (0, 0, 0, ())


@pytest.mark.parametrize("stall_s", [1.5e-3, 5e-3, 23e-3, 400e-3])
def test_a_controller_keeps_its_time_while_the_machine_stands_still(clock: Clock, stall_s: float) -> None:
    cell = Answered(clock, program=PlayedProgram(GATE))
    clock.stalls[4 * 50 - 1] = stall_s  # in the sleep before telegram 50 is due; the first one is due at once
    (block,) = played(cell, 80, block=80)
    keeps_time(cell)
    assert block.missed == int(stall_s / PERIOD + 0.5)
    assert np.max(block.woken_s) == pytest.approx(stall_s, abs=1e-9)
    assert cell.refused == block.missed  # by the controller's own count these were not answered
    x = np.array([entry[2] for entry in cell.sent])  # and the program went on
    counter = np.array([entry[1] for entry in cell.sent])
    steps = np.diff(counter) / 4
    np.testing.assert_allclose(np.diff(x)[GATE:], 0.1 * steps[GATE:], atol=1e-6)


def test_a_correction_goes_on_being_answered_while_the_machine_stands_still(clock: Clock) -> None:
    """What is in effect at the end depends on the time that has passed, not on how many cycles were missed in it."""
    reached = []
    for stall_s, cycles in ((0.0, 60), (20 * PERIOD, 40)):
        cell = Answered(clock, answer=PathAnswer(12e-3, 5.0, 0.7), program=PlayedProgram(GATE))
        cell.then = {30: {"RKorr.X": 0.5}}
        cell.clock.slept = 0
        cell.clock.stalls[4 * 35 - 1] = stall_s
        (block,) = played(cell, cycles, block=60)
        assert block.missed == round(stall_s / PERIOD)
        reached.append(cell._answer.value[0])
    assert 0.1e-3 < reached[0] < 0.6e-3
    assert reached[1] == pytest.approx(reached[0], rel=1e-12)


def test_the_robot_stands_while_the_feed_is_held(clock: Clock) -> None:
    cell = Answered(clock, program=PlayedProgram(GATE))
    cell.then = {40: {"FeedHold": 1.0, "State": HOLD}, 60: {"FeedHold": 0.0, "State": ACTIVE}}
    (block,) = played(cell, 80, block=80)
    x = np.array([entry[2] for entry in cell.sent])
    assert np.ptp(x[41:61]) == 0.0
    np.testing.assert_allclose(np.diff(x[61:]), 0.1, atol=1e-6)
    assert block.held_cycles == 20
    assert block.reported_state[50] == HOLD


def test_a_stopped_robot_begins_another_session_without_a_correction(clock: Clock) -> None:
    cell = Answered(clock, program=PlayedProgram(GATE, again=10, pause=15))
    cell.then = {30: {"RKorr.X": 0.5}, 40: {"Stop": 1.0, "State": FAULT}, 41: {"Stop": 0.0, "State": READY}}
    cell.silent = {36, 37}
    (block,) = played(cell, 80, block=80)
    assert len(cell.sent) == len(block.reply_s) == 80 - 15
    assert block.paused == 15
    assert [why for _, why in block.ended] == ["Stop"]
    before, after = cell.sent[40], cell.sent[41]
    assert after[1] - before[1] == 60_000
    assert (before[2] > 0.0, after[2], after[3]) == (True, 0.0, 0.0)
    assert np.flatnonzero(np.isnan(block.reply_s)).tolist() == [36, 37]
    assert block.reported_state[36] == NOT_REPORTED
    assert block.refused == 2
    assert block.largest_m == pytest.approx(0.5e-3)


def test_no_reading_comes_twice_while_the_robot_stands(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    """An instrument that repeats itself is called frozen, and nothing is armed."""
    force: list[tuple[float, ...]] = []
    poses: list[bytes] = []

    class Net:
        def send(self, w: Any) -> None:
            force.append(tuple(w))

        def poll(self) -> None:
            """Nothing is asked."""

        def close(self) -> None:
            """Nothing is open."""

    monkeypatch.setattr(
        recorded_cell, "_send", lambda _, data, peer: poses.append(data[24:48]) if peer == ("127.0.0.1", 7) else None
    )
    cell = Answered(clock, program=PlayedProgram(10**6), sensor=Net())
    played(cell, 200, tracker=("127.0.0.1", 7))
    assert len(force) == len(poses) == 200 * SAMPLES
    assert len(set(force)) == len(set(poses)) == 200 * SAMPLES
    assert np.abs(np.array(force)).max() < 1.0


LAG, SPAN = 7, 60
"""Cycles by which the recorded robot trails, and cycles of the pass."""


class Trailing(Answered):
    """A pass of a robot that trails its program by some cycles, and what its tracker sees in each cycle."""

    def __init__(self, clock: Clock, **chosen: Any) -> None:
        super().__init__(clock, **chosen)
        ramp = np.clip(np.arange(SPAN) - 10.0, 0.0, SPAN - 20.0) * 1e-4
        nominal, actual = (np.broadcast_to(np.eye(4), (SPAN, 4, 4)).copy() for _ in range(2))
        nominal[:, 0, 3] = ramp
        actual[LAG:, 0, 3] = ramp[:-LAG]
        p = np.zeros((SPAN, SAMPLES, 3))
        p[:, :, 0] = actual[:, 0, 3, None]
        self.played = replace(
            self.played, T_part_nominal=nominal, T_part_actual=actual, p_tracker_target=p,
            q_command=np.zeros((SPAN, 6)), q_actual=np.zeros((SPAN, 6)), w_sensor=np.zeros((SPAN, SAMPLES, 6)),
            quat_wxyz=np.broadcast_to(pose.make()[0], (SPAN, SAMPLES, 4)).copy(),
        )  # fmt: skip
        self._places = deque([0] * (self.played.lag + 1), self.played.lag + 1)
        self.seen: list[tuple[float, float]] = []

    def _instruments(self, row: int, tick: int, tracker: Any, due: float) -> None:
        super()._instruments(row, tick, tracker, due)
        if tick == 0:
            named = dict(zip(self.reader.names, self.reader.values, strict=True))
            self.seen.append((named["RSol.X"], 1e3 * self.played.p_tracker_target[row, 0, 0]))


def test_a_robot_trails_its_program_on_the_way_back_too(clock: Clock) -> None:
    """It was ahead of its program on each way back: the loop saw a tracker that stood while the program arrived."""
    cell = Trailing(clock, program=PlayedProgram(GATE))
    assert cell.played.lag == LAG
    played(cell, GATE + 4 * SPAN)
    commanded, seen = np.array(cell.seen).T
    np.testing.assert_allclose(seen[LAG:], commanded[:-LAG], atol=2e-6)
    assert np.ptp(commanded[GATE + SPAN :]) > 3.0


def test_a_robot_that_is_held_comes_to_where_its_program_stands(clock: Clock) -> None:
    cell = Trailing(clock, program=PlayedProgram(GATE))
    cell.then = {GATE + 30: {"FeedHold": 1.0, "State": HOLD}}
    played(cell, GATE + 60)
    (commanded, seen), (before, _) = cell.seen[-1], cell.seen[GATE + 32]
    assert commanded == before
    assert 1.0 < commanded < 3.0
    assert seen == pytest.approx(commanded, abs=1e-6)


def test_a_pose_is_stamped_with_the_time_of_its_measurement(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that this machine sends late was measured when the robot was there, not when it is sent."""
    stamps: list[int] = []

    def sent(_: Any, data: bytes, __: Any) -> None:
        if len(data) == DATAGRAM.size:
            stamps.append(DATAGRAM.unpack(data)[2])

    monkeypatch.setattr(recorded_cell, "_send", sent)
    cell = Answered(clock, program=PlayedProgram(GATE))
    clock.stalls[4 * 10 + 1] = 2.6e-3  # within a cycle
    played(cell, 20, tracker=("127.0.0.1", 9))
    np.testing.assert_allclose(np.diff(stamps), 1e6, atol=2.0)

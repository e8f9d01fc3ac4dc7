"""A simulated controller alone on real sockets: what it applies, with and without faults of the way."""

from __future__ import annotations

import io
import itertools
import socket
import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from counterflex.core.errors import OutputError, SimulationError
from counterflex.core.units import DEG, MM
from counterflex.geometry import pose
from counterflex.integrations.kuka.link.config import parse_config
from counterflex.integrations.kuka.link.telegram import answer_writer, robot_reader
from counterflex.integrations.kuka.simulated import FakeRsi, RsiContext
from counterflex.twin.devices.applied import COLUMNS, Applied
from counterflex.twin.devices.exact_robot import StandingRobot, Standstill
from counterflex.twin.devices.path_answer import PathAnswer
from counterflex.twin.devices.robot_server import CycleSeen, RobotServer, Timing
from counterflex.twin.network.faults import Fault, FaultSchedule

CONFIG = (
    "<ROOT><CONFIG><IP_NUMBER>127.0.0.1</IP_NUMBER><PORT>49152</PORT><SENTYPE>Counterflex</SENTYPE>ONLY</CONFIG>"
    "<SEND><ELEMENTS>"
    + "".join(f'<ELEMENT TAG="DEF_{t}" TYPE="DOUBLE" INDX="INTERNAL"/>' for t in ("RIst", "RSol", "AIPos", "ASPos"))
    + '<ELEMENT TAG="DEF_Delay" TYPE="LONG" INDX="INTERNAL"/></ELEMENTS></SEND><RECEIVE><ELEMENTS>'
    + "".join(
        f'<ELEMENT TAG="RKorr.{a}" TYPE="DOUBLE" INDX="{i}" HOLDON="HOLD"/>' for i, a in enumerate("XYZABC", start=1)
    )
    + '<ELEMENT TAG="Stop" TYPE="BOOL" INDX="7" HOLDON="1"/>'
    + '<ELEMENT TAG="FeedHold" TYPE="BOOL" INDX="8" HOLDON="1"/></ELEMENTS></RECEIVE></ROOT>'
)
PLACE = Standstill(pose.make(p=np.array([0.1, 0.2, 0.3])), np.full(6, 0.1), 4.0)


class Peer(threading.Thread):
    """A sensor program that answers telegram n with RKorr.X = ``step_mm`` n, in lockstep with the controller."""

    def __init__(self, step_mm: float = 0.001, *, sentype: str = "Counterflex", hold: int = 1) -> None:
        super().__init__(daemon=True)
        self.config = parse_config(CONFIG.replace('"HOLD"', f'"{hold}"').replace("ONLY", "").encode(), "x")
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(20.0)
        self.address = self._socket.getsockname()
        self._step, self._writer = step_mm, answer_writer(replace(self.config, sentype=sentype))
        self.counters: list[int] = []
        self.unreadable = 0
        self.ending = False
        self.holds: range = range(0)

    def run(self) -> None:
        reader, first = robot_reader(self.config), None
        while True:
            data, where = self._socket.recvfrom(65536)
            if data == b"end":
                return
            if reader.read_bytes(data) < 0 or b"</Rob>" not in data or not data.startswith(b"<Rob"):
                self.unreadable += 1
                continue
            first = reader.counter if first is None else first
            self.counters.append(reader.counter)
            self._writer.values[self._writer.place("RKorr.X")] = self._step * (reader.counter - first) / 4
            self._writer.values[self._writer.place("FeedHold")] = len(self.counters) in self.holds
            self._socket.sendto(self._writer.telegram(reader.counter), where)

    def finish(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
            end.sendto(b"end", self.address)
        self.join(20.0)
        self._socket.close()


def run(
    faults: tuple[Fault, ...] = (),
    *,
    cycles: int = 300,
    seed: int = 1,
    peer: Peer | None = None,
    most_held_s: float = 60.0,
    **context: Any,
) -> tuple[RobotServer, Applied, list[CycleSeen], Peer]:
    peer = Peer() if peer is None else peer
    peer.start()
    applied, seen = Applied(), []

    def observe(cycle: CycleSeen) -> None:
        applied.see(cycle)
        seen.append(cycle)

    settings = RsiContext(**{"timeout": 10000, **context})
    robot = StandingRobot(PLACE, settings.cycle_s, PathAnswer(0.0, 0.0))
    server = RobotServer(
        robot,
        FakeRsi(peer.config, settings),
        peer.address,
        timing=Timing(gate_s=0.0, most_held_s=most_held_s),
        faults=FaultSchedule(faults, seed),
        observe=observe,
    )
    try:
        server.run(after=0, most_cycles=cycles)
    finally:
        server.close()
        peer.finish()
    return server, applied, seen, peer


def test_without_faults_every_answer_is_applied_in_its_cycle() -> None:
    server, applied, seen, _ = run()
    assert server.stop_reason == "cycles"
    assert applied.refused == {}
    assert applied.ages == {0: 300}
    assert applied.step_m == pytest.approx(1e-6, rel=1e-6)
    assert seen[-1].correction[0] == pytest.approx(300e-6)
    shift = seen[-1].report.T_part_actual[:3, 3] - PLACE.T_part_tcp[:3, 3]
    assert shift[0] == pytest.approx(299e-6)  # the answer of a cycle moves the next
    assert len(applied.reply_s) == 300


def test_a_feed_that_is_held_for_ever_ends_a_run_that_nobody_watches() -> None:
    """Half a second is allowed: a shorter hold goes by, each by itself; a longer one is an error that says so."""
    waits = Peer()
    waits.holds = range(20, 120)
    server, _, _, _ = run(peer=waits, most_held_s=0.5)
    assert server.stop_reason == "cycles"
    holds = Peer()
    holds.holds = range(20, 10_000)
    with pytest.raises(SimulationError, match="held the feed for 0.5 s"):
        run(peer=holds, most_held_s=0.5)
    assert 20 + 125 <= len(holds.counters) <= 20 + 128


def test_lost_answers_are_late_and_the_correction_gets_old() -> None:
    _, clean, _, _ = run()
    _, applied, seen, _ = run((Fault("lost", share=0.2, direction="in"),))
    lost = applied.refused["no answer"]
    assert 30 < lost < 90
    assert seen[-1].late == lost
    assert max(applied.ages) > max(clean.ages)
    assert applied.step_m == pytest.approx((max(applied.ages) + 1) * 1e-6)


def test_holdon_zero_jumps_where_holdon_one_rests() -> None:
    faults = (Fault("lost", first=200, count=1, direction="in"),)
    _, rests, _, _ = run(faults)
    _, jumps, _, _ = run(faults, peer=Peer(hold=0))
    assert rests.step_m == pytest.approx(2e-6)
    assert jumps.step_m > 200e-6


def test_a_run_in_lockstep_repeats_itself() -> None:
    faults = (Fault("lost", share=0.1), Fault("late", share=0.1, late_s=0.006), Fault("garbage", share=0.05))
    first, again, other = run(faults)[1], run(faults)[1], run(faults, seed=2)[1]
    assert first.ages == again.ages
    assert first.refused == again.refused
    assert first.ages != other.ages


def test_late_and_repeated_telegrams_never_bring_back_an_old_correction() -> None:
    _, applied, seen, peer = run((Fault("late", share=0.3, late_s=0.010), Fault("repeated", share=0.3)))
    x = np.array([cycle.correction[0] for cycle in seen])
    assert np.all(np.diff(x) >= 0.0)
    assert applied.refused
    assert len(peer.counters) > 300


def test_garbage_and_truncated_telegrams_are_not_understood() -> None:
    _, applied, _, peer = run((Fault("garbage", first=100, count=3), Fault("truncated", first=200, count=2)))
    assert applied.refused == {"no answer": 5}
    assert peer.unreadable == 5


def test_too_many_late_answers_stop_it() -> None:
    server, _, seen, _ = run((Fault("lost", from_s=0.4, direction="in"),), timeout=10)
    assert server.stop_reason == "RSITimeout"
    assert len(seen) == 110


def test_silence_is_not_counted_and_death_is_the_end() -> None:
    server, applied, seen, peer = run((Fault("silent", from_s=0.2, for_s=0.1), Fault("dying", from_s=0.8)))
    assert server.stop_reason == "died"
    assert len(seen) == 200
    assert seen[-1].late == 0
    assert len(set(peer.counters)) == 201 - 25  # the first telegram is repeated until somebody is there
    gap = np.max(np.diff(sorted(set(peer.counters))))
    assert gap == 26 * 4
    assert applied.step_m == pytest.approx(26e-6)


def test_a_counter_that_jumps_is_answered_all_the_same() -> None:
    _, applied, seen, _ = run((Fault("counter", from_s=0.4, step=-4000),))
    assert applied.refused == {}
    assert min(b.counter - a.counter for a, b in itertools.pairwise(seen)) == -3996


def test_a_wrong_sentype_is_refused_and_stops_it() -> None:
    server, applied, _, _ = run(peer=Peer(sentype="ImFree"), timeout=10)
    assert server.stop_reason == "RSITimeout"
    assert applied.refused == {"SENTYPE": 10}
    assert applied.correction_m == 0.0


def test_poscorr_clamps_in_silence_and_poscorrmon_stops() -> None:
    server, applied, _, _ = run(peer=Peer(0.1), clamp_m=5.0 * MM, monitor_m=6.0 * MM)
    assert server.stop_reason == "cycles"
    assert applied.correction_m == pytest.approx(5.0 * MM)
    assert applied.clamped == 300 - 50
    server, applied, _, _ = run(peer=Peer(0.1), clamp_m=50.0 * MM, monitor_m=6.0 * MM)
    assert server.stop_reason == "POSCORRMON"
    assert applied.correction_m == pytest.approx(6.1 * MM)


def test_twelve_milliseconds_and_a_nearly_empty_first_telegram() -> None:
    _, applied, seen, _ = run(cycles=30, cycle_s=0.012, empty_first=True)
    assert applied.refused == {}
    assert seen[-1].counter - seen[0].counter == 29 * 12


def test_nobody_there() -> None:
    config = parse_config(CONFIG.replace('"HOLD"', '"1"').replace("ONLY", "").encode(), "x")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
        silent.bind(("127.0.0.1", 0))
        fake = FakeRsi(config, RsiContext(timeout=10))
        server = RobotServer(StandingRobot(PLACE, 0.004), fake, silent.getsockname(), timing=Timing(wait_s=0.01))
        with pytest.raises(OutputError, match=r"no sensor program answers; got nothing for 0\.01 s"):
            server.run()
        assert server.cycles == 0
        server.close()
        fake = FakeRsi(config, RsiContext(timeout=10))
        server = RobotServer(
            StandingRobot(PLACE, 0.004), fake, silent.getsockname(), timing=Timing(wait_s=0.0, patience_s=0.001)
        )
        assert server.run() == "RSITimeout"
        server.close()


def test_onlysend_expects_no_answer() -> None:
    text = CONFIG.replace('"HOLD"', '"1"').replace("ONLY", "<ONLYSEND>TRUE</ONLYSEND>")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        fake = FakeRsi(parse_config(text.encode(), "x"), RsiContext(timeout=10))
        server = RobotServer(StandingRobot(PLACE, 0.004), fake, listener.getsockname())
        assert server.run(most_cycles=40) == "cycles"
        server.close()
        assert fake.late == 0
        assert listener.recv(65536).startswith(b"<Rob")


def test_the_record_says_every_cycle() -> None:
    stream = io.StringIO()
    applied = Applied(stream)
    T = pose.make(p=np.array([1e-3, 0.0, 0.0])) @ PLACE.T_part_tcp
    robot = StandingRobot(PLACE, 0.004)
    report = replace(robot.advance(np.zeros(6)), T_part_actual=T)
    correction = np.array([0.0, 3e-3, 4e-3, 1.0 * DEG, 0.0, 0.0])
    applied.see(CycleSeen(0, 4, True, 1e-4, "", 0, 1, correction, np.zeros(6), report))
    applied.see(CycleSeen(1, 8, True, float("nan"), "IPOC", 1, 1, correction, np.full(6, 0.5 * DEG), report))
    lines = [line.split(",") for line in stream.getvalue().splitlines()]
    assert tuple(lines[0]) == COLUMNS
    rows = [dict(zip(COLUMNS, line, strict=True)) for line in lines[1:]]
    assert float(rows[0]["z_mm"]) == 4.0
    assert float(rows[0]["shift_x_mm"]) == 1.0
    assert rows[0]["reply_us"] == "100.0"
    assert (rows[1]["refused"], rows[1]["age_cycles"], rows[1]["reply_us"]) == ("IPOC", "1", "")
    assert applied.correction_m == pytest.approx(5e-3)
    assert applied.correction_rad == pytest.approx(1.0 * DEG)
    assert applied.step_axes_rad == pytest.approx(0.5 * DEG)
    assert applied.young(0) == 0.5

"""The one call of a cycle does what the same cycle does in steps: bit for bit in records, memory and answers."""

from __future__ import annotations

import socket
from dataclasses import asdict, replace

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.integrations.ati.link.link import NetftLink
from counterflex.integrations.ati.link.telegram import Scaling
from counterflex.integrations.ati.simulated import COUNTS, SATURATED, NetftServer
from counterflex.integrations.kuka.link.link import RsiLink
from counterflex.integrations.kuka.simulated import FakeRsi, RsiContext
from counterflex.protocols.processes.control_array import CONTROL, Life, Request
from counterflex.protocols.processes.last_answer import LastAnswer
from counterflex.protocols.session.senses import Sensing
from counterflex.protocols.session.session import OnlineSession
from counterflex.protocols.session.telegram_watch import WatchSettings
from counterflex.protocols.session.whole_kernel import ANSWERED
from counterflex.protocols.system import system_calls
from counterflex.protocols.tracker.link import TrackerLink
from counterflex.protocols.tracker.telegram import DATAGRAM, MAGIC
from counterflex.runtime.loop import Loop
from counterflex.runtime.plausibility.axis_check import AxisCheck
from counterflex.runtime.record_ring import COLUMNS, RecordRing, column
from counterflex.runtime.settings import ForceMode, OnlineSettings, Output, TrackerMode
from counterflex.runtime.state.states import State
from counterflex.twin.devices.commanded_motion import Report
from counterflex_lab.composed import bench
from counterflex_lab.faults.demonstration import demo_cell

CYCLES = 700
LOST, TWICE, TWISTED, UNREADABLE, NO_FORCE, SATURATES, NO_POSE, STOPS, AGAIN = (
    300,
    320,
    340,
    360,
    380,
    400,
    420,
    450,
    520,
)


class _Cell:
    """Robot, force sensor and tracker whose datagrams stand in their sockets before the cycle that takes them."""

    def __init__(self, output: Output, *, whole: bool) -> None:
        chain, own = demo_cell().chain, bench.program()
        settings = OnlineSettings(force=ForceMode.SCALE, tracker=TrackerMode.OBSERVER, output=output)
        self.loop = Loop(chain, settings, own.T_base_part, bench.plan())
        self.device = FakeRsi(bench.config(), RsiContext(first_counter=1000, timeout=1 << 30), {"Enable": 0.0})
        self.sensor = NetftServer(http_port=None)
        force = NetftLink(self.sensor.address, Scaling(1.0 / COUNTS, 1.0 / COUNTS, 1000, "Net F/T"))
        force.start()
        self.sensor.poll()
        self.link, self.tracker = RsiLink(bench.config(), port=0), TrackerLink(mean_of=4)
        sensing = Sensing(
            force=force,
            wrench=bench.wrench(),
            angles=AxisCheck(demo_cell().controller_chain, own.T_base_part, settings.period_s),
            tracker=self.tracker,
            T_part_tracker=np.eye(4),
            T_target_tcp=np.eye(4),
        )
        self.ring, self.control = RecordRing(), np.zeros(CONTROL, dtype=np.int64)
        self.control[Life.MAY_ARM] = 1
        self.session = OnlineSession(
            self.link,
            self.loop,
            sensing=sensing,
            ring=self.ring,
            control=self.control,
            watch=WatchSettings(clock=False),
        )
        self.kept = np.zeros((2, 16))
        self.session.follow(LastAnswer(self.kept), not_closed=False)
        self.wholes = self.rehearsals = 0
        if whole:
            self._count_wholes()
        else:
            self.session._whole = None
        self._robot = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._robot.bind(("127.0.0.1", 0))
        self._robot.setblocking(False)
        self.rng = np.random.default_rng(0)
        self.answers: list[bytes] = []
        self._poses = 0

    def _count_wholes(self) -> None:
        own = self.session._whole
        assert own is not None
        run = own.run

        def counted(timeout_s: float) -> int:
            count = run(timeout_s)
            self.wholes += count == ANSWERED
            return count

        own.run = counted  # type: ignore[method-assign]

    def cycle(self, k: int) -> None:
        """Send what belongs to a cycle, let the session take it, and let the controller have the answer."""
        row = max(0, k - 150)
        self.device.frees["Enable"] = float(k >= 120)
        self._instruments(k, row)
        datagrams = [] if LOST <= k < LOST + 2 else [self._telegram(k, row)]
        if k == LOST:
            self._telegram(k, row)  # made, and lost on the way: the counter goes on
            self._telegram(k, row)
        if k == TWICE:
            datagrams.append(self._telegram(k, row))
        if k == TWISTED:
            datagrams = [self._telegram(k, row), datagrams[0]]
        if UNREADABLE <= k < UNREADABLE + 2:
            datagrams = [datagrams[0].replace(b"<RSol", b"<RSol X='1e99'", 1)]
        if k == STOPS:
            self.control[Request.STOP] = 1
        if k == AGAIN:
            self.control[Request.STOP], self.control[Request.RESET] = 0, 1
        if k in (100, AGAIN + 70):
            self.control[Request.ARM] = 1
        for data in datagrams:
            self._robot.sendto(data, self.link.address)
        whole = self.session._whole
        if whole is not None and self.session._usual() and k % 3:
            whole.rehearse()
            self.rehearsals += 1
        self.session.cycle(1.0 if datagrams else 1e-3)
        last: bytes | None = None
        while True:
            try:
                last = self._robot.recv(10_000)
            except BlockingIOError:
                break
            self.answers.append(last)
        self.device.answer(last)

    def _telegram(self, k: int, row: int) -> bytes:
        own = bench.program()
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = own.R, own.p[row]
        actual = T.copy()
        actual[:3, 3] += self.loop.correction[:3]
        return self.device.telegram(Report(4e-3 * k, T, actual, own.q[row], own.q[row], True, False))

    def _instruments(self, k: int, row: int) -> None:
        own = bench.program()
        self.sensor.status = SATURATED if SATURATES <= k < SATURATES + 2 else 0
        moved = bench.model_compliance() @ own.force[row] + self.loop.correction[:3]
        for tick in range(4):
            w = bench.reading() @ np.r_[own.force[row], np.zeros(3)] + 0.5 * self.rng.standard_normal(6)
            if not NO_FORCE <= k < NO_FORCE + 3:
                self.sensor.send(w)
            p = (own.p[row] + moved + 2e-6 * self.rng.standard_normal(3)) * 1e3
            self._poses += 1
            stamp = 4_000_000 * k + 1_000_000 * tick
            if not NO_POSE <= k < NO_POSE + 3:
                data = DATAGRAM.pack(MAGIC, self._poses, stamp, 0, 0, *p, 0.0, 1.0, 0.0, 0.0, 0.015)
                self._robot.sendto(data, self.tracker.address)

    def played(self) -> Float:
        """(n, columns) records of all cycles, without the times of this computer's clock."""
        reader = RecordRing(self.ring.name)
        reader.rewind()
        for k in range(CYCLES):
            self.cycle(k)
        rows = reader.take()
        reader.close()
        rows[:, [column("received_ns"), column("sent_ns")]] = 0.0
        return rows

    def close(self) -> None:
        """Free the sockets."""
        self.session.force.close()  # type: ignore[union-attr]
        for one in (self.link, self.tracker, self.sensor, self._robot, self.ring):
            one.close()


@pytest.mark.skipif(not system_calls.THERE, reason="no such system calls")
@pytest.mark.parametrize("output", [Output.CARTESIAN, Output.AXES])
def test_one_call_is_the_cycle_in_steps(output: Output) -> None:
    """With rehearsals; telegrams lost, twice, overtaken, unreadable; sensors silent, saturated; a stop, a reset."""
    whole, steps = _Cell(output, whole=True), _Cell(output, whole=False)
    try:
        rows, expected = whole.played(), steps.played()
        assert rows.shape == expected.shape
        differ = sorted({COLUMNS[place] for place in np.nonzero(rows.view(np.int64) != expected.view(np.int64))[1]})
        assert differ == []
        assert whole.answers == steps.answers
        assert asdict(replace(whole.link.counters, sender=0)) == asdict(replace(steps.link.counters, sender=0))
        for name, words in whole.loop.memory.items():
            assert words.tobytes() == steps.loop.memory[name].tobytes(), name
        mask = [0, 1, *range(3, 16)]  # but for the time
        assert np.array_equal(whole.kept[:, mask], steps.kept[:, mask])
        assert {State.ACTIVE, State.HOLD} <= set(rows[:, column("out_state")].astype(int).tolist())
        assert whole.wholes > 0.8 * CYCLES
        assert whole.rehearsals > 0.5 * CYCLES
    finally:
        whole.close()
        steps.close()

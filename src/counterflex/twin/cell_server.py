"""The whole simulated cell on real sockets: controller with RSI, force sensor, tracker.

Two ways of keeping time. *Lockstep*: after every telegram the cell waits for the answer, as long as ``patience_s``; as
fast as both sides can, and the same result every time. *Real time*: a telegram every cycle by the clock; what has not
come when the next is due is late.
"""

from __future__ import annotations

import contextlib
import socket
import time
from dataclasses import dataclass, field

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.geometry import pose, rotation
from counterflex.twin.fake_rsi import FakeRsi
from counterflex.twin.force_sensor import ForceSensor
from counterflex.twin.laboratory import Laboratory
from counterflex.twin.live_cell import LiveCell
from counterflex.twin.netft_server import NetftServer
from counterflex.wire.tracker_pose import BEAM_BROKEN, TrackerPose, write_pose

_STEPS_PER_SAMPLE = 2  # integration steps of 0.5 ms per sample of the instruments: 1 kHz


@dataclass(eq=False)
class Instruments:
    """What is read off the cell, every millisecond.

    Attributes:
        laboratory: Noise, and where the tracker and its target truly are.
        force_sensor: As it truly is; or None.
        netft: Where its readings go; or None.
        tracker_peer: Where poses go; or None.
        beam_broken: The tracker does not see its target.
        temperature_c: Of the force sensor.
    """

    laboratory: Laboratory
    force_sensor: ForceSensor | None = None
    netft: NetftServer | None = None
    tracker_peer: tuple[str, int] | None = None
    beam_broken: bool = False
    temperature_c: float = 20.0
    _socket: socket.socket = field(default_factory=lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    _sequence: int = 0

    def __post_init__(self) -> None:
        """Take a noise stream of its own for each instrument."""
        self._force_noise = self.laboratory.noise("live force")
        self._tracker_noise = self.laboratory.noise("live tracker")
        self._last: Float = np.eye(4)

    def sample(self, cell: LiveCell, time_s: float) -> None:
        """Read and send."""
        if self.netft is not None and self.force_sensor is not None:
            true = self.force_sensor.true_wrench(cell.plant, cell.plant.truth.gravity_base)
            w = self.force_sensor.reading(true, time_s, self.temperature_c)
            noise = self._force_noise.standard_normal(6)
            scale = np.r_[np.full(3, self.laboratory.force_n), np.full(3, self.laboratory.moment_nm)]
            self.netft.send(w + scale * noise)
        if self.tracker_peer is not None:
            self._send_pose(cell, time_s)

    def _send_pose(self, cell: LiveCell, time_s: float) -> None:
        lab = self.laboratory
        if not self.beam_broken:
            T = pose.inverse(lab.T_base_tracker) @ cell.plant.tcp_pose() @ lab.T_tcp_target
            T[:3, 3] += lab.tracker_m * self._tracker_noise.standard_normal(3)
            T[:3, :3] = rotation.exp(lab.tracker_rad * self._tracker_noise.standard_normal(3)) @ T[:3, :3]
            self._last = T
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        status = BEAM_BROKEN if self.beam_broken else 0
        sample = TrackerPose(self._sequence, round(time_s * 1e9), status, 0, self._last, lab.tracker_m)
        with contextlib.suppress(BlockingIOError, ConnectionError):
            self._socket.sendto(write_pose(sample), self.tracker_peer)  # type: ignore[arg-type]

    def close(self) -> None:
        """Free the sockets."""
        self._socket.close()
        if self.netft is not None:
            self.netft.close()


class CellServer:
    """Runs a live cell behind its protocols until the program has ended.

    Args:
        cell: The cell.
        rsi: The controller's side of RSI.
        peer: Where telegrams go: host and port of the sensor program.
        instruments: Or None.
        realtime: Keep real time; else lockstep.
        patience_s: Lockstep: how long an answer may take.
        waiting_s: How long it waits for the sensor program to be there, as a robot program does before RSI_ON.
        gate_cycles: Cycles for which the program waits after the session began, so that everything can settle; the
            robot program enables the correction at their end.

    Attributes:
        cycles: Telegrams sent.
        stop_reason: Why it ended: ``finished``, or what stopped the controller.
    """

    def __init__(
        self,
        cell: LiveCell,
        rsi: FakeRsi,
        peer: tuple[str, int],
        instruments: Instruments | None = None,
        *,
        realtime: bool = False,
        patience_s: float = 5.0,
        waiting_s: float = 60.0,
        gate_cycles: int = 150,
    ) -> None:
        if abs(rsi.context.cycle_s - cell.period_s) > 1e-9:
            raise InputError("cycle of RSI and of the cell", value=rsi.context.cycle_s, limit=cell.period_s)
        self.cell, self.rsi, self.peer, self.instruments = cell, rsi, peer, instruments
        self.realtime, self.patience_s, self.gate_cycles = realtime, patience_s, gate_cycles
        self.waiting_s = waiting_s
        self.cycles = 0
        self.stop_reason = ""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1" if peer[0] in ("127.0.0.1", "localhost") else "0.0.0.0", 0))
        self._due = time.perf_counter()
        if instruments is not None:
            cell.on_step = self._on_step  # type: ignore[method-assign]

    def _on_step(self, i: int) -> None:
        if (i + 1) % _STEPS_PER_SAMPLE == 0 and self.instruments is not None:
            self.instruments.sample(self.cell, self.cell.time_s + (i + 1) * self.cell.plant.step_s)

    def run(self, *, after: int = 50, most_cycles: int | None = None, progress: Progress = silent) -> str:
        """Run until the program has ended, the controller has stopped, or the cycles are used up.

        Args:
            after: Cycles that go on after the end of the program.
            most_cycles: Or None.
            progress: Told the fraction done.

        Returns:
            :attr:`stop_reason`.
        """
        if not self._wait_for_peer():
            self.stop_reason = "no sensor program"
            return self.stop_reason
        rest = after
        total = len(self.cell.reference.time_s)
        self._due = time.perf_counter()
        while most_cycles is None or self.cycles < most_cycles:
            if self.cycles == self.gate_cycles:
                self.cell.start()
            self.rsi.frees["Enable"] = float(self.cycles >= self.gate_cycles and not self.cell.finished)
            if self.instruments is not None and self.instruments.netft is not None:
                self.instruments.netft.poll()
            held = self.rsi.feed_hold and self.cycles > self.gate_cycles
            report = self.cell.advance(self.rsi.pose_correction(), self.rsi.axes, 0.0 if held else self.rsi.override)
            self.exchange(self.rsi.telegram(report))
            self.cycles += 1
            if self.cycles % 250 == 0:
                progress(min(0.99, self.cycles / total), "milling")
            if self.rsi.stopped:
                self.stop_reason = self.rsi.stopped
                return self.stop_reason
            if report.finished:
                rest -= 1
                if rest <= 0:
                    self.stop_reason = "finished"
                    return self.stop_reason
        self.stop_reason = "cycles"
        return self.stop_reason

    def _wait_for_peer(self) -> bool:
        """Repeat the first telegram until somebody answers; nothing moves, nothing is counted."""
        end = time.perf_counter() + self.waiting_s
        nothing = np.zeros(6)
        report = self.cell.advance(nothing)
        first = self.rsi.telegram(report)
        self._socket.settimeout(0.1)
        while time.perf_counter() < end:
            if self.instruments is not None and self.instruments.netft is not None:
                self.instruments.netft.poll()
            with contextlib.suppress(ConnectionError):
                self._socket.sendto(first, self.peer)
            try:
                self._socket.recv(65536)
            except (TimeoutError, ConnectionError):
                continue
            return True
        return False

    def exchange(self, telegram: bytes) -> None:
        """Send a telegram and take what comes until the cycle is over."""
        with contextlib.suppress(ConnectionError):
            self._socket.sendto(telegram, self.peer)
        self._due += self.cell.period_s
        answer = self._wait_realtime() if self.realtime else self._wait_lockstep()
        self.rsi.answer(answer)

    def _wait_lockstep(self) -> bytes | None:
        end = time.perf_counter() + self.patience_s
        mark = f"<IPOC>{self.rsi.counter}</IPOC>".encode("ascii")
        while (left := end - time.perf_counter()) > 0.0:
            self._socket.settimeout(left)
            try:
                data = self._socket.recv(65536)
            except (TimeoutError, ConnectionError):
                return None
            if mark in data:
                return data
        return None

    def _wait_realtime(self) -> bytes | None:
        found = None
        while (left := self._due - time.perf_counter()) > 0.0:
            self._socket.settimeout(left)
            try:
                found = self._socket.recv(65536)
            except TimeoutError:
                break
            except ConnectionError:
                continue
        if time.perf_counter() - self._due > 10.0 * self.cell.period_s:
            self._due = time.perf_counter()  # the simulation itself came late: start counting anew
        return found

    def close(self) -> None:
        """Free the sockets."""
        self._socket.close()
        if self.instruments is not None:
            self.instruments.close()

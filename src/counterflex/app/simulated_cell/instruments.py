"""Simulated instruments alone on real sockets: force sensors, and a tracker that measures or replays."""

from __future__ import annotations

import contextlib
import itertools
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.registry import imported
from counterflex.core.units import MICRO, NS
from counterflex.protocols.force.frame_format import FrameFormat
from counterflex.protocols.force.sensors import FORCE_SENSORS
from counterflex.protocols.frame.link import FrameSource
from counterflex.protocols.wrench.telegram import INVALID, SATURATED, Wrench
from counterflex.twin.devices.datagram_sender import TrackerSender, keep_pace
from counterflex.twin.devices.force_device import ForceDevice, ForceStart
from counterflex.twin.devices.pose_source import PoseSource, TrackerLog
from counterflex.twin.devices.wrench import WrenchSender
from counterflex.twin.devices.wrench_source import WrenchSource
from counterflex.twin.network.faults import FaultSchedule


def force_device(protocol: str, start: ForceStart) -> ForceDevice:
    """Start a simulated force sensor.

    Args:
        protocol: Its name, as in the cell file.

    Raises:
        InputError: The protocol has no simulated sensor, or the settings do not fit it.
        OutputError: A port is taken.
    """
    place = FORCE_SENSORS[protocol].device
    if not place:
        raise InputError(
            "no simulated force sensor speaks this protocol",
            where=start.where,
            value=f'protocol = "{protocol}"',
            limit=", ".join(name for name, kind in FORCE_SENSORS.items() if kind.device),
        )
    device: ForceDevice = imported(place)(start)
    return device


def wrench_sender(start: ForceStart) -> WrenchSender:
    """A sensor that sends wrench datagrams."""
    source = max(0, int(start.values.get("source", -1)))
    sender = WrenchSender(start.peer("wrench"), start.faults, source=source)
    sender.status = start.status
    return sender


def frame_sender(start: ForceStart) -> WrenchSender:
    """A sensor that sends the frames of the cell file by itself."""
    peer, own = start.peer("frame"), start.frame
    assert isinstance(own, FrameSource)
    if own.transport != "udp" or own.start or own.request:
        raise InputError(
            "the simulated cell sends frames by itself over UDP only",
            where=start.where,
            value="[sensor.frame] with " + ("tcp" if own.transport == "tcp" else "start or request"),
        )
    return WrenchSender(peer, start.faults, write=lambda one: _frame_of(own.frame, one))


def _frame_of(frame: FrameFormat, one: Wrench) -> bytes:
    bits = frame.saturated_bits if one.status & SATURATED else 0
    bits |= frame.invalid_bits if one.status & INVALID else 0
    return frame.write(np.array(one.w_sensor), one.sequence, bits)


RATES_HZ: Final = (0.1, 7000)
"""Rates that instruments send at."""


@dataclass(frozen=True)
class InstrumentClock:
    """Time as an instrument alone keeps it; a test gives its own."""

    now: Callable[[], float] = time.perf_counter  # s
    wait: Callable[[float], None] = time.sleep  # Waits for so many s


@dataclass(frozen=True, eq=False)
class LoneForce:
    """A force sensor alone."""

    protocol: str  # Its name, as in a cell file
    source: WrenchSource  # What it shows
    start: ForceStart  # Where it is, its rate and its faults
    seconds: float | None = None  # How long, or None for ever

    def run(
        self, *, started: Callable[[ForceDevice], None] = lambda _: None, clock: InstrumentClock | None = None
    ) -> dict[str, Any]:
        """Run a force sensor until its time is over, it dies, or somebody presses Ctrl-C.

        Args:
            started: Told the sensor.

        Returns:
            Summary: samples, what left it, samples given up because the computer was too slow.

        Raises:
            InputError: The rate is out of range.
            OutputError: A port is taken.
        """
        rate_hz = self.start.rate_hz
        _check_rate(rate_hz)
        clock = clock if clock is not None else InstrumentClock()
        device = force_device(self.protocol, self.start)
        numbers = itertools.count()
        ended, skipped = "stopped", 0
        try:
            started(device)
            with contextlib.suppress(KeyboardInterrupt):
                skipped = keep_pace(
                    _times(rate_hz, self.seconds),
                    partial(_send_force, device, self.source, numbers),
                    now=clock.now,
                    wait=clock.wait,
                )
                ended = "died" if device.dead else "finished"
        finally:
            device.close()
        return {
            "job": f"twin {self.protocol}",
            "ended": ended,
            **device.counts(next(numbers)),
            "given_up": skipped,
            "counterflex": __version__,
        }


@dataclass(frozen=True, eq=False)
class LoneTracker:
    """A tracker alone."""

    peer: tuple[str, int]  # Where its datagrams go
    source: PoseSource | None = None  # What it sees; or
    log: TrackerLog | None = None  # what it has seen, to be sent again row by row
    rate_hz: float = 1000.0  # Measurements per second of a source
    seconds: float | None = None  # How long; None for ever, or to the end of the log
    sigma_m: float = 0.0  # Standard deviation that it claims of a source
    speed: float = 1.0  # Of a replay; 2 is twice as fast as it was, with the clock of the log
    repeat: bool = False  # Begin the log again after its end, its clock going on
    clock_offset_s: float = 0.0  # Of its clock
    clock_drift_ppm: float = 0.0  # Of its clock: how much faster than the computer's it runs
    faults: FaultSchedule = field(default_factory=FaultSchedule)  # Scripted, by the time at which datagrams are sent

    def run(self, *, clock: InstrumentClock | None = None) -> dict[str, Any]:
        """Run a tracker until its time or its log is over, it dies, or somebody presses Ctrl-C.

        Returns:
            Summary: measurements sent, measurements given up because the computer was too slow.

        Raises:
            InputError: Rate or speed out of range; not one of source and log.
        """
        _check_rate(self.rate_hz)
        if (self.source is None) == (self.log is None):
            raise InputError("a tracker needs either a target or a log", hint="Give one of them")
        if not 0.01 <= self.speed <= 100.0:
            raise InputError("speed of a replay", value=self.speed, limit="0.01 .. 100")
        clock = clock if clock is not None else InstrumentClock()
        sender = TrackerSender(self.peer, self.faults)

        ended, skipped = "stopped", 0
        try:
            with contextlib.suppress(KeyboardInterrupt):
                if self.log is not None:
                    times, tick = self._replay(self.log, sender)
                else:
                    times, tick = _times(self.rate_hz, self.seconds), partial(_send_pose, self, sender)
                skipped = keep_pace(times, tick, now=clock.now, wait=clock.wait)
                ended = "died" if sender.dead else "finished"
        finally:
            sender.close()
        return {
            "job": "twin tracker",
            "ended": ended,
            "measurements": sender.sent,
            "given_up": skipped,
            "counterflex": __version__,
        }

    def _stamp(self, time_ns: int, elapsed_s: float) -> int:
        """Time by the clock of the tracker, ns."""
        return max(0, time_ns + round((self.clock_offset_s + elapsed_s * self.clock_drift_ppm * MICRO) / NS))

    def _replay(self, log: TrackerLog, sender: TrackerSender) -> tuple[Iterator[float], Callable[[int, float], bool]]:
        """Times of the rows of a log, lap after lap, and what sends each."""
        own = np.array([t - log.time_ns[0] for t in log.time_ns], dtype=np.float64) * NS
        lap = float(own[-1] + (own[-1] / (len(own) - 1) if len(own) > 1 else 1.0))
        laps: Iterable[int] = itertools.count() if self.repeat else range(1)
        due = ((number * lap + float(time_s)) / self.speed for number in laps for time_s in own)
        within = due if self.seconds is None else itertools.takewhile(lambda due_s: due_s < (self.seconds or 0.0), due)
        return within, partial(_send_row, self, log, sender, own, lap)


def _send_force(device: ForceDevice, source: WrenchSource, numbers: Iterator[int], _: int, time_s: float) -> bool:
    device.poll()
    device.send(source(time_s), time_s)
    next(numbers)
    return not device.dead


def _send_pose(settings: LoneTracker, sender: TrackerSender, _: int, time_s: float) -> bool:
    if settings.source is not None:
        time_ns = settings._stamp(round(time_s / NS), time_s)
        sender.send(settings.source(time_s), time_s, time_ns=time_ns, sigma_m=settings.sigma_m)
    return not sender.dead


def _send_row(
    settings: LoneTracker, log: TrackerLog, sender: TrackerSender, own: Float, lap: float, index: int, time_s: float
) -> bool:
    number, row = divmod(index, len(own))
    sender.send(
        log.Ts_tracker_target[row],
        time_s,
        time_ns=settings._stamp(log.time_ns[row] + round(number * lap / NS), number * lap + float(own[row])),
        status=log.status[row],
        sigma_m=log.sigma_m[row],
    )
    return not sender.dead


def _check_rate(rate_hz: float) -> None:
    if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
        raise InputError("rate of an instrument", value=rate_hz, limit=f"{RATES_HZ[0]} .. {RATES_HZ[1]} Hz")


def _times(rate_hz: float, seconds: float | None) -> Iterator[float]:
    for k in itertools.count():
        if seconds is not None and k >= seconds * rate_hz:
            return
        yield k / rate_hz

"""Simulated instruments alone on real sockets: force sensors, and a tracker that measures or replays."""

from __future__ import annotations

import contextlib
import itertools
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.simulated_cell.force_devices import force_device
from counterflex.core.errors import InputError
from counterflex.core.units import MICRO, NS
from counterflex.twin.devices.force_device import ForceDevice, ForceStart
from counterflex.twin.devices.pace import keep_pace
from counterflex.twin.devices.pose_source import PoseSource, TrackerLog
from counterflex.twin.devices.tracker import TrackerSender
from counterflex.twin.devices.wrench_source import WrenchSource
from counterflex.twin.network.faults import FaultSchedule

RATES_HZ: Final = (0.1, 7000)
"""Rates that instruments send at."""
Stamp = Callable[[int, float], int]


@dataclass(frozen=True)
class Clock:
    """Time as an instrument alone keeps it; a test gives its own.

    Attributes:
        now: s.
        wait: Waits for so many s.
    """

    now: Callable[[], float] = time.perf_counter
    wait: Callable[[float], None] = time.sleep


@dataclass(frozen=True, eq=False)
class LoneForce:
    """A force sensor alone.

    Attributes:
        protocol: Its name, as in a cell file.
        source: What it shows.
        start: Where it is, its rate and its faults.
        seconds: How long, or None for ever.
    """

    protocol: str
    source: WrenchSource
    start: ForceStart
    seconds: float | None = None


def run_force(
    settings: LoneForce, *, started: Callable[[ForceDevice], None] = lambda _: None, clock: Clock | None = None
) -> dict[str, Any]:
    """Run a force sensor until its time is over, it dies, or somebody presses Ctrl-C.

    Args:
        settings: See :class:`LoneForce`.
        started: Told the sensor.
        clock: Or None for the computer's.

    Returns:
        Summary: samples, what left it, samples given up because the computer was too slow.

    Raises:
        InputError: The rate is out of range.
        OutputError: A port is taken.
    """
    rate_hz = settings.start.rate_hz
    _check_rate(rate_hz)
    clock = clock if clock is not None else Clock()
    device = force_device(settings.protocol, settings.start)
    taken = 0
    ended, skipped = "stopped", 0

    def tick(_: int, time_s: float) -> bool:
        nonlocal taken
        device.poll()
        device.send(settings.source(time_s), time_s)
        taken += 1
        return not device.dead

    try:
        started(device)
        with contextlib.suppress(KeyboardInterrupt):
            skipped = keep_pace(_times(rate_hz, settings.seconds), tick, now=clock.now, wait=clock.wait)
            ended = "died" if device.dead else "finished"
    finally:
        device.close()
    return {
        "job": f"twin {settings.protocol}",
        "ended": ended,
        **device.counts(taken),
        "given_up": skipped,
        "counterflex": __version__,
    }


@dataclass(frozen=True, eq=False)
class LoneTracker:
    """A tracker alone.

    Attributes:
        peer: Where its datagrams go.
        source: What it sees; or
        log: what it has seen, to be sent again row by row.
        rate_hz: Measurements per second of a source.
        seconds: How long; None for ever, or to the end of the log.
        sigma_m: Standard deviation that it claims of a source.
        speed: Of a replay; 2 is twice as fast as it was, with the clock of the log.
        repeat: Begin the log again after its end, its clock going on.
        clock_offset_s: Of its clock.
        clock_drift_ppm: Of its clock: how much faster than the computer's it runs.
        faults: Scripted, by the time at which datagrams are sent.
    """

    peer: tuple[str, int]
    source: PoseSource | None = None
    log: TrackerLog | None = None
    rate_hz: float = 1000.0
    seconds: float | None = None
    sigma_m: float = 0.0
    speed: float = 1.0
    repeat: bool = False
    clock_offset_s: float = 0.0
    clock_drift_ppm: float = 0.0
    faults: FaultSchedule = field(default_factory=FaultSchedule)


def run_tracker(settings: LoneTracker, *, clock: Clock | None = None) -> dict[str, Any]:
    """Run a tracker until its time or its log is over, it dies, or somebody presses Ctrl-C.

    Args:
        settings: See :class:`LoneTracker`.
        clock: Or None for the computer's.

    Returns:
        Summary: measurements sent, measurements given up because the computer was too slow.

    Raises:
        InputError: Rate or speed out of range; not one of source and log.
    """
    _check_rate(settings.rate_hz)
    if (settings.source is None) == (settings.log is None):
        raise InputError("a tracker needs either a target or a log", hint="Give one of them")
    if not 0.01 <= settings.speed <= 100.0:
        raise InputError("speed of a replay", value=settings.speed, limit="0.01 .. 100")
    clock = clock if clock is not None else Clock()
    sender = TrackerSender(settings.peer, settings.faults)

    def stamp(time_ns: int, elapsed_s: float) -> int:
        return max(0, time_ns + round((settings.clock_offset_s + elapsed_s * settings.clock_drift_ppm * MICRO) / NS))

    ended, skipped = "stopped", 0
    try:
        with contextlib.suppress(KeyboardInterrupt):
            if settings.log is not None:
                skipped = _replay(settings, settings.log, sender, stamp, clock)
            else:
                skipped = _measure(settings, settings.source, sender, stamp, clock)
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


def _measure(
    settings: LoneTracker, source: PoseSource | None, sender: TrackerSender, stamp: Stamp, clock: Clock
) -> int:
    def tick(_: int, time_s: float) -> bool:
        if source is not None:
            sender.send(source(time_s), time_s, time_ns=stamp(round(time_s / NS), time_s), sigma_m=settings.sigma_m)
        return not sender.dead

    return keep_pace(_times(settings.rate_hz, settings.seconds), tick, now=clock.now, wait=clock.wait)


def _replay(settings: LoneTracker, log: TrackerLog, sender: TrackerSender, stamp: Stamp, clock: Clock) -> int:
    own = np.array([t - log.time_ns[0] for t in log.time_ns], dtype=np.float64) * NS
    lap = float(own[-1] + (own[-1] / (len(own) - 1) if len(own) > 1 else 1.0))
    laps: Iterable[int] = itertools.count() if settings.repeat else range(1)

    def times() -> Iterator[float]:
        for number in laps:
            for time_s in own:
                due = (number * lap + float(time_s)) / settings.speed
                if settings.seconds is not None and due >= settings.seconds:
                    return
                yield due

    def tick(index: int, time_s: float) -> bool:
        number, row = divmod(index, len(own))
        elapsed_s = number * lap + float(own[row])
        sender.send(
            log.Ts_tracker_target[row],
            time_s,
            time_ns=stamp(log.time_ns[row] + round(number * lap / NS), elapsed_s),
            status=log.status[row],
            sigma_m=log.sigma_m[row],
        )
        return not sender.dead

    return keep_pace(times(), tick, now=clock.now, wait=clock.wait)


def _check_rate(rate_hz: float) -> None:
    if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
        raise InputError("rate of an instrument", value=rate_hz, limit=f"{RATES_HZ[0]} .. {RATES_HZ[1]} Hz")


def _times(rate_hz: float, seconds: float | None) -> Iterator[float]:
    for k in itertools.count():
        if seconds is not None and k >= seconds * rate_hz:
            return
        yield k / rate_hz

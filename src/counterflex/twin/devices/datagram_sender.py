"""An instrument's end of a datagram protocol: what leaves, and what goes wrong with it, onto a socket."""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Callable, Iterable
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import NS
from counterflex.protocols.tracker.telegram import BEAM_BROKEN, TrackerPose
from counterflex.twin.network.faults import Condition, FaultSchedule, FaultyLine

LATEST_S: Final = 0.1
"""Lag from which it gives up the samples in between, as an instrument that was held up does."""


def keep_pace(
    times_s: Iterable[float],
    tick: Callable[[int, float], bool],
    *,
    now: Callable[[], float] = time.perf_counter,
    wait: Callable[[float], None] = time.sleep,
) -> int:
    """Call ``tick`` at each of the times.

    Args:
        times_s: Of the samples, s since the start, not decreasing; may never end.
        tick: Told the number of the sample and its time; returns whether to go on.
        wait: Waits for so many seconds.

    Returns:
        Number of samples given up because the pace could not be kept.
    """
    begin = now()
    skipped = 0
    for index, due in enumerate(times_s):
        remaining = begin + due - now()
        if remaining > 0.0:
            wait(remaining)
        elif remaining < -LATEST_S:
            skipped += 1
            continue
        if not tick(index, due):
            break
    return skipped


class DatagramSender:
    """Sends datagrams of an instrument by itself.

    Args:
        peer: Where they go; None sends nothing.
        faults: Scripted, by the time of the readings and their number.

    Attributes:
        sent: Readings put on the line.
        dead: It never sends again.
    """

    def __init__(self, peer: tuple[str, int] | None, faults: FaultSchedule) -> None:
        self.peer, self._faults = peer, faults
        self._line = FaultyLine(faults)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._index = -1
        self.sent = 0
        self.dead = False

    def idle(self, time_s: float) -> None:
        """Nothing is measured now; what was on its way until ``time_s`` arrives."""
        self._line.release(time_s, self._put)

    def _condition(self, time_s: float) -> Condition:
        """Condition of the instrument at its next reading."""
        self._index += 1
        condition = self._faults.condition(self._index, time_s)
        self.dead = condition.dead
        self.idle(time_s)
        return condition

    def _sequence(self, condition: Condition) -> int:
        """Number of the next datagram."""
        return (self.sent + 1 + condition.step) & 0xFFFFFFFF

    def _leave(self, data: bytes, time_s: float) -> None:
        self.sent += 1
        self._line.put(data, time_s, self._put)

    def _put(self, data: bytes) -> None:
        if self.peer is not None:
            with contextlib.suppress(BlockingIOError, ConnectionError):
                self._socket.sendto(data, self.peer)

    def close(self) -> None:
        """Free the socket."""
        self._socket.close()


FAULTS: Final = ("silent", "dying", "counter", "frozen", "status", "nan", "beam_broken", "offset")
"""Faults of the instrument itself that a tracker can show."""


class TrackerSender(DatagramSender):
    """Sends datagrams of a tracker.

    Args:
        peer: Where they go.
        faults: Scripted, by the time of the measurements and their number.
    """

    def __init__(self, peer: tuple[str, int], faults: FaultSchedule | None = None, frame_id: int = 0) -> None:
        faults = faults if faults is not None else FaultSchedule()
        faults.require(FAULTS, "a tracker")
        super().__init__(peer, faults)
        self._frame_id = frame_id
        self._last: Float = np.eye(4)

    def send(
        self,
        T_tracker_target: Float,
        time_s: float,
        *,
        time_ns: int | None = None,
        status: int = 0,
        sigma_m: float = 0.0,
    ) -> None:
        """Send a measurement.

        Args:
            T_tracker_target: (4, 4) m.
            time_ns: On the tracker's own clock; None is ``time_s`` in ns.
            status: Status bits; with a broken beam the last pose is sent again.
            sigma_m: Standard deviation of the position, 0 where not known.
        """
        condition = self._condition(time_s)
        if condition.silent:
            return
        status |= condition.bits | (BEAM_BROKEN if condition.beam_broken else 0)
        if not (status & BEAM_BROKEN or condition.frozen):
            self._last = T_tracker_target.copy()
            self._last[:3, 3] += condition.offset
        T = np.full((4, 4), np.nan) if condition.not_a_number else self._last
        stamp = round(time_s / NS) if time_ns is None else time_ns
        measured = TrackerPose(self._sequence(condition), stamp, status, self._frame_id, T, sigma_m)
        self._leave(measured.telegram(), time_s)

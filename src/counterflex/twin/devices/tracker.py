"""The tracker's end of the neutral pose datagram: measurements, and what goes wrong with them, onto a socket."""

from __future__ import annotations

import contextlib
import socket
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import NS
from counterflex.protocols.tracker.telegram import BEAM_BROKEN, TrackerPose, write_pose
from counterflex.twin.network.faults import FaultSchedule
from counterflex.twin.network.faulty_line import FaultyLine

FAULTS: Final = ("silent", "dying", "counter", "frozen", "status", "nan", "beam_broken", "offset")
"""Faults of the instrument itself that a tracker can show."""


class TrackerSender:
    """Sends datagrams of a tracker.

    Args:
        peer: Where they go.
        faults: Scripted, by the time of the measurements and their number.
        frame_id: Of the datagrams.

    Attributes:
        sent: Measurements put on the line.
        dead: It never sends again.
    """

    def __init__(self, peer: tuple[str, int], faults: FaultSchedule | None = None, frame_id: int = 0) -> None:
        self.peer = peer
        self._faults = faults if faults is not None else FaultSchedule()
        self._faults.require(FAULTS, "a tracker")
        self._line = FaultyLine(self._faults)
        self._frame_id = frame_id
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._last: Float = np.eye(4)
        self._index = -1
        self.sent = 0
        self.dead = False

    def idle(self, time_s: float) -> None:
        """Nothing is measured now; what was on its way until ``time_s`` arrives."""
        self._line.release(time_s, self._put)

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
            time_s: Since the start.
            time_ns: On the tracker's own clock; None is ``time_s`` in ns.
            status: Status bits; with a broken beam the last pose is sent again.
            sigma_m: Standard deviation of the position, 0 where not known.
        """
        self._index += 1
        condition = self._faults.condition(self._index, time_s)
        self.dead = condition.dead
        self._line.release(time_s, self._put)
        if condition.silent:
            return
        status |= condition.bits | (BEAM_BROKEN if condition.beam_broken else 0)
        if not (status & BEAM_BROKEN or condition.frozen):
            self._last = T_tracker_target.copy()
            self._last[:3, 3] += condition.offset
        T = np.full((4, 4), np.nan) if condition.not_a_number else self._last
        sequence = (self.sent + 1 + condition.step) & 0xFFFFFFFF
        stamp = round(time_s / NS) if time_ns is None else time_ns
        data = write_pose(TrackerPose(sequence, stamp, status, self._frame_id, T, sigma_m))
        self.sent += 1
        self._line.put(data, time_s, self._put)

    def _put(self, data: bytes) -> None:
        with contextlib.suppress(BlockingIOError, ConnectionError):
            self._socket.sendto(data, self.peer)

    def close(self) -> None:
        """Free the socket."""
        self._socket.close()

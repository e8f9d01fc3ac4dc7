"""The tracker's end of the neutral pose datagram: measurements, and what goes wrong with them, onto a socket."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import NS
from counterflex.protocols.tracker.telegram import BEAM_BROKEN, TrackerPose
from counterflex.twin.devices.datagram_sender import DatagramSender
from counterflex.twin.network.faults import FaultSchedule

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
            time_s: Since the start.
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

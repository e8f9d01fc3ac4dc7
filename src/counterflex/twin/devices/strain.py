"""The amplifier's end of the strain datagram: readings of all bridges, and what goes wrong with them, onto a socket."""

from __future__ import annotations

import contextlib
import socket
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MICRO, NS
from counterflex.protocols.strain.telegram import StrainSample, write_strain
from counterflex.twin.network.faults import FaultSchedule
from counterflex.twin.network.faulty_line import FaultyLine

FAULTS: Final = ("silent", "dying", "counter", "saturated", "frozen", "nan", "status", "offset")
"""Faults of the instrument itself that it can show; those with a bridge hit that bridge only."""
OF_BRIDGES: Final = ("saturated", "frozen", "nan", "offset")
SATURATED: Final = 4000.0 * MICRO
"""Strain that an amplifier at the end of its range shows."""


class StrainSender:
    """Sends datagrams of a strain amplifier.

    Args:
        peer: Where they go; None sends nothing and only shows readings.
        bridges: Number of bridges.
        faults: Scripted, by the time of the readings and their number.

    Attributes:
        sent: Readings put on the line.
        dead: It never sends again.
        shown: (n,) what it showed last, faults included.
        time_ns: When that was, its own clock.
        temperature_c: Likewise, deg C.

    Raises:
        InputError: A fault that it cannot show, or of a bridge that is not there.
    """

    def __init__(self, peer: tuple[str, int] | None, bridges: int, faults: FaultSchedule | None = None) -> None:
        self.peer, self._bridges = peer, bridges
        faults = faults if faults is not None else FaultSchedule()
        faults.require(FAULTS, "a strain amplifier", bridges=bridges)
        alone = next((f.kind for f in faults.faults if f.bridge is not None and f.kind not in OF_BRIDGES), None)
        if alone is not None:
            raise InputError("this fault hits all bridges", value=alone, limit=", ".join(OF_BRIDGES))
        self._whole = FaultSchedule(tuple(f for f in faults.faults if f.bridge is None), faults.seed)
        self._each = {
            k: FaultSchedule(own, faults.seed)
            for k in range(bridges)
            if (own := tuple(replace(f, bridge=None) for f in faults.faults if f.bridge == k + 1))
        }
        self._line = FaultyLine(self._whole)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.shown: Float = np.zeros(bridges)
        self.time_ns, self.temperature_c = 0, float("nan")
        self._index = -1
        self.sent = 0
        self.dead = False

    def send(self, strain: Float, temperature_c: float, time_s: float, time_ns: int | None = None) -> None:
        """Send a reading.

        Args:
            strain: (n,) dimensionless.
            temperature_c: deg C.
            time_s: Since the start.
            time_ns: On the amplifier's own clock; None is ``time_s`` in ns.
        """
        self._index += 1
        condition = self._whole.condition(self._index, time_s)
        self.dead = condition.dead
        self._line.release(time_s, self._put)
        if condition.silent:
            return
        shown = strain + condition.offset[0]
        if condition.frozen:
            shown = self.shown.copy()
        elif condition.saturated:
            shown = np.copysign(SATURATED, strain)
        elif condition.not_a_number:
            shown = np.full(self._bridges, np.nan)
        for k, schedule in self._each.items():
            shown[k] = self._of_bridge(schedule, k, float(shown[k]), time_s)
        self.shown, self.temperature_c = shown, temperature_c
        sequence = (self.sent + 1 + condition.step) & 0xFFFFFFFF
        self.time_ns = stamp = round(time_s / NS) if time_ns is None else time_ns
        self.sent += 1
        if self.peer is not None:
            data = write_strain(StrainSample(sequence, stamp, condition.bits, temperature_c, shown))
            self._line.put(data, time_s, self._put)

    def _of_bridge(self, schedule: FaultSchedule, k: int, shown: float, time_s: float) -> float:
        one = schedule.condition(self._index, time_s)
        if one.frozen:
            return float(self.shown[k])
        if one.saturated:
            return float(np.copysign(SATURATED, shown))
        return float("nan") if one.not_a_number else shown + one.offset[0]

    def _put(self, data: bytes) -> None:
        if self.peer is not None:
            with contextlib.suppress(BlockingIOError, ConnectionError):
                self._socket.sendto(data, self.peer)

    def close(self) -> None:
        """Free the socket."""
        self._socket.close()

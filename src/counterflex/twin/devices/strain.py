"""The amplifier's end of the strain datagram: readings of all bridges, and what goes wrong with them, onto a socket."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MICRO, NS
from counterflex.protocols.strain.telegram import StrainSample
from counterflex.twin.devices.datagram_sender import DatagramSender
from counterflex.twin.network.faults import FaultSchedule

FAULTS: Final = ("silent", "dying", "counter", "saturated", "frozen", "nan", "status", "offset")
"""Faults of the instrument itself that it can show; those with a bridge hit that bridge only."""
OF_BRIDGES: Final = ("saturated", "frozen", "nan", "offset")
SATURATED: Final = 4000.0 * MICRO
"""Strain that an amplifier at the end of its range shows."""


class StrainSender(DatagramSender):
    """Sends datagrams of a strain amplifier.

    Args:
        peer: Where they go; None sends nothing and only shows readings.
        faults: Scripted, by the time of the readings and their number.

    Attributes:
        shown: (n,) what it showed last, faults included.
        time_ns: When that was, its own clock.
        temperature_c: Likewise, deg C.

    Raises:
        InputError: A fault that it cannot show, or of a bridge that is not there.
    """

    def __init__(self, peer: tuple[str, int] | None, bridges: int, faults: FaultSchedule | None = None) -> None:
        self._bridges = bridges
        faults = faults if faults is not None else FaultSchedule()
        faults.require(FAULTS, "a strain amplifier", bridges=bridges)
        alone = next((f.kind for f in faults.faults if f.bridge is not None and f.kind not in OF_BRIDGES), None)
        if alone is not None:
            raise InputError("this fault hits all bridges", value=alone, limit=", ".join(OF_BRIDGES))
        super().__init__(peer, FaultSchedule(tuple(f for f in faults.faults if f.bridge is None), faults.seed))
        self._each = {
            k: FaultSchedule(own, faults.seed)
            for k in range(bridges)
            if (own := tuple(replace(f, bridge=None) for f in faults.faults if f.bridge == k + 1))
        }
        self.shown: Float = np.zeros(bridges)
        self.time_ns, self.temperature_c = 0, float("nan")

    def send(self, strain: Float, temperature_c: float, time_s: float, time_ns: int | None = None) -> None:
        """Send a reading.

        Args:
            strain: (n,) dimensionless.
            temperature_c: deg C.
            time_ns: On the amplifier's own clock; None is ``time_s`` in ns.
        """
        condition = self._condition(time_s)
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
        self.time_ns = round(time_s / NS) if time_ns is None else time_ns
        sample = StrainSample(self._sequence(condition), self.time_ns, condition.bits, temperature_c, shown)
        if self.peer is None:  # terminals of a PLC show it
            self.sent += 1
        else:
            self._leave(sample.telegram(), time_s)

    def _of_bridge(self, schedule: FaultSchedule, k: int, shown: float, time_s: float) -> float:
        one = schedule.condition(self._index, time_s)
        if one.frozen:
            return float(self.shown[k])
        if one.saturated:
            return float(np.copysign(SATURATED, shown))
        return float("nan") if one.not_a_number else shown + one.offset[0]

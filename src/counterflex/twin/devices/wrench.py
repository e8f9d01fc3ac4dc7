"""A simulated force sensor that sends by itself: samples, and what goes wrong with them, as datagrams onto a socket."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import NS
from counterflex.protocols.wrench.telegram import INVALID, SATURATED, Wrench
from counterflex.twin.devices.datagram_sender import DatagramSender
from counterflex.twin.network.faults import FaultSchedule

FAULTS: Final = ("silent", "dying", "counter", "saturated", "frozen", "status", "nan", "offset")
"""Faults of the instrument itself that the sensor can show."""
RANGE_N: Final = 20_000.0
"""Force at which the simulated sensor stands when it is saturated."""


class WrenchSender(DatagramSender):
    """Sends one datagram for each sample.

    Args:
        peer: Where they go.
        faults: Scripted, by the time of the samples and their number.
        source: Source id of the datagrams.
        write: What makes a datagram of a measurement; None: the generic wrench datagram.
        rate_hz: Samples per second where the times are not said.

    Attributes:
        status: Status bits of the samples, beside those of a fault.
    """

    def __init__(
        self,
        peer: tuple[str, int],
        faults: FaultSchedule | None = None,
        *,
        source: int = 0,
        write: Callable[[Wrench], bytes] | None = None,
        rate_hz: float = 1000.0,
    ) -> None:
        faults = faults if faults is not None else FaultSchedule()
        faults.require(FAULTS, "a sender of wrench datagrams")
        super().__init__(peer, faults)
        self.status, self.address, self.http_address = 0, None, None
        self._period_s = 1.0 / rate_hz
        self._source, self._write = source, write if write is not None else Wrench.written
        self._shown: Float = np.zeros(6)

    def counts(self, _: int, /) -> dict[str, int]:
        """Samples that left."""
        return {"samples": self.sent}

    def poll(self) -> None:
        """Nothing is asked of it: it sends by itself."""

    def send(self, w_sensor: Float, time_s: float | None = None) -> None:
        """Send a sample.

        Args:
            w_sensor: (6,) N, N m.
            time_s: Since the start; also its time stamp. None counts samples.
        """
        time_s = (self._index + 1) * self._period_s if time_s is None else time_s
        condition = self._condition(time_s)
        if condition.silent:
            return
        if not condition.frozen:
            self._shown = w_sensor + np.array([*condition.offset, 0.0, 0.0, 0.0])
        shown, status = self._shown, self.status | condition.bits
        if condition.saturated:
            shown = np.where(shown < 0.0, -RANGE_N, RANGE_N)
            status |= SATURATED
        if condition.not_a_number:
            shown = np.full(6, np.nan)
            status |= INVALID
        sequence = self._sequence(condition)
        fx, fy, fz, mx, my, mz = shown.tolist()
        data = self._write(Wrench(sequence, round(time_s / NS), status, self._source, (fx, fy, fz, mx, my, mz)))
        self._leave(data, time_s)

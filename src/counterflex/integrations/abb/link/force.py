"""The force that an ABB robot measures itself (option Force Control), as it comes with its EGM messages."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.integrations.abb.link.link import EgmLink

FROZEN: Final = 25
"""Messages with the same six numbers in a row that no living sensor sends."""


class EgmForce:
    """Readings out of the messages of an EGM link, in the axes of the sensor.

    Args:
        link: Whose messages are read; its cycle is that of the force.
        range_n: Largest force that the sensor measures; 95 % of it counts as saturated. None: not watched.
        range_nm: Largest moment, likewise.

    Attributes:
        saturated: It was beyond the range.
        frozen: It has not changed for 25 messages.
    """

    def __init__(self, link: EgmLink, *, range_n: float | None = None, range_nm: float | None = None) -> None:
        self._link = link
        limits = (np.inf if range_n is None else range_n, np.inf if range_nm is None else range_nm)
        self._limit = 0.95 * np.r_[np.full(3, limits[0]), np.full(3, limits[1])]
        self.w_sensor: Float = np.zeros(6)  # (6,) N, N m of the newest message that had a force
        self.samples: Float = np.zeros((1, 6))  # (1, 6) the same
        self.first = -1  # -1: they do not come at 1 kHz
        self.good = 0  # 1 when the newest message had one, else 0
        self.saturated = self.frozen = False
        self._seen = -1
        self._same = 0

    def drain(self) -> int:
        """Take the force of the newest message; returns :attr:`good`."""
        force, telegrams = self._link.force, self._link.counters.telegrams
        self.good = int(force is not None and telegrams != self._seen)
        self._seen = telegrams
        if force is None or not self.good:
            return 0
        self._same = self._same + 1 if np.array_equal(force, self.w_sensor) else 0
        self.frozen = self._same >= FROZEN - 1
        self.saturated = bool(np.any(np.abs(force) > self._limit))
        self.w_sensor[:] = force
        self.samples[0] = force
        return 1

    def close(self) -> None:
        """Nothing to free: the link has the port."""

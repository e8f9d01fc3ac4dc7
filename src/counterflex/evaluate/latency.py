"""Percentiles of any number of times in constant memory: counted in classes that are one percent wide."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError

_WIDTH: Final = math.log(1.01)
_LEAST: Final = 1e-2
_CLASSES: Final = 2084
"""Up to 1e7 times the unit of the least class."""


class LatencyHistogram:
    """Counts of times; a percentile is the upper end of its class: at most one percent above a value that was met.

    Valid from 0.01 to 1e7 of the unit that the times are given in; smaller ones count as 0.01, larger ones are in the
    last class, and :attr:`largest` keeps what was met.

    Attributes:
        n: Times counted.
        largest: Of them, 0 for none.
    """

    def __init__(self) -> None:
        self._counts: Int = np.zeros(_CLASSES, dtype=np.int64)
        self.n = 0
        self.largest = 0.0

    def add(self, times: Float) -> None:
        """Count times (n,), finite.

        Raises:
            InputError: One is not a number or below zero.
        """
        if len(times) == 0:
            return
        if not np.all(np.isfinite(times)) or np.min(times) < 0.0:
            raise InputError("a time to be counted", value=float(np.min(times)), limit="finite, >= 0")
        classes = np.ceil(np.log(np.maximum(times, _LEAST) / _LEAST) / _WIDTH).astype(np.int64)
        self._counts += np.bincount(np.minimum(classes, _CLASSES - 1), minlength=_CLASSES)
        self.n += len(times)
        self.largest = max(self.largest, float(np.max(times)))

    def at(self, share: float) -> float:
        """Time that at least this share (0 .. 1) of all does not exceed, see the class; 0 for none.

        Raises:
            InputError: ``share`` out of range.
        """
        if not 0.0 < share <= 1.0:
            raise InputError("share of a percentile", value=share, limit="0 .. 1")
        if self.n == 0:
            return 0.0
        place = int(np.searchsorted(np.cumsum(self._counts), math.ceil(share * self.n - 1e-9)))
        return min(self.largest, _LEAST * math.exp(place * _WIDTH))

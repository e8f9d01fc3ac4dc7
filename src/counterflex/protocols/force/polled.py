"""A force sensor that hands over samples when it is asked: what comes is checked here before the loop sees it."""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import InputError
from counterflex.protocols.force.source import LARGEST

MOST_SAMPLES: Final = 512
"""Samples of one drain that are kept one by one; later ones still enter the mean."""
SATURATED: Final = 0.95
"""Share of the range at which a reading is not believed any more."""
FROZEN: Final = 25
"""Samples with the same six numbers in a row that no living sensor sends."""


class Receiver(Protocol):
    """A receiver that a protocol of another package opens."""

    def receive(self) -> Float:
        """(k, 6) N, N m: the samples that have come since the last call, oldest first, k >= 0; must not wait."""

    def close(self) -> None:
        """End the stream and free the socket."""


class PolledForce:
    """Readings of a receiver. Nothing that it does can stop the loop: a call that fails is a cycle without samples.

    Args:
        receiver: What is asked in every cycle.
        range_n: Largest force that the sensor measures; 95 % of it counts as saturated. None: not watched.
        range_nm: Largest moment, likewise.

    Attributes:
        w_sensor: (6,) N, N m, mean of the good samples since the last :meth:`drain` that had any.
        samples: (MOST_SAMPLES, 6) N, N m, the good ones of the last drain one by one.
        first: -1: they do not come at 1 kHz.
        good: Good samples in the last drain.
        saturated: One of them was beyond the range.
        frozen: The readings have not changed for 25 samples.
        bad: Samples that were no six finite numbers, and calls that failed, in all.
        fault: The last thing that was wrong, for people.

    Raises:
        InputError: A range is not above 0.
    """

    def __init__(self, receiver: Receiver, *, range_n: float | None = None, range_nm: float | None = None) -> None:
        limits = [np.inf if value is None else value for value in (range_n, range_nm)]
        if not min(limits) > 0.0:
            raise InputError("the range of the force sensor is not above 0", value=min(limits))
        self._receiver = receiver
        self._limit: Float = SATURATED * np.repeat(limits, 3)
        self._last: Float = np.full(6, np.nan)
        self._same = 0
        self.w_sensor: Float = np.zeros(6)
        self.samples: Float = np.zeros((MOST_SAMPLES, 6))
        self.first, self.good, self.bad = -1, 0, 0
        self.saturated = self.frozen = False
        self.fault = ""

    def drain(self) -> int:
        """Take every sample that is there; returns the number of good ones."""
        self.good = 0
        try:
            received = np.array(self._receiver.receive(), dtype=np.float64)
        except Exception as fault:
            return self._wrong(1, f"{type(fault).__name__}: {fault}")
        if received.size == 0:
            return 0
        if received.ndim != 2 or received.shape[1] != 6:
            return self._wrong(1, f"samples of shape {received.shape}, expected (k, 6)")
        finite: Bool = np.all(np.abs(received) <= LARGEST, axis=1)  # a NaN is not
        if not np.all(finite):
            self._wrong(int(np.sum(~finite)), "a sample with a number that is not finite, or beyond 1e6")
        return self._take(received[finite])

    def _take(self, good: Float) -> int:
        self.good = len(good)
        if self.good == 0:
            return 0
        for sample in good:
            self._same = self._same + 1 if np.array_equal(sample, self._last) else 0
            self._last = sample
        self.frozen = self._same >= FROZEN - 1
        self.saturated = bool(np.any(np.abs(good) > self._limit))
        self.w_sensor[:] = good.mean(axis=0)
        count = min(self.good, MOST_SAMPLES)
        self.samples[:count] = good[:count]
        return self.good

    def _wrong(self, count: int, fault: str) -> int:
        self.bad += count
        self.fault = fault
        return 0

    def close(self) -> None:
        """End the stream; a receiver that fails in it has ended too."""
        try:
            self._receiver.close()
        except Exception as fault:
            self._wrong(1, f"{type(fault).__name__}: {fault}")

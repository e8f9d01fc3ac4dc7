"""Load of a simulated force sensor over time, where no simulated cell loads it."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError

WrenchSource = Callable[[float], Float]
"""(6,) N, N m on the sensor at a time in s since the start."""


@dataclass(frozen=True, eq=False)
class SteadyWrench:
    """A constant load, with a sine on top: ``w + a sin(2 pi f t)``."""

    w_constant: Float  # (6,) N, N m
    w_amplitude: Float  # (6,) N, N m of the sine
    sine_hz: float = 0.0  # its frequency

    def __post_init__(self) -> None:
        """Check shapes."""
        as_float("w_constant", self.w_constant, (6,))
        as_float("w_amplitude", self.w_amplitude, (6,))
        as_positive("sine_hz", self.sine_hz, zero=True)

    def __call__(self, time_s: float) -> Float:
        """The load at a time."""
        out: Float = self.w_constant + self.w_amplitude * math.sin(2.0 * math.pi * self.sine_hz * time_s)
        return out


@dataclass(frozen=True, eq=False)
class RecordedWrench:
    """A record, linear between its rows; before and after it the nearest row, or from the beginning again."""

    time_s: Float  # (n,) increasing
    w_record: Float  # (n, 6) N, N m
    repeat: bool = False  # begin again after the end

    def __post_init__(self) -> None:
        """Check shapes. Raises InputError: fewer than two rows, or times that do not increase."""
        as_float("w_record", self.w_record, (len(self.time_s), 6))
        if len(self.time_s) < 2 or np.any(np.diff(as_float("time_s", self.time_s, (None,))) <= 0.0):
            raise InputError("times of a recorded load do not increase", value=len(self.time_s), limit=">= 2 rows")

    def __call__(self, time_s: float) -> Float:
        """The load at a time; the record begins at 0."""
        span = float(self.time_s[-1] - self.time_s[0])
        t = time_s % span if self.repeat else time_s
        at = float(np.clip(self.time_s[0] + t, self.time_s[0], self.time_s[-1]))
        k = min(int(np.searchsorted(self.time_s, at, side="right")) - 1, len(self.time_s) - 2)
        u = (at - self.time_s[k]) / (self.time_s[k + 1] - self.time_s[k])
        out: Float = (1.0 - u) * self.w_record[k] + u * self.w_record[k + 1]
        return out


class NoisyWrench:
    """A load as a sensor shows it: white noise on every component.

    Args:
        noise_n: Standard deviation of a force.
        noise_nm: Standard deviation of a moment.
    """

    def __init__(self, source: WrenchSource, noise_n: float, noise_nm: float, seed: int = 0) -> None:
        self._source = source
        self._scale = np.r_[
            np.full(3, as_positive("noise_n", noise_n, zero=True)),
            np.full(3, as_positive("noise_nm", noise_nm, zero=True)),
        ]
        self._noise = np.random.default_rng(random.Random(f"counterflex-lone-force:{seed}").getrandbits(64))

    def __call__(self, time_s: float) -> Float:
        """The reading at a time."""
        out: Float = self._source(time_s) + self._scale * self._noise.standard_normal(6)
        return out

"""Flange sensor and instrumented holder as one process wrench at the TCP: fused by covariance, either may fall away."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.records import Record, records
from counterflex.runtime.sensing.pair_kernel import FIRST, PAIR, PAIRED, SECOND, pair_step
from counterflex.runtime.sensing.sensor_wrench import SensorWrench
from counterflex.runtime.sensing.strain_wrench import StrainWrench
from counterflex.runtime.state.states import Cause

_NOTHING, _INVALID, _DIFFER = int(Cause.NONE), int(Cause.FORCE_INVALID), int(Cause.FORCE_DISAGREES)
_MOMENT_S: Final = 0.1
"""Over which the moment fades when the flange sensor falls away, and comes back with it."""


@dataclass(frozen=True)
class PairTuning:
    """Settings of the filter of two sensors."""

    noise_n: float = 3.0  # standard deviation of the flange sensor's reading of a cycle
    zero_n: float = 1.0  # standard deviation of its zero when it has been taken
    walk_n: float = 0.1  # standard deviation of that zero's walk over one second
    # (3,) likewise of the force that the zeros of the holder's bridges look like, holder axes
    holder_walk_n: tuple[float, float, float] = (1.0, 1.0, 1.0)
    slew_n: float = 1000.0  # standard deviation of the force's walk over one second
    late_s: tuple[float, float] = (0.0, 0.0)  # age of a reading of the flange sensor and of the holder
    gate: float = 5.0  # standard deviations by which they may differ
    differ_n: float = 30.0  # and so many newtons on top
    differ_s: float = 0.1  # how long they may differ by more before it is an alarm; meanwhile the force stands still

    def __post_init__(self) -> None:
        """Check ranges. Raises InputError: a number that is not above zero, or an age below zero."""
        for name in ("noise_n", "zero_n", "walk_n", "slew_n", "gate", "differ_n", "differ_s"):
            as_positive(f"two sensors: {name}", getattr(self, name))
        for value in self.holder_walk_n:
            as_positive("two sensors: holder_walk_n", value)
        for value in self.late_s:
            as_positive("two sensors: late_s", value, zero=True)


class PairWrench:
    """The readings of one cycle as process wrench. The moment is that of the flange sensor; without it there is none.

    Args:
        T_base_part: (4, 4) part frame.
        period_s: Cycle.

    Attributes:
        fresh: Bits of the sensors that have something new, set before each call; those that were used after it.
        w_part: (6,) N, N m: result, on the tool about its tip, part axes.
        w_first: (6,) last wrench of the flange sensor, its zero not taken off.
        doubt: Cause why the force cannot be used, or 0.
        zero: (6,) of the flange sensor, part axes.
        paired: What the filter remembers, PAIRED.
    """

    def __init__(
        self,
        first: SensorWrench,
        second: StrainWrench,
        T_base_part: Float,
        period_s: float,
        tuning: PairTuning | None = None,
    ) -> None:
        self.tuning = PairTuning() if tuning is None else tuning
        self.first, self.second = first, second
        self._R_part_base: Float = as_float("T_base_part", T_base_part, (4, 4))[:3, :3].T.copy()
        self._period_s = as_positive("period_s", period_s)
        self._pairs, self._paireds = records(PAIR), records(PAIRED)
        self._pair: Record = self._pairs[0]
        self.paired: Record = self._paireds[0]
        t, c = self.tuning, self._pair
        c.slew, c.gate, c.floor_n = t.slew_n**2, t.gate, t.differ_n
        c.walk[:3], c.walk[3:] = t.walk_n**2, np.square(t.holder_walk_n)
        c.late[:] = t.late_s
        c.patience = max(1, round(t.differ_s / period_s))
        self.w_part: Float = np.zeros(6)
        self.w_first: Float = np.zeros(6)
        self.zero: Float = np.zeros(6)
        self.fresh, self.doubt, self.tared = 0, _NOTHING, False
        self._share = 1.0
        self.begin()

    @property
    def sigma(self) -> Float:
        """(3,) N, standard deviation of the force, part axes."""
        out: Float = np.sqrt(np.diag(self.paired.covariance)[:3])
        return out

    @property
    def gap_n(self) -> float:
        """Largest difference of both along an axis, zeros taken off, when both last had something new."""
        return float(self.paired.gap_n)

    def begin(self) -> None:
        """Begin anew, with zeros as taken."""
        p = self.paired
        p.x[:], p.covariance[:] = 0.0, 0.0
        spread = np.square(self.second.observed.sigma)
        np.fill_diagonal(p.covariance, [*(self.tuning.slew_n**2,) * 3, *(self.tuning.zero_n**2,) * 3, *spread])
        p.differing = p.alarm = 0

    def take_zero(self, zero: Float) -> None:
        """Take the flange sensor's zero (6,) N, N m, part axes, and begin anew; the holder has its own."""
        self.zero[:] = zero
        self.tared = True
        self.begin()

    def __call__(self, q: Float, w_sensor: Float, time_s: float = 0.0, temperature_c: float = math.nan) -> Float:
        """Process wrench of what is new, see :attr:`fresh`.

        Args:
            q: (6,) rad.
            w_sensor: (6,) N, N m reading of the flange sensor; the holder's samples are in the arrays of its receiver.
            time_s: Since the flange sensor's zero.
        """
        p, fresh = self.paired, self.fresh
        if fresh & FIRST:
            self.w_first[:] = self.first(q, w_sensor, time_s, temperature_c)
            fresh &= ~FIRST if self.first.doubt else FIRST | SECOND
        w_second = self.second(q) if fresh & SECOND else self.second.w_part
        if self.second.doubt:
            fresh &= ~SECOND
        self.fresh = fresh
        if not self.tared:
            self.w_part[:] = self.w_first
            self.doubt = _NOTHING if fresh == FIRST | SECOND else _INVALID
            return self.w_part
        w_first = self.w_first - self.zero
        p.axes[:3] = (self._R_part_base @ self.first.R_base_sensor).T
        p.axes[3:] = (self._R_part_base @ self.second.R_base_holder).T
        p.reading[:3], p.reading[3:] = p.axes[:3] @ w_first[:3], p.axes[3:] @ w_second[:3]
        p.noise[:3], p.noise[3:] = self.tuning.noise_n**2, np.square(self.second.observed.sigma)
        taken = pair_step(self._pair, p, self._period_s, fresh)
        step = self._period_s / _MOMENT_S
        self._share = min(1.0, self._share + step) if fresh & FIRST else max(0.0, self._share - step)
        if taken:
            self.w_part[:3], self.w_part[3:] = p.x[:3], self._share * w_first[3:]
        self.doubt = _DIFFER if p.alarm else _NOTHING if fresh else _INVALID
        return self.w_part

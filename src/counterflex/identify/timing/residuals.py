"""Residuals of a channel that follows another one late, lagged and perhaps by another clock.

Component c of the answer at its own stamp t is::

    y_c(t) = offset_c + sum_b g_cb B_b(t - delay_c - drift (t - t_mid))

with basis signals ``B_b``: the reference (behind a lag of first or second order where one is fitted) and further known
signals (torque, direction of motion), all continuous in time; so a delay need not be a whole number of samples.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Int
from counterflex.signals.lag import Lag

Order = Literal["none", "first", "second"]
"""Order of the lag."""


@dataclass(frozen=True, eq=False)
class Basis:
    """Known signals on one even grid of time."""

    start_s: float  # time of the first sample, by the clock of the reference
    step_s: float
    values: Float  # (N, B) any unit
    lagged: Bool  # (B,) which of them the lag acts on

    @property
    def end_s(self) -> float:
        """Time of the last sample."""
        return self.start_s + (len(self.values) - 1) * self.step_s


@dataclass(frozen=True)
class Places:
    """Places of the parameters of one pair of channels among all."""

    delay: tuple[int, ...]  # (m,) of each component; the same place where one delay is common
    offset: tuple[int, ...]  # (m,) of each component
    gain: tuple[tuple[int, ...], ...]  # (m, B) of each basis signal, -1 where it takes no part
    drift: int = -1  # or -1
    lag: int = -1  # or -1
    damping: int = -1  # or -1


@dataclass(frozen=True, eq=False)
class DelayResiduals:
    """See :class:`counterflex.identify.solver.residuals.Residuals` and the module."""

    name: str  # of the pair
    group: Int  # (n,) stretches of time, for hold-out
    components: tuple[str, ...]  # names with unit
    sigma: Float  # (n, m) SI
    time_s: Float  # (n,) stamps of the answer
    measured: Float  # (n, m) SI
    middle_s: float
    basis: Basis
    places: Places  # where the parameters stand
    count: int  # number of all parameters
    _memory: dict[tuple[float, ...], tuple[scipy.interpolate.CubicSpline, list[scipy.interpolate.CubicSpline]]] = field(
        default_factory=dict, repr=False
    )

    def predict(self, x: Float) -> Float:
        """Predicted values (n, m) SI at the parameters x (p,)."""
        return self._walk(x, None)

    def evaluate(self, x: Float) -> Float:
        """Weighted residuals (n, m)."""
        out: Float = (self.measured - self._walk(x, None)) / self.sigma
        return out

    def jacobian(self, x: Float) -> Float:
        """(n, m, p) derivative of the weighted residuals."""
        J: Float = np.zeros((*self.measured.shape, self.count))
        self._walk(x, J)
        out: Float = -J / self.sigma[:, :, None]
        return out

    def subset(self, rows: Bool) -> DelayResiduals:
        """The marked rows only."""
        return replace(
            self, group=self.group[rows], sigma=self.sigma[rows], time_s=self.time_s[rows], measured=self.measured[rows]
        )

    def _walk(self, x: Float, J: Float | None) -> Float:
        p = self.places
        signal, by_lag = self._splines(x)
        from_middle = self.time_s - self.middle_s
        drift = x[p.drift] if p.drift >= 0 else 0.0
        out: Float = np.empty(self.measured.shape)
        known: dict[int, tuple[Float, Float, list[Float]]] = {}
        for c in range(self.measured.shape[1]):
            place = p.delay[c]
            if place not in known:
                at = self.time_s - x[place] - drift * from_middle
                known[place] = (
                    signal(at),
                    signal(at, 1) if J is not None else np.zeros(0),
                    [part(at) for part in by_lag] if J is not None else [],
                )
            B, dB, lagged = known[place]
            gain = np.array([x[i] if i >= 0 else 0.0 for i in p.gain[c]])
            out[:, c] = x[p.offset[c]] + B @ gain
            if J is None:
                continue
            J[:, c, p.offset[c]] += 1.0
            for b, i in enumerate(p.gain[c]):
                if i >= 0:
                    J[:, c, i] += B[:, b]
            slope = dB @ gain
            J[:, c, place] -= slope
            if p.drift >= 0:
                J[:, c, p.drift] -= slope * from_middle
            for i, part in zip((p.lag, p.damping), lagged, strict=False):
                J[:, c, i] += part @ gain
        return out

    def _splines(self, x: Float) -> tuple[scipy.interpolate.CubicSpline, list[scipy.interpolate.CubicSpline]]:
        p, basis = self.places, self.basis
        key = tuple(float(x[i]) for i in (p.lag, p.damping) if i >= 0)
        # The lag is the only parameter that bends the signals; all others read the same splines at other times.
        if key not in self._memory:
            grid = basis.start_s + basis.step_s * np.arange(len(basis.values))
            values, parts = basis.values, np.zeros((0, *basis.values.shape))
            if p.lag >= 0:
                lag = Lag(key[0], key[1] if p.damping >= 0 else None)
                mine = basis.values[:, basis.lagged]
                answer, derivative = lag.sensitivity(mine, basis.step_s)
                values = basis.values.copy()
                values[:, basis.lagged] = answer
                parts = np.zeros((len(derivative), *basis.values.shape))
                parts[:, :, basis.lagged] = derivative
            self._memory.clear()
            self._memory[key] = (
                scipy.interpolate.CubicSpline(grid, values),
                [scipy.interpolate.CubicSpline(grid, part) for part in parts],
            )
        return self._memory[key]

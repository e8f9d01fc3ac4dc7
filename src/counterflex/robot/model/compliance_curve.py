"""Compliances that change with the load of their spring: gears are soft about zero torque and stiffen with it.

``c(x) = c f(x)`` is the slope of the displacement over the whole load x of the spring, own weight included; f is linear
between the loads that it is given at and constant beyond them. Data sheets of strain wave gears give such a curve as
three slopes (K1 up to T1, K2 up to T2, K3 beyond), those of cycloidal gears as lost motion and stiffness.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float

LOADS: Final = (2, 8)
"""Fewest and most loads of one curve."""
_SMALL: Final = 1e-6
"""Share of the largest load of a curve below which a load is too small to divide by."""


@dataclass(frozen=True)
class ComplianceCurve:
    """Factor on one compliance over the load of its spring."""

    segment: str  # its name, of the robot or of the end effector
    direction: int  # 0..5 of `tx ty tz rx ry rz`
    loads: tuple[float, ...]  # (k,) N or N m, rising; the sign is that of the load in the frame of the segment
    factors: tuple[float, ...]  # (k,) on the compliance at these loads

    def integral(self, load: Float) -> Float:
        """Displacement over the compliance, from the lowest load of the curve: the integral of f.

        Args:
            load: (...) N or N m.

        Returns:
            (...) N or N m.
        """
        x, f = np.array(self.loads), np.array(self.factors)
        area = np.concatenate([[0.0], np.cumsum(0.5 * (f[1:] + f[:-1]) * np.diff(x))])
        k = np.clip(np.searchsorted(x, load, side="right") - 1, 0, len(x) - 2)
        inside = np.clip(load, x[0], x[-1])
        slope = (f[k + 1] - f[k]) / (x[k + 1] - x[k])
        step = inside - x[k]
        beyond = f[0] * np.minimum(load - x[0], 0.0) + f[-1] * np.maximum(load - x[-1], 0.0)
        out: Float = area[k] + f[k] * step + 0.5 * slope * step**2 + beyond
        return out

    def secant(self, weight: Float, load: Float) -> Float:
        """Mean factor while a load is put on a spring that carries another: what the load moves is c times this.

        Args:
            weight: (...) N or N m, carried before and after.
            load: (...) N or N m, put on.

        Returns:
            (...) mean of f from ``weight`` to ``weight + load``; f itself where the load is zero.
        """
        small = _SMALL * max(abs(self.loads[0]), abs(self.loads[-1]))
        tiny = np.abs(load) < small
        put = np.where(tiny, 1.0, load)
        mean = (self.integral(weight + put) - self.integral(weight)) / put
        out: Float = np.where(tiny, np.interp(weight + 0.5 * load, self.loads, self.factors), mean)
        return out

    def times(self, other: ComplianceCurve) -> ComplianceCurve:
        """The product with another curve of the same spring, at the loads of both (the most that a curve may have)."""
        x = np.unique(np.concatenate([self.loads, other.loads]))
        if len(x) > LOADS[1]:
            # Too many loads for one curve: thinned by their number, so that they stay dense where they were.
            x = np.interp(np.linspace(0.0, 1.0, LOADS[1]), np.linspace(0.0, 1.0, len(x)), x)
        factors = np.interp(x, self.loads, self.factors) * np.interp(x, other.loads, other.factors)
        return ComplianceCurve(self.segment, self.direction, tuple(x.tolist()), tuple(factors.tolist()))


def secants(curves: Sequence[ComplianceCurve], names: Sequence[str], weight: Float, load: Float) -> Float:
    """Mean factors on all compliances of a chain while a load is put on.

    Args:
        curves: Any number, one for a spring.
        names: n segments of the chain.
        weight: (..., n, 6) N, N m of each segment, carried before and after.
        load: (..., n, 6) N, N m put on.

    Returns:
        (..., n, 6): 1 where no curve acts.
    """
    out = np.ones(load.shape)
    for curve in curves:
        at = (..., list(names).index(curve.segment), curve.direction)
        out[at] = curve.secant(weight[at], load[at])
    return out

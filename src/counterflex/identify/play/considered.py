"""What the model of a gear takes as known or leaves out: how it widens the intervals of play and friction.

The torsion compliance is held where small motions cannot see it: friction is found as a turn, ``c F``, and F is no
better than c. And no gear is an ideal dead band behind ideal springs: its flanks come to bear over some travel, part
of its wind-up comes late, and both differ from pose to pose. That is alike in every reversal, so no residual and no
part left out shows all of it. Each goes through the fit with its usual size
(:mod:`counterflex.identify.solver.considered`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.units import URAD
from counterflex.identify.play.residuals import AxisResiduals, ReversalResiduals
from counterflex.identify.solver.considered import added, considered
from counterflex.identify.solver.correlated import with_correlation
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.jackknife import widened, with_jackknife

LATE: Final = 0.1
"""Share of the lost motion that may come late."""
LATE_S: Final = (0.3, 1.0)
"""By how much."""
SOFT_RAD: Final = 6.0 * URAD
"""Travel over which flanks may come to bear."""
POSE: Final = 0.05
"""Relative difference of play and friction from pose to pose."""
_STRETCHES: Final = 6
_SAME_RAD: Final = 1e-3


def with_honest_sigma(plain: Fit, rows: AxisResiduals) -> Fit:
    """The fit of an axis with standard deviations that hold for what the model of a gear leaves out.

    ``plain``: Of these rows, its covariance that of independent rows.

    Returns:
        Standard deviations of correlated rows, not below those of the jackknife over stretches of the motions, and what
        is left out; the latter for the constants of the gear, not for the delay, which is taken out and used nowhere.
    """
    jackknife = with_jackknife(plain, [rows], [_stretches(rows)])
    wide = widened(with_correlation(plain, [rows]), np.diag(jackknife.covariance))
    more = considered(plain, [rows], [left_out(rows, plain.values)[:, None, :]])
    gear = np.isin(plain.free_index, rows.parts[0].places.constants)
    return added(wide, more * np.outer(gear, gear))


def compliance_share(fit: Fit, rows: AxisResiduals) -> Float:
    """Standard deviations (p,) SI of all parameters by a torsion compliance that is held; zero where it is fitted."""
    out = np.zeros(len(fit.values))
    place = rows.parts[0].places.compliance
    item = fit.parameters.items[place]
    if item.free:
        return out
    x, free = fit.values, fit.free_index
    off = item.prior_sigma * x[place]
    moved = -rows.jacobian(x)[:, :, place : place + 1] * rows.sigma[:, :, None] * off
    slope = fit.parameters.slope(x)[free]
    out[free] = np.sqrt(np.diag(considered(fit, [rows], [moved]))) * slope
    return out


def left_out(rows: AxisResiduals, x: Float) -> Float:
    """(n, m) what one standard deviation of each thing left out moves the measured values by, SI.

    ``x``: (p,) values.
    """
    places = [round(float(np.mean(part.q)) / _SAME_RAD) for part in rows.parts]
    poses = sorted(set(places))
    out = []
    for part, place in zip(rows.parts, places, strict=True):
        lost, _ = part.lost(x)
        lost = lost - lost.mean()
        travel = np.abs(np.diff(part.q, prepend=part.q[0]))
        time = np.zeros(len(lost)) if part.time_s is None else np.diff(part.time_s, prepend=part.time_s[0])
        shapes = [lagging(travel, lost, SOFT_RAD) - lost]
        shapes += [LATE * (lagging(time, lost, late) - lost) * (part.time_s is not None) for late in LATE_S]
        shapes += [POSE * lost * (place == one) for one in poses]
        out.append(np.stack(shapes, axis=1) * _lever(part))
    return np.concatenate(out)


def with_spread(fit: Fit, sigma: Float) -> Fit:
    """The fit with independent standard deviations (p,) SI added to those of its values; the covariance as it was."""
    return replace(fit, sigma=np.where(fit.sigma > 0.0, np.hypot(fit.sigma, sigma), 0.0))


@kernel()
def lagging(steps: Float, values: Float, length: float) -> Float:
    """Values (n,) that follow with a lag of first order, over steps (n,) of time or travel."""
    out = np.empty_like(values)
    now = values[0]
    for k in range(len(values)):
        now += (values[k] - now) * (1.0 - np.exp(-steps[k] / length))
        out[k] = now
    return out


def _lever(part: ReversalResiduals) -> float:
    """What a turn of the link moves the measured value by: 1 for encoders, m/rad for a tracker."""
    if part.by == "encoder":
        return 1.0
    angle = part.q - np.mean(part.q)
    return abs(float(np.polyfit(angle, part.measured, 1)[0]))


def _stretches(rows: AxisResiduals) -> np.ndarray:
    parts = []
    for k, part in enumerate(rows.parts):
        n = len(part.q)
        parts.append(k * _STRETCHES + np.arange(n) * _STRETCHES // max(n, 1))
    return np.concatenate(parts)

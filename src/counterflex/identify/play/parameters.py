"""Constants of play and friction of one axis, with what the cell file or experience says beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.units import MS, URAD
from counterflex.identify.data.model import CellModel
from counterflex.identify.play.data import ReversalMotion, motor_friction, motor_friction_sigma
from counterflex.identify.play.residuals import AxisResiduals, PlayPlaces, ReversalResiduals
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.jackknife import added, considered, widened, with_correlation, with_jackknife
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.robot.model.description import Play

# What the model of a gear takes as known or leaves out: how it widens the intervals of play and friction.
# The torsion compliance is held where small motions cannot see it: friction is found as a turn, ``c F``, and F is no
# better than c. And no gear is an ideal dead band behind ideal springs: its flanks come to bear over some travel, part
# of its wind-up comes late, and both differ from pose to pose. That is alike in every reversal, so no residual and no
# part left out shows all of it. Each goes through the fit with its usual size
# (:mod:`counterflex.identify.solver.jackknife`).

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


@kernel("float64[::1](float64[::1], float64[::1], float64)", entry=True)
def lagging(steps: Float, values: Float, length: float) -> Float:
    """Values (n,) that follow with a lag of first order, over steps (n,) of time or travel."""
    out = np.empty_like(values)
    now = values[0]
    for k in range(len(values)):
        now += (values[k] - now) * (1.0 - np.exp(-steps[k] / length))
        out[k] = now
    return out


def _lever(part: ReversalResiduals) -> float:
    """Change of the measured value per turn of the link: 1 for encoders, m/rad for a tracker."""
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


APART_RAD: Final = 0.1
"""Angle of any axis from which two motions are in different poses."""
POSES: Final = 2
"""Fewest poses of an axis. In one pose a dead band, friction and what the gear does in that pose look alike."""
LOADED: Final = 1.0
"""Torque in units of the dry friction from which an axis is loaded: its gear stays on one flank."""
BALANCED: Final = 0.7
"""The same below which it is balanced: its gear crosses the dead band."""


SCALE: Final = 0.03
"""Relative error of the motor's torque (torque constant, temperature), one standard deviation."""
MOST: Final = 0.15
"""Excess of the friction on the side of the link over all friction, as a share, that no standard deviation excuses: one
that wide does not tell friction from dead band. Axis 6 had 61 N m of 43 in all, +- 21, and half of its dead band."""
WIDE: Final = 1.0 / 3.0
"""Standard deviation as a share of the value above which a constant is not called determined."""


def poses_of(mine: Sequence[ReversalMotion]) -> list[Float]:
    """Poses (6,) rad in which an axis was moved, each once."""
    out: list[Float] = []
    for m in mine:
        if all(float(np.max(np.abs(m.pose - other))) > APART_RAD for other in out):
            out.append(m.pose)
    return out


def why_not(axis: int, mine: Sequence[ReversalMotion], friction_nm: float, sigma_nm: float) -> str | None:
    """Reason not to trust the values of an axis; None where there is none.

    ``axis``: 0..5. ``friction_nm``: Dry friction on the side of the link. ``sigma_nm``: Its standard deviation, that of
    the compliance it refers to included.
    """
    name = f"axis {axis + 1}"
    if len(poses_of(mine)) < POSES:
        return (
            f"{name} was moved in one pose only: dead band, friction and the gear in that pose cannot be told apart. "
            f"Measure a second pose, one balanced and one loaded (identify play --propose 24)"
        )
    every = motor_friction(mine)
    if every is None:
        return None
    spread = float(np.hypot(sigma_nm, np.hypot(motor_friction_sigma(mine), SCALE * every)))
    # One-sided: the motor's own friction comes on top of that of the link, so more in the motor is no contradiction.
    if friction_nm - every > min(spread, MOST * every):
        return (
            f"{name}: {friction_nm:.3g} +- {sigma_nm:.2g} N m of dry friction on the side of the link contradict the "
            f"{every:.3g} N m that the motor's torque shows of link and motor together, so friction and dead band are "
            f"not told apart. Check the torsion compliance of the axis in the cell file and the scale of 'tau_motor', "
            f"and measure more poses (identify play --propose 24)"
        )
    return None


def too_wide(value: float, sigma: float) -> bool:
    """Return whether a standard deviation is too wide for its value to be called determined."""
    return sigma > WIDE * abs(value)


def least_seen(axis: int, mine: Sequence[ReversalMotion], friction_nm: float) -> str | None:
    """Return what one of the two kinds of poses that is missing leaves open; None where both were measured.

    ``axis``: 0..5. ``friction_nm``: Dry friction on the side of the link.
    """
    load = [float(np.min(np.abs(m.torque))) for m in mine]
    if min(load) >= BALANCED * friction_nm:
        return (
            f"axis {axis + 1}: its weight ({min(load):.0f} N m at least) kept the gear on one flank, so the dead band "
            f"was not determined; measure in a pose where the axis is balanced"
        )
    if max(load) < LOADED * friction_nm:
        return (
            f"axis {axis + 1}: no pose loads it ({max(load):.0f} N m at most): dead band and friction are told apart "
            f"by the course of the reversal only; measure in a pose where the axis is loaded, where there is one"
        )
    return None


USUAL: Final = Play(30.0 * URAD, (100.0, 100.0, 100.0), (8.0 * URAD, 28.0 * URAD, 100.0 * URAD))
"""Where the cell file has nothing: equal shares of friction, angles evenly spaced in logarithm over what encoders and
trackers resolve. Friction is scaled so that it turns the axis by :data:`USUAL_TURN_RAD`."""
USUAL_TURN_RAD: Final = 30.0 * URAD
KNOWN: Final = (40.0 * URAD, 0.3, 0.3)
"""Prior sigma of half band, friction (log) and slip (log) where the cell file has them."""
GUESSED: Final = (60.0 * URAD, 1.0, 0.5)
COMPLIANCE: Final = 0.1
DELAY_S: Final = 20.0 * MS
_STIFFEST = 1e-12


def axis_play(cell: CellModel, axis: int) -> tuple[Play, bool]:
    """Play known beforehand, and whether the cell file has it."""
    known = (cell.robot.play or (None,) * 6)[axis]
    if known is not None and known.friction_nm:
        return known, True
    soft = compliance(cell, axis)
    scale = USUAL_TURN_RAD / soft / sum(USUAL.friction_nm)
    band = USUAL.half_band_rad if known is None else known.half_band_rad
    return Play(band, tuple(f * scale for f in USUAL.friction_nm), USUAL.slip_rad), False


def compliance(cell: CellModel, axis: int) -> float:
    """Torsion compliance of an axis, rad/(N m)."""
    return max(float(cell.chain.compliance[cell.chain.torsion[axis], 5]), _STIFFEST)


def parameters(cell: CellModel, axis: int, *, free_compliance: bool, delay: bool) -> tuple[Parameters, PlayPlaces]:
    """Parameters of an axis.

    ``axis``: 0..5. ``free_compliance``: The data see elastic torsion (encoders over large motions); else it is held.
    """
    play, known = axis_play(cell, axis)
    band, dry, slip = KNOWN if known else GUESSED
    name = f"axis{axis + 1}"
    items = [
        Parameter(
            f"{name}.compliance", "rad/(N m)", compliance(cell, axis), COMPLIANCE, free=free_compliance, log=True
        ),
        Parameter(f"{name}.half_band", "rad", play.half_band_rad, band, lower=0.0, upper=5e-3),
    ]
    count = len(play.friction_nm)
    items += [
        Parameter(f"{name}.friction{e + 1}", "N m", max(f, 1e-3), dry, log=True) for e, f in enumerate(play.friction_nm)
    ]
    items += [Parameter(f"{name}.slip{e + 1}", "rad", d, slip, log=True) for e, d in enumerate(play.slip_rad)]
    if delay:
        items.append(Parameter(f"{name}.delay", "s", 0.0, DELAY_S))
    places = PlayPlaces(
        0,
        1,
        tuple(range(2, 2 + count)),
        tuple(range(2 + count, 2 + 2 * count)),
        len(items) - 1 if delay else -1,
        len(items),
    )
    return Parameters.of(items), places


def blocks(motions: Sequence[ReversalMotion], places: PlayPlaces) -> list[ReversalResiduals]:
    """Residuals of motions of one axis."""
    return [
        ReversalResiduals(
            name=f"motion {m.run + 1}, axis {m.axis + 1}",
            group=np.full(len(m.q), m.run, dtype=np.int64),
            components=(("link minus motor rad",) if m.by == "encoder" else ("along the motion m",)),
            sigma=m.sigma[:, None],
            axis=m.axis,
            by=m.by,
            q=np.ascontiguousarray(m.q),
            torque=np.ascontiguousarray(m.torque),
            time_s=m.time_s,
            measured=m.measured,
            places=places,
        )
        for m in motions
    ]

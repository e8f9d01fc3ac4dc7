"""Uncut chip thickness along the true path of the edge, a trochoid, and by the usual approximations.

Feed along x, spindle clockwise seen from above, tooth angle phi from the left normal: while the tool centre moves by
``f_z / psi`` per radian of rotation (psi = 2 pi / N the pitch), an edge of radius R at angle phi sits at
``c + R (sin phi, cos phi)``. The thickness is measured along the ray from the present centre through the edge, back
to the path of the tooth k places ahead, which passed that ray the angle ``k psi + delta`` ago:

    R_k sin(delta) + (f_z / psi) (k psi + delta) cos(phi) = 0
    h_k = R - R_k cos(delta) + (f_z / psi) (k psi + delta) sin(phi)

What remains to be cut is what the deepest of the last N paths left: ``h = min_k h_k``.

Sources: Berger2013 ("the final model" announced there); Martellotti 1941 (trochoid); derived here.
"""

from __future__ import annotations

import math

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError, ModelError
from counterflex.core.jit import kernel

NEWTON_STEPS = 12


@kernel("float64(float64, float64, float64, float64, float64, float64)")
def trochoid_gap(phi: float, advance: float, angle: float, radius: float, previous: float, start: float) -> float:
    """Return the thickness that one earlier tooth left for this one, m; NaN if Newton's iteration does not settle.

    Args:
        phi: Immersion angle of the present edge in rad.
        advance: Feed per radian of rotation f_z / psi in m/rad.
        angle: Nominal angle k psi between the two teeth in rad.
        radius: Radius of the present edge in m.
        previous: Radius of the earlier edge in m.
        start: Starting value of delta in rad; ``-advance * angle * cos(phi) / previous`` serves.
    """
    delta = start
    cos_phi = math.cos(phi)
    for _ in range(NEWTON_STEPS):
        value = previous * math.sin(delta) + advance * (angle + delta) * cos_phi
        step = value / (previous * math.cos(delta) + advance * cos_phi)
        delta -= step
        if abs(step) < 1e-15:
            return radius - previous * math.cos(delta) + advance * (angle + delta) * math.sin(phi)
    return math.nan


@kernel("void(float64[::1], float64, float64[::1], int64, float64[::1])", entry=True)
def _thickness(phi: Float, feed: float, radii: Float, tooth: int, out: Float) -> None:
    teeth = radii.size
    pitch = 2.0 * math.pi / teeth
    advance = feed / pitch
    for i in range(phi.size):
        best = math.inf
        for k in range(1, teeth + 1):
            previous = radii[(tooth - k) % teeth]
            start = -advance * k * pitch * math.cos(phi[i]) / previous
            gap = trochoid_gap(phi[i], advance, k * pitch, radii[tooth], previous, start)
            if not gap >= best:
                best = gap
        out[i] = best


def _angles(phi_rad: float | Float) -> Float:
    return np.array(as_float("phi_rad", np.atleast_1d(np.asarray(phi_rad, dtype=np.float64))))


def trochoid_thickness(phi_rad: float | Float, feed_m: float, radii_m: Float, tooth: int = 0) -> Float:
    """Return the uncut chip thickness of one tooth on its true path.

    Args:
        phi_rad: Immersion angles in rad, (n,) or scalar.
        feed_m: Feed per tooth in m.
        radii_m: (N,) radius of each edge in m, in the order in which the edges pass: tooth j + 1 follows tooth j.
            Different radii are runout.
        tooth: Index of the tooth.

    Returns:
        (n,) thickness in m; zero or negative where an earlier tooth left nothing.

    Raises:
        InputError: Feed, radii or index out of range.
        ModelError: The feed is so large against the radius that the path crosses itself near the cut.

    Valid for: a feed per tooth well below the radius. From ``f_z N / (2 pi R) = 0.13`` on the path of an earlier tooth
    no longer crosses every ray of the arc; such a ray is refused.
    """
    as_positive("feed_m", feed_m)
    radii = np.array(as_float("radii_m", radii_m, (None,)))
    if radii.size < 1 or float(radii.min()) <= 0.0:
        raise InputError("radii_m is not a set of radii", value=radii.tolist(), limit="> 0")
    if not 0 <= tooth < radii.size:
        raise InputError("there is no such tooth", value=tooth, limit=f"0 to {radii.size - 1}")
    if feed_m * radii.size / (2.0 * math.pi) >= 0.5 * float(radii.min()):
        raise ModelError("feed per tooth is too large for the cutter's radius", value=feed_m, limit="f_z N < pi R")
    phi = _angles(phi_rad)
    out = np.empty_like(phi)
    _thickness(phi, feed_m, radii, tooth, out)
    if not np.all(np.isfinite(out)):
        raise ModelError("edge path could not be intersected", value=feed_m, hint="Check feed per tooth and radii")
    return out


def circle_thickness(phi_rad: float | Float, feed_m: float) -> Float:
    """Return the usual approximation ``h = f_z sin(phi)`` in m: the edge's path taken as a circle."""
    result: Float = feed_m * np.sin(_angles(phi_rad))
    return result


def edge_radii(radius_m: float, flutes: int, runout_m: float, runout_angle_rad: float, lag_rad: float = 0.0) -> Float:
    """Return the distance of every edge from the spindle axis for a cutter that runs out.

    ``R_j^2 = R^2 + e^2 + 2 R e cos(alpha + j psi + lag)``: tooth j follows the first one by j psi.

    Args:
        radius_m: Cutter radius R in m.
        flutes: Number of teeth.
        runout_m: Offset e of the cutter's axis from the spindle's in m.
        runout_angle_rad: Angle alpha of that offset from the first edge at the tip, clockwise from above, in rad.
        lag_rad: Angle by which the helix lets the edges lag at the height looked at, in rad.

    Returns:
        (N,) radii in m. The small change of the pitch angles, below e / R, is neglected.
    """
    angle = runout_angle_rad + lag_rad + 2.0 * math.pi / flutes * np.arange(flutes)
    radii: Float = np.sqrt(radius_m**2 + runout_m**2 + 2.0 * radius_m * runout_m * np.cos(angle))
    return radii

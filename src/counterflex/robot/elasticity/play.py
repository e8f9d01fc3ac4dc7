"""Lost motion of the drives: gear play and dry friction, with the memory of where each axis came from.

Behind the motor of an axis lies a torsion spring of compliance c with a dead band of half width b in front of it; dry
friction holds the link. With q the motor angle, s the torsion (link angle L = q + s) and T the torque of weight,
cylinder and process about the axis, at rest and at working feeds::

    s = c M + b sgn(M),   M = T + sum_e f_e,   f_e <- clip(f_e - (F_e / d_e) dL, -F_e, F_e)

The friction is a sum of Maxwell slip elements: element e is a spring that yields at the torque F_e, d_e after a
reversal. The model is quasi-static and rate independent: what counts is the order of the points, not their time. The
motor angle is controlled (integral action), so friction on the motor's side moves nothing. What the elastic model of
:mod:`counterflex.robot.elasticity.compliance` does not have is ``s - c T``. Width of the loop at a reversal of a
loaded axis: ``2 c sum F``; at a reversal of the torque as well: ``2 b + 2 c sum F``.

Source: Maxwell slip: Al-Bender et al. 2005, "The generalized Maxwell-slip model"; dead band: backlash in series with
the gear's stiffness.
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, as_float, batches
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel
from counterflex.robot.elasticity.chain import ElasticChain, frames, jacobian
from counterflex.robot.elasticity.compliance import element_loads
from counterflex.robot.elasticity.gravity import weight_loads

STIFFEST_RAD_NM = 1e-12
"""Torsion compliance of an axis that the description has as rigid: play and friction need a spring to lean on."""
FLOATING_NM = 1.0
"""A relaxed axis with less torque than this hangs within its play, in proportion."""


@kernel()
def spring_torque(s: float, compliance: float, half_band: float) -> float:
    """Torque of a torsion spring behind a dead band, N m: ``(s -+ b) / c`` outside it, 0 inside."""
    if s > half_band:
        return (s - half_band) / compliance
    if s < -half_band:
        return (s + half_band) / compliance
    return 0.0


@kernel()
def imbalance(
    s: float, moved: float, torque: float, compliance: float, half_band: float, limit: Float, slip: Float, force: Float
) -> float:
    """Torque left over at the torsion s, N m: ``T + sum clip(f - F/d (moved + s), -F, F) - spring(s)``.

    Never rises with s, and is linear in pieces. Arguments as for :func:`settle_axis`.
    """
    remaining = torque - spring_torque(s, compliance, half_band)
    for e in range(limit.shape[0]):
        if limit[e] > 0.0:
            remaining += min(max(force[e] - limit[e] / slip[e] * (moved + s), -limit[e]), limit[e])
    return remaining


@kernel()
def settle_axis(
    moved: float,
    torque: float,
    start: float,
    compliance: float,
    half_band: float,
    limit: Float,
    slip: Float,
    force: Float,
) -> float:
    """Torsion that balances an axis after a step, for elements that held ``force`` before it.

    Exact: the corners of :func:`imbalance` (ends of the play, onset of slip of each element both ways) close the root
    in between two of them, where it is linear.

    Args:
        moved: Motor angle now minus link angle before, rad.
        torque: T, N m.
        start: Torsion before, rad; kept as far as play leaves the axis free.
        compliance: c > 0, rad/(N m).
        half_band: b, rad.
        limit: (m,) F, N m; elements with 0 are left out.
        slip: (m,) d, rad.
        force: (m,) N m; not changed.

    Returns:
        Torsion s, rad.
    """
    total = 0.0
    for e in range(limit.shape[0]):
        total += limit[e]
    # Friction holds at most its whole limit either way: the torsion lies between what the spring answers to both.
    low = min(compliance * (torque - total), 0.0) - half_band
    high = max(compliance * (torque + total), 0.0) + half_band
    at_low = imbalance(low, moved, torque, compliance, half_band, limit, slip, force)
    at_high = imbalance(high, moved, torque, compliance, half_band, limit, slip, force)
    for corner in range(2 + 2 * limit.shape[0]):
        side = 1.0 if corner % 2 == 0 else -1.0
        if corner < 2:
            s = side * half_band
        else:
            e = corner // 2 - 1
            if limit[e] == 0.0:
                continue
            s = (force[e] / limit[e] + side) * slip[e] - moved
        if not low < s < high:
            continue
        remaining = imbalance(s, moved, torque, compliance, half_band, limit, slip, force)
        if remaining > 0.0:
            low, at_low = s, remaining
        elif remaining < 0.0:
            high, at_high = s, remaining
        # Nothing pulls within the play: the bracket closes towards the torsion before.
        elif s <= start:
            low, at_low = s, remaining
        else:
            high, at_high = s, remaining
    if at_low == at_high:  # free within the play
        return min(max(start, low), high)
    return low + (high - low) * at_low / (at_low - at_high)


@kernel(
    "void(float64[:, ::1], float64[:, ::1], float64[::1], float64[::1], float64[:, ::1], float64[:, "
    "::1], float64[:, ::1])",
    entry=True,
)
def follow(
    q: Float, torque: Float, compliance: Float, half_band: Float, limit: Float, slip: Float, torsion: Float
) -> None:
    """Torsion of the axes along a path, from relaxed elements at the first point.

    Args:
        q: (n, k) rad, motor angles in order.
        torque: (n, k) N m in the positive direction of each angle.
        compliance: (k,) rad/(N m), > 0.
        half_band: (k,) rad.
        limit: (k, m) N m.
        slip: (k, m) rad, > 0.
        torsion: (n, k) rad, written.
    """
    elements = limit.shape[1]
    force = np.zeros(elements)
    for a in range(q.shape[1]):
        force[:] = 0.0
        # A hanging axis leans on one flank. Without a torque it may be anywhere in its play, so the middle is taken.
        lean = min(max(torque[0, a] / FLOATING_NM, -1.0), 1.0)
        s = compliance[a] * torque[0, a] + lean * half_band[a]
        torsion[0, a] = s
        link = q[0, a] + s
        for n in range(1, q.shape[0]):
            s = settle_axis(q[n, a] - link, torque[n, a], s, compliance[a], half_band[a], limit[a], slip[a], force)
            step = q[n, a] + s - link
            for e in range(elements):
                if limit[a, e] > 0.0:
                    force[e] = min(max(force[e] - limit[a, e] / slip[a, e] * step, -limit[a, e]), limit[a, e])
            link = q[n, a] + s
            torsion[n, a] = s


def torsion_path(q: Float, torque: Float, compliance: Float, half_band: Float, limit: Float, slip: Float) -> Float:
    """Torsion of independent axes along a path, with play and friction; see the module's equations.

    Args:
        q: (n, k) rad, motor angles in order.
        torque: (n, k) N m, external torque in the positive direction of each angle.
        compliance: (k,) rad/(N m); below :data:`STIFFEST_RAD_NM` counts as that.
        half_band: (k,) rad, >= 0.
        limit: (k, m) N m, >= 0.
        slip: (k, m) rad, > 0.

    Returns:
        (n, k) rad. The first point is relaxed: no friction, the play taken up by the torque (in proportion below
        :data:`FLOATING_NM`).

    Raises:
        InputError: Shapes do not match or a parameter is negative.
    """
    angles = as_float("q", q, (None, None))
    n, k = angles.shape
    m = np.shape(limit)[-1] if np.ndim(limit) == 2 else 0
    loads = as_float("torque", torque, (n, k))
    soft = as_float("compliance", compliance, (k,))
    band = as_float("half_band", half_band, (k,))
    most, reach = as_float("limit", limit, (k, m)), as_float("slip", slip, (k, m))
    for name, values in (("compliance", soft), ("half_band", band), ("limit", most)):
        if np.any(values < 0.0):
            raise InputError(f"{name} of an axis is negative", value=float(values.min()), limit=">= 0")
    if np.any(reach <= 0.0):
        raise InputError("slip of a friction element", value=float(reach.min()), limit="> 0 rad")
    out = np.empty((n, k))
    if n:
        follow(
            np.ascontiguousarray(angles), np.ascontiguousarray(loads), np.maximum(soft, STIFFEST_RAD_NM), band.copy(),
            np.ascontiguousarray(most), np.ascontiguousarray(reach), out,
        )  # fmt: skip
    return out


def axis_torque(chain: ElasticChain, q: Float, w_tcp_base: Float | None = None) -> Float:
    """Torque on the torsion of each axis, positive in the positive direction of the axis angle.

    Args:
        chain: Masses, gravity, counterbalance.
        q: (n, 6) rad.
        w_tcp_base: (n, 6) N, N m on the tool about its tip in base axes; None is weight alone.

    Returns:
        (n, 6) N m.
    """
    angles = as_float("q", q, (None, 6))
    out = np.empty((len(angles), 6))
    sign = chain.sign[chain.joint >= 0]
    for rows in batches(len(angles)):
        Ts = frames(chain, angles[rows])
        load = weight_loads(chain, angles[rows], Ts)
        if w_tcp_base is not None:
            load = load + element_loads(chain, angles[rows], w_tcp_base[rows], Ts)
        # The load is about the frame's z; the controller counts the angle the other way where its sign is -1.
        out[rows] = sign * load[:, chain.torsion, 5]
    return out


def torsion(chain: ElasticChain, q: Float, w_tcp_base: Float | None = None) -> tuple[Float, Float]:
    """Torsion of the axes along a path, with play and friction, and what of it is lost motion.

    Args:
        chain: With ``play``; None or axes without an entry are linear springs.
        q: (n, 6) rad, motor angles in the order of the motion, from a state with relaxed friction.
        w_tcp_base: (n, 6) N, N m on the tool; None is weight alone.

    Returns:
        ``s - c T`` (n, 6) rad: what play and friction add to the elastic torsion, link side, positive in the positive
        direction of the axis angle; and M (n, 6) N m, the torque that the gears pass on to the motors.
    """
    angles = as_float("q", q, (None, 6))
    torque = axis_torque(chain, angles, w_tcp_base)
    if chain.play is None:
        return np.zeros(angles.shape), torque
    soft = np.maximum(chain.compliance[chain.torsion, 5], STIFFEST_RAD_NM)
    band, limit, slip = arrays(chain)
    s = torsion_path(angles, torque, soft, band, limit, slip)
    lost: Float = s - soft * torque
    through = (s - np.clip(s, -band, band)) / soft
    without = [entry is None for entry in chain.play]
    # An axis without an entry is a plain spring: what the search for its root leaves is rounding, no lost motion.
    lost[:, without] = 0.0
    through[:, without] = torque[:, without]
    return lost, through


def lost_motion(chain: ElasticChain, q: Float, w_tcp_base: Float | None = None) -> Float:
    """Torsion of each axis along a path by play and friction alone: the first part of :func:`torsion`.

    Args:
        chain: With ``play`` or None.
        q: (n, 6) rad, in the order of the motion.
        w_tcp_base: (n, 6) N, N m on the tool; None is weight alone.

    Returns:
        (n, 6) rad.
    """
    if chain.play is None:
        return np.zeros(as_float("q", q, (None, 6)).shape)
    return torsion(chain, q, w_tcp_base)[0]


def relaxed(chain: ElasticChain, q: Float, w_tcp_base: Float | None = None) -> Float:
    """Lost motion at points that are each reached after a long rest: play taken up by the torque, no friction.

    Args:
        chain: With ``play`` or None.
        q: (n, 6) rad.
        w_tcp_base: (n, 6) N, N m on the tool; None is weight alone.

    Returns:
        (n, 6) rad.
    """
    angles = as_float("q", q, (None, 6))
    if chain.play is None:
        return np.zeros(angles.shape)
    band, _, _ = arrays(chain)
    out: Float = band * np.clip(axis_torque(chain, angles, w_tcp_base) / FLOATING_NM, -1.0, 1.0)
    return out


def at_tcp(chain: ElasticChain, q: Float, angle: Float) -> Float:
    """Displacement of the tool by small angles of the axes, ``J(q) angle``.

    ``q``: (n, 6) rad; ``angle``: (n, 6) rad.

    Returns:
        (n, 6) translation m, rotation vector rad, base axes.
    """
    out: Float = (jacobian(chain, q) @ angle[..., None])[..., 0]
    return out


def arrays(chain: ElasticChain) -> tuple[Float, Float, Float]:
    """Half bands (6,), friction (6, m) and slip (6, m) of a chain's play; slip 1 rad where there is no element."""
    play = chain.play or (None,) * 6
    m = max((len(entry.friction_nm) for entry in play if entry is not None), default=0)
    band, limit, slip = np.zeros(6), np.zeros((6, m)), np.ones((6, m))
    for axis, entry in enumerate(play):
        if entry is not None:
            count = len(entry.friction_nm)
            band[axis] = entry.half_band_rad
            limit[axis, :count], slip[axis, :count] = entry.friction_nm, entry.slip_rad
    return band, limit, slip

"""Elastic deflection of the chain under load, linear and nonlinear, and its Cartesian compliance.

One model covers both sources: springs of any subset of six directions at any frame under a full wrench. Linear, it is
the series of six-dof joints of Denkena2015; composed as finite z-y'-x'' rotations, the virtual joints of Haehn2020.

Loads on the rigid geometry (Haehn2020) leave out that the load follows the deflection. The equilibrium form takes them
where the bodies are after deflection; it is conservative and equals a chain of real spring-loaded joints. The two
differ by about the deflection squared over the lever arms.

Measured on a KR 300 R2500 ultra with an 86 kg end effector, 20 000 poses in front of the robot, forces to 800 N per
axis, deflection 1.9 mm median and 5.3 mm at most, TCP position, median / maximum: nonlinear against ``C w`` 2.0 / 14 um
(0.11 % / 0.30 %), equilibrium against rigid geometry 2.1 / 14 um, with own weight in both states 3.4 / 26 um; sag 2.4 /
4.1 mm, of which the equilibrium form changes 2.2 / 6.3 um.
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, batches
from counterflex.core.errors import InputError, ModelError
from counterflex.robot.elasticity.chain import ElasticChain, frames, points, require_settled
from counterflex.robot.elasticity.gravity import weight_loads
from counterflex.robot.elasticity.kernels import batch
from counterflex.robot.model.description import secants

LANES_FROM = 200_000  # points from which the lane-blocked kernels repay their longer compilation
LARGEST_ROTATION = 0.2  # rad; beyond this a deflection is not elastic any more
LARGEST_TRANSLATION = 1.0  # m


def element_loads(chain: ElasticChain, q: Float, w_tcp_base: Float, Ts_base_segment: Float | None = None) -> Float:
    """Wrench that a load at the TCP puts on each elastic element: about and in the segment's frame, rigid geometry.

    Args:
        q: (..., 6) rad.
        w_tcp_base: (..., 6) N, N m, what the surroundings do to the tool, about the TCP in base axes.
        Ts_base_segment: (rows, n, 4, 4) the rigid chain's :func:`counterflex.robot.elasticity.chain.frames` at q
            where they are known already.

    Returns:
        (..., n, 6) N, N m.
    """
    q, w, lead = points(q, w_tcp_base)
    Ts = frames(chain, q) if Ts_base_segment is None else Ts_base_segment
    tip = (Ts[:, -1] @ chain.T_last_tcp)[:, :3, 3]
    force = w[:, None, :3]
    moment = w[:, None, 3:] + np.cross(tip[:, None, :] - Ts[..., :3, 3], force)
    R_seg_base = np.swapaxes(Ts[..., :3, :3], -1, -2)
    f = (R_seg_base @ force[..., None])[..., 0]
    m = (R_seg_base @ moment[..., None])[..., 0]
    return np.concatenate([f, m], axis=-1).reshape(*lead, chain.n, 6)


def element_jacobians(chain: ElasticChain, q: Float) -> Float:
    """TCP twist of a unit displacement of each element in each of its six directions; rigid geometry, base axes.

    Args:
        q: (..., 6) rad.

    Returns:
        (..., n, 6, 6): column d for direction d of ``tx ty tz rx ry rz``.
    """
    Ts = frames(chain, q)
    R, p = Ts[..., :3, :3], Ts[..., :3, 3]
    tip = (Ts[..., -1, :, :] @ chain.T_last_tcp)[..., :3, 3]
    columns = np.zeros((*Ts.shape[:-2], 6, 6))
    columns[..., :3, :3] = R
    columns[..., 3:, 3:] = R
    lever = (tip[..., None, :] - p)[..., None, :]
    columns[..., :3, 3:] = np.swapaxes(np.cross(np.swapaxes(R, -1, -2), lever), -1, -2)
    return columns


def load_factors(chain: ElasticChain, q: Float, w_tcp_base: Float) -> Float:
    """Mean factors of compliance curves on the compliances while a load at the TCP is put on the weight of the arm.

    Args:
        q: (..., 6) rad.
        w_tcp_base: (..., 6) N, N m, about the TCP in base axes.

    Returns:
        (..., n, 6): 1 where no curve acts. Rigid geometry.
    """
    if not chain.curves:
        return np.ones((*np.shape(q)[:-1], chain.n, 6))
    return secants(chain.curves, chain.names, weight_loads(chain, q), element_loads(chain, q, w_tcp_base))


def _of_curves(chain: ElasticChain, q: Float, w_tcp_base: Float) -> Float:
    """(n, 6, 6) what compliance curves add to the compliance at the TCP under loads (n, 6)."""
    out = np.zeros((len(q), 6, 6))
    names = list(chain.names)
    for rows in batches(len(q)):
        columns = element_jacobians(chain, q[rows])
        factors = load_factors(chain, q[rows], w_tcp_base[rows])
        more = (factors - 1.0) * chain.compliance_at(q[rows])
        for curve in chain.curves:
            i, d = names.index(curve.segment), curve.direction
            J = columns[:, i, :, d]
            out[rows] += more[:, i, d, None, None] * J[:, :, None] * J[:, None, :]
    return out


def cartesian_compliance(chain: ElasticChain, q: Float, w_tcp_base: Float | None = None) -> Float:
    """Compliance at the TCP, ``C(q) = sum_i J_i diag(c_i) J_i^T``.

    Column d of ``J_i`` is the TCP twist of a unit displacement of element i in its direction d. Denkena2015 eq. 1-7 in
    base axes: springs in series add their compliances.

    Args:
        q: (..., 6) rad.
        w_tcp_base: (..., 6) N, N m about the TCP in base axes: the load that compliance curves are taken at, a secant
            from none to this; None takes the compliances of the cell.

    Returns:
        (..., 6, 6) m/N, rad/N, m/(N m), rad/(N m): ``deflection = C w_tcp_base``; symmetric, positive semidefinite.
    """
    rows, w, lead = points(q, w_tcp_base)
    out = np.empty((len(rows), 36))
    if len(rows) <= batch.CHUNK:
        batch.compliance_range(chain.compact, rows, out, 0, len(rows))
    else:
        batch.compliance_threads(chain.compact, rows, out)
    matrices = out.reshape(-1, 6, 6)
    if chain.curves and w_tcp_base is not None:
        matrices += _of_curves(chain, rows, w)
    return matrices.reshape(*lead, 6, 6)


def deflection(
    chain: ElasticChain,
    q: Float,
    w_tcp_base: Float,
    *,
    nonlinear: bool = True,
    gravity: bool = False,
    equilibrium: bool = False,
) -> Float:
    """Deflection of the TCP: pose under load minus pose without it.

    Args:
        q: (..., 6) rad.
        w_tcp_base: (..., 6) N, N m, about the TCP in base axes; broadcast against ``q``.
        nonlinear: Compose the finite z-y'-x'' displacements (Haehn2020 eq. 2-9) instead of ``C(q) w``.
        gravity: Own weight, payload and counterbalance act in both states, so that the result is what the load alone
            adds to the sag (:func:`counterflex.robot.elasticity.gravity.sag`). Differs by second order only.
        equilibrium: Take all loads on the deflected geometry (the wrench keeps its base axes and follows the TCP)
            instead of the rigid one.

    Returns:
        (..., 6) translation of the TCP in m and rotation vector in rad, base axes.

    Raises:
        InputError: Wrong shapes, not finite, or ``gravity`` or ``equilibrium`` asked of the linear form.
        ModelError: The deflection is beyond 0.2 rad or 1 m, where no elastic model holds, or there is no equilibrium.
    """
    q, w, lead = points(q, w_tcp_base)
    if not nonlinear:
        if gravity or equilibrium:
            raise InputError("gravity and equilibrium need the nonlinear form", value="nonlinear=False")
        out: Float = (cartesian_compliance(chain, q, w) @ w[:, :, None])[..., 0]
    else:
        out = np.empty((len(q), 6))
        how = batch.SETTLED if equilibrium else batch.ON_RIGID
        if len(q) <= batch.CHUNK:
            failed = batch.deflection_range(chain.compact, q, w, how, int(gravity), out, 0, len(q))
        # Weight and regions change load and spring from point to point, which the lanes do not have.
        elif len(q) >= LANES_FROM and not (gravity or equilibrium or chain.regions):
            from counterflex.robot.elasticity.kernels.lanes import deflection_lanes

            deflection_lanes(chain.compact, q, w, out)
            failed = 0
        else:
            failed = batch.deflection_threads(chain.compact, q, w, how, int(gravity), out)
        require_settled(failed)
        # A curve changes a compliance by its load. To first order that adds; what finite rotations make of the change
        # is of second order, below what is known of any curve.
        if chain.curves:
            out += (_of_curves(chain, q, w) @ w[:, :, None])[..., 0]
    _plausible(out)
    return out.reshape(*lead, 6)


def shares(chain: ElasticChain, q: Float, w_tcp_base: Float) -> Float:
    """Contribution of each segment to the linear deflection; the sum over segments is ``C(q) w``.

    Args:
        q: (..., 6) rad.
        w_tcp_base: (..., 6) N, N m.

    Returns:
        (..., n, 6) m, rad, base axes at the TCP, in the order of ``chain.names``.
    """
    q, w, lead = points(q, w_tcp_base)
    out = np.empty((len(q), chain.n, 6))
    for rows in batches(len(q)):
        columns = element_jacobians(chain, q[rows])
        delta = chain.compliance_at(q[rows]) * (np.swapaxes(columns, -1, -2) @ w[rows, None, :, None])[..., 0]
        out[rows] = (columns @ delta[..., None])[..., 0]
    return out.reshape(*lead, chain.n, 6)


def linear_gap(
    chain: ElasticChain, q: Float, w_tcp_base: Float, *, gravity: bool = False, equilibrium: bool = False
) -> Float:
    """Difference of the two forms: nonlinear deflection minus ``C(q) w``.

    Args:
        q: (..., 6) rad.
        w_tcp_base: (..., 6) N, N m.
        gravity: As for :func:`deflection`, on the nonlinear side.
        equilibrium: As for :func:`deflection`, on the nonlinear side.

    Returns:
        (..., 6) m, rad, base axes.
    """
    curved = deflection(chain, q, w_tcp_base, gravity=gravity, equilibrium=equilibrium)
    out: Float = curved - deflection(chain, q, w_tcp_base, nonlinear=False)
    return out


def _plausible(deflections: Float) -> None:
    worst = np.max(np.abs(deflections), axis=0, initial=0.0)
    # Asked this way round, NaN is refused too.
    if not (np.all(worst[:3] <= LARGEST_TRANSLATION) and np.all(worst[3:] <= LARGEST_ROTATION)):
        raise ModelError(
            "the load deflects the chain beyond any elastic model",
            value=f"{worst[:3].max():.3g} m, {worst[3:].max():.3g} rad",
            limit=f"<= {LARGEST_TRANSLATION:g} m, {LARGEST_ROTATION:g} rad",
            hint="Check the units of load and compliance",
        )

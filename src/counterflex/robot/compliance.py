"""Elastic deflection of the chain under load, linear and nonlinear, and its Cartesian compliance."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.geometry import pose, rotation
from counterflex.robot.chain import ElasticChain, frames, joint_angles
from counterflex.robot.gravity import weight_loads


def element_loads(chain: ElasticChain, q: Float, w_tcp_base: Float) -> Float:
    """Wrench that a load at the TCP puts on each elastic element: about and in the segment's frame, rigid geometry.

    Args:
        chain: The chain.
        q: (..., 6) rad.
        w_tcp_base: (..., 6) N, N m, what the surroundings do to the tool, about the TCP in base axes.

    Returns:
        (..., n, 6) N, N m.
    """
    Ts = frames(chain, q)
    w = np.asarray(w_tcp_base, dtype=np.float64)
    tip = (Ts[..., -1, :, :] @ chain.T_last_tcp)[..., :3, 3]
    force = w[..., None, :3]
    moment = w[..., None, 3:] + np.cross(tip[..., None, :] - Ts[..., :3, 3], force)
    R_seg_base = np.swapaxes(Ts[..., :3, :3], -1, -2)
    f = (R_seg_base @ force[..., None])[..., 0]
    m = (R_seg_base @ moment[..., None])[..., 0]
    out: Float = np.concatenate([np.broadcast_to(f, m.shape), m], axis=-1)
    return out


def cartesian_compliance(chain: ElasticChain, q: Float) -> Float:
    """Compliance at the TCP, ``C(q) = sum_i J_i diag(c_i) J_i^T``.

    Column d of ``J_i`` is the TCP twist of a unit displacement of element i in its direction d (Denkena2015 eq. 1-7 in
    base axes; springs in series add their compliances).

    Args:
        chain: The chain.
        q: (..., 6) rad.

    Returns:
        (..., 6, 6) m/N, rad/N, m/(N m), rad/(N m): ``deflection = C w_tcp_base``; symmetric, positive semidefinite.
    """
    Ts = frames(chain, joint_angles(q))
    tip = (Ts[..., -1, :, :] @ chain.T_last_tcp)[..., :3, 3]
    R = Ts[..., :3, :3]
    columns = np.zeros((*Ts.shape[:-2], 6, 6))
    columns[..., :3, :3] = R
    columns[..., 3:, 3:] = R
    columns[..., :3, 3:] = -rotation.skew(tip[..., None, :] - Ts[..., :3, 3]) @ R
    out: Float = np.einsum("...nij,nj,...nkj->...ik", columns, chain.compliance, columns)
    return out


def _elastic(chain: ElasticChain, q: Float, loads: Float) -> Float:
    """TCP pose with every element displaced by compliance times load. Loads (..., n, 6) in segment axes."""
    q = joint_angles(q)
    delta = chain.compliance * loads
    lead = np.broadcast_shapes(q.shape[:-1], delta.shape[:-2])
    T = np.broadcast_to(np.eye(4), (*lead, 4, 4))
    for i in range(chain.n):
        T = T @ chain.fixed[i]
        if chain.joint[i] >= 0:
            theta = chain.sign[i] * q[..., chain.joint[i]] + chain.offset[i]
            T = T @ pose.make(rotation.about_z(theta))
        d = delta[..., i, :]
        T = T @ pose.make(rotation.from_zyx(d[..., [5, 4, 3]]), d[..., :3])
    out: Float = T @ chain.T_last_tcp
    return out


def deflection(
    chain: ElasticChain, q: Float, w_tcp_base: Float, *, nonlinear: bool = True, gravity: bool = False
) -> Float:
    """Deflection of the TCP: loaded minus unloaded.

    Args:
        chain: The chain.
        q: (..., 6) rad.
        w_tcp_base: (..., 6) N, N m, about the TCP in base axes.
        nonlinear: Compose the finite z-y'-x'' displacements (Haehn2020 eq. 2-9) instead of ``C(q) w``.
        gravity: Own weight acts in both states.

    Returns:
        (..., 6) translation of the TCP in m and rotation vector in rad, base axes.
    """
    q = joint_angles(q)
    w = as_float("w_tcp_base", w_tcp_base)
    if not nonlinear:
        linear: Float = (cartesian_compliance(chain, q) @ w[..., None])[..., 0]
        return linear
    loads = element_loads(chain, q, w)
    weight = weight_loads(chain, q) if gravity else np.zeros_like(loads)
    return pose.difference(_elastic(chain, q, weight), _elastic(chain, q, weight + loads))


def elastic_pose(chain: ElasticChain, q: Float, w_tcp_base: Float | None, *, gravity: bool) -> Float:
    """See :func:`counterflex.robot.chain.forward_elastic`."""
    w = np.zeros(6) if w_tcp_base is None else as_float("w_tcp_base", w_tcp_base)
    loads = element_loads(chain, q, w)
    return _elastic(chain, q, loads + weight_loads(chain, q) if gravity else loads)

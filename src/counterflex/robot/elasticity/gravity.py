"""Own weight of the chain: loads on the elastic elements, counterbalance, sag."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.robot.elasticity.chain import ElasticChain, frames, joint_angles, points, require_settled
from counterflex.robot.elasticity.kernels.batch import ON_RIGID, SETTLED, sag_range


def weight_loads(chain: ElasticChain, q: Float, Ts_base_segment: Float | None = None) -> Float:
    """Wrench of own weight and payload on each elastic element, relieved by the counterbalance; rigid geometry.

    Element i carries every body from i outward (its own body lies behind its elasticity): force ``sum m_k g``, moment
    ``sum m_k (p_com_k - p_i) x g`` about its origin, both in its axes. The counterbalance bypasses the drive of its
    axis, so it acts on that drive's torsion alone.

    Args:
        q: (..., 6) rad.
        Ts_base_segment: (..., n, 4, 4) frames of the bodies where they are not those of the rigid chain at q.

    Returns:
        (..., n, 6) N, N m in each segment's frame.
    """
    q = joint_angles(q)
    Ts = frames(chain, q) if Ts_base_segment is None else Ts_base_segment
    R, p = Ts[..., :3, :3], Ts[..., :3, 3]
    com = (R @ chain.com[..., None])[..., 0] + p
    mass = np.cumsum(chain.mass[::-1])[::-1]
    first_moment = np.cumsum((chain.mass[:, None] * com)[..., ::-1, :], axis=-2)[..., ::-1, :]
    force = mass[:, None] * chain.gravity
    moment = np.cross(first_moment - mass[:, None] * p, chain.gravity)
    R_seg_base = np.swapaxes(R, -1, -2)
    f = (R_seg_base @ np.broadcast_to(force, moment.shape)[..., None])[..., 0]
    m = (R_seg_base @ moment[..., None])[..., 0]
    if chain.counterbalance is not None:
        joint = chain.counterbalance.joint
        drive = int(np.flatnonzero(chain.joint == joint)[0])
        torque = chain.counterbalance.torque(q[..., joint])
        m[..., chain.torsion[joint], 2] += chain.sign[drive] * torque
    return np.concatenate([f, m], axis=-1)


def sag(chain: ElasticChain, q: Float, *, equilibrium: bool = True) -> Float:
    """Displacement of the TCP by own weight and payload: unloaded pose with weight minus weightless pose.

    Args:
        chain: The chain; its masses, gravity and counterbalance.
        q: (..., 6) rad.
        equilibrium: Take the loads on the deflected geometry (default); else on the rigid one.

    Returns:
        (..., 6) translation m, rotation vector rad, base axes.

    Raises:
        ModelError: No stable equilibrium near the pose.
    """
    rows, _, lead = points(q, None)
    out = np.empty((len(rows), 6))
    require_settled(sag_range(chain.compact, rows, SETTLED if equilibrium else ON_RIGID, out, 0, len(rows)))
    return out.reshape(*lead, 6)

"""Pose of a body of the elastic chain under weight and process load: the frame a sensor in it measures in.

750 N turn a flange sensor enough for 1 % of its tool's weight to appear as a force, so its rotation is taken from the
bent arm, not from the rigid one.
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity.chain import ElasticChain, frames, joint_angles
from counterflex.robot.elasticity.compliance import element_loads
from counterflex.robot.elasticity.gravity import weight_loads


def segment_index(chain: ElasticChain, segment: str) -> int:
    """Place of a segment in the chain. Raises InputError: there is none of that name."""
    if segment not in chain.names:
        raise InputError("there is no such body in the cell", value=segment, limit=", ".join(chain.names))
    return chain.names.index(segment)


def carrier_pose(
    chain: ElasticChain, segment: str, q: Float, w_tcp_base: Float | None = None, *, elastic: bool = True
) -> Float:
    """Pose of a body, bent by weight and load: ``prod_i fixed_i Rz(theta_i) E(C_i w_i)`` up to the body.

    The loads ``w_i`` are those on the rigid geometry; what that leaves out turns the body by some 10 urad.

    ``q``: (..., 6) rad controller angles. ``w_tcp_base``: (..., 6) N, N m on the tool about the TCP in base axes, as
    many as ``q``; None is none. Returns (..., 4, 4) T_base_seg. Raises InputError: no such body, or arrays that do not
    match.
    """
    last = segment_index(chain, segment)
    q = joint_angles(q)
    rigid = frames(chain, q)
    if not elastic:
        out: Float = rigid[..., last, :, :]
        return out
    load = weight_loads(chain, q)
    if w_tcp_base is not None:
        load = load + element_loads(chain, q, w_tcp_base)
    delta = chain.compliance * load
    turn = rotation.from_zyx(delta[..., [5, 4, 3]])
    E = pose.make(turn, delta[..., :3])
    T = np.broadcast_to(np.eye(4), (*q.shape[:-1], 4, 4))
    before = T
    for i in range(last + 1):
        T = T @ pose.inverse(before) @ rigid[..., i, :, :] @ E[..., i, :, :]
        before = rigid[..., i, :, :]
    return T


def hose_rotation(chain: ElasticChain, body: str, segment: str, q: Float) -> Float:
    """Rotation of the sensor's body in the body that the hose pack comes from.

    What a hose pack between two bodies does to the outer one, weight apart, goes by how they stand to each other, not
    by how they stand in the hall. The bending of the arm between them, some 0.1 mrad, is left out.

    ``body``: That the hose comes from; one that an axis drives. ``q``: (..., 6) rad controller angles. Returns (..., 3,
    3) R_hose_seg. Raises InputError: no such bodies, or not in this order.
    """
    first, last = hose_place(chain, body, segment), segment_index(chain, segment)
    T = frames(chain, joint_angles(q))
    out: Float = np.swapaxes(T[..., first, :3, :3], -1, -2) @ T[..., last, :3, :3]
    return out


def hose_place(chain: ElasticChain, body: str, segment: str) -> int:
    """Place in the chain of the body that a hose pack comes from.

    Args:
        body: See :func:`hose_rotation`.
        segment: Likewise.

    Raises:
        InputError: No such bodies, no axis drives the first, or no axis moves between them.
    """
    first, last = segment_index(chain, body), segment_index(chain, segment)
    if chain.joint[first] < 0 or not np.any(chain.joint[first + 1 : last + 1] >= 0):
        raise InputError(
            "the hose pack cannot come from there",
            value=body,
            limit="a body that an axis drives, with another axis between it and the sensor",
            hint=", ".join(hose_bodies(chain, segment)),
        )
    return first


def hose_bodies(chain: ElasticChain, segment: str) -> tuple[str, ...]:
    """Bodies that a hose pack to a sensor can come from, outward: all that an axis drives, but for the last."""
    last = segment_index(chain, segment)
    driven = [i for i in range(last + 1) if chain.joint[i] >= 0]
    return tuple(chain.names[i] for i in driven[:-1])


def carrier_to_tcp(chain: ElasticChain, segment: str) -> Float:
    """Rigid pose ``T_seg_tcp`` (4, 4) of the TCP in an undriven body behind the last axis.

    Raises InputError: no such body, or an axis lies between it and the tool.
    """
    first = segment_index(chain, segment)
    if np.any(chain.joint[first + 1 :] >= 0):
        raise InputError("an axis moves between this body and the tool", value=segment)
    T = np.eye(4)
    for i in range(first + 1, chain.n):
        T = T @ chain.fixed[i] @ pose.make(rotation.about_z(chain.offset[i]))
    out: Float = T @ chain.T_last_tcp
    return out


def mass_behind(chain: ElasticChain, segment: str) -> tuple[float, Float]:
    """Mass of the bodies behind a body, and their centre of gravity in its frame.

    ``segment``: Name of a body without an axis behind it; its own mass does not count. Returns kg and (3,) m (zero
    where nothing weighs). Raises InputError: no such body, or an axis lies between it and the tool.
    """
    first = segment_index(chain, segment)
    if np.any(chain.joint[first + 1 :] >= 0):
        raise InputError("an axis moves between this body and the tool", value=segment)
    T, mass, moment = np.eye(4), 0.0, np.zeros(3)
    for i in range(first + 1, chain.n):
        T = T @ chain.fixed[i] @ pose.make(rotation.about_z(chain.offset[i]))
        mass += float(chain.mass[i])
        moment = moment + chain.mass[i] * pose.transform(T, chain.com[i])
    return mass, (moment / mass if mass > 0.0 else np.zeros(3))

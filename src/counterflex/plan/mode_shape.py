"""How the points of the arm move in a mode, for drawing it."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.plan.elastic_motion import coordinates
from counterflex.robot.elasticity.chain import ElasticChain, forward, frames


def point_motion(chain: ElasticChain, q: Float, shapes: Float) -> tuple[Float, Float]:
    """Points of the arm, and their motion in given shapes.

    ``dp_i = sum_c x_c s_c`` over the coordinates c at or before segment i, with ``s_c = a_c x (p_i - o_c)`` of a
    turn about the axis ``a_c`` through ``o_c``, and ``s_c = a_c`` of a shift along it. Linear: right for small motion.

    Args:
        chain: The chain.
        q: (6,) rad.
        shapes: (n, m) rad or m of each coordinate of :func:`counterflex.plan.elastic_motion.matrices`.

    Returns:
        (k, 3) m, base axes: the robot's foot, the origin of every segment, the flange behind its segment, the tool's
        tip at the end; and (k, 3, m) m, their motion.

    Raises:
        InputError: The shapes are not of this chain.
    """
    Ts = frames(chain, as_float("q", q, (6,)))
    segment, direction, sign = coordinates(chain)
    x = as_float("shapes", shapes, (None, None))
    if len(x) != len(segment):
        raise InputError("the shapes are of another chain", value=len(x), limit=f"{len(segment)} coordinates")
    last = chain.flange_segment
    T_base_flange = (Ts[last] if last >= 0 else np.eye(4)) @ chain.T_segment_flange
    own = np.arange(chain.n)
    p = np.array([np.zeros(3), *Ts[: last + 1, :3, 3], T_base_flange[:3, 3], *Ts[last + 1 :, :3, 3]])
    p = np.vstack([p, forward(chain, q)[:3, 3]])
    on = np.concatenate([[-1], own[: last + 1], [last], own[last + 1 :], [chain.n - 1]])
    axis = sign[:, None] * Ts[segment, :3, direction % 3]
    turned = np.cross(axis, p[:, None] - Ts[segment, :3, 3])
    screw = np.where((direction >= 3)[:, None], turned, axis)
    moved: Float = np.einsum("kcd,cm->kdm", np.where((on[:, None] >= segment)[..., None], screw, 0.0), x)
    return p, moved

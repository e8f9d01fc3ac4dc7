"""Springs about the axes alone: which axes have none, and what some of them yield."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.robot.elasticity.chain import ElasticChain, jacobian


def rigid_axes(chain: ElasticChain) -> tuple[int, ...]:
    """Axes that nothing turns elastically.

    An axis counts as elastic when its own segment, or one between it and the next drive (the flange for axis 6), has
    a compliance about any of its three directions: an element may sit in a frame of its own behind the drive.

    Args:
        chain: The robot with its end effector.

    Returns:
        Numbers 0..5, rising.
    """
    drives = np.flatnonzero(np.asarray(chain.joint) >= 0)
    ends = np.append(drives[1:], chain.flange_segment + 1)
    turns = np.any(chain.compliance[:, 3:] != 0.0, axis=1)
    return tuple(
        int(chain.joint[begin])
        for begin, end in zip(drives.tolist(), ends.tolist(), strict=True)
        if not turns[begin:end].any()
    )


def axis_deflections(chain: ElasticChain, q: Float, w_tcp_base: Float, axes: tuple[int, ...]) -> Float:
    """Displacement of the TCP for each axis, times the stiffness of that axis: ``J_i (J_i^T w)``.

    With springs ``k_i`` about the axes the TCP yields by ``sum_i J_i (J_i^T w) / k_i`` (linear, on the rigid geometry).

    ``q``: (n, 6) rad; ``w_tcp_base``: (n, 6) N, N m; ``axes``: numbers 0..5.

    Returns:
        (n, axes, 3) N m2/rad, base axes: divided by k in N m/rad, m.
    """
    J = jacobian(chain, q)[..., list(axes)]
    torque = np.einsum("...ia,...i->...a", J, w_tcp_base)
    out: Float = np.swapaxes(J[..., :3, :] * torque[..., None, :], -1, -2)
    return out

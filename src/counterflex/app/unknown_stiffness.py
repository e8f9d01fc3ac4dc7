"""Says which axes of a robot have no stiffness, so that nobody takes their deflection for zero."""

from __future__ import annotations

import numpy as np

from counterflex.robot.elasticity.chain import ElasticChain


def rigid_axes(chain: ElasticChain) -> list[int]:
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
    return [
        int(chain.joint[begin])
        for begin, end in zip(drives.tolist(), ends.tolist(), strict=True)
        if not turns[begin:end].any()
    ]


def unknown_stiffness(chain: ElasticChain) -> list[str]:
    """Warning where axes of the robot have no stiffness; none where every axis has one.

    Args:
        chain: The robot with its end effector.
    """
    axes = rigid_axes(chain)
    if not axes:
        return []
    named = ", ".join(f"A{axis + 1}" for axis in axes)
    return [
        f"no stiffness is known of {named} of {chain.name}: taken as rigid, their deflection is missing from every "
        "prediction and correction. Measure it: counterflex identify stiffness"
    ]

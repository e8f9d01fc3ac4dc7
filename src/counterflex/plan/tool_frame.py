"""The pose of the tool frame along a path: what a three-axis program leaves free is fixed here."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.geometry import pose


def tool_orientation(axis_part: Float, rotation_about_tool_rad: float) -> Float:
    """Orientation of the TCP frame for given tool axes.

    z of the TCP frame points out of the spindle through the tip, ``z = -axis``. x is the part's x axis projected
    square to the tool axis (the part's y axis where the tool lies along x), turned about the tool axis by the free
    angle, right-handed about ``axis``.

    Args:
        axis_part: (n, 3) unit vectors from the tip towards the spindle, in part axes.
        rotation_about_tool_rad: The free angle.

    Returns:
        Rs_part_tcp (n, 3, 3).
    """
    axis = as_float("axis_part", axis_part, (None, 3))
    reference = np.where(np.abs(axis[:, :1]) < 0.9, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    x0 = reference - np.sum(reference * axis, axis=1, keepdims=True) * axis
    x0 /= np.linalg.norm(x0, axis=1, keepdims=True)
    x = np.cos(rotation_about_tool_rad) * x0 + np.sin(rotation_about_tool_rad) * np.cross(axis, x0)
    z = -axis
    out: Float = np.stack([x, np.cross(z, x), z], axis=-1)
    return out


def tool_poses(T_base_part: Float, p_part_tcp: Float, Rs_part_tcp: Float) -> Float:
    """Poses of the tool frame in the robot base.

    Args:
        T_base_part: (4, 4).
        p_part_tcp: (n, 3) m.
        Rs_part_tcp: (n, 3, 3).

    Returns:
        Ts_base_tcp (n, 4, 4).
    """
    Ts_part_tcp = pose.make(Rs_part_tcp, p_part_tcp)
    Ts_base_tcp: Float = T_base_part @ Ts_part_tcp
    return Ts_base_tcp

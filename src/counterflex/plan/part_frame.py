"""What is left of own-weight sag once the part frame has been measured.

A part frame measured with the robot itself (touching datum points) already contains the sag and the geometric error
that the robot has at those points: there they cancel. What remains is how sag varies across the part. A frame measured
with an external instrument contains nothing, and the whole sag remains.
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.geometry import pose, registration
from counterflex.plan.setting import Setting
from counterflex.plan.tool_frame import tool_orientation, tool_poses
from counterflex.robot.elasticity import gravity
from counterflex.robot.elasticity.chain import forward
from counterflex.robot.kinematics.inverse import inverse_path

_ROUNDING_M = 1e-12
"""Deviations below this are what the transforms round: a robot without sag deviates by exactly nothing."""


def true_part_frame(T_base_part: Float, datum_points_part: Float, sag_base_datum: Float) -> Float:
    """Where the part is when its frame was measured by touching points with a sagging robot.

    The controller saw ``T_base_part p`` at each datum point p; the tool was truly at that position plus the sag.

    Args:
        T_base_part: (4, 4) the frame the controller got.
        datum_points_part: (k, 3) m, k >= 3.
        sag_base_datum: (k, 3) m, sag of the tool tip at those points, base axes.

    Returns:
        (4, 4) the pose of the part that best explains what was touched.
    """
    seen = pose.transform(T_base_part, datum_points_part)
    T_base_true, _ = registration.register(seen + sag_base_datum, datum_points_part)
    return T_base_true


def sag_deviation(T_base_part: Float, T_base_true: Float, p_part: Float, sag_base: Float) -> Float:
    """Deviation of the unloaded tool tip from the programmed point, in the frame of the part as it truly lies.

    Args:
        T_base_part: (4, 4) the frame the controller uses.
        T_base_true: (4, 4) from :func:`true_part_frame`, or ``T_base_part`` for an externally measured frame.
        p_part: (n, 3) m programmed points.
        sag_base: (n, 3) m sag of the tool tip there, base axes.

    Returns:
        (n, 3) m, actual - nominal.
    """
    p_base = pose.transform(T_base_part, p_part) + sag_base
    out: Float = pose.transform(pose.inverse(T_base_true), p_base) - np.asarray(p_part, dtype=np.float64)
    out[np.abs(out) < _ROUNDING_M] = 0.0
    return out


def residual_sag(p_part: Float, q: Float, setting: Setting) -> Float:
    """(n, 3) m, deviation of the unloaded tool along the path, see :mod:`counterflex.plan.part_frame`.

    What the robot does at its commanded joint angles with nothing but its own weight on it: sag, periodic errors of its
    drives, and the difference between its geometry and the one the controller has.
    """
    off = _unloaded_offset(setting, q)
    touched = touched_points(setting)
    if touched is None:
        return sag_deviation(setting.T_base_part, setting.T_base_part, p_part, off)
    datum, q_datum = touched
    T_base_true = true_part_frame(setting.T_base_part, datum, _unloaded_offset(setting, q_datum))
    return sag_deviation(setting.T_base_part, T_base_true, p_part, off)


def touched_points(setting: Setting) -> tuple[Float, Float] | None:
    """Datum points (k, 3) m in the part frame and the angles (k, 6) rad at them; None for a frame from outside."""
    if setting.datum_points_part is None:
        return None
    datum = setting.datum_points_part
    axes = np.tile([0.0, 0.0, 1.0], (len(datum), 1))
    Rs_part_tcp = tool_orientation(axes, setting.rotation_about_tool_rad)
    Ts_base_tcp = tool_poses(setting.T_base_part, datum, Rs_part_tcp)
    return datum, inverse_path(setting.controller_chain, Ts_base_tcp, setting.branch).q


def _unloaded_offset(setting: Setting, q: Float) -> Float:
    """(n, 3) m, true minus believed position of the unloaded tool tip, base axes."""
    off: Float = gravity.sag(setting.chain, q)[..., :3]
    if setting.controller_chain is not setting.chain or setting.drive_errors:
        links = setting.drive_errors.link_angles(q)
        off += forward(setting.chain, links)[..., :3, 3] - forward(setting.controller_chain, q)[..., :3, 3]
    return off

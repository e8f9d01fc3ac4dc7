"""Find the OPW lengths, offsets and signs of a chain from its joint axes at zero, where it has that geometry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from counterflex.core.arrays import Float
from counterflex.geometry import pose, rotation
from counterflex.robot.model.description import Opw, Segment
from counterflex.robot.model.opw_chain import from_opw

TOLERANCE_M = 5e-3
"""Flange position within which the closed form is a fit seed for the polish on the true chain."""
TOLERANCE_RAD = 5e-3
_SNAP_M = 1e-7
_LIMITS = np.tile([-math.pi, math.pi], (6, 1))


def flange_pose(segments: Sequence[Segment], T_last_flange: Float, q: Float) -> Float:
    """Rigid flange pose of a chain of segments: ``prod T_prev_seg Rz(sign q + offset)``. (6,) rad to (4, 4)."""
    T = np.eye(4)
    for segment in segments:
        T = T @ segment.T_prev_seg
        if segment.joint is not None:
            T = T @ pose.make(rotation.about_z(segment.sign * q[segment.joint] + segment.offset_rad))
    out: Float = T @ T_last_flange
    return out


def fit_opw(segments: Sequence[Segment], T_last_flange: Float) -> Opw | None:
    """OPW geometry of a chain, or None where it does not have one.

    Read from the six axis lines at q = 0: axis 1 along the base z, axes 2 and 3 across it and parallel, axes 4 to 6
    through one point, flange on axis 6. The result is checked at 24 spread postures against the chain; lengths within
    5 mm and 5 mrad there are a fit, since the polish on the true chain does the rest.

    Args:
        segments: From the base outward, joints 0..5 in order.
        T_last_flange: (4, 4), z out of the flange along axis 6.

    Source: geometry of Brandstoetter et al. 2014.
    """
    point, axis, T_base_flange = _axes(segments, T_last_flange)
    opw = _read(point, axis, T_base_flange)
    if opw is None:
        return None
    model = from_opw("fit", opw, _LIMITS)
    R6 = flange_pose(model.segments, model.T_last_flange, np.zeros(6))[:3, :3].T @ T_base_flange[:3, :3]
    opw = replace(opw, offsets_rad=(*opw.offsets_rad[:5], -float(rotation.log(R6)[2])))
    model = from_opw("fit", opw, _LIMITS)
    for k in range(24):
        q = np.sin((k + 1.0) * np.array([1.0, 1.7, 2.3, 3.1, 4.3, 5.9])) * 2.0
        gap = pose.difference(
            flange_pose(segments, T_last_flange, q), flange_pose(model.segments, model.T_last_flange, q)
        )
        if np.max(np.abs(gap[:3])) > TOLERANCE_M or np.max(np.abs(gap[3:])) > TOLERANCE_RAD:
            return None
    return opw


def _axes(segments: Sequence[Segment], T_last_flange: Float) -> tuple[Float, Float, Float]:
    """A point (6, 3) and the positive direction (6, 3) of each joint axis at q = 0, and the flange."""
    point, axis, T = np.zeros((6, 3)), np.zeros((6, 3)), np.eye(4)
    for segment in segments:
        T = T @ segment.T_prev_seg
        if segment.joint is not None:
            point[segment.joint], axis[segment.joint] = T[:3, 3], segment.sign * T[:3, 2]
            T = T @ pose.make(rotation.about_z(segment.offset_rad))
    return point, axis, T @ T_last_flange


def _read(point: Float, axis: Float, T_base_flange: Float) -> Opw | None:
    up = np.array([0.0, 0.0, 1.0])
    rough = 10.0 * TOLERANCE_RAD
    if 1.0 - abs(axis[0] @ up) > rough or abs(axis[1] @ up) > rough or 1.0 - abs(axis[1] @ axis[2]) > rough:
        return None
    wrist = _common_point(point[3:], axis[3:])
    sideways = np.cross(axis[1], up)  # in the plane of the arm, horizontal
    forward = sideways / np.linalg.norm(sideways)
    ahead = float((point[1] - point[0]) @ forward)
    if ahead < -_SNAP_M or (abs(ahead) <= _SNAP_M and forward[0] < 0.0):
        forward = -forward
    left = np.cross(up, forward)
    plane = np.stack([forward, up])  # coordinates in the arm's plane
    shoulder, elbow, hand = (plane @ (p - np.append(point[0][:2], 0.0)) for p in (point[1], point[2], wrist))
    arm = elbow - shoulder
    theta2 = math.atan2(arm[0], arm[1])
    along = plane @ axis[3]
    if np.linalg.norm(along) < 0.5 or np.linalg.norm(arm) < 1e-3:
        return None
    along = along / np.linalg.norm(along)
    if along @ (hand - elbow) < 0.0:
        along = -along
    lean = math.atan2(along[0], along[1])
    across = np.array([math.cos(lean), -math.sin(lean)])
    u = along[0] * forward + along[1] * up
    theta4, sign5 = _smaller(left, axis[4], u)
    hinge = sign5 * axis[4]
    out = T_base_flange[:3, 2]
    theta5 = math.atan2(float(out @ np.cross(hinge, u)), float(out @ u))
    theta1 = math.atan2(forward[1], forward[0])
    signs = [axis[0] @ up, axis[1] @ left, axis[2] @ left, axis[3] @ u, sign5, axis[5] @ out]
    return Opw(
        a1_m=_snap(float(shoulder[0])),
        a2_m=_snap(float(across @ (hand - elbow))),
        b_m=_snap(float((wrist - point[0]) @ left)),
        c1_m=_snap(float(shoulder[1])),
        c2_m=float(np.linalg.norm(arm)),
        c3_m=_snap(float(along @ (hand - elbow))),
        c4_m=_snap(float((T_base_flange[:3, 3] - wrist) @ out)),
        offsets_rad=(-theta1, -theta2, -_turn(lean - theta2), -theta4, -theta5, 0.0),
        signs=tuple(1 if s > 0.0 else -1 for s in signs),
    )


def _smaller(zero: Float, axis: Float, about: Float) -> tuple[float, int]:
    """Angle from ``zero`` to plus or minus ``axis`` about a third direction, whichever is smaller, and that sign."""
    angle = math.atan2(float(axis @ np.cross(about, zero)), float(axis @ zero))
    if abs(angle) <= math.pi / 2 + 1e-9:
        return angle, 1
    return _turn(angle + math.pi), -1


def _common_point(points: Float, directions: Float) -> Float:
    """Point with the least sum of squared distances from some lines."""
    A, b = np.zeros((3, 3)), np.zeros(3)
    for p, d in zip(points, directions, strict=True):
        across = np.eye(3) - np.outer(d, d)
        A += across
        b += across @ p
    out: Float = np.asarray(np.linalg.lstsq(A, b, rcond=None)[0], dtype=np.float64)
    return out


def _snap(length: float) -> float:
    return 0.0 if abs(length) < _SNAP_M else length


def _turn(angle: float) -> float:
    return angle - 2.0 * math.pi * round(angle / (2.0 * math.pi))

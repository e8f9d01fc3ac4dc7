"""Read a robot from a URDF file: a serial chain of six revolute joints from a base link to a tip link.

Every joint becomes a segment with z along its axis, so a URDF joint angle is the controller angle with sign +1 and
offset 0. Many public URDFs have another zero pose or sense of rotation than the robot's controller: compare a pose
with the controller's display before use. A URDF holds no compliance; everything is rigid until the cell file adds it.
"""

from __future__ import annotations

import importlib
import math
import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from counterflex.core.arrays import Float, frozen
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.file_content import readable
from counterflex.core.remarks import remark
from counterflex.geometry import pose, rotation
from counterflex.robot.model.description import Opw, Robot, Segment
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
    # What is left between both flanges is a turn about axis 6: its zero, which no axis line shows.
    opw = replace(opw, offsets_rad=(*opw.offsets_rad[:5], -float(rotation.log(R6)[2])))
    model = from_opw("fit", opw, _LIMITS)
    for k in range(24):
        # Rates without a common measure: no two axes repeat together, so that few postures are spread.
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
    # Forward is where axis 2 lies; where it meets axis 1, base x decides.
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


_FIXED = "fixed"
_TURNING = ("revolute", "continuous")
_TIPS = ("tool0", "flange")
CONTINUOUS_LIMIT_RAD = 2.0 * math.pi
"""Limit given to a joint that the URDF calls continuous."""


def load_urdf(path: str | os.PathLike[str], tip_link: str | None = None, base_link: str | None = None) -> Robot:
    """Import a robot.

    Fixed joints are merged; the mass of a fixed link goes to the link that carries it, and the mass of the base is left
    out, since it does not move.

    Args:
        path: URDF file (no xacro).
        tip_link: Link whose frame is the flange, z out of the flange. None takes ``tool0`` or ``flange`` where there is
            one, else the only link without children.
        base_link: Link whose frame is the robot's base, z up. None takes the root of the tree.

    Returns:
        The robot, named as in the file; limits in rad, speeds in rad/s (None where a joint states none). ``opw`` is set
        where the geometry fits, see :func:`counterflex.robot.model.urdf.fit_opw`.

    Raises:
        InputError: The package yourdfpy is missing; a link name is unknown or ambiguous.
        FileFormatError: Not a URDF, or not a serial chain of six revolute joints: prismatic, floating, planar or mimic
            joints, branches that move, loops, other numbers of axes, impossible limits, axes or masses.
    """
    file = Path(path)
    model = _parse(file)
    where = str(file)
    links = {link.name: link for link in model.links}
    parent_of, children_of = _tree(model, where)
    base = base_link or _root(links, parent_of, where)
    tip = tip_link or _tip(links, children_of, where)
    for name in (base, tip):
        if name not in links:
            raise InputError(f"{where}: no link {name!r}", limit="one of " + ", ".join(sorted(links)))
    joints = _path(parent_of, base, tip, where)
    _check_branches(children_of, base, joints, where)
    segments: list[Segment] = []
    limits, speeds = np.empty((6, 2)), np.full(6, np.nan)
    T_seg_link = np.eye(4)  # the current link in the last segment's frame (base for the first)
    for joint in joints:
        T_seg_link = T_seg_link @ _origin(joint, where)
        if joint.type == _FIXED:
            continue
        k = len(segments)
        place = f"{where}: joint {joint.name!r}"
        R_link_seg = _along(_axis(joint, place))
        limits[k], speeds[k] = _limits(joint, place)
        T_link_seg = pose.make(R_link_seg)
        mass, com = _carried(joint.child, children_of, links, where)
        segments.append(
            Segment(
                name=f"axis{k + 1}",
                T_prev_seg=frozen(T_seg_link @ T_link_seg),
                joint=k,
                mass_kg=mass,
                p_seg_com=frozen(R_link_seg.T @ com),
            )
        )
        T_seg_link = pose.inverse(T_link_seg)
    unknown = np.isnan(speeds)
    if unknown.any() and not unknown.all():
        names = ", ".join(f"axis {k + 1}" for k in np.flatnonzero(unknown))
        remark(
            f"{where}: no speed of {names} is stated, so no joint speed is looked at; limits.joint_speed_deg_s has all"
        )
    return Robot(
        name=str(model.name or file.stem),
        segments=tuple(segments),
        T_last_flange=frozen(T_seg_link),
        joint_limits_rad=frozen(limits),
        joint_speeds_rad_s=None if unknown.any() else frozen(speeds),
        opw=fit_opw(segments, T_seg_link),
    )


def _parse(file: Path) -> Any:
    try:
        library = importlib.import_module("yourdfpy")
    except ImportError as fault:
        raise InputError(
            "reading URDF files needs the package yourdfpy", hint='Run: pip install "counterflex[urdf]"'
        ) from fault
    with readable(file, "a URDF", "Export the robot as URDF (no xacro)"):
        try:
            ElementTree.parse(file)  # the library repairs broken XML and carries on; a robot must not be guessed
        except ElementTree.ParseError as fault:
            line, column = fault.position
            place = f"{file}:{line}:{column + 1}"
            raise FileFormatError("not well-formed XML", where=place, value=str(fault)) from fault
        return library.URDF.load(str(file), build_scene_graph=False, load_meshes=False).robot


def _tree(model: Any, where: str) -> tuple[dict[str, Any], dict[str, list[Any]]]:
    parent_of: dict[str, Any] = {}
    children_of: dict[str, list[Any]] = {}
    names = {link.name for link in model.links}
    for joint in model.joints:
        if joint.child in parent_of:
            raise FileFormatError(f"link {joint.child!r} has two parents: the chain is not serial", where=where)
        for end in (joint.parent, joint.child):
            if end not in names:
                raise FileFormatError(f"joint {joint.name!r} names the link {end!r}, which is not there", where=where)
        parent_of[joint.child] = joint
        children_of.setdefault(joint.parent, []).append(joint)
    return parent_of, children_of


def _root(links: dict[str, Any], parent_of: dict[str, Any], where: str) -> str:
    roots = [name for name in links if name not in parent_of]
    if len(roots) != 1:
        raise InputError(f"{where}: the base link is not clear", value=roots, limit="one root", hint="Name base_link")
    return roots[0]


def _tip(links: dict[str, Any], children_of: dict[str, list[Any]], where: str) -> str:
    for name in _TIPS:
        if name in links:
            return name
    ends = [name for name in links if name not in children_of]
    if len(ends) != 1:
        raise InputError(f"{where}: the flange link is not clear", value=ends, limit="one end", hint="Name tip_link")
    return ends[0]


def _path(parent_of: dict[str, Any], base: str, tip: str, where: str) -> list[Any]:
    """Joints from base to tip."""
    joints: list[Any] = []
    link = tip
    while link != base:
        # More steps than there are joints: the links go round in a circle.
        if link not in parent_of or len(joints) > len(parent_of):
            raise InputError(f"{where}: link {tip!r} is not connected to link {base!r}")
        joints.append(parent_of[link])
        link = parent_of[link].parent
    joints.reverse()
    for joint in joints:
        if joint.mimic is not None:
            raise FileFormatError(
                f"joint {joint.name!r} follows another one (mimic)", where=where, limit="six free axes"
            )
        if joint.type != _FIXED and joint.type not in _TURNING:
            raise FileFormatError(
                f"joint {joint.name!r} of the chain does not turn", where=where, value=joint.type, limit="revolute"
            )
    count = sum(joint.type != _FIXED for joint in joints)
    if count != 6:
        raise FileFormatError(
            f"the chain from {base!r} to {tip!r} is not a six-axis robot", where=where, value=count, limit="6 revolute"
        )
    return joints


def _check_branches(children_of: dict[str, list[Any]], base: str, joints: list[Any], where: str) -> None:
    """Nothing may move beside the chain."""
    chain = {joint.name for joint in joints}
    waiting = [base]
    while waiting:
        for joint in children_of.get(waiting.pop(), []):
            waiting.append(joint.child)
            if joint.name not in chain and joint.type != _FIXED:
                raise FileFormatError(
                    f"joint {joint.name!r} is outside the chain, so the robot is not serial",
                    where=where,
                    hint="Remove it or make it fixed",
                )


def _origin(joint: Any, where: str) -> Float:
    T: Float = np.eye(4) if joint.origin is None else np.array(joint.origin, dtype=np.float64)
    if T.shape != (4, 4) or not np.all(np.isfinite(T)):
        raise FileFormatError(f"joint {joint.name!r} has an impossible origin", where=where)
    return T


def _axis(joint: Any, place: str) -> Float:
    axis = np.array([1.0, 0.0, 0.0] if joint.axis is None else joint.axis, dtype=np.float64)
    norm = float(np.linalg.norm(axis)) if axis.shape == (3,) and np.all(np.isfinite(axis)) else 0.0
    if norm < 1e-9:
        raise FileFormatError("the axis is no direction", where=place, value=axis.tolist())
    return axis / norm


def _along(axis: Float) -> Float:
    """Rotation whose z is the axis, by the shortest way from z."""
    z = np.array([0.0, 0.0, 1.0])
    across = np.cross(z, axis)
    s, c = float(np.linalg.norm(across)), float(axis[2])
    if s < 1e-12:
        return np.eye(3) if c > 0.0 else np.diag([1.0, -1.0, -1.0])
    R = rotation.exp(across / s * math.atan2(s, c))
    R[np.abs(R) < 1e-15] = 0.0
    return R


def _limits(joint: Any, place: str) -> tuple[tuple[float, float], float]:
    speed = math.nan
    if joint.limit is not None and joint.limit.velocity:
        speed = float(joint.limit.velocity)
        if not speed > 0.0:
            raise FileFormatError("the speed limit is not positive", where=place, value=speed, limit="> 0 rad/s")
    if joint.type == "continuous":
        return (-CONTINUOUS_LIMIT_RAD, CONTINUOUS_LIMIT_RAD), speed
    if joint.limit is None:
        raise FileFormatError("a revolute joint without limits", where=place)
    low = 0.0 if joint.limit.lower is None else float(joint.limit.lower)
    high = 0.0 if joint.limit.upper is None else float(joint.limit.upper)
    if not low < high or not math.isfinite(high - low):
        raise FileFormatError("the lower limit is not below the upper one", where=place, value=(low, high))
    if high - low > 30.0:
        raise FileFormatError(
            "the limits are implausibly wide", where=place, value=(low, high), hint="URDF limits are in rad"
        )
    return (low, high), speed


def _carried(link: str, children_of: dict[str, list[Any]], links: dict[str, Any], where: str) -> tuple[float, Float]:
    """Mass of a link and all that is fixed to it, and its centre of gravity in the link's frame."""
    mass, moment = 0.0, np.zeros(3)
    waiting = [(link, np.eye(4))]
    while waiting:
        name, T = waiting.pop()
        inertial = links[name].inertial
        if inertial is not None and inertial.mass is not None:
            own = float(inertial.mass)
            com = np.zeros(3) if inertial.origin is None else np.array(inertial.origin, dtype=np.float64)[:3, 3]
            if not math.isfinite(own) or own < 0.0 or not np.all(np.isfinite(com)):
                raise FileFormatError(f"link {name!r} has an impossible mass", where=where, value=own, limit=">= 0 kg")
            mass += own
            moment += own * pose.transform(T, com)
        waiting.extend(
            (joint.child, T @ _origin(joint, where)) for joint in children_of.get(name, []) if joint.type == _FIXED
        )
    return mass, moment / mass if mass > 0.0 else moment

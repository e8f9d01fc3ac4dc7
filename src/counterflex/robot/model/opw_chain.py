"""From OPW geometry to the segment chain: frames with z along each joint axis, at the bearing centre.

The chain is the modified Denavit-Hartenberg (Craig) form of an OPW arm, ``T = Rx(alpha) Tx(a) Rz(theta) Tz(d)`` per
axis with, in terms of the OPW angles ``t_i = sign_i q_i - offset_i``::

    alpha    0      -90     0       -90    90   -90
    a        0       a1     c2      -a2     0     0
    theta    t1   t2-90   t3-90      t4    t5  t6+180
    d        c1       b     0        c3     0    c4

Rotation about and shift along z commute, so each frame may slide along its axis to the bearing centre by a shift that
the next segment undoes. The flange frame does not depend on the shifts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from counterflex.core.arrays import Float, as_float, frozen
from counterflex.core.errors import InputError
from counterflex.geometry import pose, rotation
from counterflex.robot.model.description import RIGID, Counterbalance, Opw, Robot, Segment

_ALPHA_DEG = (0.0, -90.0, 0.0, -90.0, 90.0, -90.0)
_R_ALPHA = [np.rint(rotation.about_x(math.radians(alpha))) + 0.0 for alpha in _ALPHA_DEG]  # exact quarter turns
_THETA0_RAD = (0.0, -math.pi / 2, -math.pi / 2, 0.0, 0.0, math.pi)


@dataclass(frozen=True)
class Element:
    """An undriven body with an elastic element, between two driven axes."""

    name: str  # for messages, for example `link_arm`
    after_joint: int  # joint index 0..5 of the driven axis it follows
    T_axis_elem: Float  # (4, 4) its frame in the bearing frame of that axis
    compliance: Float = field(default_factory=lambda: RIGID)  # (6,) `tx ty tz rx ry rz` m/N, rad/(N m) in its own axes
    mass_kg: float = 0.0  # mass of its body
    p_elem_com: Float = field(default_factory=lambda: np.zeros(3))  # (3,) m centre of gravity in its frame

    def body(self, T_prev_elem: Float) -> Segment:
        """Undriven body of the chain."""
        return Segment(
            name=self.name,
            T_prev_seg=frozen(T_prev_elem),
            compliance=frozen(self.compliance),
            mass_kg=self.mass_kg,
            p_seg_com=frozen(self.p_elem_com),
        )


def from_opw(
    name: str,
    opw: Opw,
    limits_rad: Float,
    compliances: Float | None = None,
    *,
    bearings_m: Float | None = None,
    masses_kg: Float | None = None,
    p_axis_com: Float | None = None,
    elements: Sequence[Element] = (),
    speeds_rad_s: Float | None = None,
    counterbalance: Counterbalance | None = None,
) -> Robot:
    """Build a robot of OPW geometry as a chain of segments ``axis1`` ... ``axis6``.

    Args:
        opw: Geometry, m and rad.
        limits_rad: (6, 2) lower and upper limit of the angles the controller shows.
        compliances: (6, 6) elastic element of each driven axis, row ``tx ty tz rx ry rz`` in m/N and rad/(N m), in the
            bearing frame (z along the joint axis); None is rigid.
        bearings_m: (6,) position of each bearing centre along the axis z, measured from the point where the previous
            segment's offset ends (the foot of the common normal): axis 1 from the base, axis 4 from the axis 3
            side, axis 5 and 6 from the wrist centre. None is zero everywhere.
        masses_kg: (6,) mass of the body each axis carries; None is massless.
        p_axis_com: (6, 3) m, centre of gravity in the bearing frame.
        elements: Further elastic bodies between the axes, in order along each axis' body.
        speeds_rad_s: (6,) or None.

    Returns:
        The robot, with ``opw`` kept for the closed-form inverse.

    Raises:
        InputError: A shape, sign or limit is impossible, or a number is not finite.

    Source: Brandstoetter et al. 2014 for the geometry; Craig, Introduction to Robotics, for the frames.
    """
    opw = checked(opw)
    limits = as_float("joint limits", limits_rad, (6, 2))
    if np.any(limits[:, 0] >= limits[:, 1]):
        axis = int(np.argmax(limits[:, 0] >= limits[:, 1]))
        raise InputError(
            f"the lower limit of axis {axis + 1} of {name} is not below the upper one",
            value=np.degrees(limits[axis]).round(3).tolist(),
            limit="lower < upper, in deg",
        )
    soft = _rows("compliances", compliances, 6)
    com = _rows("centres of gravity", p_axis_com, 3)
    shift = np.zeros(6) if bearings_m is None else as_float("bearing positions", bearings_m, (6,))
    masses = np.zeros(6) if masses_kg is None else as_float("masses", masses_kg, (6,))
    if np.any(soft < 0.0) or np.any(masses < 0.0) or any(np.any(e.compliance < 0) or e.mass_kg < 0 for e in elements):
        raise InputError(f"{name} has a negative compliance or mass", limit=">= 0")
    a = (0.0, opw.a1_m, opw.c2_m, -opw.a2_m, 0.0, 0.0)
    d = (opw.c1_m, opw.b_m, 0.0, opw.c3_m, 0.0, opw.c4_m)
    segments: list[Segment] = []
    T_prev_axis = np.eye(4)  # from the previous axis' bearing frame (base for the first) back to its DH frame
    for joint in range(6):
        T_dh = pose.make(_R_ALPHA[joint], np.array([a[joint], 0.0, 0.0]))
        T_bearing = T_prev_axis @ T_dh @ pose.make(p=np.array([0.0, 0.0, shift[joint]]))
        T_here = np.eye(4)  # from the axis' bearing frame to the last segment placed
        for element in elements:
            if element.after_joint == joint - 1:
                segments.append(element.body(pose.inverse(T_here) @ element.T_axis_elem))
                T_here = element.T_axis_elem
        segments.append(
            Segment(
                name=f"axis{joint + 1}",
                T_prev_seg=frozen(pose.inverse(T_here) @ T_bearing),
                joint=joint,
                sign=float(opw.signs[joint]),
                offset_rad=_THETA0_RAD[joint] - opw.offsets_rad[joint],
                compliance=frozen(soft[joint]),
                mass_kg=float(masses[joint]),
                p_seg_com=frozen(com[joint]),
            )
        )
        T_prev_axis = pose.make(p=np.array([0.0, 0.0, d[joint] - shift[joint]]))
    T_here = np.eye(4)
    for element in elements:
        if element.after_joint == 5:
            segments.append(element.body(pose.inverse(T_here) @ element.T_axis_elem))
            T_here = element.T_axis_elem
    return Robot(
        name=name,
        segments=tuple(segments),
        T_last_flange=frozen(pose.inverse(T_here) @ T_prev_axis),
        joint_limits_rad=frozen(limits),
        joint_speeds_rad_s=None if speeds_rad_s is None else frozen(as_float("speeds", speeds_rad_s, (6,))),
        opw=opw,
        counterbalance=counterbalance,
    )


def checked(opw: Opw) -> Opw:
    """The geometry, with offsets and signs checked: six each, finite, signs +1 or -1, c2 and the forearm not zero."""
    lengths = as_float("OPW lengths", [opw.a1_m, opw.a2_m, opw.b_m, opw.c1_m, opw.c2_m, opw.c3_m, opw.c4_m], (7,))
    offsets = as_float("OPW offsets", opw.offsets_rad, (6,))
    if len(opw.signs) != 6 or any(s not in (-1, 1) for s in opw.signs):
        raise InputError("OPW signs are wrong", value=list(opw.signs), limit="six numbers, each +1 or -1")
    if lengths[4] <= 0.0 or math.hypot(lengths[1], lengths[5]) <= 0.0:
        raise InputError(
            "an OPW arm needs a link arm and a forearm", value=f"c2 = {lengths[4]} m, c3 = {lengths[5]} m", limit="> 0"
        )
    return replace(opw, offsets_rad=tuple(float(o) for o in offsets), signs=tuple(int(s) for s in opw.signs))


def _rows(what: str, value: Float | None, width: int) -> Float:
    return np.zeros((6, width)) if value is None else as_float(what, value, (6, width))

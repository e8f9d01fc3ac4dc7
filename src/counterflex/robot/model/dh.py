"""From Denavit-Hartenberg rows to the segment chain: any six-axis arm, with or without a spherical wrist.

Per axis, with ``theta_i = sign_i q_i + offset_i``::

    standard    Rz(theta_i) Tz(d_i) Tx(a_i) Rx(alpha_i)      (Denavit and Hartenberg 1955)
    modified    Rx(alpha_i) Tx(a_i) Rz(theta_i) Tz(d_i)      (Craig)

Segment ``axisN`` has its z along axis N: in the modified form its origin is that of the row's frame before ``d``, in
the standard form the one of the row before. What remains behind axis 6 leads to the flange.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from counterflex.core.arrays import Float, frozen
from counterflex.core.errors import ModelError
from counterflex.geometry import pose, rotation
from counterflex.robot.model.description import Robot, Segment

AXES: Final = 6
Convention = Literal["standard", "modified"]


@dataclass(frozen=True)
class DhRow:
    """One axis."""

    a_m: float  # length of the common normal
    d_m: float  # offset along the axis
    alpha_rad: float  # twist about the common normal
    offset_rad: float = 0.0  # see `sign`
    sign: float = 1.0  # +1 or -1; `theta = sign q + offset_rad`
    limits_rad: tuple[float, float] = (-np.pi, np.pi)  # lower and upper limit of the angle that the controller shows
    mass_kg: float = 0.0  # mass of the body that the axis carries
    # (3,) m, its centre of gravity in the frame `axisN` (z along the axis, turning with it)
    p_axis_com: tuple[float, float, float] = (0.0, 0.0, 0.0)


def from_dh(name: str, rows: Sequence[DhRow], convention: Convention = "standard") -> Robot:
    """Build a robot from its DH rows.

    ``rows``: six, from the base outward; ``convention``: of the rows, see the module.

    Returns:
        The robot; rigid, without closed-form inverse kinematics.

    Raises:
        ModelError: Not six rows, or a convention that does not exist.
    """
    if len(rows) != AXES:
        raise ModelError("a robot has six axes", where=name, value=f"{len(rows)} DH rows", limit=AXES)
    if convention not in ("standard", "modified"):
        raise ModelError("unknown DH convention", where=name, value=convention, limit="standard or modified")
    segments = []
    before = np.eye(4)
    for i, row in enumerate(rows):
        normal = pose.make(p=np.array([row.a_m, 0.0, 0.0])) @ pose.make(_about_x(row.alpha_rad))
        along = pose.make(p=np.array([0.0, 0.0, row.d_m]))
        if convention == "modified":
            before = before @ pose.make(_about_x(row.alpha_rad)) @ pose.make(p=np.array([row.a_m, 0.0, 0.0]))
        segments.append(
            Segment(
                name=f"axis{i + 1}",
                T_prev_seg=frozen(before),
                joint=i,
                sign=row.sign,
                offset_rad=row.offset_rad,
                mass_kg=row.mass_kg,
                p_seg_com=np.array(row.p_axis_com, dtype=np.float64),
            )
        )
        before = along @ normal if convention == "standard" else along
    return Robot(
        name=name,
        segments=tuple(segments),
        T_last_flange=frozen(before),
        joint_limits_rad=np.array([row.limits_rad for row in rows], dtype=np.float64),
    )


def _about_x(angle: float) -> Float:
    """Turn about x; exact where it is a multiple of a quarter turn."""
    R = rotation.about_x(angle)
    quarter = angle / (0.5 * np.pi)
    return np.rint(R) + 0.0 if abs(quarter - round(quarter)) < 1e-12 else R

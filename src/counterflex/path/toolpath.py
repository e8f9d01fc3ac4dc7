"""A sampled tool path in the part frame, and the pose of the tool frame along it.

A three-axis program leaves the rotation about the tool axis free; it is fixed here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.geometry import pose


@dataclass(frozen=True, eq=False)
class Run:
    """Record of a machining, simulated or measured; n rows, part axes, SI."""

    time_s: Float  # (n,) controller time; stretches of air may be left out
    motion: Int  # (n,) program motion
    kind: Int  # (n,) RAPID or FEED
    progress: Float  # (n,) share 0..1 of the program's path length that is done
    p_part_command: Float  # (n, 3) m, interpolated set-point
    p_part_tcp: Float  # (n, 3) m, where the tool tip was
    tilt_part: Float  # (n, 3) rad, from the commanded to the true orientation
    force_part: Float  # (n, 3) N, mean force on the tool
    moment_part: Float  # (n, 3) N m
    force_peak_n: Float
    depth_m: Float  # (n,) m, engaged axial depth, 0 in air
    q_motor: Float  # (n, 6) rad
    # (n, 3) unit vectors from the tip to the spindle, as the tool was held; None in records of before
    axis_part: Float | None = field(default=None, kw_only=True)


RAPID: Final = 0
FEED: Final = 1


@dataclass(frozen=True)
class ToolPath:
    """Points the tool centre point runs through, joined by straight segments; row i ends segment i.

    Row 0 is the start and ends no segment. Consecutive rows may coincide (a dwell: time passes, nothing moves).
    """

    p_part_tcp: Float  # (n, 3) m. Tool tip in the part frame (for a ball mill the tip too, not the ball centre)
    axis_part: Float  # (n, 3) unit vectors from the tool tip towards the spindle, in the part frame
    kind: Int  # (n,) RAPID or FEED of the segment that ends here
    feed_m_s: Float  # (n,) m/s. Programmed speed along the segment that ends here
    spindle_rad_s: Float  # (n,) rad/s. Spindle speed, positive clockwise seen from the spindle (M3), 0 when off
    time_s: Float  # (n,) s. Time of arrival at the programmed speed, non-decreasing, `time_s[0] == 0`
    motion: Int  # (n,) index of the program motion that the segment belongs to, non-decreasing
    tool: Int  # (n,) number of the tool in the spindle
    # (n,) number of the place of the external axes, between two of them where they move; zeros where it is left out:
    # they stand in one place
    place: Float = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        """Check lengths and order."""
        n = len(self.p_part_tcp)
        if len(self.place) == 0:
            object.__setattr__(self, "place", np.zeros(n))
        for name in ("axis_part", "kind", "feed_m_s", "spindle_rad_s", "time_s", "motion", "tool", "place"):
            if len(getattr(self, name)) != n:
                raise InputError(f"tool path column {name} has another length", value=len(getattr(self, name)), limit=n)
        if n and (np.any(np.diff(self.time_s) < 0.0) or np.any(np.diff(self.motion) < 0)):
            raise InputError("tool path runs backwards in time or in motions")

    def __len__(self) -> int:
        """Number of points."""
        return len(self.p_part_tcp)


def tool_orientation(axis_part: Float, rotation_about_tool_rad: float | Float) -> Float:
    """Orientation of the TCP frame for given tool axes.

    z of the TCP frame points out of the spindle through the tip, ``z = -axis``. x is the part's x axis projected
    square to the tool axis (the part's y axis where the tool lies along x), turned about the tool axis by the free
    angle, right-handed about ``axis``.

    Args:
        axis_part: (n, 3) unit vectors from the tip towards the spindle, in part axes.
        rotation_about_tool_rad: The free angle, or (n,) one for each axis.

    Returns:
        Rs_part_tcp (n, 3, 3).
    """
    axis = as_float("axis_part", axis_part, (None, 3))
    reference = np.where(np.abs(axis[:, :1]) < 0.9, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    x0 = reference - np.sum(reference * axis, axis=1, keepdims=True) * axis
    x0 /= np.linalg.norm(x0, axis=1, keepdims=True)
    angle = np.reshape(rotation_about_tool_rad, (-1, 1))
    x = np.cos(angle) * x0 + np.sin(angle) * np.cross(axis, x0)
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

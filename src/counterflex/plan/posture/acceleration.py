"""Postures in which an axis has to accelerate faster at feed than its drive can.

The accelerations are those of :func:`counterflex.plan.preflight.joints.joint_accelerations`, which preflight compares
with the same limits: at corners, starts and stops ``J^-1 a`` with the acceleration of the controller, along arcs that
of the programmed feed.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.path.toolpath import ToolPath
from counterflex.plan.posture.cut_path import LoadedPath
from counterflex.plan.posture.survey import RobotHere, survey_path
from counterflex.plan.preflight.joints import at_feed, joint_accelerations, joint_speeds

NEIGHBOURS: Final = 3
"""Rows on either side of a point that its acceleration is computed from."""


@dataclass(frozen=True)
class TooFast:
    """The axis that is asked for most beyond its limit."""

    point: int  # row of the path
    axis: int  # 0..5
    acceleration_rad_s2: float  # its size
    limit_rad_s2: float  # of the drive


def too_fast(path: ToolPath, robot: RobotHere, q: Float) -> TooFast | None:
    """The worst acceleration of an axis at feed; None where all can be reached, or no limits are known.

    ``robot``: with the limits; ``q``: (n, 6) rad.
    """
    limits = robot.joint_accelerations_rad_s2
    if limits is None:
        return None
    size = (
        np.abs(
            joint_accelerations(path, joint_speeds(path, robot.controller_chain.axes.shown(q)), robot.acceleration_m_s2)
        )
        * at_feed(path)[:, None]
    )
    point, axis = np.unravel_index(int(np.argmax(size / limits)), size.shape)
    if size[point, axis] <= limits[axis]:
        return None
    return TooFast(int(point), int(axis), float(size[point, axis]), float(limits[axis]))


def too_fast_at(path: ToolPath, robot: RobotHere, rotations_rad: Float, point: int) -> Bool:
    """Postures held all along in which an axis is too slow for one point.

    ``robot``: with limits; ``rotations_rad``: (r,) rad about the tool axis; ``point``: Row of the path.

    Returns:
        (r, 8); False for postures that do not reach the point or those beside it.
    """
    limits = robot.joint_accelerations_rad_s2
    out = np.zeros((len(rotations_rad), 8), dtype=np.bool_)
    if limits is None:
        return out
    rows = slice(max(0, point - NEIGHBOURS), min(len(path), point + NEIGHBOURS + 1))
    here, count = point - rows.start, rows.stop - rows.start
    none = np.zeros(count)
    piece = LoadedPath(
        path.p_part_tcp[rows], path.axis_part[rows], np.zeros((count, 6)), np.zeros((count, 1, 3)), none, none,
        np.zeros(count, dtype=np.int64),
    )  # fmt: skip
    q = survey_path(piece, robot, rotations_rad, np.arange(count)).q
    part = _piece(path, rows)
    for turn, slot in np.argwhere(~np.isnan(q[..., 0]).any(axis=0)).tolist():
        # Each row is solved within one turn by itself: a jump by a whole one is no motion.
        angles = np.unwrap(q[:, turn, slot], axis=0)
        shown = robot.controller_chain.axes.shown(angles)
        values = joint_accelerations(part, joint_speeds(part, shown), robot.acceleration_m_s2)[here]
        out[turn, slot] = bool(np.any(np.abs(values) > limits))
    return out


def _piece(path: ToolPath, rows: slice) -> ToolPath:
    """Some rows of a path, its clock from 0."""
    columns = {field.name: getattr(path, field.name)[rows] for field in fields(path)}
    return replace(path, **columns | {"time_s": path.time_s[rows] - path.time_s[rows.start]})

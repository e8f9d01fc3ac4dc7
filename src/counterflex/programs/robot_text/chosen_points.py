"""Which points of a corrected path are written: few enough for tolerance and controller."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.path.sampling import point_spacing
from counterflex.path.toolpath import FEED
from counterflex.programs.compensated import CompensatedPath
from counterflex.programs.motion_rows import MotionRows
from counterflex.programs.robot_writer.points import FineRows
from counterflex.programs.robot_writer.spaced_points import refined, spaced

_LEVER_M: Final = 0.3
"""A turn by 1 rad moves as much as this: the reach of a tool and its holder."""


def fine_rows(
    rows: MotionRows, compensated: CompensatedPath, tolerance_m: float, cycle_s: float
) -> tuple[MotionRows, Float]:
    """The rows of a path with the points to write among them, and further rows where points need places between.

    Ends of motions and changes of speed stay. Between them a straight line leads from point to point within the
    tolerance at the same place of the way, and points are at least feed times cycle apart (Berger2013 eq. 5); where the
    two contradict, the distance wins.

    Args:
        rows: The compensated path by motion.
        compensated: The same rows.
        tolerance_m: Largest distance of a commanded row from the written path, m.
        cycle_s: Time the controller needs per point, s.

    Returns:
        The rows, ``vertex`` where a point is written, and (n,) rotation vectors of the correction in part axes, rad.
    """
    path, n = compensated.path, len(compensated.path)
    stays = np.zeros(n, dtype=np.bool_)
    have = rows.last >= 0
    stays[rows.last[have]] = stays[np.maximum(rows.first[have] - 1, 0)] = True
    stays[:1] = True
    stays[:-1] |= rows.share[1:] != rows.share[:-1]
    travel = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(rows.command, axis=0), axis=1))])[:n]
    spacing = np.where(path.kind == FEED, point_spacing(1.0, cycle_s) * path.feed_m_s, 0.0)
    pieces = refined(travel, spacing, np.flatnonzero(rows.vertex | stays))
    fine = FineRows(pieces)
    ends = np.cumsum(pieces) - 1
    along, command = fine.between(rows.along), np.ascontiguousarray(fine.between(rows.command))
    rotvec = np.ascontiguousarray(fine.between(compensated.rotvec_part_command))
    chosen = spaced(
        along, command, rotvec, fine.between(travel), spacing[fine.row], fine.at_rows(stays), tolerance_m,
        tolerance_m / _LEVER_M,
    )  # fmt: skip
    vertex = np.zeros(len(along), dtype=np.bool_)
    vertex[chosen] = True
    return (
        replace(
            rows,
            first=np.where(rows.first > 0, ends[np.maximum(rows.first - 1, 0)] + 1, 0),
            last=np.where(have, ends[rows.last], -1),
            nominal=fine.between(rows.nominal),
            command=command,
            shift=fine.between(rows.shift),
            way=fine.between(rows.way),
            vertex=vertex,
            share=rows.share[fine.row],
            along=along,
        ),
        rotvec,
    )

"""The wall finish that a program makes: its side, width, depth, chip and speed, where it is and against which wall."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.app.inputs import Job, faults_in, setting_of
from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.progress import Progress
from counterflex.core.units import DEG
from counterflex.cutting.tilted_stock import working_plane
from counterflex.files.cell.cell import Cell
from counterflex.plan.elastic_motion import postures
from counterflex.plan.inputs import CompensationInputs, solve_joints
from counterflex.plan.strategy.side_cut import SideCuts
from counterflex.plan.undisturbed_cut import undisturbed_cut

POSTURE_RAD: Final = 2.0 * DEG
"""Change of an axis after which modes are computed anew."""
_RISE: Final = 0.1  # Share of the way along the axis up to which a motion of a turning tool counts as one beside a wall
_TANGENT_RAD: Final = 0.25
"""An arc that begins nearer than this to 0 begins at the wall: the stock's grid blurs the end of thin chips."""


@dataclass(frozen=True, eq=False)
class Along:
    """A posture along a wall."""

    q: Float  # (6,) rad
    normal_part: Float  # (3,) unit normal of the wall, out of the material
    axis_part: Float  # (3,) unit vector from the tip to the spindle
    to_part: Float  # (6, 6) motion of the tool relative to the part from that of the hand
    line: int  # Of the program; 0 without one

    def upright(self) -> tuple[Float, Float]:
        """Motion (6, 6) and normal (3,) in axes whose z is the tool axis."""
        R = working_plane(self.axis_part).T
        turn = np.kron(np.eye(2), R)
        return turn @ self.to_part, R @ self.normal_part


@dataclass(frozen=True, eq=False)
class OwnCut:
    """Cut of a program along a wall."""

    cuts: SideCuts
    tool: int
    spindle_rad_s: float
    p_part: Float  # (3,) m, a point in the middle of it
    q: Float  # (6,) rad there
    normal_part: Float  # (3,) unit normal of the wall there, out of the material
    line: int
    axis_part: Float  # (3,) unit vector from the tip to the spindle there
    to_part: Float  # (6, 6) see :class:`counterflex.plan.relative_motion.RelativeMotion`, there
    along: tuple[Along, ...]  # Postures along all of the side, :data:`POSTURE_RAD` apart

    @classmethod
    def of(cls, job: Job, cell: Cell, tool: int | None, progress: Progress) -> OwnCut:
        """Find the wall finish of a program: the side on which most of its length in the cut is milled.

        Args:
            tool: Number of the tool; None is any.

        Raises:
            ProgramError: It mills no side of a wall, only slots or nothing.
            CounterflexError: It does not fit the cell.
        """
        path, setting = job.path, setting_of(cell, job, part_may_be_held=True)
        line = job.line_of_motion[path.motion]
        with faults_in(job):
            q = solve_joints(path, line, setting).q
            undisturbed = undisturbed_cut(CompensationInputs(path, line, cell.stock(), setting, q), progress)
        cut = undisturbed.cut
        axis = path.axis_part
        step = np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1])
        rise = np.sum(step * axis, axis=1)
        step -= rise[:, None] * axis
        length = np.linalg.norm(step, axis=1)
        turns = np.any(axis != axis[:1])
        level = np.abs(rise) <= (_RISE * length if turns else 1e-9)
        level &= undisturbed.contact & (length > 0.0) & (cut.axial_depth_m > 0.0)
        if tool is not None:
            level &= path.tool == tool
        at_left, at_right = cut.entry_rad < _TANGENT_RAD, cut.exit_rad > math.pi - _TANGENT_RAD
        up, down = level & at_left & ~at_right, level & at_right & ~at_left
        side = up if float(length[up].sum()) >= float(length[down].sum()) else down
        if not side.any():
            raise ProgramError(
                "the program finishes no wall"
                + (": it mills slots only" if (level & at_left & at_right).any() else ""),
                where=Path(job.program.name).name,
                hint="For a slot see `counterflex plan trochoid`; or state the cut: --ae-mm, --ap-mm, --fz-mm, --rpm",
            )
        number = int(np.bincount(path.tool[side], length[side]).argmax())
        rows = np.flatnonzero(side & (path.tool == number))
        cutter = cell.cutter(number)
        immersion = float(np.median(cut.exit_rad[rows] if side is up else math.pi - cut.entry_rad[rows]))
        one = np.ones(1)
        cuts = SideCuts(
            cutter,
            np.array([side is up]),
            one * min(cutter.radius_m * (1.0 - math.cos(immersion)), cutter.diameter_m),
            one * min(float(np.median(cut.axial_depth_m[rows])), cutter.flute_length_m),
            one * float(np.median(cut.feed_per_tooth_m[rows])),
        )
        row = int(rows[len(rows) // 2])
        x = step / np.maximum(length, 1e-12)[:, None]
        left = np.cross(axis, x)
        normals = -left if side is up else left
        _, stands = postures(q[rows], POSTURE_RAD)
        to_part = setting.relative_motion(path).to_part
        fixed = len(to_part) == 1
        along = tuple(
            Along(q[i], normals[i], axis[i], to_part[0 if fixed else i], int(line[i])) for i in rows[stands].tolist()
        )
        return cls(
            cuts,
            number,
            float(np.median(path.spindle_rad_s[rows])),
            path.p_part_tcp[row],
            q[row],
            normals[row],
            int(line[row]),
            axis[row],
            to_part[0 if fixed else row],
            along,
        )

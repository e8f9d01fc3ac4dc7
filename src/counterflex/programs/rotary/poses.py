"""Poses of the tool along a program that turns it, and the words that command a corrected pose."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.geometry import rotation
from counterflex.path.toolpath import ToolPath
from counterflex.path.turning import TurnedPath, Turning
from counterflex.programs.compensated import programmed_motions
from counterflex.programs.program import TOOL_CENTRE, TOOL_VECTOR, Program
from counterflex.programs.rotary.machine import RotaryMachine

_Z: Final = np.array([0.0, 0.0, 1.0])
_NONE: Final = 1e-9


@dataclass(frozen=True, eq=False)
class RotaryWords:
    """Meaning of the words of a program."""

    machine: RotaryMachine | None  # Its rotary axes; None where every direction is given as I J K
    tool_centre: Bool  # (motions,) True where XYZ is the tip in the part frame
    vector: Bool  # (motions,) True where the direction is given as I J K (G43.5)

    @classmethod
    def of(cls, program: Program, machine: RotaryMachine | None) -> RotaryWords:
        """Read them from the modes of the program's blocks."""
        codes = np.array([program.blocks[motion.block].modal.tool_centre for motion in program.motions], dtype=np.int64)
        return cls(machine, codes == TOOL_CENTRE, codes == TOOL_VECTOR)

    def pose(self, p: Float, angle: Float, motion: Int) -> tuple[Float, Float]:
        """Tips (k, 3) m and tool axes (k, 3) in the part frame for programmed points, angles and their motions."""
        vector = self.vector[motion]
        unit = _unit(angle)
        if self.machine is None:
            return p.copy(), unit
        turned = np.where(vector[:, None], 0.0, angle)
        tip = np.where(vector[:, None], p, self.machine.tip(p, turned, self.tool_centre[motion]))
        return tip, np.where(vector[:, None], unit, self.machine.tool_axis(turned))

    def programmed(self, p_part_tcp: Float, axis_part: Float, near: Float, motion: Int) -> tuple[Float, Float]:
        """XYZ (k, 3) m and angles (or I J K) (k, 3) that command poses of the tool near given ones.

        Near a singular position of the rotary axes the direction is kept, see
        :meth:`~counterflex.programs.rotary.machine.RotaryMachine.turned_to`; the tip is where it is asked for.
        """
        vector = self.vector[motion]
        if self.machine is None:
            return p_part_tcp.copy(), axis_part.copy()
        near_angle = np.where(vector[:, None], 0.0, near)
        angle = near_angle.copy()
        angle[~vector] = self.machine.turned_to(axis_part[~vector], near_angle[~vector])
        p = self.machine.program_point(p_part_tcp, angle, self.tool_centre[motion])
        return np.where(vector[:, None], p_part_tcp, p), np.where(vector[:, None], axis_part, angle)


def _unit(vector: Float) -> Float:
    """Directions of length one; z where a program has not said any yet."""
    length = np.linalg.norm(vector, axis=1, keepdims=True)
    out: Float = np.where(length > _NONE, vector / np.where(length > _NONE, length, 1.0), _Z)
    return out


def turned_path(
    program: Program,
    words: RotaryWords,
    *,
    step_m: float,
    rapid_speed_m_s: float,
    chord_m: float = 5e-6,
    step_s: float = math.inf,
) -> TurnedPath:
    """Sample a program that turns the tool; see :meth:`~counterflex.path.turning.TurnedPath.sampled`.

    Args:
        program: From :func:`~counterflex.programs.rotary.fitted.fitted`.
        words: What its words mean.
        step_m: Longest step, m.
        rapid_speed_m_s: Speed assumed for rapids, m/s.
        chord_m: Allowed chord error of arcs, m.
        step_s: Longest time of a step, s.

    Returns:
        The path of the tool in the part frame, and the programmed points and angles.
    """
    start = np.array([motion.abc_start for motion in program.motions]).reshape(-1, 3)
    end = np.array([motion.abc_end for motion in program.motions]).reshape(-1, 3)
    start = np.where(words.vector[:, None], _unit(start), start)
    end = np.where(words.vector[:, None], _unit(end), end)
    feed = np.array([motion.feed_rad_s for motion in program.motions])
    turning = Turning(start, end, feed, words.pose)
    return TurnedPath.sampled(
        programmed_motions(program),
        turning,
        step_m=step_m,
        rapid_speed_m_s=rapid_speed_m_s,
        chord_m=chord_m,
        step_s=step_s,
    )


@dataclass(frozen=True, eq=False)
class CommandedWords:
    """A compensated path in the words of its program."""

    path: ToolPath  # Nominal rows, points as programmed
    p_command: Float  # (n, 3) m, XYZ to command
    angle_rad: Float  # (n, 3) nominal angles, or components of the tool axis
    # (n, 3) those to command; equal to the nominal ones bit for bit where nothing is corrected
    angle_command_rad: Float
    dropped_rad: float  # Largest correction of the direction that the words could not say

    @classmethod
    def of(cls, turned: TurnedPath, words: RotaryWords, correction_part: Float, rotvec_part: Float) -> CommandedWords:
        """Turn corrections of the pose into corrected words.

        Args:
            turned: Nominal path, n rows, in the part frame.
            words: What the program's words mean.
            correction_part: (n, 3) m, added to the tip.
            rotvec_part: (n, 3) rad, correction of the orientation in part axes; a turn about the tool axis means
                nothing.
        """
        path = turned.path
        moved = np.any(correction_part != 0.0, axis=1) | np.any(rotvec_part != 0.0, axis=1)
        axis = np.einsum("nij,nj->ni", rotation.exp(rotvec_part), path.axis_part)
        p, angle = turned.programmed.p_part_tcp.copy(), turned.angle_rad.copy()
        rows = np.flatnonzero(moved)
        dropped = 0.0
        if len(rows):
            p[rows], angle[rows] = words.programmed(
                (path.p_part_tcp + correction_part)[rows], axis[rows], turned.angle_rad[rows], path.motion[rows]
            )
            reached = words.pose(p[rows], angle[rows], path.motion[rows])[1]
            dropped = float(np.linalg.norm(reached - axis[rows], axis=1).max())
        return cls(turned.programmed, p, turned.angle_rad, angle, dropped)

"""From a program's motions to a sampled tool path."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.errors import ProgramError
from counterflex.core.units import DEG
from counterflex.path.sampling import ARC_MOTION, DWELL_MOTION, FEED_MOTION, RAPID_MOTION, MotionTable, sample
from counterflex.path.toolpath import ToolPath
from counterflex.programs.program import Program

_KIND: Final = {"rapid": RAPID_MOTION, "feed": FEED_MOTION, "arc": ARC_MOTION, "dwell": DWELL_MOTION}
_ZERO: Final = (0.0, 0.0, 0.0)


def motion_table(program: Program) -> MotionTable:
    """Return the motions of a three-axis program as columns.

    Args:
        program: As read.

    Returns:
        One row for each of ``program.motions``.

    Raises:
        ProgramError: The program turns a rotary axis: how A, B and C turn the tool in the part frame belongs to the
            machine that the program was written for and is not defined for a robot.
    """
    motions = program.motions
    for motion in motions:
        if motion.abc_end != _ZERO or motion.abc_start != _ZERO:
            block = program.blocks[motion.block]
            turned = [round(angle / DEG, 6) for angle in motion.abc_end]
            raise ProgramError(
                "the program moves a rotary axis, whose meaning for a robot is not defined",
                where=f"{program.name}:{block.line}:1",
                value=f"A B C = {turned} deg",
                limit="A B C = 0",
                hint="Post the program as three-axis milling",
            )
    n = len(motions)
    centre, normal = np.zeros((n, 3)), np.zeros((n, 3))
    for index, motion in enumerate(motions):
        if motion.p_centre is not None and motion.normal is not None:
            centre[index] = motion.p_centre
            normal[index] = motion.normal
    return MotionTable(
        kind=np.array([_KIND[motion.kind] for motion in motions], dtype=np.int64),
        p_start=np.array([motion.p_start for motion in motions], dtype=np.float64).reshape(n, 3),
        p_end=np.array([motion.p_end for motion in motions], dtype=np.float64).reshape(n, 3),
        feed_m_s=np.array([motion.feed_m_s for motion in motions], dtype=np.float64),
        spindle_rad_s=np.array([motion.spindle_rad_s for motion in motions], dtype=np.float64),
        tool=np.array([motion.tool for motion in motions], dtype=np.int64),
        duration_s=np.array([motion.duration_s for motion in motions], dtype=np.float64),
        p_centre=centre,
        normal=normal,
        turn_rad=np.array([motion.turn_rad for motion in motions], dtype=np.float64),
    )


def tool_path(
    program: Program, *, step_m: float = 1e-3, rapid_speed_m_s: float = 0.5, chord_m: float = 5e-6
) -> ToolPath:
    """Sample the motions of a three-axis program.

    Args:
        program: As read.
        step_m: Longest step of feed and arc motions, m, > 0.
        rapid_speed_m_s: Speed assumed for rapids, m/s, > 0.
        chord_m: Allowed chord error of arcs, m, > 0.

    Returns:
        The tool path; its column ``motion`` indexes ``program.motions``.

    Raises:
        ProgramError: The program turns a rotary axis.
        InputError: An argument is out of range.
    """
    return sample(motion_table(program), step_m=step_m, rapid_speed_m_s=rapid_speed_m_s, chord_m=chord_m)

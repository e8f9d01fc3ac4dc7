"""The motions of a program, to be listed: with tools, frames and machine of a cell where there is one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.app.inputs import Reading, machine_of
from counterflex.app.robot_programs import rotation_about_tool
from counterflex.core.arrays import Float
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.programs.listing import Orientations
from counterflex.programs.program import TOOL_VECTOR, Program
from counterflex.programs.robot_text.program import RobotProgram
from counterflex.programs.rotary.fitted import fitted, turns
from counterflex.programs.rotary.machine import RotaryMachine
from counterflex.programs.rotary.poses import RotaryWords

_NONE: Final = 1e-9


def listed(program: str | Path, reading: Reading, cell_file: str | Path | None = None) -> tuple[Program, Orientations]:
    """Read a program to list its motions.

    Motions to and from places that are not known (G53, G28) are kept and marked.

    Args:
        cell_file: Its tools (by name), frames, work offsets and rotary machine are used.

    Returns:
        The program, and how the tool is held at the end of each motion.
    """
    cell = None if cell_file is None else read_cell(cell_file)
    read = replace(reading, listed=True).program(program, cell)
    return read, orientations(read, cell)


def orientations(program: Program, cell: Cell | None) -> Orientations:
    """Return how the tool is held at the end of each motion."""
    count = len(program.motions)
    if isinstance(program, RobotProgram) and program.Rs_part_tcp is not None and count:
        return Orientations(-program.Rs_part_tcp[:, :, 2], rotation_about_tool(program.Rs_part_tcp))
    axes = np.tile(np.array([0.0, 0.0, 1.0]), (count, 1))
    if turns(program):
        machine = None if cell is None else machine_of(cell)
        axes = _turned(program if machine is None else fitted(program, machine), machine)
    return Orientations(axes, np.full(count, np.nan))


def _turned(program: Program, machine: RotaryMachine | None) -> Float:
    """Tool axes (motions, 3); NaN where rotary words turn the tool and no machine says how."""
    ends = np.array([motion.abc_end for motion in program.motions])
    if machine is not None:
        points = np.array([motion.p_end for motion in program.motions])
        return RotaryWords.of(program, machine).pose(points, ends, np.arange(len(ends)))[1]
    vector = np.array([program.blocks[m.block].modal.tool_centre == TOOL_VECTOR for m in program.motions])
    length = np.linalg.norm(ends, axis=1, keepdims=True)
    axes = np.where(length > _NONE, ends / np.where(length > _NONE, length, 1.0), [0.0, 0.0, 1.0])
    axes[~vector & (length[:, 0] > _NONE)] = np.nan
    return axes

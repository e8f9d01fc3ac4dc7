"""What every job starts from: the program read and sampled, and the setting the plan needs, from a cell."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.app.unknown_stiffness import require_stiffness
from counterflex.core.arrays import Int
from counterflex.core.errors import CounterflexError, ProgramError
from counterflex.core.units import MM
from counterflex.cutting.coefficients import ForceLaw
from counterflex.files.cell.cell import Cell
from counterflex.path.toolpath import ToolPath
from counterflex.plan.feed_schedule import FeedGroups
from counterflex.plan.inputs import Setting, with_settling
from counterflex.programs.compensated import tool_path
from counterflex.programs.gcode.read.parameter_file import MillingMachine, read_parameter_file
from counterflex.programs.gcode.read.reader import read_gcode_file
from counterflex.programs.limits import DIALECTS
from counterflex.programs.motion_rows import single_straight
from counterflex.programs.program import Program
from counterflex.robot.elasticity.chain import ElasticChain

_PER_MINUTE: Final = 94
"""G94: F in units per minute."""
STEP_M = 0.25 * MM
"""Longest step of a sampled path: a fraction of the distance over which the engagement changes."""


@dataclass(frozen=True, eq=False)
class Job:
    """A program, ready for work.

    Attributes:
        program: As read.
        path: As sampled, with the start made known: an axis that the program has not named yet stands where it is
            first sent to (a program begins wherever the machine is; without this it would begin at zero, in the stock).
        sampled: As sampled, axes that were not named yet at zero; for writing the program back.
        line_of_motion: (motions,) source line of each motion.
        machined: ``path`` without the stops that planning puts in: what a machine runs.
        feeds: Where the feed can be changed.
    """

    program: Program
    path: ToolPath
    sampled: ToolPath
    line_of_motion: Int
    machined: ToolPath
    feeds: FeedGroups


@dataclass(frozen=True)
class Reading:
    """How a program is read.

    Attributes:
        dialect: Of the language.
        parameters: LinuxCNC parameter file of the machine that the program was written for, or None.
        complete: Refuse a program that stops without M2, M30 or a closing ``%``.
    """

    dialect: str = DIALECTS[0]
    parameters: Path | None = None
    complete: bool = True

    def program(self, file: str | Path) -> Program:
        """Read a program.

        Raises:
            ProgramError: It cannot be read exactly.
            FileFormatError: The parameter file cannot be used.
        """
        machine = MillingMachine(known=False) if self.parameters is None else read_parameter_file(self.parameters)
        return read_gcode_file(file, dialect=self.dialect, complete=self.complete, machine=machine)


AS_IT_IS: Final = Reading()
"""A whole program that says all by itself."""


def read_job(file: str | Path, cell: Cell, *, reading: Reading = AS_IT_IS, step_m: float = STEP_M) -> Job:
    """Read a program and sample its path with the cell's rapid speed.

    Raises:
        FileFormatError: The cell file describes no milling.
        ProgramError: The program cannot be read exactly, or makes no motion.
    """
    cell.require_milling()
    program = reading.program(file)
    if len(program.motions) == 0:
        raise ProgramError("the program moves nothing", where=str(file))
    bare = tool_path(program, step_m=step_m, rapid_speed_m_s=cell.tables.controller.rapid_m_s)
    path = with_settling(bare)
    _check_tools(program, cell)
    lines = np.array([program.blocks[motion.block].line for motion in program.motions], dtype=np.int64)
    return Job(program, _start_known(program, path), path, lines, _start_known(program, bare), _feeds(program, path))


def _feeds(program: Program, path: ToolPath) -> FeedGroups:
    """An arc and a block of several motions have one feed; only F in units per minute can be changed."""
    motion, n = path.motion, len(path)
    alone = np.array([single_straight(program, k) for k in range(len(program.motions))], dtype=np.bool_)
    block = np.array([m.block for m in program.motions], dtype=np.int64)
    per_minute = np.array([program.blocks[b].modal.feed_mode == _PER_MINUTE for b in block], dtype=np.bool_)
    group: Int = np.where(alone[motion], np.arange(n), n + block[motion])
    return FeedGroups(group, ~per_minute[motion])


def _check_tools(program: Program, cell: Cell) -> None:
    known = {tool.number for tool in cell.tables.tools}
    for motion in program.motions:
        if motion.kind in ("feed", "arc") and motion.tool not in known:
            raise ProgramError(
                "the program cuts with a tool that the cell does not have" if motion.tool else "no tool is selected",
                where=f"{program.name}:{program.blocks[motion.block].line}",
                value=f"T{motion.tool}",
                limit=", ".join(f"T{number}" for number in sorted(known)),
                hint=f"Add a [[tools]] table with number = {motion.tool} to {cell.path}"
                if motion.tool
                else "Select a tool before the first cut: M6 T...",
            )


@contextlib.contextmanager
def faults_in(job: Job) -> Iterator[None]:
    """Say of faults that name a motion or a line which line of which program it is."""
    try:
        yield
    except CounterflexError as fault:
        place, name = fault.where or "", Path(job.program.name).name
        if "motion" in fault.data:
            motion = int(fault.data["motion"])
            place = f"{name}:{int(job.line_of_motion[motion])}{place.removeprefix(f'motion {motion}')}"
        elif place.startswith("line "):
            place = f"{name}:{place.removeprefix('line ')}"
        else:
            raise
        raise type(fault)(
            fault.what, where=place, value=fault.value, limit=fault.limit, hint=fault.hint, **fault.data
        ) from fault


def _start_known(program: Program, path: ToolPath) -> ToolPath:
    p = path.p_part_tcp.copy()
    for axis, letter in enumerate("XYZ"):
        for block in program.blocks:
            if block.motion_count and any(word.letter == letter for word in block.words):
                before = path.motion < block.first_motion
                before[0] = True
                p[before, axis] = program.motions[block.first_motion].p_end[axis]
                break
    return replace(path, p_part_tcp=p)


def setting_of(
    cell: Cell,
    *,
    normal_only: bool = False,
    orientation: bool = False,
    chain: ElasticChain | None = None,
    law: ForceLaw | None = None,
) -> Setting:
    """The plan's setting for a cell; ``chain`` and ``law`` replace what the cell file says about robot and force.

    Raises:
        InputError: Without ``chain``, a cell with axes of unknown stiffness.
    """
    if chain is None:
        require_stiffness(cell)
    tables = cell.tables
    return Setting(
        chain=cell.chain if chain is None else chain,
        controller_chain=cell.controller_chain,
        T_base_part=cell.T_base_part,
        datum_points_part=cell.datum_points_part if cell.part.measured_with == "robot" else None,
        branch=tables.posture.branch,
        rotation_about_tool_rad=tables.posture.rotation_about_tool_rad,
        law=cell.force_law if law is None else law,
        cutter_of=cell.cutter,
        mode=tables.dynamics.mode,
        shaping=tables.dynamics.shaping,
        limits=tables.limits.limits,
        swing_m=tables.dynamics.swing_m,
        acceleration_m_s2=tables.controller.acceleration_m_s2,
        normal_only=normal_only,
        orientation=orientation,
        allow_extrapolation=cell.material.allow_extrapolation,
        drive_errors=cell.drive_errors,
    )

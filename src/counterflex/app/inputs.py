"""Inputs of every job: the program read and sampled, and the setting that the plan needs, from a cell."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app.external_moves import changes_along, places_along, refuse_moves, turned_with_places
from counterflex.app.robot_programs import by_axes_of, held_as_programmed, robot_cell, with_spindle
from counterflex.app.unknown_stiffness import require_stiffness
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import CounterflexError, FileFormatError, ProgramError
from counterflex.core.next_command import next_command
from counterflex.core.remarks import remark
from counterflex.core.units import DEG, MM, MS
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.tilted_stock import may_touch, working_plane
from counterflex.files.cell.cell import Cell
from counterflex.files.plan_file import TOOL_TURNS, WORKING_PLANE
from counterflex.path.external_axes import AxisChange, ExternalPlaces, with_places
from counterflex.path.tool_rotation import APART_M
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.path.turning import TurnedPath
from counterflex.plan.feed_schedule import FeedGroups
from counterflex.plan.inputs import Setting, with_settling
from counterflex.programs.compensated import tool_path
from counterflex.programs.gcode.read.parameter_file import MillingMachine, read_parameter_file
from counterflex.programs.language import BY_ENDING, LANGUAGES
from counterflex.programs.motion_rows import single_straight
from counterflex.programs.program import Program
from counterflex.programs.reading import dialect_of, read_program_file
from counterflex.programs.robot_text.program import RobotProgram
from counterflex.programs.rotary.fitted import fitted, turns
from counterflex.programs.rotary.machine import RotaryMachine
from counterflex.programs.rotary.poses import RotaryWords, turned_path
from counterflex.programs.stated.two_readings import doubtful_readings
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.kinematics.joint_path import ByAxes

_PER_MINUTE: Final = 94  # G94: F in units per minute
_COARSE_M: Final = 1.0 * MM
STEP_M = 0.25 * MM
"""Longest step of a sampled path: a fraction of the distance over which the engagement changes."""
STEP_S = 10.0 * MS
"""Longest time of its steps, half of that over which corrections are shaped: where an axis turns at the end of a slow
plunge, the correction is another within hundredths of a second."""


@dataclass(frozen=True, eq=False)
class Job:
    """A program, ready for work."""

    program: Program
    # As sampled, with the start made known: an axis that the program has not named yet stands where it is first sent to
    # (a program begins wherever the machine is; without this it would begin at zero, in the stock)
    path: ToolPath
    sampled: ToolPath  # As sampled, axes that were not named yet at zero; for writing the program back
    line_of_motion: Int  # (motions,) source line of each motion
    machined: ToolPath  # ``path`` without the stops that planning puts in: what a machine runs
    feeds: FeedGroups  # Where the feed can be changed
    # Of a program that turns the tool, ``path`` in the part frame and the words at its rows
    turned: TurnedPath | None = None
    words: RotaryWords | None = None  # What those words mean; None where the tool stays along z
    changes: tuple[AxisChange, ...] = ()  # Where external axes go to another place
    places: ExternalPlaces | None = None  # Their places; None where they stand in one

    def _check_tool_rotation(self, cell: Cell) -> None:
        """Refuse a rotation along the program that was chosen for another one."""
        rotation = cell.tables.posture.turning
        if rotation is None:
            return
        apart_m, place_m = rotation.distance(self.path.p_part_tcp)
        if apart_m > APART_M:
            raise FileFormatError(
                "turning_mm_deg turns the tool along another program than this one",
                where=f"{cell.path}: posture",
                value=f"{Path(self.program.name).name} is {apart_m / MM:.0f} mm away from where it was expected after "
                f"{place_m / MM:.0f} mm",
                limit=f"{APART_M / MM:g} mm",
                hint="Take turning_mm_deg and turning_at_mm out and choose a posture for this program: "
                + next_command("plan posture", self.program.name, cell=cell.path, turning=30, out="DIR"),
            )


@dataclass(frozen=True)
class Reading:
    """Settings by which a program is read."""

    dialect: str = BY_ENDING  # Language, one of :func:`~counterflex.programs.language.dialects`
    parameters: Path | None = None  # LinuxCNC parameter file of the machine that the program was written for, or None
    complete: bool = True  # Refuse a program that stops without M2, M30 or a closing ``%``
    listed: bool = False  # Keep motions to and from places that are not known, marked: for a list of the motions

    def program(self, file: str | Path, cell: Cell | None = None) -> Program:
        """Read a program, and remark every word of it that has a second reading.

        Args:
            cell: That frames and process words of a robot program are held against.

        Raises:
            ProgramError: It cannot be read exactly.
        """
        program = self._read(file, cell)
        for sentence in doubtful_readings(program):
            remark(sentence)
        return program

    def _read(self, file: str | Path, cell: Cell | None) -> Program:
        language = dialect_of(file, self.dialect)
        if cell is not None and LANGUAGES[language].robot:
            program = read_program_file(file, dialect=language, complete=self.complete, cell=robot_cell(cell, language))
            return with_spindle(program, cell) if isinstance(program, RobotProgram) else program
        machine = MillingMachine(known=False) if self.parameters is None else read_parameter_file(self.parameters)
        if cell is not None:
            machine = replace(machine, tool_names=cell.tool_names, part_offsets=cell.work_offsets)
            if self.parameters is not None and cell.work_offsets:
                raise FileFormatError(
                    "work offsets are given twice", where=f"{cell.path}: part.work_offsets_mm",
                    value=str(self.parameters), hint="Leave one of them out",
                )  # fmt: skip
        machine = replace(machine, listed=self.listed)
        program = read_program_file(file, dialect=self.dialect, complete=self.complete, machine=machine)
        return program if cell is None or not LANGUAGES[language].tool_stays else with_only_tool(program, cell)


def with_only_tool(program: Program, cell: Cell) -> Program:
    """Return the program with the only tool of the cell, where it names none at all.

    On these controls the tool that was active before the program stays so: a part program without T is run with the
    tool that the operator mounted. With several tools in the cell, or a T anywhere, nothing is taken.
    """
    tools = cell.tables.tools
    if len(tools) != 1 or any(motion.tool for motion in program.motions):
        return program
    number = tools[0].number
    motions = tuple(replace(motion, tool=number) for motion in program.motions)
    return replace(program, motions=motions, tool_taken=number)


AS_IT_IS: Final[Reading] = Reading()
"""A whole program that says all by itself."""


def read_job(
    file: str | Path, cell: Cell, *, reading: Reading = AS_IT_IS, step_m: float = STEP_M, may_move: bool = False
) -> Job:
    """Read a program and sample its path with the cell's rapid speed.

    Raises:
        InputError: External axes move between its operations, and ``may_move`` does not let them.
        FileFormatError: The cell file describes no milling, or turns the tool along another program.
        ProgramError: The program cannot be read exactly, or makes no motion.
    """
    cell.require_milling()
    return _job_of(reading.program(file, cell), file, cell, step_m, may_move)


def read_in_plane(
    file: str | Path, cell: Cell, *, reading: Reading = AS_IT_IS, step_s: float = STEP_S, may_move: bool = False
) -> tuple[Cell, Job]:
    """Read a program once, for :func:`in_working_plane` and :func:`read_job`; their results, and their errors."""
    cell.require_milling()
    program = reading.program(file, cell)
    held = held_as_programmed(program, _in_plane_of(program, cell))
    if held is not cell and isinstance(program, RobotProgram):  # it is read against the frames of the cell
        program = reading.program(file, held)
    return held, _job_of(program, file, held, STEP_M, may_move, step_s)


def _job_of(
    program: Program, file: str | Path, cell: Cell, step_m: float, may_move: bool, step_s: float = STEP_S
) -> Job:
    """The job of a program that was read."""
    if len(program.motions) == 0:
        what = "the program moves nothing"
        if isinstance(program, RobotProgram):
            what += " along a path: it has no Cartesian target, places by axes alone are none"
        raise ProgramError(what, where=str(file))
    job = (_turned_job if turns(program) else _job)(program, cell, step_m, step_s)
    job._check_tool_rotation(cell)
    if not may_move:
        refuse_moves(job.places, str(file))
    return job


def _job(program: Program, cell: Cell, step_m: float, step_s: float) -> Job:
    """The job of a program whose tool stays along z."""
    rapid_m_s = cell.tables.controller.rapid_m_s
    bare = tool_path(program, step_m=step_m, step_s=step_s, rapid_speed_m_s=rapid_m_s)
    changes = changes_along(program, _start_known(program, bare), cell)
    places = places_along(changes, cell)
    bare = bare if places is None else with_places(bare, changes, places, rapid_m_s)
    path = with_settling(bare)
    _check_tools(program, cell)
    lines = np.array([program.blocks[motion.block].line for motion in program.motions], dtype=np.int64)
    return Job(
        program, _start_known(program, path), path, lines, _start_known(program, bare), _feeds(program, path),
        changes=changes, places=places,
    )  # fmt: skip


def _turned_job(program: Program, cell: Cell, step_m: float, step_s: float) -> Job:
    """The job of a program that turns the tool; its path is given in the working plane of the cell."""
    program = fitted(program, machine_of(cell))
    words = RotaryWords.of(program, machine_of(cell))
    rapid_m_s = cell.tables.controller.rapid_m_s
    turned = turned_path(program, words, step_m=step_m, step_s=step_s, rapid_speed_m_s=rapid_m_s)
    R_part_plane = np.eye(3) if cell.R_part_plane is None else cell.R_part_plane
    changes = changes_along(program, turned_by(turned.path, R_part_plane.T), cell)
    places = places_along(changes, cell)
    if places is not None:
        turned = turned_with_places(turned, changes, places, rapid_m_s)
    bare = turned_by(turned.path, R_part_plane.T)
    path = with_settling(bare)
    _check_tools(program, cell)
    _check_direction(program, path, cell)
    angle_rad = with_settling(replace(turned.path, p_part_tcp=turned.angle_rad)).p_part_tcp
    rows = TurnedPath(turned_by(path, R_part_plane), with_settling(turned.programmed), angle_rad)
    lines = np.array([program.blocks[motion.block].line for motion in program.motions], dtype=np.int64)
    return Job(program, path, path, lines, bare, _feeds(program, path), rows, words, changes, places)


def machine_of(cell: Cell) -> RotaryMachine | None:
    """Rotary axes that the programs of a cell were written for, or None."""
    return None if cell.tables.machine is None else cell.tables.machine.machine()


def turned_by(path: ToolPath, R: Float) -> ToolPath:
    """A path in other axes: points and tool axes times ``R``."""
    return replace(path, p_part_tcp=path.p_part_tcp @ R.T, axis_part=path.axis_part @ R.T)


def _check_direction(program: Program, path: ToolPath, cell: Cell) -> None:
    """Refuse feeds with the tool elsewhere than along z of the working plane."""
    if cell.tool_turns:
        return
    tolerance_rad = cell.tables.limits.limits.rotation_rad
    tilted = np.flatnonzero((path.kind == FEED) & (path.axis_part[:, 2] < np.cos(tolerance_rad)))
    if cell.R_part_plane is None and len(tilted):
        raise ProgramError(
            "the tool is tilted, and this command takes programs with the tool along z of the part only",
            where=program.blocks[program.motions[path.motion[tilted[0]]].block].where(program.name),
            hint="compensate, simulate, evaluate, prove, preflight and plan take tilted cuts (docs/programs.md)",
        )
    tilt = np.where(path.kind == FEED, np.arccos(np.clip(path.axis_part[:, 2], -1.0, 1.0)), 0.0)
    for number in np.unique(path.tool[tilt > tolerance_rad]):
        rows = np.flatnonzero((tilt > tolerance_rad) & (path.tool == number))
        cuts = may_touch(cell.stock(), path.p_part_tcp[rows], path.axis_part[rows], cell.cutter(int(number)))
        tilt[rows[~cuts]] = 0.0  # in the air the tool may turn
    row = int(np.argmax(tilt > tolerance_rad))
    if tilt[row] > tolerance_rad:
        raise ProgramError(
            "the tool cuts in another direction than in the original program",
            where=program.blocks[program.motions[path.motion[row]].block].where(program.name),
            value=f"{tilt.max() / DEG:.3g} deg from it",
            limit=f"<= {tolerance_rad / DEG:g} deg (limits.correction_deg)",
            hint="Give the original that the program was compensated from",
        )


def in_working_plane(program: str | Path, cell: Cell, reading: Reading = AS_IT_IS) -> Cell:
    """The cell with its part seen along the tool, for a program that cuts with a tilted one (3+2 axes).

    The direction is that of the first feed that may touch the blank, of the first feed if none does. Programs that do
    not turn the tool leave the cell as it is. One that cuts in several directions, or turns the tool while it may touch
    the blank, leaves the part in its own axes, with :attr:`~counterflex.files.cell.cell.Cell.tool_turns`.

    Args:
        program: G-code file; of a compensated program its original, whose direction is exact.

    Raises:
        ProgramError: The program cannot be read, or its words do not fit the machine.
    """
    read = reading.program(program, cell)
    return held_as_programmed(read, _in_plane_of(read, cell))


def _in_plane_of(read: Program, cell: Cell) -> Cell:
    """The cell with its part seen along the tool of a program."""
    if not turns(read):
        return cell
    known = fitted(read, machine_of(cell))
    words = RotaryWords.of(known, machine_of(cell))
    path = turned_path(known, words, step_m=_COARSE_M, rapid_speed_m_s=cell.tables.controller.rapid_m_s).path
    fed = np.flatnonzero(path.kind == FEED)
    if len(fed) == 0:
        return cell
    stock, cuts = cell.stock(), np.zeros(len(fed), dtype=np.bool_)
    for tool in cell.tables.tools:
        rows = path.tool[fed] == tool.number
        at = fed[rows]
        cuts[rows] = may_touch(stock, path.p_part_tcp[at], path.axis_part[at], cell.cutter(tool.number))
    axes = path.axis_part[fed]
    first = axes[int(np.argmax(cuts))]
    if np.any(axes[cuts] @ first < np.cos(cell.tables.limits.limits.rotation_rad)):
        return cell.with_turning_tool()
    return cell.in_plane(working_plane(first))


def in_plane_of(cell: Cell) -> dict[str, Any]:
    """Return facts of a tilted tool for summaries and plans: axes of the working plane as columns, or that it turns."""
    if cell.tool_turns:
        return {TOOL_TURNS: True}
    return {} if cell.R_part_plane is None else {WORKING_PLANE: np.round(cell.R_part_plane, 9).tolist()}


def _feeds(program: Program, path: ToolPath) -> FeedGroups:
    """An arc and a block of several motions have one feed; only F in units per minute can be changed."""
    motion, n = path.motion, len(path)
    alone = np.array([single_straight(program, k) for k in range(len(program.motions))], dtype=np.bool_)
    block = np.array([m.block for m in program.motions], dtype=np.int64)
    per_minute = np.array([program.blocks[b].modal.feed_mode == _PER_MINUTE for b in block], dtype=np.bool_)
    group: Int = np.where(alone[motion], np.arange(n), n + block[motion])
    return FeedGroups(group, ~per_minute[motion])


def _check_tools(program: Program, cell: Cell) -> None:
    known, forms = {tool.number for tool in cell.tables.tools}, LANGUAGES[program.dialect].forms
    for motion in program.motions:
        if motion.kind in ("feed", "arc") and motion.tool not in known:
            raise ProgramError(
                "the program cuts with a tool that the cell does not have" if motion.tool else "no tool is selected",
                where=program.blocks[motion.block].where(program.name),
                value=f"T{motion.tool}",
                limit=", ".join(f"T{number}" for number in sorted(known)),
                hint=f"Add a [[tools]] table with number = {motion.tool} to {cell.path}"
                if motion.tool
                else f"Say which tool it is: tools.{forms.data_key}, or a statement of tool_change in "
                f"[controller.spindle.{program.dialect}]"
                if forms is not None
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
            block = job.program.blocks[job.program.motions[motion].block]
            place = f"{block.where(name)}{place.removeprefix(f'motion {motion}')}"
        elif (line := re.match(r"line (\d+)", place)) is not None:
            named = job.program.place(int(line[1]))
            place = f"{named if ':' in named else f'{name}:{line[1]}'}{place[line.end() :]}"
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
    job: Job | None = None,
    *,
    normal_only: bool = False,
    orientation: bool = False,
    chain: ElasticChain | None = None,
    law: ForceLaw | None = None,
    part_may_be_held: bool = False,
) -> Setting:
    """The plan's setting for a cell; ``chain`` and ``law`` replace what the cell file says about robot and force.

    Drives, friction and play that the file does not give are those of the robot's class (``Cell.planning_chain``).

    A ``job`` says which motions the controller makes by axes, and where external axes go.

    Raises:
        InputError: Without ``chain``, a cell with axes of unknown stiffness; without ``part_may_be_held``, a robot that
            holds the part.
    """
    if chain is None:
        require_stiffness(cell)
    tables = cell.tables
    return Setting(
        chain=cell.planning_chain if chain is None else chain,
        controller_chain=cell.controller_chain,
        T_base_part=np.eye(4) if part_may_be_held and cell.holds_part else cell.T_base_part,
        T_base_tcp=cell.T_base_tcp,
        datum_points_part=cell.datum_points_part if cell.part.measured_with == "robot" else None,
        branch=tables.posture.branch,
        rotation_about_tool_rad=tables.posture.rotation_about_tool_rad,
        turning=tables.posture.turning,
        law=cell.force_law if law is None else law,
        cutter_of=cell.cutter,
        mode=tables.dynamics.mode,
        shaping=tables.dynamics.shaping,
        limits=tables.limits.limits,
        swing_m=tables.dynamics.swing_m,
        acceleration_m_s2=tables.controller.acceleration_m_s2,
        blending_m=tables.controller.blending_m,
        normal_only=normal_only,
        orientation=orientation,
        allow_extrapolation=cell.material.allow_extrapolation,
        drive_errors=cell.drive_errors,
        damping=tables.dynamics.damping,
        by_axes=ByAxes() if job is None else by_axes_of(job.program, cell),
        places=None if job is None else job.places,
    )

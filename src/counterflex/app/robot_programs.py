"""Programs that are written for the robot itself: what the cell says of them, and how they hold the tool."""

from __future__ import annotations

import datetime
import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app.robot_axes import axes_in, part_in_world, tcp_of_axes
from counterflex.core import file_content
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ProgramError
from counterflex.core.units import DEG, MM, RPM
from counterflex.files.cell.cell import Cell
from counterflex.geometry import pose
from counterflex.path.toolpath import tool_orientation
from counterflex.programs.language import LANGUAGES, object_at
from counterflex.programs.program import Program
from counterflex.programs.reading import RobotCell
from counterflex.programs.robot_text.program import TURNING, RobotProgram
from counterflex.robot.kinematics.joint_path import ByAxes, Turns

_LINES: Final = re.compile(r"\b(?:in )?lines? (\d+(?:(?:, | and | to )\d+)*)(?![\d.])")


def with_files(data: Any, program: Program) -> Any:
    """Return a result with the files of its lines; unchanged where all motions stand in one file.

    Args:
        data: Plain values. A row with a whole number as ``line`` gets ``place`` (``cut.src:8``), ``lines`` get
            ``places``, and ``line 8`` in a sentence becomes the place.
    """
    if not any(program.blocks[motion.block].file for motion in program.motions):
        return data
    return _named(data, program)


def _named(data: Any, program: Program) -> Any:
    if isinstance(data, str):
        return _LINES.sub(lambda match: _places(match[0], match[1], program), data)
    if isinstance(data, list | tuple):
        return type(data)(_named(item, program) for item in data)
    if not isinstance(data, dict):
        return data
    out = {key: _named(value, program) for key, value in data.items()}
    line, lines = data.get("line"), data.get("lines")
    if isinstance(line, int):
        out.setdefault("place", program.place(line))
    if isinstance(lines, list) and all(isinstance(item, int) for item in lines):
        out.setdefault("places", [program.place(item) for item in lines])
    return out


def _places(text: str, numbers: str, program: Program) -> str:
    begin = "in " if text.startswith("in ") else ""
    return begin + re.sub(r"\d+", lambda number: program.place(int(number[0])), numbers)


_SAME_DEG: Final = 0.01
_APART_M: Final = 1e-6


def companions(file: Path) -> tuple[Path, ...]:
    """Return the files that are read with a program: those of its job."""
    ending = file.suffix.lower()
    place = next((one.files for _, one in LANGUAGES.items() if ending in one.endings and one.files is not None), None)
    files: tuple[Path, ...] = () if place is None else object_at(place)(file)
    return files


def digest(program: str | Path) -> str:
    """SHA-256 of a program, with the files that are read with it."""
    files = sorted({Path(program), *companions(Path(program))})
    return hashlib.sha256(b"".join(file_content.content(file) for file in files)).hexdigest()


def inputs_of(program: str | Path, cell_file: str | Path) -> dict[str, str]:
    """Return what a job begins with, for its summary: digests of program and cell file, and the time (UTC)."""
    begun = datetime.datetime.now(tz=datetime.UTC).isoformat(timespec="milliseconds")
    return {"program_sha256": digest(program), "cell_sha256": digest(cell_file), "begun": begun}


def with_spindle(program: RobotProgram, cell: Cell) -> RobotProgram:
    """The program with the spindle turning as ``tools.spindle_rpm`` of the cell says, where it says nothing itself.

    Robots' programs are often posted without spindle statements: a person or the line controller starts the spindle.
    A program that turns the spindle on anywhere is returned as it is.
    """
    if any(motion.spindle_rad_s for motion in program.motions):
        return program
    speeds = {tool.number: tool.spindle_rpm * RPM for tool in cell.tables.tools if tool.spindle_rpm is not None}
    if not speeds:
        return program
    motions = tuple(replace(motion, spindle_rad_s=speeds.get(motion.tool, 0.0)) for motion in program.motions)
    return replace(program, motions=motions)


def robot_cell(cell: Cell, dialect: str) -> RobotCell:
    """Return what a robot program in a language is held against.

    Args:
        dialect: One of :func:`~counterflex.programs.language.robot_dialects`.

    Raises:
        InputError: Programs of the language are not read for a robot that holds the part, and it does.
    """
    against: RobotCell = object_at(LANGUAGES[dialect].cell)(cell)
    return against


def refuse_held_part(cell: Cell, language: str) -> None:
    """Refuse a cell whose robot holds the part, for a language that is not read and written for such.

    Raises:
        InputError: It does.
    """
    if cell.holds_part:
        raise InputError(
            f"{language} programs of a robot that holds the part are not read",
            where=str(cell.path),
            value='part_on = "flange"',
            limit='part_on = "table"',
            hint="Give the G-code that it was made from",
        )


def shared_facts(cell: Cell, language: str) -> dict[str, Any]:
    """Return what every language needs of a cell, see :class:`~counterflex.programs.robot_text.cell.RobotTextCell`."""
    return {
        "where": str(cell.path),
        "tools": [tool.number for tool in cell.tables.tools],
        "T_flange_tcp": cell.controller_chain.T_flange_tcp,
        "T_base_part": part_in_world(replace(cell, R_part_plane=None), language),
        "functions": cell.machine_functions(language),
        "external_axes": {int(axis.name[1:]): axis.shown for axis in cell.tables.external_axes},
        "tip_of_axes": None
        if cell.holds_part
        else lambda axes_deg, external: _tip_of_axes(cell, language, axes_deg, external),
    }


def numbered_facts(cell: Cell, dialect: str, language: str) -> dict[str, Any]:
    """The same of a language that names tools and frames by numbers, see ``NumberedCell`` there.

    Raises:
        InputError: The robot holds the part: such programs are not read.
    """
    refuse_held_part(cell, language)
    controller, tools = cell.tables.controller, cell.tables.tools
    return {
        **shared_facts(cell, dialect),
        "tool_number": controller.tool_number,
        "base_number": controller.base_number,
        "tool_of_data": {tool.tool_data: tool.number for tool in tools if tool.tool_data is not None},
    }


def _tip_of_axes(cell: Cell, language: str, axes_deg: Sequence[float], external: Mapping[int, float]) -> Float:
    """Return (4, 4) m, the TCP frame in the part frame where the controller shows these axes, external ones too."""
    T_base_tcp = tcp_of_axes(cell, language, np.asarray(axes_deg, dtype=np.float64) * DEG)
    there = replace(cell if not external else cell.at_external(external), R_part_plane=None)
    out: Float = pose.inverse(there.T_base_part) @ T_base_tcp
    return out


def by_axes_of(program: Program, cell: Cell) -> ByAxes:
    """Motions that the controller makes by axes, with the axes or turns that the program states at their ends.

    Args:
        program: As read; others than programs of robots have none.
    """
    if not isinstance(program, RobotProgram):
        return ByAxes()
    stated = {}
    if program.axes_deg:
        axes, _ = axes_in(cell, program.dialect)
        stated = {motion: axes.model(np.asarray(values) * DEG) for motion, values in program.axes_deg.items()}
    return ByAxes(program.by_axes, stated, _turns_of(program, cell))


def _turns_of(program: RobotProgram, cell: Cell) -> dict[int, Turns]:
    """Turns that the program states at its start and the ends of its motions by axes.

    None where no one says how axes are counted.
    """
    given = {motion: one for motion, one in program.turns().items() if motion == 0 or motion in program.by_axes}
    if not given:
        return {}
    try:
        axes, _ = axes_in(cell, program.dialect)
    except InputError:
        return {}
    return {
        motion: Turns(axes, TURNING, np.array(one.low_deg) * DEG, np.array(one.high_deg) * DEG, one.words)
        for motion, one in given.items()
    }


def held_as_programmed(program: Program, cell: Cell) -> Cell:
    """The cell with the rotation about the tool axis that a robot program states; others leave it as it is.

    Args:
        cell: With its working plane, if it has one.

    Raises:
        ProgramError: The program turns the tool about its axis in one place.
    """
    if not isinstance(program, RobotProgram) or program.Rs_part_tcp is None or not len(program.motions):
        return cell
    R = program.Rs_part_tcp
    R = R if cell.R_part_plane is None else cell.R_part_plane.T @ R
    angle = np.unwrap(rotation_about_tool(R)) / DEG
    angle -= 360.0 * np.round(angle[0] / 360.0)
    posture = cell.tables.posture
    if float(np.ptp(angle)) <= _SAME_DEG:
        change = {"rotation_about_tool_deg": float(angle[0]), "turning_mm_deg": (), "turning_at_mm": ()}
    else:
        change = _turning(program, cell, angle)
    tables = cell.tables.model_copy(update={"posture": posture.model_copy(update=change)})
    return replace(cell, tables=tables)


def rotation_about_tool(Rs_part_tcp: Float) -> Float:
    """Free angle (n,) rad of orientations (n, 3, 3), see :func:`counterflex.path.toolpath.tool_orientation`."""
    zero = tool_orientation(-Rs_part_tcp[:, :, 2], 0.0)
    x0, x = zero[:, :, 0], Rs_part_tcp[:, :, 0]
    y0 = np.cross(-Rs_part_tcp[:, :, 2], x0)
    out: Float = np.arctan2(np.sum(x * y0, axis=1), np.sum(x * x0, axis=1))
    return out


def _turning(program: RobotProgram, cell: Cell, angle_deg: Float) -> dict[str, object]:
    """Tables of a rotation that changes along the program, linear between the targets."""
    ends = np.array([motion.p_end for motion in program.motions])
    way = np.cumsum(np.linalg.norm(np.diff(ends, axis=0, prepend=ends[:1]), axis=1))
    same = np.diff(way) <= _APART_M
    jumps = np.flatnonzero(same & (np.abs(np.diff(angle_deg)) > _SAME_DEG))
    if len(jumps):
        motion = program.motions[int(jumps[0]) + 1]
        raise ProgramError(
            "the tool turns about its own axis in one place, which is not planned",
            where=program.blocks[motion.block].where(program.name),
            value=f"{np.diff(angle_deg)[jumps[0]]:.3g} deg",
            hint="Turn it along a motion, or hold it as it is",
        )
    stays = np.concatenate([[True], ~same])
    if any(motion.kind == "arc" for motion in program.motions):
        raise ProgramError(
            "the tool turns about its own axis in a program with circles, which is not planned",
            where=program.name,
            hint="Hold the rotation about the tool axis, or post straight moves",
        )
    points = ends if cell.R_part_plane is None else ends @ cell.R_part_plane
    return {
        "rotation_about_tool_deg": float(angle_deg[0]),
        "turning_mm_deg": tuple((float(w / MM), float(a)) for w, a in zip(way[stays], angle_deg[stays], strict=True)),
        "turning_at_mm": tuple((float(x / MM), float(y / MM), float(z / MM)) for x, y, z in points[stays]),
    }

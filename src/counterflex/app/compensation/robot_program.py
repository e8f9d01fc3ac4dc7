"""Checks and words of a robot beside the path, for jobs that write a language of robots."""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from typing import Final

from counterflex.app.inputs import Job, faults_in
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell
from counterflex.programs.gcode.read.motion import UNKNOWN_PLACE
from counterflex.programs.language import StatementForms
from counterflex.programs.limits import RESERVED
from counterflex.programs.program import Program, has_g
from counterflex.programs.robot_text.program import RobotProgram
from counterflex.programs.robot_writer.spaced_points import implied_stops
from counterflex.programs.robot_writer.writer import changes_tool

_HOMING: Final = frozenset((28.0, 30.0, 53.0))
_NAME_CHARACTERS: Final = 20
_SHOWN: Final = 4
_SAME_PLACE_M: Final = 1e-7


def check_machine(job: Job, cell: Cell, language: str) -> None:
    """Refuse, before anything is planned, a program whose spindle, coolant or tools the robot cannot be told.

    Raises:
        ProgramError: An M-code or a tool frame that the cell file does not map; names line and key.
    """
    refuse_unmapped(job.program, cell)
    functions = cell.machine_functions(language)
    with faults_in(job):
        functions.check((*job.program.blocks, *implied_stops(job.program).all()))
    tool_data(job.program, cell, language)
    refuse_change_in_cut(job.program, cell)
    refuse_other_height(job.program)
    omissions(job.program)


def refuse_unmapped(program: Program, cell: Cell) -> None:
    """Refuse a robot program with statements that another language would lose: outputs, waits for inputs, TRIGGER.

    Raises:
        ProgramError: There is one.
    """
    if isinstance(program, RobotProgram) and program.acting:
        line = program.acting[0]
        raise ProgramError(
            "this acts on the cell, and the cell file does not say what it is in another language",
            where=f"{Path(program.name).name}:{line}",
            value=program.lines[line - 1].strip()[:60],
            limit=f"statements of [controller.spindle.{program.dialect}] in {cell.path}",
            hint=f"Give it an M-code there (m_codes); {len(program.acting)} lines in all. In its own language it stays",
        )


def refuse_change_in_cut(program: Program, cell: Cell) -> None:
    """Refuse a tool change where the tool stands below the top of the blank.

    M6 takes the spindle of a milling machine to where tools are changed; a robot stands where it is, and goes back
    there with the next tool.

    Raises:
        ProgramError: The last motion before a change is a cut that ends there.
    """
    top_m = float(cell.stock().z.max())
    for block in program.blocks:
        if not changes_tool(block) or block.first_motion == 0:
            continue
        last = program.motions[block.first_motion - 1]
        if last.kind != "rapid" and last.p_end[2] < top_m:
            raise ProgramError(
                "the tool is changed in the cut: M6 takes a milling machine out of it, a robot stays",
                where=block.where(Path(program.name).name), value=f"Z {last.p_end[2] / MM:g} mm",
                limit=f"above the blank, Z {top_m / MM:g} mm", hint="Retract with G0 first",
            )  # fmt: skip


def refuse_other_height(program: Program) -> None:
    """Refuse a cut from another place than the tool stands at, because the program changed its length (G43.1, G49).

    A milling machine stays where it is then, and its coordinates become others; a robot would go to them.

    Raises:
        ProgramError: The motion behind such a change is none that leads to a place of its own along that axis.
    """
    motions = program.motions
    for before, motion in itertools.pairwise(motions):
        if program.blocks[motion.block].modal.tool_centre != program.blocks[before.block].modal.tool_centre:
            continue  # other coordinates of the same place
        jump = motion.p_start - before.p_end
        axis = int(abs(jump).argmax())
        if abs(jump[axis]) <= _SAME_PLACE_M:
            continue
        block = program.blocks[motion.block]
        named = any(word.letter == "XYZ"[axis] for word in block.words)
        if motion.kind != "rapid" or not named or not block.modal.absolute:
            raise ProgramError(
                f"the tool length was changed by {abs(jump[axis]) / MM:g} mm before this: the robot would move by it",
                where=block.where(Path(program.name).name),
                value=block.text.strip()[:40],
                limit=f"G0 with {'XYZ'[axis]} first",
                hint="Change the length above the part and go to a height of its own, or leave G43.1 and G49 out",
            )


def omissions(program: Program) -> list[str]:
    """Return what another program leaves out of one, in words.

    Places of the milling machine (G28, G30, G53), and motions by axes around the path of a robot program.

    Raises:
        ProgramError: That was the way out of the cut: the robot would stay there.
    """
    return [*_homing(program), *_by_axes(program)]


def _by_axes(program: Program) -> list[str]:
    places = program.left_out if isinstance(program, RobotProgram) else ()
    if not places:
        return []
    shown = ", ".join(places[:_SHOWN]) + (f" and {len(places) - _SHOWN} more" if len(places) > _SHOWN else "")
    return [f"motions by axes before the path or behind it stay in the program that was read: {shown}"]


def _homing(program: Program) -> list[str]:
    """Return the words that lead to places of the milling machine."""
    places: dict[str, list[str]] = {}
    for block in program.blocks:
        codes = {word.value for word in block.words if word.letter == "G"} & _HOMING
        if not codes or block.motion_count or block.first_motion == 0:
            continue
        name, place = f"G{min(codes):g}", block.where(Path(program.name).name)
        if program.motions[block.first_motion - 1].kind != "rapid":
            raise ProgramError(
                f"{name} is the way out of the cut, and where it leads is not known: the robot would stay in the cut",
                where=place, value=block.text.strip()[:40], hint=f"Retract with G0 first. {UNKNOWN_PLACE}",
            )  # fmt: skip
        places.setdefault(str(block.line), []).append(name)
    if not places:
        return []
    names = sorted({name for codes_of in places.values() for name in codes_of}, key=lambda name: float(name[1:]))
    clause = f"in line {', '.join(places)} leads" if len(places) == 1 else f"in lines {', '.join(places)} lead"
    return [f"{', '.join(names)} {clause} to places of the milling machine: the robot stays where it is"]


def other_lengths(program: Program) -> list[str]:
    """Return where G43 names another tool's length than that of the tool in the spindle, in words."""
    lengths = {}
    for block in program.blocks:
        if not has_g(block.words, 43.0):
            continue
        h = next((int(word.value) for word in block.words if word.letter == "H"), 0)
        if h not in (0, block.modal.tool):
            lengths[h, block.modal.tool] = (
                f"G43 H{h} in line {block.line} names another length than that of T{block.modal.tool}: "
                f"the robot takes the frame of T{block.modal.tool}"
            )
    return list(lengths.values())


def tool_data(program: Program, cell: Cell, language: str) -> dict[int, str]:
    """Return what the controller calls the tool frame, for each tool that the program uses.

    Empty where it uses one tool that has no name of its own: that one is ``controller.tool_number`` (KRL), or the
    program brings its tooldata (RAPID).

    Raises:
        ProgramError: The program changes tools, and one of them is not named: it would run with another one's length.
    """
    named = cell.machine_functions(language).tool_data
    used: dict[int, int] = {}
    for motion in program.motions:
        if motion.tool:
            used.setdefault(motion.tool, motion.block)
    unnamed = [tool for tool in used if tool not in named]
    if unnamed and len(used) > 1:
        key, tools = StatementForms.of(language).data_key, ", ".join(f"T{tool}" for tool in unnamed)
        raise ProgramError(
            "the program changes tools, and the cell file does not say which frame "
            + ("one of them has" if len(unnamed) == 1 else f"{len(unnamed)} of them have"),
            where=program.blocks[used[unnamed[0]]].where(Path(program.name).name),
            value=tools,
            limit=f"tools.{key} of {tools} in {cell.path}",
            hint="Give every tool of the program its own: the controller compensates its length",
        )
    return {tool: named[tool] for tool in used if tool in named}


def routine_name(stem: str) -> str:
    """A file name as a routine name: letters, digits and underscores, 20 at most, a letter first, no reserved word."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", stem)[:_NAME_CHARACTERS]
    own = name[:1].isalpha() and name.upper() not in RESERVED
    return name if own else f"p_{name}"[:_NAME_CHARACTERS]

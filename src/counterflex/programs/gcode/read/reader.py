"""Read RS274/NGC programs as LinuxCNC does, strictly."""

from __future__ import annotations

import functools
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from counterflex.core.errors import InputError, ProgramError
from counterflex.programs.foreign_language import foreign_language
from counterflex.programs.gcode.read.flow import GcodeSource, line_end, split_lines
from counterflex.programs.gcode.read.interpreter import Interpreter
from counterflex.programs.gcode.read.jumps import Include
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.state import ModalState
from counterflex.programs.gcode.read.work_offsets import WorkOffsets
from counterflex.programs.program import Block, Motion, Program
from counterflex.programs.source_text import read_text

Point = tuple[float, float, float]
FURTHER_OFFSET: Final = re.compile(r"\bG(54\.1|154)\s*P|\bG54\s*P", re.IGNORECASE)
"""A further work offset of Fanuc or Haas, so that L20 of G10 is that of Fanuc."""
FANUC: Final = re.compile(
    r"^\s*(?:N\d+\s*)?[O:]\d{1,8}\b(?!\s*(?:sub|call|if|while|do|repeat|end\w*|else\w*|break|continue|return)\b)"
    r"|\bM9[789]\b|\bG(?:65|66|54\.1|154|0?5\.1|1[12]\d|187)\b|\b(?:IF|WHILE)\s*\[.*\]\s*(?:GOTO|THEN|DO)",
    re.IGNORECASE,
)
"""Number or code of a program that was written for Fanuc or Haas, in a line without its comments."""
COMMENT: Final = re.compile(r"\([^()]*\)|;.*")
_HERE: Final[Point] = (0.0, 0.0, 0.0)
COORDINATES_OF_THE_PART: Final = MillingMachine()
"""A machine whose coordinates are those of the part, with nothing else known."""


def read_gcode(
    text: str,
    *,
    name: str = "program",
    machine: MillingMachine = COORDINATES_OF_THE_PART,
    step_limit: int = 2_000_000,
    includes: Include | None = None,
    block_delete: bool = False,
    complete: bool = False,
    plain_lines: bool = True,
) -> Program:
    """Execute a program's text and return the blocks passed and the motions made.

    Positions are of the tool tip in the part frame: ``p_part = work_offset + g92 + value``, with the tool length offset
    taken out. With the default offsets of zero the zero of G54 is the zero of the part.

    Args:
        machine: What is known of the machine that the program was written for.
        step_limit: Largest number of lines executed.
        includes: Given the name of a subroutine that the text does not define, returns name and text of its file or
            None.
        block_delete: Skip lines that begin with a slash, as with the operator's switch on.
        complete: Refuse a text that stops without M2, M30 or a closing ``%``, as LinuxCNC does: it may have been
            cut off.
        plain_lines: Read plain lines the short way; False gives the same program more slowly.

    Raises:
        ProgramError: With ``name:line:column``, at the first thing that is unknown, contradictory, unsafe or endless.
        InputError: An argument is out of range.

    Source: LinuxCNC, G-code overview, G-codes, M-codes, O-codes.
    """
    if step_limit < 1:
        raise InputError("the step limit is out of range", value=step_limit, limit=">= 1")
    for tool, length in (machine.tool_lengths or {}).items():
        if not -10.0 <= length <= 10.0:
            raise InputError(f"the length of tool {tool} is out of range", value=length, limit="-10 to 10 m")
    newline = line_end(text)
    lines = split_lines(text)
    _refuse_hidden_ends(lines, name)
    if not any(line.strip() for line in lines):
        hint = "Give a file with G-code; post it again where the CAM system wrote nothing"
        raise ProgramError("the program is empty", where=f"{name}:1:1", hint=hint)
    state = _state_at_start(machine, lines)
    zero = state.position[:3]
    try:
        source = GcodeSource(name, lines)
        interpreter = Interpreter(
            source, state, machine, includes, step_limit=step_limit, block_delete=block_delete, complete=complete,
            plain=plain_lines,
        )  # fmt: skip
        straight = interpreter.run()
    except ProgramError as fault:
        raise _named(fault, name, lines) from fault
    return Program(
        name=name,
        dialect="linuxcnc",
        lines=(*source.lines, "") if text.endswith(("\n", "\r")) else source.lines,
        newline=newline,
        blocks=tuple(_moved_block(block, zero) for block in interpreter.blocks),
        motions=tuple(_moved(motion, zero) for motion in interpreter.motions),
        straight=straight,
        part_zero=(state.work_offsets.reference, state.work_offsets.line) if state.work_offsets.reference else None,
    )


def _state_at_start(machine: MillingMachine, lines: Sequence[str]) -> ModalState:
    of_fanuc = any(FANUC.search(COMMENT.sub("", line)) for line in lines)
    state = ModalState(
        work_offsets=WorkOffsets(machine.work_offsets, machine.known, machine.part_offsets),
        unknown=set() if machine.known else {0, 1, 2},
        of_fanuc=of_fanuc,
        retract_initial=of_fanuc,  # G98 is in force at the start of Fanuc and Haas, G99 of LinuxCNC
        fanuc_offsets=any(FURTHER_OFFSET.search(line) for line in lines),
        g92_known=machine.known,
        lengths_known=machine.known or machine.tool_lengths is not None,
    )
    if machine.part_at_g54:
        state.position = state.work_offsets["G54"]
    return state


def _refuse_hidden_ends(lines: Sequence[str], name: str) -> None:
    """Refuse a carriage return within a line: it was the end of one, and two blocks would be read as one."""
    for number, line in enumerate(lines, start=1):
        if "\r" in line.strip("\r"):
            column = line.strip("\r").index("\r") + 1
            raise ProgramError(
                "a carriage return stands within a line: the file mixes line ends", where=f"{name}:{number}:{column}",
                value=repr(line[:40]), hint="Save it with one kind of line ends (LF or CRLF)",
            )  # fmt: skip


def _named(fault: ProgramError, name: str, lines: Sequence[str]) -> ProgramError:
    """The fault that is told: which language it is, where the text is no G-code at all."""
    result = foreign_language(lines)
    if result is None:
        return fault
    own = any("made by counterflex" in line for line in lines[:20])
    hint = "This is an output of counterflex: give the original program" if own else result.hint
    return ProgramError(
        f"this is {result.name}; G-code as LinuxCNC reads it is required", where=f"{name}:{result.line}",
        value=result.text, hint=hint, language=result.name,
    )  # fmt: skip


def _moved_block(block: Block, zero: Point) -> Block:
    if zero == _HERE:
        return block
    x, y, z = block.modal.p_part_origin
    origin = (x - zero[0], y - zero[1], z - zero[2])
    return replace(block, modal=replace(block.modal, p_part_origin=origin))


def _moved(motion: Motion, zero: Point) -> Motion:
    if zero == _HERE:
        return motion
    centre = None if motion.p_centre is None else motion.p_centre - zero
    return replace(motion, p_start=motion.p_start - zero, p_end=motion.p_end - zero, p_centre=centre)


def _file_names(label: str, suffix: str) -> list[str]:
    """Names of the file of a subroutine: ``drill.ngc``, and of a number ``1001.nc``, ``O1001.nc``, ``O1001``."""
    stems = [label]
    if label.isdecimal():
        stems += [label.zfill(4), *(f"{letter}{number}" for letter in "Oo" for number in (label, label.zfill(4)))]
    suffixes = dict.fromkeys((suffix, ".ngc", ".nc", ".tap", ".cnc", ".NC", ""))
    return [stem + ending for stem in dict.fromkeys(stems) for ending in suffixes]


def read_gcode_file(
    path: str | os.PathLike[str],
    *,
    machine: MillingMachine = COORDINATES_OF_THE_PART,
    step_limit: int = 2_000_000,
    block_delete: bool = False,
    complete: bool = True,
) -> Program:
    """Read a program from a file; the subroutines that it does not define are files of its folder.

    They are named by the subroutine: ``drill.ngc``, ``O1001.nc``.

    Args:
        path: The file, UTF-8 or Latin-1 (comments only may hold more than ASCII).
        machine: See :func:`read_gcode`.
        step_limit: Largest number of lines executed.
        block_delete: Skip lines that begin with a slash.
        complete: Refuse a file that stops without M2, M30 or a closing ``%``.

    Raises:
        ProgramError: The file cannot be read, is no text, or is no program that can be executed exactly.
    """
    file = Path(path)
    text, encoding = read_text(file)
    program = read_gcode(
        text,
        name=file.name,
        machine=machine,
        step_limit=step_limit,
        includes=functools.partial(_subroutine_beside, file),
        block_delete=block_delete,
        complete=complete,
    )
    return replace(program, encoding=encoding)


def _subroutine_beside(file: Path, label: str) -> tuple[str, str] | None:
    """Name and text of the file of a subroutine in the folder of a program; None where there is none."""
    for name in _file_names(label, file.suffix):
        neighbour = file.parent / name
        if neighbour.parent == file.parent and neighbour != file and neighbour.is_file():
            return name, read_text(neighbour)[0]
    return None


@dataclass(frozen=True)
class FileReader:
    """Reads a program of a control from a file, UTF-8 or Latin-1; programs that it calls are in its folder."""

    read: Callable[..., Program]  # ``(text, *, name, machine, complete, folder) -> Program``
    language: str  # Named in errors

    def __call__(
        self, file: str | os.PathLike[str], *, machine: MillingMachine = COORDINATES_OF_THE_PART, complete: bool = True
    ) -> Program:
        """Read a file; a parameter file of LinuxCNC says nothing about such a control.

        Raises:
            ProgramError: The file cannot be read, or is no program that can be executed exactly.
        """
        if machine.part_at_g54:
            what = f"--parameters is a file of LinuxCNC and has no meaning for {self.language}"
            raise ProgramError(what, where=str(file))
        path = Path(file)
        text, encoding = read_text(path)
        made = self.read(text, name=path.name, complete=complete, machine=machine, folder=path.parent)
        return replace(made, encoding=encoding)

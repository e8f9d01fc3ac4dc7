"""Read Klartext programs: executed statement by statement, with labels, calls, parameters and cycles."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.integrations.heidenhain.language.run import Run
from counterflex.integrations.heidenhain.language.source import Library, Source
from counterflex.programs.gcode.read.flow import line_end, split_lines
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.reader import COORDINATES_OF_THE_PART, FileReader
from counterflex.programs.program import Program

_HIDDEN: Final = re.compile(r"\s*\d+\s*/")


def hidden_blocks(program: Program) -> list[str]:
    """Return one sentence where blocks with motions are marked with / behind their number."""
    lines = [block.line for block in program.blocks if block.motion_count and _HIDDEN.match(block.text)]
    if not lines:
        return []
    more = f" and {len(lines) - 1} more" if len(lines) > 1 else ""
    return [
        f"line {lines[0]}{more}: a block with / behind its number is read as executed; leave the switch that hides "
        "blocks off, or take it out and plan again"
    ]


def read_heidenhain(
    text: str,
    *,
    name: str = "program",
    complete: bool = False,
    machine: MillingMachine = COORDINATES_OF_THE_PART,
    folder: Path | None = None,
) -> Program:
    """Execute a program's text and return the statements passed and the motions made.

    The active preset is the zero of the part, tool lengths are compensated by the control. Where the program tilts the
    working plane (PLANE, cycle 19) or gives tool vectors (LN with TX TY TZ), the tool axis of each motion is given as
    I J K of :data:`~counterflex.programs.program.TOOL_VECTOR`; M128 with A B C is
    :data:`~counterflex.programs.program.TOOL_CENTRE`.

    Args:
        name: Its name, for errors.
        complete: Refuse a text that stops without END PGM, M2 or M30: it may have been cut off.
        machine: Tools by name. ``known``: the tool starts at zero; else where it stands is not known before the
            program names its axes.
        folder: Where programs of CALL PGM are.

    Raises:
        ProgramError: With ``name:line:column``, at the first thing that is unknown, refused or contradictory.

    Source: HEIDENHAIN TNC 640 (34059x-05), User's Manual Conversational Programming.
    """
    lines = split_lines(text)
    if not any(line.strip() for line in lines):
        raise ProgramError("the program is empty", where=f"{name}:1:1", hint="Give a file with a Klartext program")
    source = Source(name, lines)
    run = Run(source, machine, Library(folder))
    ended = run.run()
    if complete and not ended:
        raise source.statements[-1].fault(
            name, "the program stops without END PGM, M2 or M30", None, None,
            "The file may be truncated. If it is complete, add --without-end",
        )  # fmt: skip
    blocks = run.finished_blocks()
    return Program(
        name=name,
        dialect="heidenhain",
        lines=(*lines, "") if text.endswith(("\n", "\r")) else lines,
        newline=line_end(text),
        blocks=blocks,
        motions=tuple(run.maker.motions),
        straight=all(block.single for block in blocks),
    )


read_heidenhain_file = FileReader(read_heidenhain, "Klartext")

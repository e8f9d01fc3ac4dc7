"""Read ABB RAPID modules strictly: what cannot be known exactly is refused with its line and what to do."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from counterflex.core.errors import ProgramError
from counterflex.programs.gcode.read.flow import line_end, split_lines
from counterflex.programs.program import RAPID_DIALECT, TOOL_VECTOR
from counterflex.programs.rapid.program import RapidProgram
from counterflex.programs.rapid.read.data import Data
from counterflex.programs.rapid.read.frames import RapidCell
from counterflex.programs.rapid.read.interpreter import Interpreter
from counterflex.programs.rapid.read.routines import Routines
from counterflex.programs.rapid.read.scanner import Source
from counterflex.programs.robot_text.axes import tilted, with_axes
from counterflex.programs.source_text import read_text


def read_rapid(
    text: str, *, name: str = "program.mod", cell: RapidCell | None = None, complete: bool = True
) -> RapidProgram:
    """Execute a module's text and return the statements passed and the motions made.

    Positions are of the tool tip in the work object, which is the part frame; the tool axis and the rotation about it
    are those of the quaternion. A program that keeps the tool along z of the part has motions without rotary angles;
    another one has the components of the tool axis there, see :data:`~counterflex.programs.program.TOOL_VECTOR`. The
    first target is approached from wherever the robot is: it counts as reached by a rapid without length.

    Args:
        text: The module.
        name: Its name, for errors.
        cell: What frames and process words are checked against; None takes every frame and knows no process words.
        complete: Refuse a text without ENDMODULE: it may have been cut off.

    Returns:
        The program as executed: ``PROC main``, or the only routine that no other calls.

    Raises:
        ProgramError: With ``name:line:column``, at the first thing that is unknown, contradictory or cannot be read
            exactly.
    """
    source = Source(text, name)
    statements = list(source.statements())
    routines, data = Routines(source, statements, complete=complete), Data(source, statements)
    lines = split_lines(text)
    interpreter = Interpreter(source, routines, data, cell, lines)
    interpreter.run()
    rotations = np.array(interpreter.rotations).reshape(-1, 3, 3)
    leans = tilted(rotations)
    return RapidProgram(
        name=name,
        dialect=RAPID_DIALECT,
        lines=(*lines, "") if text.endswith(("\n", "\r")) else lines,
        newline=line_end(text),
        blocks=tuple(interpreter.blocks(TOOL_VECTOR if leans else 0)),
        motions=tuple(with_axes(interpreter.motions, rotations) if leans else interpreter.motions),
        straight=not any(call.repeated for call in interpreter.calls),
        Rs_part_tcp=rotations,
        acting=tuple(sorted(set(interpreter.acting))),
        text=text,
        moves=tuple(interpreter.moves),
        calls=tuple(interpreter.calls),
        declarations=routines.declarations,
        names=data.names,
    )


def read_rapid_file(
    path: str | os.PathLike[str], *, cell: RapidCell | None = None, complete: bool = True
) -> RapidProgram:
    """Read a module.

    Args:
        path: The file, UTF-8 or Latin-1.
        cell: See :func:`read_rapid`.
        complete: Refuse a file without ENDMODULE.

    Raises:
        ProgramError: The file cannot be read, is no text, or is no program that can be executed exactly.
    """
    file = Path(path)
    text, encoding = read_text(file)
    if encoding == "utf-8-sig":
        raise ProgramError(
            "the file begins with a byte order mark, which not every controller reads", where=str(file),
            hint="Save it as ASCII or Latin-1, or as UTF-8 without a mark",
        )  # fmt: skip
    return replace(read_rapid(text, name=file.name, cell=cell, complete=complete), encoding=encoding)

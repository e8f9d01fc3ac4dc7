"""Read KUKA KRL programs strictly: what cannot be known exactly is refused with its line and what to do."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from counterflex.core.errors import ProgramError
from counterflex.programs.gcode.read.flow import line_end, split_lines
from counterflex.programs.krl.program import KrlProgram
from counterflex.programs.krl.read.data_list import data_file_of, data_list
from counterflex.programs.krl.read.frames import KrlCell
from counterflex.programs.krl.read.interpreter import Interpreter
from counterflex.programs.program import KRL_DIALECT, TOOL_VECTOR
from counterflex.programs.robot_text.axes import tilted, with_axes
from counterflex.programs.source_text import read_text


def read_krl(
    text: str,
    *,
    name: str = "program.src",
    data: str | None = None,
    data_name: str = "program.dat",
    cell: KrlCell | None = None,
    complete: bool = True,
) -> KrlProgram:
    """Execute a program's text and return the lines passed and the motions made.

    Positions are of the tool tip in $BASE, which is the part frame; the tool axis and the rotation about it are those
    of ``R = Rz(A) Ry(B) Rx(C)``. A program that keeps the tool along z of the part has motions without rotary angles;
    another one has the components of the tool axis there, see :data:`~counterflex.programs.program.TOOL_VECTOR`. The
    first Cartesian target is approached from wherever the robot is: it counts as reached by a rapid without length.

    Args:
        text: The ``.src`` file.
        name: Its name, for errors.
        data: The ``.dat`` file; None where there is none.
        data_name: Its name, for errors.
        cell: What frames and process words are checked against; None takes every frame and knows no process words.
        complete: Refuse a text without END: it may have been cut off.

    Returns:
        The program as executed.

    Raises:
        ProgramError: With ``name:line:column``, at the first thing that is unknown, contradictory or cannot be read
            exactly.
    """
    lines = _lines(text, name)
    data_lines = None if data is None else _lines(data, data_name)
    named = {} if data_lines is None else data_list(data_lines, data_name)
    interpreter = Interpreter(name, lines, named, data_name if data is not None else "", cell, complete=complete)
    interpreter.run()
    rotations = np.array(interpreter.rotations).reshape(-1, 3, 3)
    leans = tilted(rotations)
    return KrlProgram(
        name=name,
        dialect=KRL_DIALECT,
        lines=(*lines, "") if text.endswith(("\n", "\r")) else lines,
        newline=line_end(text),
        blocks=tuple(interpreter.blocks(TOOL_VECTOR if leans else 0)),
        motions=tuple(with_axes(interpreter.motions, rotations) if leans else interpreter.motions),
        straight=len({move.line for move in interpreter.moves}) == len(interpreter.moves),
        data=None
        if data is None or data_lines is None
        else (*data_lines, *([""] if data.endswith(("\n", "\r")) else [])),
        data_name=data_name if data is not None else "",
        data_newline="\n" if data is None else line_end(data),
        moves=tuple(interpreter.moves),
        Rs_part_tcp=rotations,
        R_tcp_tool=interpreter.frames.R_tcp_tool,
        extra=interpreter.extra_text,
        acting=tuple(interpreter.acting),
        loose_triggers=interpreter.loose,
    )


def read_krl_file(path: str | os.PathLike[str], *, cell: KrlCell | None = None, complete: bool = True) -> KrlProgram:
    """Read a ``.src`` file, with the ``.dat`` file of the same name beside it.

    Args:
        path: The ``.src`` file, UTF-8 or Latin-1.
        cell: See :func:`read_krl`.
        complete: Refuse a file without END.

    Raises:
        ProgramError: A file cannot be read, is no text, or is no program that can be executed exactly.
    """
    file = Path(path)
    text, encoding = read_text(file)
    listed = data_file_of(file)
    data, data_encoding = (None, encoding) if listed is None else read_text(listed)
    for encoded, of in ((encoding, file), (data_encoding, listed)):
        if encoded == "utf-8-sig":
            raise ProgramError(
                "the file begins with a byte order mark, which no KUKA controller reads", where=str(of),
                hint="Save it as ASCII or Latin-1, or as UTF-8 without a mark",
            )  # fmt: skip
    if encoding != data_encoding and listed is not None:
        encoding = "latin-1"
        text, data = (one.read_bytes().decode(encoding) for one in (file, listed))
    program = read_krl(
        text,
        name=file.name,
        data=data,
        data_name="" if listed is None else listed.name,
        cell=cell,
        complete=complete,
    )
    return replace(program, encoding=encoding)


def _lines(text: str, name: str) -> tuple[str, ...]:
    """Lines of a file that can be put together again byte for byte.

    Raises:
        ProgramError: The file is empty or mixes line ends.
    """
    lines, newline = split_lines(text), line_end(text)
    if not any(line.strip() for line in lines):
        raise ProgramError("the program is empty", where=f"{name}:1:1", hint="Post it again")
    whole = newline.join(lines) + (newline if text.endswith(("\n", "\r")) else "")
    if whole != text:
        at = next((i for i, (a, b) in enumerate(zip(whole, text, strict=False)) if a != b), 0)
        raise ProgramError(
            "the file mixes line ends",
            where=f"{name}:{text.count(chr(10), 0, at) + 1}",
            hint="Save it with one kind of line ends (LF or CRLF)",
        )
    return lines

"""Read VAL3 programs strictly: what cannot be known exactly is refused with its line and what to do."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.errors import ProgramError
from counterflex.programs.gcode.read.flow import line_end, split_lines
from counterflex.programs.program import TOOL_VECTOR, VAL3_DIALECT
from counterflex.programs.robot_text.axes import tilted, with_axes
from counterflex.programs.source_text import read_text
from counterflex.programs.val3.program import Val3Program
from counterflex.programs.val3.read.data_file import DataFile, data_file_of
from counterflex.programs.val3.read.interpreter import Interpreter, Val3Cell, code_of

_HINT: Final = "Give the program (.pgx) that holds the path, not the project"


def read_val3(
    text: str,
    *,
    name: str = "program.pgx",
    data: str = "",
    data_name: str = "program.dtx",
    cell: Val3Cell | None = None,
    complete: bool = True,
) -> Val3Program:
    """Execute a program and return the lines passed and the motions made.

    Positions are of the tool tip in the frame of the points, which is the part frame. The first point is approached
    from wherever the robot is: it counts as reached by a rapid without length.

    Args:
        text: The program file.
        name: Its name, for errors.
        data: The data file; empty where there is none.
        data_name: Its name, for errors.
        cell: What frames and process words are checked against; None takes every frame and knows no process words.
        complete: Refuse a text without the end of its program: it may have been cut off.

    Returns:
        The program as executed.

    Raises:
        ProgramError: With ``name:line:column``, at the first thing that is unknown, contradictory or cannot be read
            exactly.
    """
    lines = split_lines(text)
    starts = [0, *(match.end() for match in re.finditer(r"\r\n|\n|\r", text))]
    if not text.strip():
        raise ProgramError("the program is empty", where=f"{name}:1:1", hint="Post it again")
    if len(re.findall(r"<Program\s", text)) != 1 or "<Code>" not in text:
        raise ProgramError("this is no program file of VAL3", where=f"{name}:1:1", value=text.strip()[:60],
                           limit='<Program name="..."> ... <Code>', hint=_HINT)  # fmt: skip
    begin, end = _body(lines, name, complete=complete)
    file = DataFile(data, data_name)
    interpreter = Interpreter(name, lines, begin + 1, end, starts, file, cell)
    interpreter.run()
    rotations = np.array(interpreter.rotations).reshape(-1, 3, 3)
    leans = tilted(rotations)
    return Val3Program(
        name=name,
        dialect=VAL3_DIALECT,
        lines=(*lines, "") if text.endswith(("\n", "\r")) else tuple(lines),
        newline=line_end(text),
        blocks=tuple(interpreter.blocks(TOOL_VECTOR if leans else 0)),
        motions=tuple(with_axes(interpreter.motions, rotations) if leans else interpreter.motions),
        straight=True,
        Rs_part_tcp=rotations,
        acting=tuple(sorted(set(interpreter.acting))),
        text=text,
        data=data,
        data_name=data_name if data else "",
        moves=tuple(interpreter.moves),
        variables=file.variables,
        mentions=interpreter.mentions,
        code=starts[begin] if begin < len(starts) else len(text),
        datas_end=file.end,
    )


def _body(lines: tuple[str, ...], name: str, *, complete: bool) -> tuple[int, int]:
    """1-based lines of ``begin`` and ``end``; the line behind the last one where a cut text is taken as complete.

    Raises:
        ProgramError: One is missing.
    """
    codes = [code_of(line).strip() for line in lines]
    begin = next(
        (number for number, code in enumerate(codes, start=1) if re.sub(r"^.*CDATA\[", "", code) == "begin"), 0
    )
    end = next((number for number, code in enumerate(codes, start=1) if number > begin and code == "end"), 0)
    if not begin or (not end and complete):
        raise ProgramError(
            f"the program has no {'end' if begin else 'begin'}: it may be cut off",
            where=f"{name}:{len(lines) if begin else 1}",
            limit="begin ... end, each on a line of its own",
            hint="Post it again" + (", or say --without-end if it is complete" if begin else ""),
        )
    if end and complete and "</Program>" not in "".join(lines[end:]):
        raise ProgramError("the file stops before </Program>: it may be cut off", where=f"{name}:{len(lines)}",
                           hint="Post it again, or say --without-end if it is complete")  # fmt: skip
    return begin, end or len(lines) + 1


def read_val3_file(path: str | os.PathLike[str], *, cell: Val3Cell | None = None, complete: bool = True) -> Val3Program:
    """Read a program file, with the data file beside it: of the same name, or the only one of its folder.

    Args:
        path: The ``.pgx`` file, UTF-8 or Latin-1.
        cell: See :func:`read_val3`.
        complete: Refuse a file without its end.

    Raises:
        ProgramError: A file cannot be read, is no text, or is no program that can be executed exactly.
    """
    file = Path(path)
    text, encoding = read_text(file)
    listed = data_file_of(file)
    data, data_encoding = ("", encoding) if listed is None else read_text(listed)
    for one, kind, of in ((text, encoding, file), (data, data_encoding, listed)):
        newline = line_end(one)
        if one and newline.join(split_lines(one)) + (newline if one.endswith(("\n", "\r")) else "") != one:
            raise ProgramError("the file mixes line ends", where=str(of),
                               hint="Save it with one kind of line ends (LF or CRLF)")  # fmt: skip
        if kind == "utf-8-sig" and data_encoding != encoding and listed is not None:
            raise ProgramError("one of program and data file begins with a byte order mark, the other does not",
                               where=str(of), hint="Save both in one encoding")  # fmt: skip
    program = read_val3(
        text, name=file.name, data=data, data_name="" if listed is None else listed.name, cell=cell, complete=complete
    )
    return replace(program, encoding=encoding)

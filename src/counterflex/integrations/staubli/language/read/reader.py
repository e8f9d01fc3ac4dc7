"""Read VAL3 programs strictly: what cannot be known exactly is refused with its line and what to do."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from counterflex.core.errors import ProgramError
from counterflex.integrations.staubli.language.program import Val3Program, Val3Source
from counterflex.integrations.staubli.language.read.branches import Val3Folder
from counterflex.integrations.staubli.language.read.data_file import DataFile, data_file_of
from counterflex.integrations.staubli.language.read.interpreter import Val3Interpreter
from counterflex.integrations.staubli.language.read.motions import Val3Cell
from counterflex.integrations.staubli.language.read.program_file import Val3Routine
from counterflex.integrations.staubli.language.read.store import Store
from counterflex.programs.gcode.read.flow import line_end, split_lines
from counterflex.programs.source_text import common_encoding, read_text


def read_val3(
    text: str,
    *,
    name: str = "program.pgx",
    data: str = "",
    data_name: str = "program.dtx",
    cell: Val3Cell | None = None,
    complete: bool = True,
    folder: Val3Folder | None = None,
) -> Val3Program:
    """Execute a program and return the lines passed and the motions made.

    Positions are of the tool tip in the part frame: with a cell the cell's, else the frame of the first point. The
    first point is approached from wherever the robot is: it counts as reached by a rapid without length.

    Args:
        data: The data file; empty where there is none.
        cell: What frames and process words are checked against; None knows no process words.
        complete: Refuse a text without the end of its program: it may have been cut off.
        folder: Programs that it can call; None has none.

    Raises:
        ProgramError: With ``name:line:column``, at the first thing that is unknown, contradictory or cannot be read
            exactly.
    """
    routine = Val3Routine(text, name, complete)
    file, store, folder = DataFile(data, data_name), Store(), folder or Val3Folder()
    store.load(file)
    interpreter = Val3Interpreter(routine, folder, store, cell)
    interpreter.run()
    sources = {name: routine, **{one.name: one for one in folder.routines.values()}}
    return Val3Program(
        **interpreter.fields(name, text),
        dialect="val3",
        straight=len(sources) == 1 and max(interpreter.runs.values(), default=1) == 1,
        sources={
            key: Val3Source(one.text, one.starts[one.first] if one.first < len(one.starts) else len(one.text))
            for key, one in sources.items()
        },
        data=data,
        data_name=data_name if data else "",
        moves=tuple(interpreter.moves),
        variables=file.variables,
        mentions=dict(interpreter.uses + store.reads),
        datas_end=file.end,
        old=file.old,
    )


def read_val3_file(path: str | os.PathLike[str], *, cell: Val3Cell | None = None, complete: bool = True) -> Val3Program:
    """Read a program file with its data file, and the programs and libraries that it calls.

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
    folder = Val3Folder(file.parent, complete=complete)
    _refuse_mixed(text, str(file))
    _refuse_mixed(data, str(listed))
    if "utf-8-sig" in (encoding, data_encoding) and encoding != data_encoding:
        raise ProgramError("one of program and data file begins with a byte order mark, the other does not",
                           where=str(file), hint="Save both in one encoding")  # fmt: skip
    program = read_val3(
        text, name=file.name, data=data, data_name="" if listed is None else listed.name, cell=cell, complete=complete,
        folder=folder,
    )  # fmt: skip
    texts = {file.name: (text, encoding)}
    texts |= {} if listed is None else {listed.name: (data, data_encoding)}
    for one in folder.routines.values():
        _refuse_mixed(one.text, one.name)
        texts[one.name] = (one.text, one.encoding)
    return replace(program, encoding=common_encoding(texts))


def _refuse_mixed(text: str, where: str) -> None:
    """Refuse a text with two kinds of line ends."""
    newline = line_end(text)
    if text and newline.join(split_lines(text)) + (newline if text.endswith(("\n", "\r")) else "") != text:
        raise ProgramError("the file mixes line ends", where=where,
                           hint="Save it with one kind of line ends (LF or CRLF)")  # fmt: skip

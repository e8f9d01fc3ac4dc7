"""Read FANUC TP listings strictly: what cannot be known exactly is refused with its line and what to do."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Final

from counterflex.integrations.fanuc.language.program import FanucProgram
from counterflex.integrations.fanuc.language.read.interpreter import Interpreter
from counterflex.integrations.fanuc.language.read.listing import Listing
from counterflex.integrations.fanuc.language.read.routine import Folder, Routine, listings_beside
from counterflex.programs.gcode.read.flow import split_lines
from counterflex.programs.robot_text.cell import NumberedCell
from counterflex.programs.source_text import common_encoding, read_text, refuse_mark

_GROUP: Final = re.compile(r"\s*GP([2-9])\s*:", re.IGNORECASE)


def read_fanuc(
    text: str,
    *,
    name: str = "program.ls",
    cell: NumberedCell | None = None,
    complete: bool = True,
    folder: Folder | None = None,
) -> FanucProgram:
    """Execute a listing and return the statements passed and the motions made.

    Positions are of the tool tip in the user frame, which is the part frame; the tool axis and the rotation about it
    are those of W P R (:func:`~counterflex.integrations.fanuc.language.program.frame_of`).
    The first position is approached from wherever the robot is: it counts as reached by a rapid without length.

    Args:
        name: Its name, for errors.
        cell: What frames and process words are checked against; None takes the first user frame for the part frame and
            knows no process words.
        complete: Refuse a text without /END: it may have been cut off.
        folder: Programs that it can call; None has none.

    Raises:
        ProgramError: With ``name:line:column``, at the first thing that is unknown, contradictory or cannot be read
            exactly.
    """
    listing = Listing(text, name, complete=complete)
    lines = split_lines(text)
    routine, folder = Routine(listing, lines), folder or Folder()
    interpreter = Interpreter(routine, folder, cell)
    interpreter.run()
    return FanucProgram(
        **interpreter.fields(name, text),
        dialect="fanuc",
        straight=not folder.routines and max(interpreter.runs.values(), default=1) == 1,
        external=interpreter.targets.external.changes(interpreter.motions),
        listings={name: routine.about(), **{key: one.about() for key, one in folder.routines.items()}},
        moves=tuple(interpreter.moves),
    )


def read_fanuc_file(
    path: str | os.PathLike[str], *, cell: NumberedCell | None = None, complete: bool = True
) -> FanucProgram:
    """Read a listing, with those of its folder that it calls.

    Args:
        path: The file, UTF-8 or Latin-1.
        cell: See :func:`read_fanuc`.
        complete: Refuse a file without /END.

    Raises:
        ProgramError: A file cannot be read, is no text, or is no program that can be executed exactly.
    """
    file = Path(path)
    text, encoding = read_text(file)
    folder = Folder(listings_beside(file), complete=complete)
    refuse_mark(encoding, file)
    program = read_fanuc(text, name=file.name, cell=cell, complete=complete, folder=folder)
    texts = {file.name: (text, encoding)} | {
        name: (routine.listing.text, routine.encoding) for name, routine in folder.routines.items()
    }
    return replace(program, encoding=common_encoding(texts))


def further_groups(program: FanucProgram) -> list[str]:
    """Return one sentence where positions state motion groups besides that of the arm."""
    group = next(((k, m) for k, text in enumerate(program.lines, start=1) if (m := _GROUP.match(text))), None)
    if group is None:
        return []
    line, match = group
    return [
        f"line {line}: positions state group {match[1]}, too, at one place; whether part or robot stand there was not "
        "compared with the cell file"
    ]

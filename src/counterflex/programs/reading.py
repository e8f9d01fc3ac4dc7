"""Read a program file in its language, told by the ending of the file or by the first lines of it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from counterflex.core.errors import CounterflexError, InputError, ProgramError
from counterflex.programs.foreign_language import language_among
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.reader import COORDINATES_OF_THE_PART
from counterflex.programs.language import BY_ENDING, GCODE, LANGUAGES, Language, dialects, object_at
from counterflex.programs.program import Program
from counterflex.programs.robot_text.cell import RobotTextCell
from counterflex.programs.robot_text.program import RobotProgram
from counterflex.programs.source_text import read_text
from counterflex.programs.statement_table import StatementTable

RobotCell = RobotTextCell
"""What a robot program is held against: of the language that it is in."""


def dialect_of(file: str | os.PathLike[str], dialect: str = BY_ENDING) -> str:
    """Return the language that a file is read in.

    Args:
        dialect: A name of :data:`~counterflex.programs.language.LANGUAGES` that is read;
            :data:`~counterflex.programs.language.BY_ENDING` takes the language of the file's ending, and G-code as
            LinuxCNC reads it where the ending tells none.

    Raises:
        InputError: There is no such language.
    """
    if dialect != BY_ENDING:
        known = list(dialects())
        if dialect not in known:
            raise InputError("an unknown language of programs", value=dialect, limit=" ".join(known))
        return dialect
    path = Path(file)
    if path.suffix[1:].isdecimal():  # Creo numbers its versions: part.ncl.1
        path = path.with_suffix("")
    ending = path.suffix.lower()
    known = [name for name, one in LANGUAGES.items() if ending in one.endings and one.read is not None]
    return next(iter(known), GCODE) if len(known) < 2 else _by_first_lines(Path(file), known)


def _by_first_lines(file: Path, known: Sequence[str]) -> str:
    """The language of several with one ending whose signs stand first in a file; the first of them where none does."""
    lines = read_text(file)[0].splitlines() if file.is_file() else []
    return language_among(lines, known) or known[0]


def read_program_file(
    file: str | os.PathLike[str],
    *,
    dialect: str = BY_ENDING,
    machine: MillingMachine = COORDINATES_OF_THE_PART,
    complete: bool = True,
    cell: RobotCell | None = None,
) -> Program:
    """Read a program in the language it is written in.

    Args:
        dialect: See :func:`dialect_of`.
        machine: What is known of the machine that it was written for.
        complete: Refuse a program that stops without the end that its language requires.
        cell: What frames and process words of a robot program are held against.

    Returns:
        The program as executed; :attr:`~counterflex.programs.program.Program.dialect` is the language.

    Raises:
        ProgramError: It cannot be read exactly.
        InputError: There is no such language.
    """
    name = dialect_of(file, dialect)
    language = LANGUAGES[name]
    against = {"cell": cell} if language.robot else {"machine": machine}
    if name in LANGUAGES.own:
        program: Program = object_at(language.read)(file, **against, complete=complete)
        return program
    return _by_package(name, language, Path(file), **against, complete=complete)


def _by_package(name: str, language: Language, file: Path, **settings: object) -> Program:
    """Read by another package, whose faults are its own."""
    try:
        program = object_at(language.read)(file, **settings)
    except CounterflexError:
        raise
    except Exception as fault:
        raise ProgramError(
            f"the reader of another package fails: {type(fault).__name__}: {fault}", where=file.name,
            value=LANGUAGES.package(name), hint="Report it to its author",
        ) from fault  # fmt: skip
    if not isinstance(program, RobotProgram if language.robot else Program) or program.dialect != name:
        raise ProgramError(
            "the reader of another package gives no program of its language", where=file.name,
            value=LANGUAGES.package(name), hint="Report it to its author",
        )  # fmt: skip
    return program


def statement_tables() -> dict[str, StatementTable]:
    """Return the table of statements of each language that has one."""
    return {name: object_at(one.table) for name, one in LANGUAGES.items() if one.table is not None}


def require_linuxcnc(program: Program, command: str) -> None:
    """Refuse a program that a command cannot change, because it writes G-code as LinuxCNC reads it.

    Raises:
        ProgramError: It is in another language, or rotates, mirrors or scales its coordinates.
    """
    turned = next((b for b in program.blocks if b.modal.R_part_work is not None or b.modal.not_written), None)
    if turned is not None:
        raise ProgramError(
            f"{command} writes moves along the axes of the part, and this program turns its coordinates",
            where=turned.where(Path(program.name).name), value=turned.text.strip()[:40],
            hint="Post it without G68, G51.1 and G16",
        )  # fmt: skip
    if program.dialect != GCODE:
        raise ProgramError(
            f"{command} writes G-code as LinuxCNC reads it", where=Path(program.name).name, value=program.dialect,
            limit=GCODE, hint="Post the tool path for LinuxCNC",
        )  # fmt: skip

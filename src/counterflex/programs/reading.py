"""Which language a program file is in, and its reader: the one place where a language to read is added.

A language has a name in :data:`~counterflex.programs.limits.DIALECTS`, the endings of its files in
:data:`~counterflex.programs.limits.ENDINGS`, and a line in :data:`_READERS`, or in :data:`_ROBOT_READERS`.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from counterflex.core.errors import InputError, ProgramError
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.reader import COORDINATES_OF_THE_PART
from counterflex.programs.limits import BY_ENDING, DIALECTS, ENDINGS
from counterflex.programs.program import Program
from counterflex.programs.robot_text.cell import RobotTextCell
from counterflex.programs.statement_table import StatementTable

LINUXCNC: Final = "linuxcnc"
RobotCell = RobotTextCell
"""What a robot program is held against: of the language that it is in."""
_READERS: Final[dict[str, str]] = {
    LINUXCNC: "counterflex.programs.gcode.read.reader:read_gcode_file",
    "sinumerik": "counterflex.programs.gcode.sinumerik.reader:read_sinumerik_file",
    "twincat": "counterflex.programs.gcode.twincat.reader:read_twincat_file",
    "apt": "counterflex.programs.apt.reader:read_apt_file",
}
"""``module:function`` of each language; the function takes the file and, by name, ``machine`` and ``complete``."""
_ROBOT_READERS: Final[dict[str, str]] = {
    "krl": "counterflex.programs.krl.read.reader:read_krl_file",
    "rapid": "counterflex.programs.rapid.read.reader:read_rapid_file",
    "fanuc": "counterflex.programs.fanuc.read.reader:read_fanuc_file",
    "val3": "counterflex.programs.val3.read.reader:read_val3_file",
}
"""The same for languages of robots; the function takes ``cell`` in place of ``machine``."""
_STATEMENT_TABLES: Final[dict[str, str]] = {
    "krl": "counterflex.programs.krl.read.table:TABLE",
    "rapid": "counterflex.programs.rapid.table:TABLE",
    "fanuc": "counterflex.programs.fanuc.read.table:TABLE",
    "val3": "counterflex.programs.val3.read.table:TABLE",
    LINUXCNC: "counterflex.programs.gcode.read.code_table:TABLE",
    "sinumerik": "counterflex.programs.gcode.sinumerik.word_table:TABLE",
    "twincat": "counterflex.programs.gcode.twincat.word_table:TABLE",
    "apt": "counterflex.programs.apt.word_table:TABLE",
}
"""``module:name`` of each language's :class:`~counterflex.programs.statement_table.StatementTable`."""


def dialect_of(file: str | os.PathLike[str], dialect: str = BY_ENDING) -> str:
    """Return the language that a file is read in.

    Args:
        file: The program.
        dialect: One of :data:`~counterflex.programs.limits.DIALECTS`; :data:`~counterflex.programs.limits.BY_ENDING`
            takes the language of the file's ending, and G-code as LinuxCNC reads it where the ending tells none.

    Raises:
        InputError: There is no such language.
    """
    if dialect not in DIALECTS:
        raise InputError("an unknown language of programs", value=dialect, limit=" ".join(DIALECTS))
    if dialect != BY_ENDING:
        return dialect
    path = Path(file)
    if path.suffix[1:].isdecimal():  # Creo numbers its versions: part.ncl.1
        path = path.with_suffix("")
    ending = path.suffix.lower()
    return next((name for name, endings in ENDINGS.items() if ending in endings), LINUXCNC)


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
        file: The program.
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
    language = dialect_of(file, dialect)
    if language in _ROBOT_READERS:
        return _reader(_ROBOT_READERS[language])(file, cell=cell, complete=complete)
    return _reader(_READERS[language])(file, machine=machine, complete=complete)


def statement_tables() -> dict[str, StatementTable]:
    """Return the table of statements of each language that has one."""
    return {language: _named(place) for language, place in _STATEMENT_TABLES.items()}


def _reader(place: str) -> Callable[..., Program]:
    read: Callable[..., Program] = _named(place)
    return read


def _named(place: str) -> Any:
    module, _, name = place.partition(":")
    return getattr(importlib.import_module(module), name)


def require_linuxcnc(program: Program, command: str) -> None:
    """Refuse a program that a command cannot change, because it writes G-code as LinuxCNC reads it.

    Raises:
        ProgramError: It is in another language, or rotates, mirrors or scales its coordinates.
    """
    turned = next((b for b in program.blocks if b.modal.R_part_work is not None or b.modal.not_written), None)
    if turned is not None:
        raise ProgramError(
            f"{command} writes moves along the axes of the part, and this program turns its coordinates",
            where=turned.where(Path(program.name).name),
            value=turned.text.strip()[:40],
            hint="Post it without G68, G51.1 and G16",
        )
    if program.dialect != LINUXCNC:
        raise ProgramError(
            f"{command} writes G-code as LinuxCNC reads it",
            where=Path(program.name).name,
            value=program.dialect,
            limit=LINUXCNC,
            hint="Post the tool path for LinuxCNC",
        )

"""Read cutter location files: APT as ISO 4343 has it and CAM systems write it."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from counterflex.core.errors import ProgramError
from counterflex.programs.apt.run import AptRun
from counterflex.programs.apt.statements import statements, tilts
from counterflex.programs.gcode.read.flow import line_end, split_lines
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.program import Program
from counterflex.programs.source_text import read_text


def read_apt(text: str, *, name: str = "program", complete: bool = False, listed: bool = False) -> Program:
    """Execute a file's text and return the statements passed and the motions made.

    The coordinates of the file are those of the part. GOTO is the tool tip; where the tool axis is anywhere else than
    along z, the axis of each point is given as I J K of
    :data:`~counterflex.programs.program.TOOL_VECTOR`.

    Args:
        complete: Refuse a text that stops without FINI or END-OF-PATH.
        listed: Keep motions to places that are not known (GOHOME), marked.

    Returns:
        The program as executed, a block for each statement.

    Raises:
        ProgramError: With ``name:line:column``, at the first thing that is unknown, refused or contradictory.

    Source: ISO 4343, numerical control of machines, processor output.
    """
    lines = split_lines(text)
    if not any(line.strip() for line in lines):
        raise ProgramError("the program is empty", where=f"{name}:1:1", hint="Give a cutter location file")
    parts = list(statements(lines, name))
    run = AptRun(name, any(tilts(part) for part in parts), listed)
    ended = False
    for part in parts:
        if ended:
            break
        run.statement(part)
        ended = part.major in ("FINI", "END")
    if complete and not ended and not any(part.major == "END-OF-PATH" for part in parts):
        raise ProgramError(
            "the program stops without FINI or END-OF-PATH", where=f"{name}:{len(lines)}:1",
            hint="The file may be truncated. If it is complete, add --without-end",
        )  # fmt: skip
    return Program(
        name=name,
        dialect="apt",
        lines=(*lines, "") if text.endswith(("\n", "\r")) else lines,
        newline=line_end(text),
        blocks=tuple(run.blocks),
        motions=tuple(run.motions),
        straight=True,
    )


def read_apt_file(
    file: str | os.PathLike[str], *, machine: MillingMachine | None = None, complete: bool = True
) -> Program:
    """Read a cutter location file.

    Args:
        file: UTF-8 or Latin-1.
        machine: A parameter file of LinuxCNC says nothing about such a file.
        complete: See :func:`read_apt`.

    Raises:
        ProgramError: The file cannot be read, or is no program that can be executed exactly.
    """
    if machine is not None and machine.part_at_g54:
        raise ProgramError("--parameters is a file of LinuxCNC and has no meaning for APT", where=str(file))
    text, encoding = read_text(Path(file))
    listed = machine is not None and machine.listed
    return replace(read_apt(text, name=Path(file).name, complete=complete, listed=listed), encoding=encoding)

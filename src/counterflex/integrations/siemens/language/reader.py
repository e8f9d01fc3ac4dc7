"""Read programs in the Sinumerik dialect: executed line by line, with jumps, loops, variables and subprograms."""

from __future__ import annotations

from pathlib import Path

from counterflex.core.errors import ProgramError
from counterflex.programs.gcode.read.flow import split_lines
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.reader import COORDINATES_OF_THE_PART, FileReader
from counterflex.programs.gcode.sinumerik.run import SinumerikRun
from counterflex.programs.gcode.sinumerik.source import library_of, programs_of
from counterflex.programs.program import Program


def read_sinumerik(
    text: str,
    *,
    name: str = "program",
    complete: bool = False,
    machine: MillingMachine = COORDINATES_OF_THE_PART,
    folder: Path | None = None,
) -> Program:
    """Execute a program's text and return the blocks passed and the motions made.

    The zero of the first settable offset (G54 to G57, G505 to G599) is the zero of the part, tool lengths are
    compensated by the control, and the basic system is metric: F is in mm/min under G70 and G71.

    Args:
        text: The program, perhaps with its subprograms (``%_N_NAME_SPF``).
        complete: Refuse a text that stops without M2, M17, M30 or RET: it may have been cut off.
        machine: Tools by name, and settable offsets in the part frame. ``known``: the tool starts at zero; else where
            it stands is not known before the program names its axes.
        folder: Where subprograms are files (``NAME.spf``).

    Returns:
        The program as executed; A3 B3 C3 appear as the I J K of
        :data:`~counterflex.programs.program.TOOL_VECTOR`, CR as R.

    Raises:
        ProgramError: With ``name:line:column``, at the first thing that is unknown, refused or contradictory.

    Source: SINUMERIK 840D sl, Programming Manual Fundamentals, and Job Planning (TRAORI, frames, flexible NC
    programming).
    """
    if not any(line.strip() for line in split_lines(text)):
        raise ProgramError("the program is empty", where=f"{name}:1:1", hint="Give a file with a Sinumerik program")
    programs = programs_of(name, text)
    run = SinumerikRun(next(iter(programs.values())), machine, library_of(programs, folder))
    ended = run.run()
    if complete and not ended:
        raise run.flow.fault(
            "the program stops without M2, M17, M30 or RET", 0, None,
            "The file may be truncated. If it is complete, add --without-end",
        )  # fmt: skip
    return run.program("sinumerik", text)


read_sinumerik_file = FileReader(read_sinumerik, "Sinumerik")

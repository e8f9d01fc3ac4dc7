"""Read programs for TwinCAT NC I: every line once and in order."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.integrations.beckhoff.language.words import TWINCAT
from counterflex.programs.gcode.read.flow import split_lines
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.reader import COORDINATES_OF_THE_PART
from counterflex.programs.gcode.read.scanner import error_at
from counterflex.programs.gcode.sinumerik.run import Run
from counterflex.programs.gcode.sinumerik.scanner import Line
from counterflex.programs.gcode.sinumerik.source import programs_of
from counterflex.programs.program import Program
from counterflex.programs.source_text import read_text

_CARRIED: Final = re.compile(
    r"#\s*(?:set|SET)\s+param(?:VertexSmoothing|CircularSmoothing|AutoAccurateStop|SplineSmoothing|Dynamics\w*"
    r"|PathDynamics|C1ReductionFactor|VeloJump\w*|ToleranceBallReduction\w*|EndBlockVelocity\w*)\s*\([^#]*\)\s*#"
    r"|#\s*MSG\s*\([^#]*\)\s*#|@(?:714|716|717)\b",
)
"""Statements of the channel that change no target: smoothing, dynamics, messages, decoder stops."""
_COMMENT: Final = re.compile(r"\([^()]*\)")
_CHANNEL: Final = re.compile(r"#|@\d*|!|\$")
_CALL: Final = re.compile(r"\s*(?:N\d+\s*)?L\s*\d+", re.IGNORECASE)


def _blank(match: re.Match[str]) -> str:
    return " " * len(match[0])


def prepared(text: str, name: str, line: int) -> str:
    """A line with comments and carried statements of the channel as blanks, as long as it was.

    Raises:
        ProgramError: A statement of the channel that is not read, a comment that is not closed, a subprogram.
    """
    bare = _COMMENT.sub(_blank, _CARRIED.sub(_blank, text))
    if (match := _CHANNEL.search(bare)) is not None:
        raise error_at(
            name, line, "a statement of the channel that is not read", match.start(), text[match.start() :][:40],
            "Smoothing, dynamics, #MSG and @714 are carried; shifts, rotations, variables and jumps are not",
        )  # fmt: skip
    if (match := re.search(r"[();]", bare)) is not None:
        raise error_at(name, line, "comments stand in brackets, each on one line", match.start(),
                       text[match.start() :][:40], "Write (comment)")  # fmt: skip
    if (match := _CALL.match(bare)) is not None:
        raise error_at(name, line, "subprograms are not read", match.start(), text.strip()[:40],
                       "Post the program without subprograms, jumps and calculations")  # fmt: skip
    return bare


class _Run(Run):
    """One pass through a program, with the words of TwinCAT."""

    table = TWINCAT

    def scanned(self, text: str, number: int) -> Line:
        """The line: U is a radius, X of a G4 its time."""
        line = super().scanned(prepared(text, self.flow.source.name, number), number)
        dwell = any(address.name == "G" and address.value == 4.0 for address in line.addresses)
        names = {"U": "CR", **({"X": "F"} if dwell else {})}
        return replace(line, addresses=tuple(
            replace(address, name=names.get(address.name, address.name)) for address in line.addresses
        ))  # fmt: skip


def read_twincat(
    text: str, *, name: str = "program", complete: bool = False, machine: MillingMachine = COORDINATES_OF_THE_PART
) -> Program:
    """Execute a program's text and return the blocks passed and the motions made.

    The zero of the active offset (G53 to G57, one of them) is the zero of the part; G71 (mm) is active at the start.

    Args:
        text: The program.
        name: Its name, for errors.
        complete: Refuse a text that stops without M2 or M30: it may have been cut off.
        machine: See :func:`~counterflex.integrations.siemens.language.reader.read_sinumerik`.

    Returns:
        The program as executed; U appears as R.

    Raises:
        ProgramError: With ``name:line:column``, at the first thing that is unknown, refused or contradictory.
    """
    if not any(line.strip() for line in split_lines(text)):
        raise ProgramError("the program is empty", where=f"{name}:1:1", hint="Give a file with a TwinCAT program")
    run = _Run(next(iter(programs_of(name, text, flow=False).values())), machine)
    if not run.run() and complete:
        raise run.flow.fault("the program stops without M2 or M30", 0, None,
                             "The file may be truncated. If it is complete, add --without-end")  # fmt: skip
    return run.program("twincat", text)


def read_twincat_file(
    file: str | os.PathLike[str], *, machine: MillingMachine = COORDINATES_OF_THE_PART, complete: bool = True
) -> Program:
    """Read a program from a file.

    Args:
        file: UTF-8 or Latin-1.
        machine: A parameter file of LinuxCNC says nothing about this control.
        complete: See :func:`read_twincat`.

    Raises:
        ProgramError: The file cannot be read, or is no program that can be executed exactly.
    """
    if machine.part_at_g54:
        raise ProgramError("--parameters is a file of LinuxCNC and has no meaning for TwinCAT", where=str(file))
    text, encoding = read_text(Path(file))
    return replace(read_twincat(text, name=Path(file).name, complete=complete, machine=machine), encoding=encoding)

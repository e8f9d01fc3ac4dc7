"""Read programs for TwinCAT NC I: every line once and in order."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.programs.gcode.read.code_table import Code, neutral, read, refused
from counterflex.programs.gcode.read.flow import split_lines
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.reader import COORDINATES_OF_THE_PART, FileReader
from counterflex.programs.gcode.read.scanner import error_at
from counterflex.programs.gcode.sinumerik.run import SinumerikRun
from counterflex.programs.gcode.sinumerik.scanner import Line
from counterflex.programs.gcode.sinumerik.source import programs_of
from counterflex.programs.gcode.sinumerik.words import WordTable
from counterflex.programs.program import Program
from counterflex.programs.statement_table import Statement, StatementTable, Treatment

# All statements and words of TwinCAT NC I (DIN 66025), and what the reader does with each.
# Source: Beckhoff, TF5100 TwinCAT 3 NC I, "Interpreter (DIN 66025/G-Code)" and "Command overview".

_CAM: Final = "Let the CAM system write the tool-centre path"
_UNROLLED: Final = "Post the program without subprograms, jumps and calculations"
_ARCS: Final = "Post G2 or G3 with I J K or U"
_FRAMES: Final = "Post without frames of the control"

CODES: Final[tuple[Code, ...]] = (
    *read("G0 G1", "motion", "straight motion", "* X1 Y1 Z5 F600"),
    *read("G2 G3", "motion", "arc with I J K or U", "* X1 Y0 U1 F600"),
    *read("G4", "dwell", "dwell: X in seconds", "G4 X0.5"),
    *read("G17 G18 G19", "plane", "plane of arcs"),
    *read("G70 G71", "unit", "unit of lengths"),
    *read("G90 G91", "distance", "values count from zero, or from where the tool stands"),
    *read("G40", "cutter radius", "no cutter radius compensation"),
    *read("G53 G54 G55 G56 G57", "work offset", "offset; the first one is that of the part"),
    *neutral("G60", "exact stop", group="path control"),
    *neutral("G9", "exact stop for one block", group="exact stop once"),
    *neutral("FCONST|FLIN", "how the feed goes to its new value"),
    *refused("G41 G42", "cutter radius compensation depends on the control's tool table", _CAM, "* D1"),
    *refused("G58 G59", "the second programmable offset is not read", "Write the targets themselves", "* X1"),
    *refused("G74", "a reference point of the machine is not known here", "Retract with a plain G0", "G74 X0"),
    *refused("G31", "deleting the distance to go is not read", "Post the path without it", "G31 X1"),
    *refused("CIP G303", "the arc through a point is not read", _ARCS, "* X1 Y1"),
    *refused("B", "a radius B is not told from a rotary axis B", "Write the radius as U", "B=1"),
    *refused("ROT AROT MIRROR ZDS CLOCKDB", "this frame is not read", _FRAMES),
    *refused("L IF ELSE ELSIF ENDIF FOR WHILE REPEAT SWITCH WHEN GOTO SYNC CALL",
             "jumps, loops, subprograms and variables are not read", _UNROLLED),
)  # fmt: skip
_OTHER: Final[tuple[tuple[str, Treatment, str, str], ...]] = (
    ("F", Treatment.EVALUATED, "feed per minute", "F600"),
    ("S", Treatment.EVALUATED, "spindle speed", "S1000"),
    ("T", Treatment.EVALUATED, "tool of the next M6", "T1"),
    ("M3", Treatment.EVALUATED, "spindle", "M3"),
    ("M4", Treatment.EVALUATED, "spindle", "M4"),
    ("M5", Treatment.EVALUATED, "spindle", "M5"),
    ("M6", Treatment.EVALUATED, "the tool that T chose", "T1 M6"),
    ("M2", Treatment.EVALUATED, "end of the program", "M2"),
    ("M30", Treatment.EVALUATED, "end of the program", "M30"),
    ("R=", Treatment.EVALUATED, "R parameter, with arithmetic", "R1=2*3"),
    *((axis, Treatment.EVALUATED, "target", f"G1 {axis}1 F600") for axis in "XYZ"),
    ("U", Treatment.EVALUATED, "radius of an arc", "G2 X1 Y0 U1 F600"),
    ("M", Treatment.NEUTRAL, "other functions: the channel defines them", "M8"),
    ("N", Treatment.NEUTRAL, "block number", "N10"),
    ("D", Treatment.NEUTRAL, "number of a tool offset: the control compensates it", "D1"),
    ("H", Treatment.NEUTRAL, "function of the machine", "H1"),
    ("( )", Treatment.NEUTRAL, "comment", "(text)"),
    ("#set param...()#", Treatment.NEUTRAL, "smoothing, dynamics", "#set paramVertexSmoothing(2; 1)#"),
    ("#MSG()#", Treatment.NEUTRAL, "message", "#MSG(NCI; INFO; text)#"),
    ("@714", Treatment.NEUTRAL, "how far the control reads ahead", "@714"),
)
_REFUSED: Final[tuple[tuple[str, str, str, str], ...]] = (
    ("#set paramZeroShift()#", "a statement of the channel that is not read", "Write the targets themselves",
     "#set paramZeroShift(G54; 1; 2; 3)#"),
    ("@100", "jumps, loops, subprograms and variables are not read", _UNROLLED, "@100 K10"),
    ("$IF", "jumps, loops, subprograms and variables are not read", _UNROLLED, "$IF R1=1"),
    ("!", "jumps, loops, subprograms and variables are not read", _UNROLLED, "!CALL"),
)  # fmt: skip
TABLE: Final = StatementTable(
    "twincat",
    "TwinCAT 3 NC I (TF5100), Interpreter (DIN 66025)",
    (
        *(code.statement for code in CODES),
        *(Statement(word, treatment, reason, samples=(sample,)) for word, treatment, reason, sample in _OTHER),
        *(Statement(word, Treatment.REFUSED, why, fix, (sample,)) for word, why, fix, sample in _REFUSED),
    ),
)


TWINCAT: Final = WordTable(
    dialect="TwinCAT",
    group={code.word: code.group for code in CODES if code.group.islower()},
    carried=frozenset(("FCONST", "FLIN")),
    carried_values=frozenset(("H", "D")),
    refused={code.word: (code.reason, code.remedy) for code in CODES if code.treatment is Treatment.REFUSED},
    m_codes=frozenset(range(160)) - {17},
    cycles=(),
)
"""M functions are defined by the machine builder in the channel; those of counterflex keep their usual meaning."""


_CARRIED: Final = re.compile(
    r"#\s*(?:set|SET)\s+param(?:VertexSmoothing|CircularSmoothing|AutoAccurateStop|SplineSmoothing|Dynamics\w*"
    r"|PathDynamics|C1ReductionFactor|VeloJump\w*|ToleranceBallReduction\w*|EndBlockVelocity\w*)\s*\([^#]*\)\s*#"
    r"|#\s*MSG\s*\([^#]*\)\s*#|@(?:714|716|717)\b"
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


class _Run(SinumerikRun):
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
    text: str,
    *,
    name: str = "program",
    complete: bool = False,
    machine: MillingMachine = COORDINATES_OF_THE_PART,
    folder: Path | None = None,
) -> Program:
    """Execute a program's text and return the blocks passed and the motions made.

    The zero of the active offset (G53 to G57, one of them) is the zero of the part; G71 (mm) is active at the start.

    Args:
        complete: Refuse a text that stops without M2 or M30: it may have been cut off.
        machine: See :func:`~counterflex.integrations.siemens.language.reader.read_sinumerik`.
        folder: Not looked at: the control's subprograms are not read.

    Returns:
        The program as executed; U appears as R.

    Raises:
        ProgramError: With ``name:line:column``, at the first thing that is unknown, refused or contradictory.
    """
    del folder
    if not any(line.strip() for line in split_lines(text)):
        raise ProgramError("the program is empty", where=f"{name}:1:1", hint="Give a file with a TwinCAT program")
    run = _Run(next(iter(programs_of(name, text, flow=False).values())), machine)
    if not run.run() and complete:
        raise run.flow.fault("the program stops without M2 or M30", 0, None,
                             "The file may be truncated. If it is complete, add --without-end")  # fmt: skip
    return run.program("twincat", text)


read_twincat_file = FileReader(read_twincat, "TwinCAT")

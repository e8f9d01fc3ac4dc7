"""All statements and words of TwinCAT NC I (DIN 66025), and what the reader does with each.

Source: Beckhoff, TF5100 TwinCAT 3 NC I, "Interpreter (DIN 66025/G-Code)" and "Command overview".
"""

from __future__ import annotations

from typing import Final

from counterflex.programs.gcode.read.code_table import Code, neutral, read, refused
from counterflex.programs.statement_table import Statement, StatementTable, Treatment

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

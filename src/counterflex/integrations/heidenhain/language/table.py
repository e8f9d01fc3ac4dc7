"""All statements, cycles and M functions of Klartext, and what the reader does with each.

Source: HEIDENHAIN TNC 640 (34059x-05), User's Manual Conversational Programming and User's Manual Cycle Programming,
overviews of path functions, Q-parameter functions, cycles and M functions.
"""

from __future__ import annotations

from typing import Final

from counterflex.programs.statement_table import Statement, StatementTable, Treatment

_CAM: Final = "Let the CAM system write the tool-centre path"
_MOVES: Final = "Let the CAM system write the moves of the cycle"
_VALUE: Final = "Write the values themselves"

M_READ: Final[dict[int, tuple[int, ...]]] = {
    0: (0,), 1: (1,), 2: (2,), 3: (3,), 4: (4,), 5: (5,), 6: (), 7: (7,), 8: (8,), 9: (9,), 13: (3, 8), 14: (4, 8),
    30: (30,),
}  # fmt: skip
"""M functions that are read, with the codes that they stand for; M6 is part of TOOL CALL."""
M_STATE: Final = {
    89: "calls the cycle behind every positioning block", 91: "coordinates of the machine: the place is not known",
    92: "coordinates of the machine: the place is not known", 94: "value of a rotary axis below 360 deg",
    99: "calls the cycle", 126: "rotary axes go the shortest way", 127: "ends M126", 128: "the tip is guided (TCPM)",
    129: "ends M128", 140: "retracts along the tool axis: the place is not known",
}  # fmt: skip
M_CARRIED: Final[dict[int, str]] = {
    19: "stops the spindle at an angle", 90: "how corners are passed", 97: "acts with radius compensation only",
    98: "acts with radius compensation only", 101: "replacement tool", 102: "ends M101", 107: "no check of deltas",
    108: "ends M107", 111: "ends M109 and M110", 112: "smoothing between blocks", 113: "ends M112",
    117: "ends M116", 120: "look-ahead of radius compensation", 124: "points that are left out of smoothing",
    134: "exact stop of rotary axes", 135: "ends M134", 137: "ends M136", 148: "lift-off at a stop", 149: "ends M148",
}  # fmt: skip
M_REFUSED: Final[dict[int, tuple[str, str]]] = {
    103: ("a factor of the plunging feed is not read", "Write F in the blocks that plunge"),
    109: ("a constant speed of the cutting edge changes F on arcs", "Leave it out"),
    110: ("a constant speed of the cutting edge changes F on arcs", "Leave it out"),
    116: ("a feed of rotary axes in mm/min depends on the machine", "Write M128"),
    118: ("the handwheel moves the tool beside the program", "Leave it out"),
    130: ("points in the untilted coordinate system are not read", "Write PLANE RESET before"),
    136: ("a feed in mm per revolution for all blocks is not read", "Write FU in the blocks"),
    138: ("the choice of tilting axes belongs to the machine", "Leave it out"),
    144: ("the kinematics of the machine is taken into account", "Write M128"),
    197: ("rounded corners are not read", _CAM),
}
"""M functions that are known and not taken, with the reason and what to do."""
CYCLES: Final[dict[int, str]] = {
    **dict.fromkeys((7, 8, 9, 10, 11, 19, 26, 200, 201, 247), "read"),
    **dict.fromkeys((13, 32), ""),
    **dict.fromkeys((12,), "a program called by a cycle is not read"),
    **dict.fromkeys((202, 203, 204, 205, 208, 240, 241), "this drilling cycle is not read"),
    **dict.fromkeys((206, 207, 209, *range(262, 268), 18, 2, 17), "tapping and thread milling are not read"),
    **dict.fromkeys((*range(250, 260), *range(210, 216), 4, 5, 3), "pocket, stud and slot milling is not read"),
    **dict.fromkeys((14, *range(20, 26), 27, 28, 29, 39, *range(270, 277)), "contour cycles are not read"),
    **dict.fromkeys((220, 221), "point patterns are not read"),
    **dict.fromkeys((*range(230, 234), 225, 239, *range(291, 293)), "this milling cycle is not read"),
    **dict.fromkeys((*range(400, 500), 0, 1), "touch probe cycles measure what is not known here"),
    **dict.fromkeys(range(800, 900), "turning cycles are not read"),
}
"""Treatment by number: ``read``, empty where it is neutral, else why it is refused."""
NEUTRAL: Final[dict[str, tuple[str, str]]] = {
    "BLK FORM": ("blank of the simulation", "BLK FORM 0.1 Z X+0 Y+0 Z-20"),
    "TOOL DEF": ("prepares the next tool", "TOOL DEF 5"),
    "FN 16": ("writes to a file or the screen", "FN 16: F-PRINT TNC:\\A.A / SCREEN:"),
    "FN 26": ("opens a table", "FN 26: TABOPEN TNC:\\A.TAB"),
    "FN 27": ("writes to a table", "FN 27: TABWRITE 5/\"A\" = Q5"),
}  # fmt: skip
REFUSED: Final[dict[str, tuple[str, str, str]]] = {
    "APPR": ("approach functions are not read", "Let the CAM system write lines and arcs", "APPR LT X+1 LEN5 RL"),
    "DEP": ("departure functions are not read", "Let the CAM system write lines and arcs", "DEP LT LEN5"),
    "CHF": ("its manual does not say whether the length is that of the chamfer or of its sides", "Write L", "CHF 5"),
    **dict.fromkeys(("FL", "FLT", "FC", "FCT", "FPOL", "FSELECT"),
                    ("free contour programming is not read", "Convert it to L, C and CR on the control", "")),
    "SPL": ("splines are not read", _CAM, "SPL X+1"),
    "SEL": ("programs, tables and patterns that are selected are not read", "Write CALL PGM, or the values", ""),
    "CALL SELECTED": ("a selected program is not read", "Write CALL PGM", "CALL SELECTED PGM"),
    "PATTERN DEF": ("point patterns are not read", "Write L with M99", "PATTERN DEF POS1 (X+1 Y+1 Z+0)"),
    "CONTOUR DEF": ("contour cycles are not read", _MOVES, "CONTOUR DEF P1 = LBL 1"),
    "TRANS": ("this spelling of frames is not read", "Write CYCL DEF 7, 8, 10 or 26", "TRANS DATUM AXIS X+10"),
    "TCH PROBE": ("a touch probe measures what is not known here", _VALUE, "TCH PROBE 427"),
    "PARAXCOMP": ("parallel axes are not read", _CAM, "PARAXCOMP DISPLAY W"),
    "PARAXMODE": ("parallel axes are not read", _CAM, "PARAXMODE X Y Z"),
    "IF": ("conditions of newer controls are not read", "Write FN 9 to FN 12", "IF Q1 == 1"),
    "FN 14": ("an error message stops the program", "Take it out", "FN 14: ERROR = 1000"),
    "FN 15": ("printing by FN 15 is not read", "Take it out", "FN 15: PRINT 20"),
    "FN 17": ("data of the control are set, and what they change is not known", "Take it out",
              "FN 17: SYSWRITE ID210 NR1 = 5"),
    "FN 19": ("the PLC may act on what it gets", "Take it out", "FN 19: PLC=+10"),
    "FN 20": ("how long the program waits is not known", "Take it out", "FN 20: WAIT FOR I4==1"),
    "FN 29": ("the PLC may act on what it gets", "Take it out", "FN 29: PLC=+10"),
    "FN 37": ("a value of the program is handed to a cycle", "Take it out", "FN 37: EXPORT Q5"),
    "FN 38": ("the control may act on what it gets", "Take it out", "FN 38: SEND /\"A\""),
    "FN": ("this function is not read", _VALUE, "FN 99: X"),
}  # fmt: skip
"""Statements that are known and not taken, with the reason, what to do, and an example."""
_PATHS: Final = {
    "L": ("straight motion", "L X+1 Y+2 R0 F500"), "LN": ("straight motion with tool vector", "LN X+1 R0 F500"),
    "LP": ("straight motion in polar coordinates", "LP PR+5 PA+30 R0 F500"),
    "CC": ("circle centre, pole", "CC X+1 Y+2"), "C": ("arc about CC", "C X+1 Y+2 DR+ F500"),
    "CP": ("polar arc, helix", "CP IPA+90 DR+ F500"), "CR": ("arc with radius", "CR X+3 Y+0 R+50 DR- F500"),
    "CT": ("tangential arc", "CT X+1 Y+2 F500"), "CTP": ("tangential arc, polar", "CTP PR+5 PA+10 F500"),
    "RND": ("rounds the corner of two straight feeds", "RND R1"),
    "R0": ("no radius compensation", "L X+1 R0 F500"), "FMAX": ("rapid, in its block only", "L Z+50 R0 FMAX"),
    "F AUTO": ("feed of TOOL CALL", "L X+1 R0 F AUTO"), "FU": ("feed per revolution", "L X+1 R0 FU0.1"),
    "TOOL CALL": ("tool, spindle speed, feed", "TOOL CALL 2 Z S1000 F300 DL+0 DR+0.1"),
    "CYCL CALL": ("calls the cycle", "CYCL CALL"), "LBL": ("label", "LBL 99"),
    "CALL LBL": ("subprogram, or repetition (REP)", "CALL LBL 99"), "STOP": ("as M0", "STOP"),
    "CALL PGM": ("program of the folder", "CALL PGM X.H"), "BEGIN PGM": ("head: name and unit", "BEGIN PGM A MM"),
    "END PGM": ("end", "END PGM A MM"),
    "Q": ("parameter, formula", "Q1 = 2 * SIN (30)"), "FN 0 to FN 8, FN 13": ("arithmetic", "FN 1: Q1 = +2 + +3"),
    "FN 9 to FN 12": ("jump under a condition", "FN 9: IF +1 EQU +2 GOTO LBL 1"),
    "FN 18": ("value of the control: unknown", "FN 18: SYSREAD Q1 = ID270 NR1 IDX1"),
    "FN 28": ("value of a table: unknown", "FN 28: TABREAD Q1 = 5/\"A\""),
    "PLANE SPATIAL": ("tilted plane by spatial angles", "PLANE SPATIAL SPA+0 SPB+30 SPC+0 TURN FMAX"),
    "PLANE EULER": ("tilted plane by Euler angles", "PLANE EULER EULPR+0 EULNU+30 EULROT+0 TURN FMAX"),
    "PLANE VECTOR": ("tilted plane by vectors", "PLANE VECTOR BX1 BY0 BZ0 NX0 NY0 NZ1 TURN FMAX"),
    "PLANE POINTS": ("tilted plane by points",
                     "PLANE POINTS P1X+0 P1Y+0 P1Z+0 P2X+1 P2Y+0 P2Z+0 P3X+0 P3Y+1 P3Z+1 TURN FMAX"),
    "PLANE RELATIV": ("tilts the plane further", "PLANE RELATIV SPB+10 TURN FMAX"),
    "PLANE RESET": ("untilted plane", "PLANE RESET STAY"),
    "FUNCTION TCPM": ("as M128", "FUNCTION TCPM F TCP AXIS POS PATHCTRL AXIS"),
    "FUNCTION RESET TCPM": ("as M129", "FUNCTION RESET TCPM"),
    "FUNCTION MODE MILL": ("milling on a machine that also turns", "FUNCTION MODE MILL"),
    "CYCL DEF 7": ("datum shift", "CYCL DEF 7.0 DATUM SHIFT\nCYCL DEF 7.1 X+0"),
    "CYCL DEF 8": ("mirror image", "CYCL DEF 8.0 MIRROR IMAGE\nCYCL DEF 8.1 X"),
    "CYCL DEF 9": ("dwell", "CYCL DEF 9.0 DWELL TIME\nCYCL DEF 9.1 DWELL 0.5"),
    "CYCL DEF 10": ("rotation", "CYCL DEF 10.0 ROTATION\nCYCL DEF 10.1 ROT+0"),
    "CYCL DEF 11": ("scale; only 1", "CYCL DEF 11.0 SCALING\nCYCL DEF 11.1 SCL1"),
    "CYCL DEF 19": ("tilted plane by one angle", "CYCL DEF 19.0 WORKING PLANE\nCYCL DEF 19.1 A+0 B+0 C+0"),
    "CYCL DEF 26": ("scale of each axis", "CYCL DEF 26.0 AXIS-SPEC. SCALING\nCYCL DEF 26.1 X1 Y1"),
    "CYCL DEF 200": ("drilling", "CYCL DEF 200 DRILLING ~\nQ200=2 ~\nQ201=-5 ~\nQ206=150 ~\nQ202=5 ~\nQ210=0 ~\n"
                     "Q203=+0 ~\nQ204=50 ~\nQ211=0"),
    "CYCL DEF 201": ("reaming", "CYCL DEF 201 REAMING ~\nQ200=2 ~\nQ201=-5 ~\nQ206=150 ~\nQ211=0 ~\nQ208=0 ~\n"
                     "Q203=+0 ~\nQ204=50"),
    "CYCL DEF 247": ("preset: that of the part; only one", "CYCL DEF 247 PRESET ~\nQ339=+1"),
}  # fmt: skip
_SAMPLES: Final = {"FL": "FL AN+30", "FLT": "FLT AN+30", "FC": "FC R5 DR+", "FCT": "FCT R5 DR+", "FPOL": "FPOL X+0 Y+0",
                   "FSELECT": "FSELECT 1", "SEL": "SEL TABLE \"A.D\""}  # fmt: skip


def _rows() -> tuple[Statement, ...]:
    read, neutral, refused = Treatment.EVALUATED, Treatment.NEUTRAL, Treatment.REFUSED
    rows = [Statement(word, read, why, samples=(sample,)) for word, (why, sample) in _PATHS.items()]
    rows += [Statement(f"M{m}", read, "as in G-code", samples=(f"M{m}",)) for m in M_READ]
    rows += [Statement(f"M{m}", read, why, samples=(f"L X+1 R0 FMAX M{m}",)) for m, why in M_STATE.items()]
    rows += [Statement(word, neutral, why, samples=(sample,)) for word, (why, sample) in NEUTRAL.items()]
    rows += [Statement(f"M{m}", neutral, why, samples=(f"M{m}",)) for m, why in M_CARRIED.items()]
    rows += [
        Statement("CYCL DEF 13", neutral, "stops the spindle at an angle",
                  samples=("CYCL DEF 13.0 ORIENTATION\nCYCL DEF 13.1 ANGLE 180",)),
        Statement("CYCL DEF 32", neutral, "how the control follows the path",
                  samples=("CYCL DEF 32.0 TOLERANCE\nCYCL DEF 32.1 T0.05",)),
        Statement("; text", neutral, "comment", samples=("; text",)),
        Statement("* - text", neutral, "structure block", samples=("* - text",)),
    ]  # fmt: skip
    rows += [Statement(f"M{m}", refused, why, fix, (f"L X+1 R0 FMAX M{m}",)) for m, (why, fix) in M_REFUSED.items()]
    rows += [Statement(word, refused, why, fix, (sample or _SAMPLES[word],))
             for word, (why, fix, sample) in REFUSED.items() if word != "FN"]  # fmt: skip
    rows += [Statement(f"CYCL DEF {n}", refused, why, _MOVES, (f"CYCL DEF {n} CYCLE",))
             for n, why in sorted(CYCLES.items()) if why not in ("", "read") and n < 400]  # fmt: skip
    rows += [
        Statement("CYCL DEF 400 to 499", refused, CYCLES[400], _MOVES, ("CYCL DEF 400 BASIC ROTATION",)),
        Statement("CYCL DEF 800 to 899", refused, CYCLES[800], _MOVES, ("CYCL DEF 800 ADJUST XZ SYSTEM",)),
        Statement("RL", refused, "radius compensation depends on the tool table", _CAM, ("L X+1 RL F500",)),
        Statement("RR", refused, "radius compensation depends on the tool table", _CAM, ("L X+1 RR F500",)),
        Statement("FZ", refused, "the number of teeth is in the tool table", _VALUE, ("L X+1 FZ0.1",)),
        Statement("PLANE AXIAL", refused, "positions of rotary axes belong to a machine", "Write PLANE SPATIAL",
                  ("PLANE AXIAL B+30 TURN FMAX",)),
        Statement("PLANE PROJECTED", refused, "the direction of X in a projected plane is not read",
                  "Write PLANE SPATIAL", ("PLANE PROJECTED PROPR+30 PROMIN+0 ROT+0 TURN FMAX",)),
        Statement("CYCL CALL PAT", refused, "point patterns are not read", "Write L with M99", ("CYCL CALL PAT FMAX",)),
        Statement("CYCL CALL POS", refused, "a position of a cycle call is not read", "Write L with M99",
                  ("CYCL CALL POS X+1 Y+1 Z+0 FMAX",)),
    ]  # fmt: skip
    return tuple(rows)


TABLE: Final = StatementTable("heidenhain", "HEIDENHAIN TNC 640 (34059x-05), Klartext", _rows())

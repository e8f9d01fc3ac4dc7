"""Statements of FANUC TP: what the reader does with each."""

from __future__ import annotations

import re
from typing import Final

from counterflex.programs.statement_table import Statement, StatementTable, Treatment

_E, _N, _R = Treatment.EVALUATED, Treatment.NEUTRAL, Treatment.REFUSED
_POST: Final = "Post the path without it"
_AS_M_CODE: Final = "Name the statement in [controller.spindle.fanuc] (m_codes) of the cell file if it moves nothing"


def _row(word: str, treatment: Treatment, reason: str, *samples: str, remedy: str = "") -> Statement:
    return Statement(word, treatment, reason, remedy, samples)


_MOTIONS: Final = (
    _row("J", _E, "rapid to a position", "J P[1] 20% FINE"),
    _row("L", _E, "straight motion at a speed", "L P[1] 25mm/sec CNT100"),
    _row("C", _E, "circle through the first position to the second", "C P[1]\n    :  P[2] 25mm/sec FINE"),
    _row("A", _E, "chain of points on one circle", "A P[1] 25mm/sec FINE"),
    _row("S", _R, "the curve of a spline is the controller's own", "S P[1] 25mm/sec FINE", remedy="Post the path as L"),
)
OPTION: Final = "option "
"""Begins the key of an option of a motion."""
_OPTIONS: Final = (
    *(
        _row(f"{OPTION}{word}", _E, reason, f"L P[1] 25mm/sec {sample}")
        for word, reason, sample in (
            ("FINE", "the robot stops at the end", "FINE"),
            ("CNT", "the corner is rounded", "CNT100"),
            ("CD", "distance at which the corner is rounded", "CD5"),
            ("CR", "radius of the corner", "CR5"),
            ("ACC", "carried: acceleration, not path or speed", "FINE ACC50"),
            ("PTH", "carried: short motions run more evenly", "CNT100 PTH"),
            ("BREAK", "carried: the controller does not look ahead", "FINE BREAK"),
            ("MROT", "carried: of J, which is a rapid", "FINE MROT"),
            ("AP_LD", "carried: length that is not rounded", "CNT100 AP_LD50"),
            ("RT_LD", "carried: length that is not rounded", "CNT100 RT_LD50"),
            ("EV", "carried: speed of external axes, which stand still", "FINE EV50%"),
            ("COORD", "carried: the positioner stands still", "FINE COORD"),
            ("INC", "the end counts from the end before", "FINE INC"),
            ("Offset", "added to the end in the user frame", "FINE Offset,PR[1]"),
            ("Tool_Offset", "turned and added in the tool frame", "FINE Tool_Offset,PR[1]"),
            ("TA", "something happens behind the end", "FINE TA .10sec,DO[1]=ON"),
            ("TB", "something happens before the end", "FINE TB .10sec,DO[1]=ON"),
            ("DB", "something happens before the end", "FINE DB 5.0mm,DO[1]=ON"),
        )
    ),
    *(
        _row(f"{OPTION}{word}", _R, reason, f"L P[1] 25mm/sec FINE {word}", remedy=_POST)
        for word, reason in (
            ("Wjnt", "the wrist runs by axes: the tool's axis between the ends is not known"),
            ("RTCP", "the tool stands still, the part moves"),
            ("VOFFSET", "a camera displaces the target"),
            ("Skip", "an input ends the motion: where the robot stops is not known"),
            ("PSPD", "the speed is multiplied by a process speed"),
            ("Weave", "the path swings"),
        )
    ),
)
_FRAMES: Final = (
    _row("UFRAME_NUM", _E, "active user frame", "UFRAME_NUM=1"),
    _row("UTOOL_NUM", _E, "active tool frame", "UTOOL_NUM=1"),
    _row("UFRAME[]", _E, "value of a user frame", "UFRAME[2]=PR[1]"),
    _row("UTOOL[]", _E, "value of a tool frame", "UTOOL[2]=PR[1]"),
    _row("OFFSET CONDITION", _E, "offset of motions with Offset", "OFFSET CONDITION PR[1]"),
    _row("TOOL_OFFSET CONDITION", _E, "offset of motions with Tool_Offset", "TOOL_OFFSET CONDITION PR[1]"),
    _row("VOFFSET CONDITION", _R, "a camera displaces the motions", "VOFFSET CONDITION VR[1]", remedy=_POST),
)
_SPEEDS: Final = (
    _row("OVERRIDE", _E, "factor of all speeds", "OVERRIDE=100%"),
    _row("LINEAR_MAX_SPEED", _E, "largest speed along the path, mm/sec", "LINEAR_MAX_SPEED=2000"),
    _row("JOINT_MAX_SPEED[]", _N, "limits axes, not the speed along the path", "JOINT_MAX_SPEED[3]=50"),
    _row("$MCR.$GENOVERRIDE", _E, "factor of all speeds", "$MCR.$GENOVERRIDE=100"),
    _row("$MCR.$PRGOVERRIDE", _E, "factor of all speeds", "$MCR.$PRGOVERRIDE=100"),
    _row("$WAITTMOUT", _N, "how long WAIT waits for an input", "$WAITTMOUT=200"),
    _row("$", _R, "a system variable can change speeds, frames and the path", "$SCR.$ORIENTOL=10",
         remedy="Set it in the controller, outside of the program"),
)  # fmt: skip
_VALUES: Final = (
    _row("R[]", _E, "register", "R[9]=(R[8]+2)*3"),
    _row("PR[]", _E, "position register, whole or one element", "PR[9,3]=12.5"),
    _row("P[]", _E, "position", "P[9]=PR[1]"),
    _row("F[]", _E, "flag", "F[1]=(ON)"),
    _row("M[]", _E, "marker", "M[1]=(ON)"),
    _row("SR[]", _E, "string register", "SR[1]='text'"),
    _row("TIMER[]", _N, "a clock", "TIMER[1]=START"),
    _row("LOCK PREG", _N, "keeps other tasks from position registers", "LOCK PREG"),
    _row("UNLOCK PREG", _N, "ends LOCK PREG", "UNLOCK PREG"),
    _row("GET_VAR", _R, "which register it sets is known to the controller alone", "GET_VAR PROG X R[1]", remedy=_POST),
    _row("SET_VAR", _R, "sets a variable of KAREL", "SET_VAR PROG X 1", remedy=_POST),
)
_FLOW: Final = (
    _row("!", _N, "remark", "!remark"),
    _row("//", _N, "statement that is commented out", "//L P[1] 20mm/sec FINE"),
    _row("--", _N, "remark of several lines", "-- eg:remark"),
    _row("LBL[]", _E, "label", "LBL[1:again]"),
    _row("JMP", _E, "jump to a label", "JMP LBL[1]"),
    _row("IF", _E, "condition", "IF R[1]=2,JMP LBL[1]"),
    _row("ELSE", _E, "other branch of IF and SELECT", "ELSE"),
    _row("ENDIF", _E, "end of IF", "ENDIF"),
    _row("SELECT", _E, "branches by the value of a register", "SELECT R[1]=1,CALL PART"),
    _row("=", _E, "further branch of SELECT", "=2,CALL PART"),
    _row("FOR", _E, "counted loop", "FOR R[1]=1 TO 3"),
    _row("ENDFOR", _E, "end of FOR", "ENDFOR"),
    _row("CALL", _E, "a program whose listing lies in the folder", "CALL PART(1)"),
    _row("RUN", _E, "a program without motions, beside this one", "RUN WATCH"),
    _row("END", _E, "end of the program", "END"),
    _row("RETURN", _E, "end of the program", "RETURN"),
    _row("ABORT", _E, "end of all programs", "ABORT"),
    _row("PAUSE", _E, "stop until a person goes on", "PAUSE"),
    _row("WAIT", _E, "dwell of a time; waits for an input", "WAIT DI[1]=ON"),
    _row("ERROR_PROG", _N, "runs behind an alarm", "ERROR_PROG=RESCUE"),
    _row("RESUME_PROG[]", _N, "runs behind an alarm", "RESUME_PROG[1]=RESCUE"),
    _row("RESUME_PROG", _N, "runs behind an alarm", "RESUME_PROG=RESCUE"),
    _row("MAINT_PROG[]", _N, "runs behind an alarm", "MAINT_PROG[1]=RESCUE"),
    _row("CLEAR_RESUME_PROG", _N, "runs behind an alarm", "CLEAR_RESUME_PROG"),
    _row("RETURN_PATH_DSBL", _N, "holds behind an alarm", "RETURN_PATH_DSBL"),
    _row("MONITOR", _N, "watches a condition; what it calls has no motion group", "MONITOR WATCH"),
    _row("MONITOR END", _N, "ends MONITOR", "MONITOR END WATCH"),
    _row("WHEN", _R, "belongs into a program of conditions", "WHEN DI[1]=ON,CALL X", remedy="Give the program that "
         "holds the path"),
)  # fmt: skip
_CELL: Final = (
    _row("DO[]", _N, "output", "DO[1]=ON", "DO[2:clamp]=PULSE,0.5sec"),
    _row("RO[]", _N, "output", "RO[1]=OFF"),
    _row("GO[]", _N, "output", "GO[1]=R[3]"),
    _row("AO[]", _N, "output", "AO[1]=12"),
    _row("SO[]", _N, "output of the operator's panel", "SO[1]=ON"),
    _row("UO[]", _N, "output to the line", "UO[1]=ON"),
    _row("WO[]", _N, "output of a welding set", "WO[1]=ON"),
    _row("SPO[]", _N, "output", "SPO[1]=ON"),
    _row("UALM[]", _N, "alarm of the user", "UALM[1]"),
    _row("MESSAGE[]", _N, "text on the screen", "MESSAGE[next part]"),
    _row("PAYLOAD[]", _N, "load for the controller's own model of gravity", "PAYLOAD[2]"),
    _row("COL DETECT", _N, "watches for a collision", "COL DETECT OFF"),
    _row("COL GUARD ADJUST", _N, "sensitivity to a collision", "COL GUARD ADJUST 120"),
    _row("DIAG_REC[]", _N, "records for diagnosis", "DIAG_REC[1,5,2]"),
    _row("RSR[]", _N, "requests of other programs", "RSR[1]=ENABLE"),
    _row("SEMAPHORE[]", _N, "order of tasks", "SEMAPHORE[1]=ON"),
    _row("SKIP CONDITION", _N, "takes effect at motions with Skip, which are refused", "SKIP CONDITION DI[1]=ON"),
)
_SENSORS: Final = tuple(
    _row(word, _R, reason, sample, remedy=_POST)
    for word, reason, sample in (
        ("VISION", "a camera decides where the robot goes", "VISION RUN_FIND 'A'"),
        ("VR[]", "a camera decides where the robot goes", "VR[1]=VR[2]"),
        ("SOFTFLOAT", "an axis yields", "SOFTFLOAT[1]"),
        ("SOFTFLOAT[]", "an axis yields", "SOFTFLOAT[1]"),
        ("FOLLOW UP", "an axis yields", "FOLLOW UP"),
        ("FORCE", "a force decides where the robot goes", "FORCE CTRL[1]"),
        ("TORQ_LIMIT", "an axis yields", "TORQ_LIMIT 50%"),
        ("CONTACT STOP", "a force decides where the robot goes", "CONTACT STOP"),
        ("TRACK", "a sensor displaces the path", "TRACK TAST[1]"),
        ("TOUCH", "a sensor displaces the path", "TOUCH OFFSET PR[1]"),
        ("SEARCH", "a sensor displaces the path", "SEARCH START[1]"),
        ("WEAVE", "the path swings", "WEAVE SINE[1]"),
        ("LINE", "the path follows a conveyor", "LINE[1] ON"),
        ("LINE[]", "the path follows a conveyor", "LINE[1] ON"),
        ("SETTRIG", "the path follows a conveyor", "SETTRIG LNSCH[1] R[1]"),
        ("DEFENC[]", "the path follows a conveyor", "DEFENC[1]"),
        ("STOP_TRACKING", "the path follows a conveyor", "STOP_TRACKING"),
        ("PALLETIZING", "a pallet's counter decides where the robot goes", "PALLETIZING-B_1"),
        ("PL[]", "a pallet's counter decides where the robot goes", "PL[1]=[1,1,1]"),
        ("INDEPENDENT", "another group moves", "INDEPENDENT GP"),
        ("SIMULTANEOUS", "another group moves", "SIMULTANEOUS GP"),
        ("FIND", "a displacement is computed from other programs", "FIND SHIFT"),
        ("STITCH", "motions are interrupted", "STITCH"),
        ("RTCP", "the tool stands still, the part moves", "RTCP"),
    )
)
_PROCESS: Final = tuple(
    _row(word, _R, reason, sample, remedy=_AS_M_CODE)
    for word, reason, sample in (
        ("ARC", "welding", "ARC START[1]"),
        ("SPOT[]", "spot welding", "SPOT[1]"),
        ("SS", "sealing", "SS[1]"),
        ("PASS", "of an application package", "PASS"),
        ("BACKUP", "spot welding", "BACKUP=OPEN"),
        ("GUN", "spot welding", "GUN ON"),
        ("CALC", "of an application package", "CALC"),
        ("PROC_START", "of an application package", "PROC_START"),
    )
)
TABLE: Final = StatementTable(
    "fanuc",
    "FANUC Robot series R-30iB and R-30iB Plus, Operator's manual (basic operation), chapters 4 and 9",
    (*_MOTIONS, *_OPTIONS, *_FRAMES, *_SPEEDS, *_VALUES, *_FLOW, *_CELL, *_SENSORS, *_PROCESS),
)
ACTING: Final = frozenset(
    ("DO[]", "RO[]", "GO[]", "AO[]", "SO[]", "UO[]", "WO[]", "SPO[]", "UALM[]", "MONITOR", "MONITOR END", "F[]",
     "M[]")
)  # fmt: skip
"""Statements that act on the cell, or wait for it."""
_WORD: Final = re.compile(
    r"(?P<system>\$\w+(?:\[[^\]]*\])?(?:\.\$\w+(?:\[[^\]]*\])?)*)|(?P<sign>!|//|--|=)"
    r"|(?P<one>[A-Za-z_]\w*)(?P<index>\s*\[)?(?:\s+(?P<two>[A-Za-z_]+)(?:\s+(?P<three>[A-Za-z_]+))?)?"
)


def row_of(code: str) -> Statement | None:
    """Return the row of a statement; None where no row names it."""
    match = _WORD.match(code)
    if match is None:
        return None
    if match["sign"] is not None:
        return TABLE.find(match["sign"])
    if match["system"] is not None:
        return TABLE.find(re.sub(r"\[[^\]]*\]", "", match["system"])) or TABLE.find("$")
    one, two, three = match["one"], match["two"], match["three"]
    if match["index"] is not None:
        return TABLE.find(f"{one}[]")
    words = (f"{one} {two} {three}" if three else "", f"{one} {two}" if two else "", one)
    return next((row for word in words if word and (row := TABLE.find(word)) is not None), None)

"""All major words of APT and CL files for milling, and what the reader does with each.

Source: ISO 4343 (processor output), and the files that CATIA, Creo, NX and SolidWorks CAM write.
"""

from __future__ import annotations

import re
from typing import Final

from counterflex.core.units import INCH, MM
from counterflex.programs.statement_table import Statement, StatementTable, Treatment

_GOTO: Final = "Let the CAM system write GOTO"
_EVALUATED: Final[tuple[tuple[str, str, str], ...]] = (
    ("GOTO", "target, tool axis", "GOTO/1,2,3"),
    ("GODLTA", "target from where the tool stands; one number: along the tool axis", "GODLTA/1,0,0"),
    ("FROM", "where the tool stands at the start", "FROM/0,0,50"),
    ("CIRCLE", "arc to the next GOTO", "CIRCLE/0,0,0,0,0,1,5"),
    ("MOVARC", "arc to the next GOTO", "MOVARC/0,0,0,0,0,1,5"),
    ("INDIRV", "direction in which TLON sets off", "INDIRV/1,0,0"),
    ("TLON", "arc to a line", "TLON,GOFWD/(CIRCLE/0,0,0,5),ON,(LINE/0,0,0,0,5,0)"),
    ("RAPID", "the next motion is a rapid", "RAPID"),
    ("FEDRAT", "feed and its unit", "FEDRAT/600,MMPM"),
    ("SPINDL", "spindle", "SPINDL/RPM,3000,CLW"),
    ("COOLNT", "coolant", "COOLNT/ON"),
    ("LOADTL", "tool", "LOADTL/1"),
    ("LOAD", "tool", "LOAD/TOOL,1"),
    ("TLAXIS", "tool axis of a GOTO without one", "TLAXIS/0,0,1"),
    ("UNITS", "unit of lengths", "UNITS/MM"),
    ("UNIT", "unit of lengths", "UNIT/MM"),
    ("MM", "unit of lengths", "MM"),
    ("INCH", "unit of lengths", "INCH"),
    ("INCHES", "unit of lengths", "INCHES"),
    ("DELAY", "dwell in seconds", "DELAY/0.5"),
    ("STOP", "stop", "STOP"),
    ("OPSTOP", "stop", "OPSTOP"),
    ("AUXFUN", "M code that moves nothing; others are refused", "AUXFUN/8"),
    ("MSYS", "coordinate system of the file; a second one is refused", "MSYS/0,0,0,1,0,0,0,1,0"),
    ("$$-> CSYS", "coordinate system of the file; a second one is refused", "$$-> CSYS / 1,0,0,0,0,1,0,0,0,0,1,0"),
    ("GOHOME", "to a place of the machine that is not known: only the end may follow", "GOHOME"),
    ("FINI", "end", "FINI"),
    ("END", "end, as CATIA writes it", "END"),
)  # fmt: skip
_NEUTRAL: Final[tuple[tuple[str, str, str], ...]] = (
    ("PARTNO PPRINT REMARK MACHIN PLABEL TPRINT TOOL_PATH PAINT", "text", "*/TEXT"),
    ("INSERT", "text of the control without codes; text with codes is refused", "INSERT/(TEXT)"),
    ("CUTTER TLDATA TOOLNO SELECT SELCTL SELECTL", "shape and number of the tool: the cell file has them", "*/10"),
    ("INTOL OUTTOL TOLER LINTOL ARCSLP", "tolerance of the points that are written", "*/0.01"),
    ("MULTAX", "GOTO has a tool axis, or none", "MULTAX/ON"),
    ("MODE HEAD AUTOPS SWITCH NOPOST CLPRNT DISPLY CLRSRF CLEARP", "settings of the post processor", "*/ON"),
    ("OPSKIP SEQNO LEADER REWIND TMARK BREAK END-OF-PATH", "numbers and marks of blocks", "*"),
    ("FIXTURE", "name of a fixture", "FIXTURE/1"),
    ("CSI_...", "notes of SolidWorks CAM; those of frames, cycles and offsets are refused", "CSI_OPERATION/1"),
    ("$$", "comment; one that ends in $ goes on in the next line", "$$ TEXT"),
    ("CUTCOM/OFF", "no cutter radius compensation", "CUTCOM/OFF"),
    ("CYCLE/OFF", "no cycle", "CYCLE/OFF"),
    ("TRACUT/NOMORE", "no transformation", "TRACUT/NOMORE"),
    ("COPY/NOMORE", "no copies", "COPY/NOMORE"),
    ("ORIGIN/0,0,0", "the zero of the file", "ORIGIN/0,0,0"),
    ("TRANS/0,0,0", "no shift", "TRANS/0,0,0"),
    ("SET/OFSETL", "number of a tool length offset", "SET/OFSETL,1"),
)
_REFUSED: Final[tuple[tuple[str, str, str, str], ...]] = (
    ("INDIRP GOFWD GOLFT GORGT GOBACK GO", "geometry that a post processor must solve is not read",
     "Write the file with CIRCLE or GOTO", "*/1,2,3"),
    ("TLLFT TLRGT", "geometry that a post processor must solve is not read", "Write the file with CIRCLE or GOTO",
     "*,GOFWD/L1,ON,L2"),
    ("RETRCT SAFPOS", "a motion of the machine to a height that is not known", _GOTO, "*"),
    ("ORIGIN TRANS MATRIX TRACUT ROTATE ROTABL ROTHED COPY PIVOTZ", "motions and frames of the machine are not read",
     _GOTO, "*/1,2,3"),
    ("CUTCOM", "cutter radius compensation is not read", _GOTO, "CUTCOM/LEFT"),
    ("CYCLE", "machining cycles are not read", _GOTO, "CYCLE/DRILL,10,MMPM,100"),
    ("PREFUN", "a G code of the control", "Use the words of APT", "PREFUN/54"),
    ("SET", "a setting of the post processor that is not read", "Take it out of the file", "SET/MODE"),
    ("MACRO CALL TERMAC JUMPTO IF LOOPST LOOPND DEFSUB ENDSUB CALSUB INDEX", "macros and jumps are not read", _GOTO,
     "*/1"),
    ("SPLINE NURBS POLYN BSPLIN", "splines are not read", _GOTO, "*/1"),
    ("THREAD TAP PROBE TURRET", "threads, probing and turning are not milling of a path", _GOTO, "*/1"),
    ("CLAMP", "a clamp may stop an axis", "Take it out of the file", "CLAMP/ON"),
)  # fmt: skip
NOTES: Final = "CSI_"
"""Beginning of the words that SolidWorks CAM writes for its own post processors."""


def _rows() -> list[Statement]:
    rows = [Statement(word, Treatment.EVALUATED, reason, samples=(sample,)) for word, reason, sample in _EVALUATED]
    for words, reason, sample in _NEUTRAL:
        for word in words.split():
            shown = word.replace("_", " ") if word == "TOOL_PATH" else word
            rows.append(Statement(shown, Treatment.NEUTRAL, reason, samples=(sample.replace("*", shown),)))
    for words, reason, remedy, sample in _REFUSED:
        rows += [Statement(w, Treatment.REFUSED, reason, remedy, (sample.replace("*", w),)) for w in words.split()]
    return rows


TABLE: Final = StatementTable(
    "apt", "ISO 4343, with the words that CATIA, Creo, NX and SolidWorks CAM write", tuple(_rows())
)


POST: Final = "Let the CAM system write GOTO"
CARRIED: Final = frozenset(row.word for row in TABLE.of(Treatment.NEUTRAL) if "/" not in row.word)
"""Words that change no target."""
READ: Final = tuple(row.word for row in TABLE.of(Treatment.EVALUATED))
REFUSED: Final = {row.word: (row.reason, row.remedy) for row in TABLE.of(Treatment.REFUSED)}
"""Words that the reader knows and does not take."""
HARMLESS: Final = {
    tuple(row.word.split("/", 1)) for row in TABLE.of(Treatment.NEUTRAL) if "/" in row.word and row.word[0] != "$"
}
"""Words that are neutral with these arguments, and refused with others."""
MOVES_FRAMES: Final = re.compile(
    r"TRANS|ROT|CSYS|ORIG|MATRIX|COORD|CYCLE|HOME|OFFSET|DRILL|TAP|PLANE|AXIS|MOVE|FEED|SPEED"
)
"""Notes of SolidWorks CAM that may not be neutral."""
CODES: Final = re.compile(r"(?<![A-Z])[GMTSF]\d|(?<![A-Z])[XYZABCIJKR]\s*[-+=]?\s*[\d.#]", re.IGNORECASE)
"""Codes and targets in a text for the control (INSERT)."""
FEEDS: Final = {
    "MMPM": (94, MM), "IPM": (94, INCH), "MMPR": (95, MM), "IPR": (95, INCH), "PERMIN": (94, 0.0), "PERREV": (95, 0.0),
    "MPM": (94, 1.0),
}  # fmt: skip
COOLANT: Final = {"ON": 8, "FLOOD": 8, "TAP": 8, "THRU": 8, "TAPKUL": 8, "MIST": 7, "AIR": 7, "OFF": 9}
LOADS: Final = (
    "ADJUST", "LENGTH", "OSETNO", "ZOFF", "IN", "OFFSET", "MILL", "AUTO", "MANUAL", "MODIFY", "LARGE", "SMALL",
    "HIGH", "LOW",
)  # fmt: skip
"""Words of a tool change that move nothing in the part: its place in the magazine, registers, how it is changed."""
NEUTRAL_M: Final = frozenset(
    (0, 1, 7, 8, 9, 10, 11, 12, 13, 31, 33, 34, 35, 40, 41, 42, 48, 49, 50, 51, 83, 84, 88, 89)
)
"""M codes of AUXFUN that move nothing."""
TURNS: Final = {"CLW": 1, "FWD": 1, "CCLW": -1, "REV": -1, "OFF": 0, "ORIENT": 0, "LOCK": 0}
"""Sense of the spindle; clockwise where none is named."""

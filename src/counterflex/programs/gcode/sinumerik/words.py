"""Which codes and words of Sinumerik the reader knows, by group, and why it refuses the others.

Source: SINUMERIK 840D sl, Programming Manual Fundamentals and Job Planning: lists of G groups and of statements.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from counterflex.programs.gcode.sinumerik.cycles import NAMES


@dataclass(frozen=True)
class WordTable:
    """Words of a dialect that is read as Sinumerik is.

    Attributes:
        dialect: Its name, for errors.
        group: Modal group of each code or word that is read.
        carried: Words that change no target.
        carried_values: The same with a value.
        refused: Words that are known and not taken, with the reason and what to do.
        m_codes: M codes that are read.
        cycles: Beginnings of the names of machining cycles.
        drilling: Names of cycles that are read.
    """

    dialect: str
    group: Mapping[str, str]
    carried: frozenset[str]
    carried_values: frozenset[str]
    refused: Mapping[str, tuple[str, str]]
    m_codes: frozenset[int]
    cycles: tuple[str, ...]
    drilling: tuple[str, ...] = ()


_OFFSETS: Final = ("G54", "G55", "G56", "G57", *(f"G{number}" for number in range(505, 600)))
GROUP: Final[dict[str, str]] = {
    **dict.fromkeys(("G0", "G1", "G2", "G3", "CIP"), "motion"),
    "G4": "dwell",
    **dict.fromkeys(("G17", "G18", "G19"), "plane"),
    **dict.fromkeys(("G70", "G71", "G700", "G710"), "unit"),
    **dict.fromkeys(("G90", "G91"), "distance"),
    **dict.fromkeys(("G93", "G94", "G95"), "feed"),
    "G40": "cutter radius",
    **dict.fromkeys(("G500", *_OFFSETS), "work offset"),
    **dict.fromkeys(("G53", "G153", "SUPA"), "machine"),
    **dict.fromkeys(("G60", "G64", "G641", "G642", "G643", "G644", "G645"), "path control"),
    **dict.fromkeys(("G601", "G602", "G603"), "exact stop"),
    "G9": "exact stop once",
    **dict.fromkeys(("G450", "G451"), "corner"),
    **dict.fromkeys(("TRANS", "ATRANS", "ROT", "AROT"), "frame"),
    **dict.fromkeys(("TRAORI", "TRAFOOF"), "transformation"),
}
"""Modal group of each code or word that is read."""
_SETTINGS: Final = """
BRISK SOFT DRIVE BRISKA SOFTA FFWON FFWOF CFC CFTCP CFIN COMPOF COMPON COMPCURV COMPCAD COMPSURF STOPRE MSG ORIWKS
ORIMKS
ORIVECT ORIPLANE ORIAXES ORISOF ORISON UPATH SPATH FIFOCTRL STARTFIFO STOPFIFO CYCLE832 WORKPIECE GROUP_BEGIN GROUP_END
DISPLOF DISPLON ACTBLOCNO FNORM FLIN DIAMOF SETMS KONT NORM CDOF CDOF2 WALIMOF
"""
CARRIED: Final = frozenset(re.findall(r"\w+", _SETTINGS))
"""Words that change no target: how the control accelerates, smooths, shows."""
CARRIED_VALUES: Final = frozenset(("ADIS", "ADISPOS", "OTOL", "CTOL", "FL", "ACC", "DISC"))
"""The same with a value: ``ADIS=0.05``."""
_CAM: Final = "Let the CAM system write the tool-centre path"
_MOVES: Final = "Let the CAM system write the moves of the cycle"
_UNROLLED: Final = "Post the program without subprograms, jumps and calculations"
_FLOW: Final = """
IF ELSE ENDIF FOR ENDFOR WHILE ENDWHILE REPEAT REPEATB UNTIL LOOP ENDLOOP GOTO GOTOF GOTOB GOTOC CASE CALL EXTCALL PCALL
PROC DEF REDEF ID IDS WHEN WHENEVER DO EVERY
"""
REFUSED: Final[dict[str, tuple[str, str]]] = {
    "G41": ("cutter radius compensation G41 depends on the control's tool table", _CAM),
    "G42": ("cutter radius compensation G42 depends on the control's tool table", _CAM),
    **dict.fromkeys(
        ("G33", "G34", "G35", "G63", "G331", "G332"), ("threads and tapping are not milling of a path", _MOVES)
    ),
    **dict.fromkeys(("G74", "G75"), ("a fixed point of the machine is not known here", "Retract with a plain G0")),
    **dict.fromkeys(("G58", "G59"), ("axial offsets G58 and G59 are not read", "Use TRANS and ATRANS")),
    **dict.fromkeys(("G110", "G111", "G112", "AP", "RP"), ("polar coordinates are not read", "Post X, Y and Z")),
    **dict.fromkeys(("G96", "G961", "G97", "G971"), ("constant cutting speed is turning, not milling", "Use S in rpm")),
    "CT": ("the tangential arc CT is not read", "Post G2 or G3 with I J K or CR="),
    **dict.fromkeys(("ASPLINE", "BSPLINE", "CSPLINE", "POLY", "OEMIPO1"), ("splines are not read", "Post G1")),
    **dict.fromkeys(("RND", "RNDM", "CHF", "CHR"), ("chamfers and roundings are not read", _CAM)),
    **dict.fromkeys(
        ("SCALE", "ASCALE", "MIRROR", "AMIRROR", "ROTS", "AROTS", "CROTS", "TOFRAME", "TOROT", "CYCLE800"),
        ("this frame is not read", "Post with TRANS, ATRANS, ROT, AROT, or without frames"),
    ),
    **dict.fromkeys(
        ("TRANSMIT", "TRACYL", "TRAANG", "TRACON"), ("this transformation is not read", "Use TRAORI or none")
    ),
    **dict.fromkeys(("ORICONCW", "ORICONCCW", "ORICONIO", "ORICURVE", "A2", "B2", "C2", "LEAD", "TILT", "A4", "A5"),
                    ("this way of giving the tool axis is not read", "Post A3= B3= C3=")),
    **dict.fromkeys(
        re.findall(r"\w+", _FLOW),
        ("jumps, loops, subprograms and variables are not read", _UNROLLED),
    ),
}  # fmt: skip
"""Words that the reader knows and does not take, with the reason and what to do."""
REFUSED_CYCLE: Final = ("machining cycles are not read", _MOVES)
REFUSED_CALL: Final = ("a subprogram is called, and subprograms are not read", _UNROLLED)
AXES: Final = "XYZ"
ROTARY: Final = "ABC"
VECTOR: Final = ("A3", "B3", "C3")
M_CODES: Final = frozenset((0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 17, 19, 30, *range(40, 46)))
M_END: Final = frozenset((2, 17, 30))
SINUMERIK: Final = WordTable(
    "Sinumerik", GROUP, CARRIED, CARRIED_VALUES, REFUSED, M_CODES,
    ("CYCLE", "HOLES", "SLOT", "POCKET", "LONGHOLE", "ORI"), NAMES,
)  # fmt: skip

"""Which words of APT the reader knows, and why it refuses the others.

Source: ISO 4343, numerical control of machines, processor output.
"""

from __future__ import annotations

from typing import Final

from counterflex.core.units import INCH, MM
from counterflex.programs.apt.statements import FREE_TEXT

CARRIED: Final = FREE_TEXT | frozenset(
    ("CUTTER", "TLDATA", "INTOL", "OUTTOL", "TOLER", "LINTOL", "CLEARP", "OPSKIP", "SEQNO", "SELCTL", "TOOLNO",
     "SELECT", "END-OF-PATH", "MSYS", "NOPOST", "CLPRNT", "DISPLY", "MODE", "HEAD", "CLRSRF", "ARCSLP", "FIXTURE",
     "AUTOPS", "SELECTL", "SWITCH")
)  # fmt: skip
"""Words that change no target."""
READ: Final = (
    "GOTO", "GODLTA", "FROM", "CIRCLE", "MOVARC", "INDIRV", "RAPID", "FEDRAT", "SPINDL", "COOLNT", "LOADTL", "LOAD",
    "TLAXIS", "MULTAX","UNITS", "MM", "INCH", "INCHES", "DELAY", "STOP", "OPSTOP", "CUTCOM", "CYCLE", "FINI",
)  # fmt: skip
POST: Final = "Let the CAM system write GOTO"
REFUSED: Final[dict[str, tuple[str, str]]] = {
    **dict.fromkeys(("INDIRP", "TLON", "TLLFT", "TLRGT", "GOFWD", "GOLFT", "GORGT", "GOBACK", "GO"),
                    ("geometry that a post processor must solve is not read", "Write the file with CIRCLE or GOTO")),
    **dict.fromkeys(("GOHOME", "RETRCT", "ORIGIN", "TRANS", "ROTATE", "ROTABL", "ROTHED", "COPY", "TRACUT"),
                    ("motions and frames of the machine are not read", POST)),
    **dict.fromkeys(("AUXFUN", "PREFUN"), ("functions of the machine are not read", "Use SPINDL, COOLNT, LOADTL")),
    **dict.fromkeys(("MACRO", "CALL", "TERMAC", "JUMPTO", "IF", "LOOPST"), ("macros and jumps are not read", POST)),
    **dict.fromkeys(("SPLINE", "NURBS", "POLYN"), ("splines are not read", POST)),
}  # fmt: skip
"""Words that the reader knows and does not take."""
FEEDS: Final = {"MMPM": (94, MM), "IPM": (94, INCH), "MMPR": (95, MM), "IPR": (95, INCH), "PERMIN": (94, 0.0),
                 "PERREV": (95, 0.0)}  # fmt: skip
COOLANT: Final = {"ON": 8, "FLOOD": 8, "MIST": 7, "OFF": 9}

"""The words of APT as the reader asks for them, from the table of statements, and their units and coolants."""

from __future__ import annotations

import re
from typing import Final

from counterflex.core.units import INCH, MM
from counterflex.programs.apt.word_table import TABLE
from counterflex.programs.statement_table import Treatment

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

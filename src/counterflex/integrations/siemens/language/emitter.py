"""Write Sinumerik: steps of another language, and the spelling of what a compensation adds."""

from __future__ import annotations

import re
from typing import ClassVar, Final

from counterflex.programs.convert.emitter import Conversion
from counterflex.programs.convert.machine_languages import OWN_CODES, GcodeEmitter
from counterflex.programs.convert.steps import Move
from counterflex.programs.gcode.sinumerik import LIMITS
from counterflex.programs.gcode.write.spelling import Spelling
from counterflex.programs.gcode.write.written_line import number

SPELLING: Final = Spelling(
    "CR=", ("A3=", "B3=", "C3="), ("; ", ""), LIMITS.line_characters, re.compile(r"\s*(%|;\$PATH=)", re.IGNORECASE)
)


class SinumerikEmitter(GcodeEmitter):
    """Sinumerik; the tool axis as A3 B3 C3 under TRAORI."""

    language: ClassVar[str] = "sinumerik"
    words_of_codes: ClassVar[bool] = False
    ending: ClassVar[str] = ".mpf"
    vector: ClassVar[tuple[str, str, str]] = ("A3=", "B3=", "C3=")
    codes: ClassVar[frozenset[int]] = OWN_CODES | frozenset((19, *range(40, 46)))

    def begin(self) -> None:
        """Units, plane, distances."""
        self.comment(self.origin())
        self.lines.append("G17 G54 G71 G90 G94")
        if self.turning:
            self.lines += ["TRAORI", "ORIWKS"]
        self._plane = 17

    def comment(self, text: str) -> None:
        """Behind a semicolon."""
        self.lines.append(f"; {text}")

    def dwell(self, move: Move) -> None:
        """G4 in seconds."""
        self.lines.append(f"G4 F{number(move.motion.duration_s, 4)}")

    def turns(self, count: int) -> str:
        """Turns besides the first."""
        return f"TURN={count - 1}"


def convert(order: Conversion) -> SinumerikEmitter:
    """Return the writer of a conversion."""
    return SinumerikEmitter(order.program.name, order.stem, order.tolerance_m)

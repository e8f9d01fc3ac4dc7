"""Write Sinumerik: steps of another language, and the spelling of what a compensation adds."""

from __future__ import annotations

import re
from typing import ClassVar, Final

from counterflex.programs.convert.machine_languages import OWN_CODES, GcodeEmitter
from counterflex.programs.gcode.sinumerik import LIMITS
from counterflex.programs.gcode.write.written_line import Spelling

SPELLING: Final = Spelling(
    "CR=", ("A3=", "B3=", "C3="), ("; ", ""), LIMITS.line_characters, re.compile(r"\s*(%|;\$PATH=)", re.IGNORECASE)
)


class SinumerikEmitter(GcodeEmitter):
    """Sinumerik; the tool axis as A3 B3 C3 under TRAORI."""

    language: ClassVar[str] = "sinumerik"
    words_of_codes: ClassVar[bool] = False
    ending: ClassVar[str] = ".mpf"
    head: ClassVar[str] = "G17 G54 G71 G90 G94"
    turning_head: ClassVar[tuple[str, ...]] = ("TRAORI", "ORIWKS")
    remark: ClassVar[str] = "; {}"
    pause: ClassVar[str] = "G4 F{}"
    vector: ClassVar[tuple[str, str, str]] = ("A3=", "B3=", "C3=")
    codes: ClassVar[frozenset[int]] = OWN_CODES | frozenset((19, *range(40, 46)))

    def turns(self, count: int) -> str:
        """Turns besides the first."""
        return f"TURN={count - 1}"


convert = SinumerikEmitter.of

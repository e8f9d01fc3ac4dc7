"""Write TwinCAT NC I: steps of another language, and the spelling of what a compensation adds."""

from __future__ import annotations

import math
import re
from typing import ClassVar, Final

from counterflex.programs.convert.machine_languages import TURN_HINT, GcodeEmitter
from counterflex.programs.convert.steps import Move
from counterflex.programs.gcode.write.written_line import Spelling
from counterflex.programs.limits import LINUXCNC

SPELLING: Final = Spelling("U", ("I", "J", "K"), ("(", ")"), LINUXCNC.line_characters, re.compile(r"\s*%"))


class TwincatEmitter(GcodeEmitter):
    """TwinCAT NC I; the tool is upright: the control has no word for its axis."""

    language: ClassVar[str] = "twincat"
    words_of_codes: ClassVar[bool] = False
    ending: ClassVar[str] = ".nc"
    head: ClassVar[str] = "G17 G54 G71 G90"
    turning_head: ClassVar[tuple[str, ...]] = ()
    pause: ClassVar[str] = "G4 X{}"
    codes: ClassVar[frozenset[int]] = frozenset(range(160)) - {2, 17, 30}

    def straight(self, move: Move, share: float) -> None:
        """G0 or G1. Raises a ProgramError for a tool that is not upright."""
        if self.turning:
            raise self.refuse(move.line, "tool axis", "the tool is not upright", TURN_HINT)
        super().straight(move, share)

    def arc_shares(self, move: Move) -> list[float] | None:
        """One turn at a time."""
        turns = max(1, math.ceil(abs(move.motion.turn_rad) / (2.0 * math.pi) - 1e-6))
        return [k / turns for k in range(1, turns + 1)] if self.plane(move) else None

    def turns(self, count: int) -> str:
        """Never needed: each turn is a block."""
        raise AssertionError(count)


convert = TwincatEmitter.of

"""Steps as a cutter location file."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.programs.convert.machine_languages import DECIMALS, MachineEmitter
from counterflex.programs.convert.steps import MachineFunction, Move
from counterflex.programs.gcode.write.written_line import number


class AptEmitter(MachineEmitter):
    """Cutter location file (ISO 4343)."""

    language: ClassVar[str] = "apt"
    partial: ClassVar[bool] = False
    _words: ClassVar[dict[int, str]] = {
        0: "STOP", 1: "OPSTOP", 5: "SPINDL/OFF", 7: "COOLNT/MIST", 8: "COOLNT/FLOOD", 9: "COOLNT/OFF",
    }  # fmt: skip

    def begin(self) -> None:
        """Units and axes."""
        self.lines += [f"PARTNO/{self.name.upper()}"]
        self.comment(self.origin())
        self.lines += ["UNITS/MM", *(["MULTAX/ON"] if self.turning else [])]

    def end(self) -> dict[str, str]:
        """One file."""
        return {f"{self.name}.apt": "\n".join([*self.lines, "FINI", ""])}

    def comment(self, text: str) -> None:
        """Behind $$."""
        self.lines.append(f"$$ {text.replace('$', ' ')}")

    def process(self, step: MachineFunction) -> None:
        """SPINDL, COOLNT, LOADTL, STOP."""
        rpm = number(abs(step.block.modal.spindle_rpm), 3)
        if step.code in (3, 4):
            self.lines.append(f"SPINDL/{rpm},RPM,{'CLW' if step.code == 3 else 'CCLW'}")
        elif step.code == 6:
            self.lines.append(f"LOADTL/{step.block.modal.tool}")
        elif step.code in self._words:
            self.lines.append(self._words[step.code])
        else:
            raise self.refuse(
                step.line, " ".join(f"{letter}{value:g}" for letter, value in step.words),
                "there is no word for this machine function", "Leave it out of the program, and write it by hand",
            )  # fmt: skip

    def dwell(self, move: Move) -> None:
        """DELAY in seconds."""
        self.lines.append(f"DELAY/{number(move.motion.duration_s, 4)}")

    def straight(self, move: Move, share: float) -> None:
        """GOTO, with RAPID before it or at its FEDRAT."""
        if move.motion.kind == "rapid":
            self.lines.append("RAPID")
        else:
            self._feed(move)
        self._goto(move, move.at(share))

    def _goto(self, move: Move, p: Float) -> None:
        texts = [number(float(value), DECIMALS) for value in p / MM]
        self.lines.append("GOTO/" + ",".join([*texts, *(self.axis_words(move) if self.turning else [])]))

    def _feed(self, move: Move) -> None:
        feed = self.feed_of(move)
        if feed != self.feed:
            self.feed = feed
            self.lines.append(f"FEDRAT/{feed},MMPM")

    def arc_shares(self, move: Move) -> list[float] | None:
        """One turn at a time."""
        turns = max(1, math.ceil(abs(move.motion.turn_rad) / (2.0 * math.pi) - 1e-6))
        return [k / turns for k in range(1, turns + 1)]

    def arc(self, move: Move, start_share: float, end_share: float) -> None:
        """CIRCLE with centre, axis and radius, and the GOTO that ends it."""
        third = {17: 2, 18: 1, 19: 0}[self.plane(move)]
        self._feed(move)
        motion = move.motion
        start, centre = move.at(start_share), np.asarray(motion.p_centre).copy()
        centre[third] = start[third]
        axis = ["0.0", "0.0", "0.0"]
        axis[third] = "-1.0" if self.clockwise(move) else "1.0"
        radius = float(np.linalg.norm(start - centre))
        words = [number(float(value), DECIMALS) for value in centre / MM]
        self.lines.append("CIRCLE/" + ",".join([*words, *axis, number(radius / MM, DECIMALS)]))
        self._goto(move, move.at(end_share))


convert = AptEmitter.of

"""Steps in languages of machines: what all share, and G-code as LinuxCNC reads it."""

from __future__ import annotations

import math
from typing import ClassVar, Final, Self

import numpy as np

from counterflex.core.units import MM, MM_PER_MIN
from counterflex.programs.convert.emitter import Conversion, ProgramEmitter
from counterflex.programs.convert.steps import MachineFunction, Move
from counterflex.programs.gcode.read.arc import PLANE_AXES
from counterflex.programs.gcode.write.written_line import number

DECIMALS: Final = 4
_AXIS_DECIMALS: Final = 9
_ALONG: Final = 1e-9
OWN_CODES: Final = frozenset((0, 1, 3, 4, 5, 6, 7, 8, 9))
TURN_HINT: Final = "Post straight moves, or convert to a language of robots"


class MachineEmitter(ProgramEmitter):
    """Planes, tool axes, feeds in mm/min: common to languages of machines."""

    partial: ClassVar[bool] = True

    def __init__(self, source: str, name: str, tolerance_m: float) -> None:
        super().__init__(source, name, tolerance_m)
        self.feed = ""

    @classmethod
    def of(cls, order: Conversion) -> Self:
        """Return the writer of a conversion."""
        return cls(order.program.name, order.stem, order.tolerance_m)

    def plane(self, move: Move) -> int:
        """17, 18 or 19. Raises a ProgramError for a circle about another axis, or with a tool that is not upright."""
        motion = move.motion
        normal = np.abs(np.asarray(motion.normal))
        if float(np.sort(normal)[1]) > _ALONG:
            raise self.refuse(move.line, "circle", "its axis is none of X, Y, Z", TURN_HINT)
        if self.turning:
            raise self.refuse(move.line, "circle", "the tool is not upright on it", TURN_HINT)
        return {2: 17, 1: 18, 0: 19}[int(np.argmax(normal))]

    def clockwise(self, move: Move) -> bool:
        """Seen against the axis of its plane."""
        normal = np.asarray(move.motion.normal)
        return float(normal[int(np.argmax(np.abs(normal)))]) * move.motion.turn_rad < 0.0

    def refuse_turn(self, move: Move) -> None:
        """A feed without way has no meaning in mm/min."""
        motion = move.motion
        way = float(np.linalg.norm(np.asarray(motion.p_end) - np.asarray(motion.p_start)))
        if motion.kind == "feed" and way < _ALONG and float(np.abs(move.R_part_tcp - move.R_part_start).max()) > 1e-6:
            raise self.refuse(
                move.line, "turn in place", "F in mm/min is no speed of turning", "Turn it along a motion"
            )

    def feed_of(self, move: Move) -> str:
        """``F`` of a motion, mm/min."""
        return number(move.motion.feed_m_s / MM_PER_MIN, DECIMALS)

    def axis_words(self, move: Move) -> list[str]:
        """Components of the tool axis."""
        return [number(float(value), _AXIS_DECIMALS) for value in move.axis]


class GcodeEmitter(MachineEmitter):
    """G-code as LinuxCNC reads it; the tool axis as I J K under G43.5."""

    language: ClassVar[str] = "gcode"
    words_of_codes: ClassVar[bool] = True
    """M-codes have words of their own."""
    ending: ClassVar[str] = ".ngc"
    head: ClassVar[str] = "G21 G17 G90 G94 G54"
    """Units, plane, distances."""
    turning_head: ClassVar[tuple[str, ...]] = ("G43.5",)
    """Switches the tool axis on."""
    remark: ClassVar[str] = "({})"
    pause: ClassVar[str] = "G4 P{}"
    """A dwell in seconds."""
    vector: ClassVar[tuple[str, str, str]] = ("I", "J", "K")
    codes: ClassVar[frozenset[int]] = OWN_CODES | frozenset((19, *range(50, 54), *range(62, 69), *range(100, 200)))

    def begin(self) -> None:
        """Units, plane, distances."""
        self.comment(self.origin())
        self.lines += [self.head, *(self.turning_head if self.turning else ())]
        self._plane = 17

    def end(self) -> dict[str, str]:
        """One file."""
        return {f"{self.name}{self.ending}": "\n".join([*self.lines, "M30", ""])}

    def comment(self, text: str) -> None:
        """On a line of its own."""
        self.lines.append(self.remark.format(text))

    def process(self, step: MachineFunction) -> None:
        """M-codes."""
        own = [(letter, value) for letter, value in step.words if letter in "PQER"]
        if step.code not in self.codes or (own and not self.words_of_codes):
            raise self.refuse(
                step.line, " ".join(f"{letter}{value:g}" for letter, value in step.words),
                "this machine function is not known there", "Leave it out of the program, and write it by hand",
            )  # fmt: skip
        words = [f"{letter}{value:g}" for letter, value in step.words if letter in "ST"]
        self.lines.append(" ".join([*words, f"M{step.code}", *(f"{letter}{value:g}" for letter, value in own)]))

    def dwell(self, move: Move) -> None:
        """G4 in seconds."""
        self.lines.append(self.pause.format(number(move.motion.duration_s, 4)))

    def straight(self, move: Move, share: float) -> None:
        """G0 or G1."""
        rapid = move.motion.kind == "rapid"
        p = move.at(share) / MM
        words = ["G0" if rapid else "G1"]
        words += [f"{c}{number(float(v), DECIMALS)}" for c, v in zip("XYZ", p, strict=True) if c in move.named]
        if self.turning:
            words += [f"{c}{v}" for c, v in zip(self.vector, self.axis_words(move), strict=True)]
        self.lines.append(" ".join(words) + ("" if rapid else self._feed(move)))

    def _feed(self, move: Move) -> str:
        feed = self.feed_of(move)
        if feed == self.feed:
            return ""
        self.feed = feed
        return f" F{feed}"

    def arc_shares(self, move: Move) -> list[float] | None:
        """As one, with its turns."""
        return [1.0] if self.plane(move) else None

    def arc(self, move: Move, start_share: float, end_share: float) -> None:
        """G2 or G3 with I J K from the start."""
        plane, motion = self.plane(move), move.motion
        if plane != self._plane:
            self._plane = plane
            self.lines.append(f"G{plane}")
        first, second, _ = PLANE_AXES[plane]
        start = np.round(move.at(start_share) / MM, DECIMALS)
        offset = np.asarray(motion.p_centre) / MM - start
        words = ["G2" if self.clockwise(move) else "G3"]
        words += [f"{c}{number(float(v), DECIMALS)}" for c, v in zip("XYZ", move.at(end_share) / MM, strict=True)]
        words += [f"{'IJK'[axis]}{number(float(offset[axis]), DECIMALS + 1)}" for axis in (first, second)]
        turn = abs(motion.turn_rad) * (end_share - start_share)
        turns = max(1, math.ceil(turn / (2.0 * math.pi) - 1e-6))
        words += [self.turns(turns)] if turns > 1 else []
        self.lines.append(" ".join(words) + self._feed(move))

    def turns(self, count: int) -> str:
        """Word of several turns."""
        return f"P{count}"


gcode = GcodeEmitter.of

"""Steps as G-code for LinuxCNC, as Sinumerik, and as a cutter location file (APT)."""

from __future__ import annotations

import math
from typing import ClassVar, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM, MM_PER_MIN
from counterflex.programs.convert.emitter import Emitter
from counterflex.programs.convert.steps import Move, Process
from counterflex.programs.gcode.read.arc import PLANE_AXES
from counterflex.programs.gcode.write.written_line import number

_DECIMALS: Final = 4
_AXIS_DECIMALS: Final = 9
_ALONG: Final = 1e-9
_OWN: Final = frozenset((0, 1, 3, 4, 5, 6, 7, 8, 9))
_TURN_HINT: Final = "Post straight moves, or convert to a language of robots"


class MachineEmitter(Emitter):
    """What languages of machines share: planes, tool axes, feeds in mm/min."""

    partial: ClassVar[bool] = True

    def __init__(self, source: str, name: str, tolerance_m: float) -> None:
        super().__init__(source, name, tolerance_m)
        self.feed = ""

    def plane(self, move: Move) -> int:
        """17, 18 or 19. Raises a ProgramError for a circle about another axis, or with a tool that is not upright."""
        motion = move.motion
        normal = np.abs(np.asarray(motion.normal))
        if float(np.sort(normal)[1]) > _ALONG:
            raise self.refuse(move.line, "circle", "its axis is none of X, Y, Z", _TURN_HINT)
        if self.turning:
            raise self.refuse(move.line, "circle", "the tool is not upright on it", _TURN_HINT)
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
        return number(move.motion.feed_m_s / MM_PER_MIN, _DECIMALS)

    def axis_words(self, move: Move) -> list[str]:
        """Components of the tool axis."""
        return [number(float(value), _AXIS_DECIMALS) for value in move.axis]


class GcodeEmitter(MachineEmitter):
    """G-code as LinuxCNC reads it; the tool axis as I J K under G43.5."""

    language: ClassVar[str] = "gcode"
    ending: ClassVar[str] = ".ngc"
    vector: ClassVar[tuple[str, str, str]] = ("I", "J", "K")
    codes: ClassVar[frozenset[int]] = _OWN | frozenset((19, *range(50, 54), *range(62, 69), *range(100, 200)))

    def begin(self) -> None:
        """Units, plane, distances."""
        self.comment(self.origin())
        self.lines.append("G21 G17 G90 G94 G54")
        if self.turning:
            self.lines.append("G43.5")
        self._plane = 17

    def end(self) -> dict[str, str]:
        """One file."""
        return {f"{self.name}{self.ending}": "\n".join([*self.lines, "M30", ""])}

    def comment(self, text: str) -> None:
        """In parentheses."""
        self.lines.append(f"({text})")

    def process(self, step: Process) -> None:
        """M-codes."""
        own = [(letter, value) for letter, value in step.words if letter in "PQER"]
        if step.code not in self.codes or (own and self.language != "gcode"):
            raise self.refuse(
                step.line, " ".join(f"{letter}{value:g}" for letter, value in step.words),
                "this machine function is not known there", "Leave it out of the program, and write it by hand",
            )  # fmt: skip
        words = [f"{letter}{value:g}" for letter, value in step.words if letter in "ST"]
        self.lines.append(" ".join([*words, f"M{step.code}", *(f"{letter}{value:g}" for letter, value in own)]))

    def dwell(self, move: Move) -> None:
        """G4 in seconds."""
        self.lines.append(f"G4 P{number(move.motion.duration_s, 4)}")

    def straight(self, move: Move, share: float) -> None:
        """G0 or G1."""
        rapid = move.motion.kind == "rapid"
        p = move.at(share) / MM
        words = ["G0" if rapid else "G1"]
        words += [f"{c}{number(float(v), _DECIMALS)}" for c, v in zip("XYZ", p, strict=True) if c in move.named]
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
        start = np.round(move.at(start_share) / MM, _DECIMALS)
        offset = np.asarray(motion.p_centre) / MM - start
        words = ["G2" if self.clockwise(move) else "G3"]
        words += [f"{c}{number(float(v), _DECIMALS)}" for c, v in zip("XYZ", move.at(end_share) / MM, strict=True)]
        words += [f"{'IJK'[axis]}{number(float(offset[axis]), _DECIMALS + 1)}" for axis in (first, second)]
        turn = abs(motion.turn_rad) * (end_share - start_share)
        turns = max(1, math.ceil(turn / (2.0 * math.pi) - 1e-6))
        words += [self.turns(turns)] if turns > 1 else []
        self.lines.append(" ".join(words) + self._feed(move))

    def turns(self, count: int) -> str:
        """Word of several turns."""
        return f"P{count}"


class SinumerikEmitter(GcodeEmitter):
    """Sinumerik; the tool axis as A3 B3 C3 under TRAORI."""

    language: ClassVar[str] = "sinumerik"
    ending: ClassVar[str] = ".mpf"
    vector: ClassVar[tuple[str, str, str]] = ("A3=", "B3=", "C3=")
    codes: ClassVar[frozenset[int]] = _OWN | frozenset((19, *range(40, 46)))

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


class TwincatEmitter(GcodeEmitter):
    """TwinCAT NC I; the tool is upright: the control has no word for its axis."""

    language: ClassVar[str] = "twincat"
    ending: ClassVar[str] = ".nc"
    codes: ClassVar[frozenset[int]] = frozenset(range(160)) - {2, 17, 30}

    def begin(self) -> None:
        """Units, plane, distances."""
        self.comment(self.origin())
        self.lines.append("G17 G54 G71 G90")
        self._plane = 17

    def straight(self, move: Move, share: float) -> None:
        """G0 or G1. Raises a ProgramError for a tool that is not upright."""
        if self.turning:
            raise self.refuse(move.line, "tool axis", "the tool is not upright", _TURN_HINT)
        super().straight(move, share)

    def dwell(self, move: Move) -> None:
        """G4 in seconds."""
        self.lines.append(f"G4 X{number(move.motion.duration_s, 4)}")

    def arc_shares(self, move: Move) -> list[float] | None:
        """One turn at a time."""
        turns = max(1, math.ceil(abs(move.motion.turn_rad) / (2.0 * math.pi) - 1e-6))
        return [k / turns for k in range(1, turns + 1)] if self.plane(move) else None

    def turns(self, count: int) -> str:
        """Never needed: each turn is a block."""
        raise AssertionError(count)


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

    def process(self, step: Process) -> None:
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
        texts = [number(float(value), _DECIMALS) for value in p / MM]
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
        words = [number(float(value), _DECIMALS) for value in centre / MM]
        self.lines.append("CIRCLE/" + ",".join([*words, *axis, number(radius / MM, _DECIMALS)]))
        self._goto(move, move.at(end_share))

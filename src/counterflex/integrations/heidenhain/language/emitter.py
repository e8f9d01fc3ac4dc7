"""Write Klartext: steps of another language, and how numbers are spelled."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import ClassVar, Final

import numpy as np

from counterflex.core.units import MM
from counterflex.integrations.heidenhain.language import LIMITS, VECTOR_DECIMALS
from counterflex.integrations.heidenhain.language.source import code_of
from counterflex.integrations.heidenhain.language.values import VALUE
from counterflex.programs.convert.machine_languages import OWN_CODES, MachineEmitter
from counterflex.programs.convert.steps import MachineFunction, Move
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.program import Block, Word

_MOST_DEG: Final = 5400.0  # Largest angle of CP (TNC 640, "Input format and unit of TNC functions")


def signed(value: float, decimals: int = LIMITS.position_decimals) -> str:
    """Return a number with its sign, as Klartext has it."""
    text = number(value, decimals)
    return text if text.startswith("-") else f"+{text}"


def feed_text(value: float, decimals: int = 3) -> str:
    """Return F without trailing zeros."""
    text = number(value, decimals)
    return f"F{text.rstrip('0').rstrip('.')}"


class HeidenhainEmitter(MachineEmitter):
    """Klartext; the tool axis as LN with TX TY TZ under M128."""

    language: ClassVar[str] = "heidenhain"

    def begin(self) -> None:
        """Head."""
        plain = re.sub(r"[^A-Za-z0-9_-]", "_", self.name)
        self._program = plain[: LIMITS.name_characters]
        self._rpm, self._spindle = -1.0, 0
        self.lines.append(f"BEGIN PGM {self._program.upper()} MM")
        self.comment(self.origin())
        if plain != self.name or len(plain) > LIMITS.name_characters:
            self.warnings.append(f"the control does not take the name {self.name}: {self._program}")
        if self.turning:
            self.lines.append("M128")

    def end(self) -> dict[str, str]:
        """One file with numbered blocks."""
        tail = [*(["M129"] if self.turning else []), "M30", f"END PGM {self._program.upper()} MM"]
        lines = [f"{index} {line}" for index, line in enumerate([*self.lines, *tail])]
        return {f"{self._program}.h": "\n".join([*lines, ""])}

    def comment(self, text: str) -> None:
        """Behind a semicolon."""
        self.lines.append(f";{text.replace('~', '-')}")

    def process(self, step: MachineFunction) -> None:
        """TOOL CALL and M functions; a speed is a TOOL CALL without a tool."""
        if step.code not in OWN_CODES or any(letter in "PQER" for letter, _ in step.words):
            raise self.refuse(
                step.line, " ".join(f"{letter}{value:g}" for letter, value in step.words),
                "this machine function is not known there", "Leave it out of the program, and write it by hand",
            )  # fmt: skip
        if step.code == 6:
            self.lines.append(f"TOOL CALL {step.block.modal.tool} Z")
            self._spindle = 0
            return
        if step.code in (3, 4):
            rpm, sense = abs(step.block.modal.spindle_rpm), 1 if step.code == 3 else -1
            runs = self._spindle == sense
            if rpm != self._rpm:
                if self._spindle == -sense:
                    raise self.refuse(step.line, f"M{step.code}", "the spindle is reversed at another speed",
                                      "Write M5 before")  # fmt: skip
                self.lines.append(f"TOOL CALL Z S{number(rpm, 3).rstrip('0').rstrip('.')}")
                self._rpm = rpm
                if runs:
                    return
            self._spindle = sense
        elif step.code == 5:
            self._spindle = 0
        self.lines.append(f"M{step.code}")

    def dwell(self, move: Move) -> None:
        """Cycle 9."""
        self.lines += dwell_lines(move.motion.duration_s)

    def straight(self, move: Move, share: float) -> None:
        """L, or LN with the tool axis."""
        p = move.at(share) / MM
        words = [f"{c}{signed(float(v))}" for c, v in zip("XYZ", p, strict=True) if c in move.named]
        if self.turning:
            words += [f"T{c}{signed(float(v), VECTOR_DECIMALS)}" for c, v in zip("XYZ", move.axis, strict=True)]
        rapid = move.motion.kind == "rapid"
        head = "LN" if self.turning else "L"
        self.lines.append(" ".join([head, *words, "R0"]) + (" FMAX" if rapid else self._feed(move)))

    def _feed(self, move: Move) -> str:
        feed = feed_text(float(self.feed_of(move)))
        if feed == self.feed:
            return ""
        self.feed = feed
        return f" {feed}"

    def arc_shares(self, move: Move) -> list[float] | None:
        """As one in the plane of X and Y; straight moves in others, and with a tilted tool."""
        if (
            self.turning
            or move.motion.normal is None
            or abs(abs(float(np.asarray(move.motion.normal)[2])) - 1.0) > 1e-9
        ):
            return None
        turns = max(1, math.ceil(abs(math.degrees(move.motion.turn_rad)) / _MOST_DEG))
        return [k / turns for k in range(1, turns + 1)]

    def arc(self, move: Move, start_share: float, end_share: float) -> None:
        """CC with C, or CP of a helix and of several turns."""
        motion = move.motion
        assert motion.normal is not None
        centre = np.asarray(motion.p_centre) / MM
        self.lines.append(f"CC X{signed(float(centre[0]))} Y{signed(float(centre[1]))}")
        turn = motion.turn_rad * (end_share - start_share) * float(np.sign(np.asarray(motion.normal)[2]))
        sense = "DR+" if turn > 0.0 else "DR-"
        end = move.at(end_share) / MM
        rise = float(end[2]) - float(move.at(start_share)[2]) / MM
        if abs(turn) > 2.0 * math.pi + 1e-6 or abs(rise) > 0.5e-4:
            words = f"CP IPA{signed(math.degrees(turn))} Z{signed(float(end[2]))} {sense}"
        else:
            words = f"C X{signed(float(end[0]))} Y{signed(float(end[1]))} {sense}"
        self.lines.append(words + self._feed(move))


def dwell_lines(time_s: float) -> list[str]:
    """Return the lines of cycle 9."""
    return ["CYCL DEF 9.0 DWELL TIME", f"CYCL DEF 9.1 DWELL {number(time_s, 3)}"]


convert = HeidenhainEmitter.of


_FUNCTION: Final = re.compile(r"\s*(LP|LN|L|CC|CTP|CT|CR|CP|C|RND)(?![A-Z0-9])", re.IGNORECASE)
_GEOMETRY: Final = re.compile(
    rf"\s*(?:I?P[RA]\s*{VALUE}|I?[XYZ]\s*{VALUE}|DR\s*[+-]|R(?!0(?![\d.,]))\s*{VALUE})", re.IGNORECASE
)
_FEED: Final = re.compile(rf"\s*F\s*(?:AUTO(?![A-Z])|{VALUE})", re.IGNORECASE)
_M: Final = re.compile(r"\s*(?<![A-Z])M\s*(\d+)(?![\d.])", re.IGNORECASE)
_ACT_LAST: Final = frozenset((0, 1, 2, 5, 6, 9, 30, 89, 99, 127, 129))
"""M functions that act at the end of their block (TNC 640, "M functions")."""
_ORDER: Final = "XYZABC"


def function_of(block: Block) -> str:
    """Return the path function of a block; empty where it is none."""
    match = _FUNCTION.match(code_of(block.text)) if "\n" not in block.text else None
    return "" if match is None else match[1].upper()


class PathLine:
    """The line of a path statement."""

    def __init__(self, block: Block) -> None:
        self.text, self.words = block.text, tuple(word for word in block.words if word.end > word.start)
        self._edits: list[tuple[int, int, str]] = []
        code = code_of(block.text)
        match = _FUNCTION.match(code)
        self._code, self._head = code, 0 if match is None else match.end()
        self._function = (0, 0) if match is None else match.span(1)

    def find(self, letter: str) -> Word | None:
        """First word with this letter."""
        return next((word for word in self.words if word.letter == letter), None)

    @property
    def has_feed(self) -> bool:
        """It says its feed."""
        return _FEED.search(self._code, self._head) is not None

    def set(self, letter: str, text: str) -> None:
        """Replace a coordinate, or put it in its place among the others."""
        word = self.find(letter)
        if word is not None:
            self._edits.append((word.start, word.end, text))
            return
        at = self._head
        for other in self.words:
            if other.letter in _ORDER and _ORDER.index(other.letter) < _ORDER.index(letter):
                at = max(at, other.end)
        self._edits.append((at, at, f" {text}"))

    def set_vector(self, texts: Iterable[str]) -> None:
        """Replace TX, TY and TZ where the line has them."""
        for letter, text in zip("IJK", texts, strict=True):
            word = self.find(letter)
            if word is not None:
                self._edits.append((word.start, word.end, text))

    def set_feed(self, text: str) -> None:
        """Replace the feed, or put it before the M functions."""
        match = _FEED.search(self._code, self._head)
        if match is not None:
            self._edits.append((*match.span(), f" {text}"))
            return
        m = _M.search(self._code, self._head)
        at = len(self._code.rstrip()) if m is None else m.start()
        self._edits.append((at, at, f" {text}"))

    def become(self, function: str, coordinates: str) -> None:
        """Let the line have another path function and other coordinates."""
        self._edits += [(*match.span(), "") for match in _GEOMETRY.finditer(self._code, self._head)]
        self._edits.append((*self._function, f"{function} {coordinates}"))

    def take_last(self) -> str:
        """Take out the M functions that act at the end of the block, and return them."""
        last = [match for match in _M.finditer(self._code, self._head) if int(match[1]) in _ACT_LAST]
        self._edits += [(*match.span(), "") for match in last]
        return "".join(f" M{match[1]}" for match in last)

    def take(self, number: int) -> None:
        """Take out an M function."""
        self._edits += [(*m.span(), "") for m in _M.finditer(self._code, self._head) if int(m[1]) == number]

    def render(self) -> str:
        """Return the line with all edits."""
        out, at = list[str](), 0
        for start, end, text in sorted(self._edits, key=lambda edit: (edit[0], edit[1])):
            out.append(self.text[at:start] if start > at else "")
            out.append(text)
            at = max(at, end)
        out.append(self.text[at:])
        return "".join(out)


def spelled(letter: str, value: float, decimals: int) -> str:
    """Return an absolute coordinate as written."""
    return f"{letter}{signed(value, decimals)}"

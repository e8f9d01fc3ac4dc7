"""The text of a motion of FANUC TP: targets, speed, termination and options, each with its place."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.core.units import MM_PER_S
from counterflex.integrations.fanuc.language.read.table import OPTION, TABLE
from counterflex.integrations.fanuc.language.read.values import plain_code
from counterflex.programs.robot_text.process_words import NUMBER
from counterflex.programs.robot_text.program import Span
from counterflex.programs.statement_table import Treatment

_I: Final = re.IGNORECASE
MOTION: Final = re.compile(r"([JLCAS])\s+(?=PR?\s*\[|@)", _I)
_LITERAL: Final = re.compile(
    rf"([JL])\s+P\[(\d+)(?::[^\[\]]*)?\]\s+({NUMBER})(%|mm/sec)\s+(FINE|CNT\s?\d+)\s*", _I)  # fmt: skip
_TARGET: Final = re.compile(r"\s*(PR?)\s*\[", _I)
_REGISTER: Final = r"A?R\s*\[(?:[^\[\]]|\[[^\[\]]*\])*\]"
_SPEED: Final = re.compile(
    rf"\s*({NUMBER}|{_REGISTER})\s*(%|mm/sec|cm/min|inch/min|deg/sec|msec|sec)(?![A-Za-z/])|\s*(max_speed)\b", _I
)
UNITS: Final = {"mm/sec": MM_PER_S, "cm/min": 10.0 * MM_PER_S / 60.0, "inch/min": 25.4 * MM_PER_S / 60.0}
"""Speeds along the path, m/s."""
_TERMINATION: Final = re.compile(
    rf"\s*(FINE|CNT\s*(?:\d+(?:\.\d+)?|{_REGISTER})|CD\s*\d+|CR\s*\d+(?:\.\d+)?)(?![A-Za-z0-9])", _I
)
_NUMBER_OR_REGISTER: Final = rf"(?:\d+|{_REGISTER})"
_PR: Final = r"PR\s*\[(?:[^\[\]]|\[[^\[\]]*\])*\]"
_OPTION: Final = re.compile(
    rf"\s*(?:(?P<carried>ACC\s*{_NUMBER_OR_REGISTER}|(?:PTH|BREAK|MROT)(?![A-Za-z0-9])"
    rf"|(?:AP_LD|RT_LD)\s*{_NUMBER_OR_REGISTER}|(?:Ind\.)?EV\s*{_NUMBER_OR_REGISTER}\s*%|COORD(?:\s*\[[^\]]*\])?)"
    rf"|(?P<inc>INC)(?![A-Za-z])"
    rf"|(?P<offset>Offset)(?:\s*,\s*(?P<offset_by>{_PR}))?|(?P<tool>Tool_Offset)(?:\s*,\s*(?P<tool_by>{_PR}))?"
    rf"|(?P<time>(?:TA|TB|DB)\s*(?:{NUMBER}|{_REGISTER})\s*(?:sec|mm)?\s*,.*))",
    _I | re.DOTALL,
)
_REFUSED: Final = {
    row.word.removeprefix(OPTION).upper(): row.reason
    for row in TABLE.of(Treatment.REFUSED)
    if row.word.startswith(OPTION)
}
EXACT: Final = re.compile(r"FINE|CNT\s*0+", _I)


@dataclass(frozen=True, slots=True)
class TargetForm:
    """A target as written."""

    word: str  # ``P`` or ``PR``
    index: str  # Text of its number; digits of a literal one
    span: Span  # Where it stands in the statement


@dataclass(frozen=True, slots=True)
class MotionForm:
    """A motion as written; places are those in the statement."""

    word: str  # ``J L C A S``
    targets: tuple[TargetForm, ...]  # Its targets, that on a circle first
    speed: str  # Text of its number, a register, or empty of max_speed
    unit: str  # Lower case; empty of max_speed
    speed_span: Span  # Where number and unit stand
    number_span: Span  # Where the number stands
    termination: str  # FINE, CNT100
    options: tuple[tuple[str, str], ...] = ()  # By name ``inc offset tool``: the position register, or empty
    option_spans: tuple[Span, ...] = ()  # Where those stand
    at_time: str = ""  # Statement that runs before or behind the end

    @property
    def exact(self) -> bool:
        """The robot stops at its end."""
        return EXACT.fullmatch(self.termination) is not None


Refuse = Callable[[str, str, str], ProgramError]
"""Makes the error of what, limit and hint."""


def motion_form(code: str, word: str, refuse: Refuse) -> MotionForm:
    """Divide a motion.

    Args:
        word: ``J L C A``.
        refuse: Makes the error.

    Raises:
        ProgramError: It is not understood, or has an option that is not read.
    """
    literal = _LITERAL.fullmatch(code)
    if literal is not None:
        target = TargetForm("P", literal[2], (literal.start(2) - 2, code.index("]") + 1))
        return MotionForm(
            word, (target,), literal[3], literal[4].lower(), (literal.start(3), literal.end(4)), literal.span(3),
            literal[5],
        )  # fmt: skip
    at, targets = len(code) - len(code.lstrip()) + 1, []
    for _ in range(2 if word == "C" else 1):
        target, at = _target(code, at, refuse)
        targets.append(target)
    speed = _SPEED.match(code, at)
    if speed is None:
        raise refuse("the speed of a motion is not understood", "J P[1] 20% FINE, L P[2] 100mm/sec CNT100",
                     "Write the speed itself, or a register that the program sets")  # fmt: skip
    termination = _TERMINATION.match(code, speed.end())
    if termination is None:
        raise refuse("how a motion ends is not understood", "FINE or CNT0 to CNT100", "Post the program again")
    options, spans, at_time = _options(code, termination.end(), refuse)
    number = speed.span(1) if speed[1] else speed.span(3)
    return MotionForm(
        word, tuple(targets), speed[1] or "", (speed[2] or "").lower(), (number[0], speed.end()), number,
        " ".join(termination[1].split()), options, spans, at_time,
    )  # fmt: skip


def _target(code: str, at: int, refuse: Refuse) -> tuple[TargetForm, int]:
    match = _TARGET.match(code, at)
    if match is None:
        raise refuse("the target is no position", "P[n] or PR[n]", "Visual positions stand in the controller: write "
                     "the positions themselves")  # fmt: skip
    depth, end = 1, match.end()
    while end < len(code) and depth:
        depth += (code[end] == "[") - (code[end] == "]")
        end += 1
    if depth:
        raise refuse("a bracket is not closed", "P[n]", "The file may be damaged: post it again")
    index = plain_code(f"[{code[match.end() : end]}")[1:-1].strip()
    start = match.start() + len(match[0]) - len(match[0].lstrip())
    return TargetForm(match[1].upper(), index, (start, end)), end


def _options(code: str, at: int, refuse: Refuse) -> tuple[tuple[tuple[str, str], ...], tuple[Span, ...], str]:
    options: list[tuple[str, str]] = []
    spans: list[Span] = []
    at_time = ""
    while code[at:].strip():
        match = _OPTION.match(code, at)
        if match is None:
            word = re.match(r"\s*([A-Za-z_]+)", code[at:])
            reason = next((why for key, why in _REFUSED.items() if word and word[1].upper().startswith(key)), "")
            raise refuse(
                f"an option of a motion that is not read{': ' if reason else ''}{reason}",
                "ACC, PTH, BREAK, INC, Offset, Tool_Offset, COORD, TA, TB, DB", "Post the path without it",
            )  # fmt: skip
        begin = match.end() - len(match[0].lstrip())
        if match["time"]:
            at_time = match["time"].partition(",")[2].strip()
        elif match["inc"]:
            options.append(("inc", ""))
            spans.append((begin, match.end()))
        elif match["offset"] or match["tool"]:
            options.append(("offset" if match["offset"] else "tool", match["offset_by"] or match["tool_by"] or ""))
            spans.append((begin, match.end()))
        at = match.end()
    return tuple(options), tuple(spans), at_time

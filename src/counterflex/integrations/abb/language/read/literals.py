"""Aggregates of RAPID, ``[[1,2,3],[1,0,0,0],...]``, with the place of every number; arguments of an instruction."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from counterflex.programs.robot_text.process_words import NUMBER

_NUMBER: Final = re.compile(rf"\s*({NUMBER})\s*")
_WORD: Final = re.compile(r'\s*("(?:[^"\n]|"")*"|[A-Za-z]\w*)\s*')
_OPTION: Final = re.compile(r"\\\s*([A-Za-z]\w*)\s*(:=|\?)?\s*")


@dataclass(frozen=True, slots=True)
class LiteralItem:
    """A number of an aggregate: its value and where it stands in the text."""

    value: float
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class AggregateLiteral:
    """Values in brackets."""

    items: tuple[LiteralItem | str | AggregateLiteral, ...]  # Numbers, words (TRUE, names, strings) and aggregates
    start: int  # Index of the opening bracket
    end: int  # Index behind the closing one

    def numbers(self, counts: Sequence[int] = ()) -> list[LiteralItem] | None:
        """Its numbers, all of them; None where there is anything else, or another count."""
        out = [item for item in self.items if isinstance(item, LiteralItem)]
        return out if len(out) == len(self.items) and (not counts or len(out) in counts) else None


def aggregate(text: str, start: int, end: int) -> AggregateLiteral | None:
    """The aggregate that begins at an index and ends before another one; None where there is none that is read."""
    if start >= end or text[start] != "[":
        return None
    items: list[LiteralItem | str | AggregateLiteral] = []
    at = start + 1
    while at < end:
        item = _item(text, _behind_blanks(text, at, end), end)
        if item is None:
            return None
        items.append(item[0])
        at = _behind_blanks(text, item[1], end)
        if at < end and text[at] == "]":
            return AggregateLiteral(tuple(items), start, at + 1)
        if at >= end or text[at] != ",":
            return None
        at += 1
    return None


def _item(text: str, at: int, end: int) -> tuple[LiteralItem | str | AggregateLiteral, int] | None:
    """An item of an aggregate and the index behind it; None where there is none that is read."""
    if at < end and text[at] == "[":
        inner = aggregate(text, at, end)
        return None if inner is None else (inner, inner.end)
    if (match := _NUMBER.match(text, at, end)) is not None:
        return LiteralItem(float(match[1]), match.start(1), match.end(1)), match.end()
    match = _WORD.match(text, at, end)
    return None if match is None else (match[1], match.end())


def _behind_blanks(text: str, at: int, end: int) -> int:
    while at < end and text[at].isspace():
        at += 1
    return at


_PART: Final = r"(\[[^\[\]]*\]|[A-Za-z][\w.{}]*)"
_VALUE: Final = rf"\s*({NUMBER})\s*"
_ROBTARGET: Final = re.compile(
    rf"\[\s*\[{','.join([_VALUE] * 3)}\]\s*,\s*\[{','.join([_VALUE] * 4)}\]\s*,\s*{_PART}\s*,\s*{_PART}\s*\]"
)


@dataclass(frozen=True, slots=True)
class RobtargetLiteral:
    """A robtarget whose position and orientation are written as numbers."""

    start: int  # Index of its opening bracket
    end: int  # Index behind its closing one
    numbers: tuple[tuple[int, int], ...]  # Where its x, y, z, q1, q2, q3, q4 stand
    values: tuple[float, ...]  # Those numbers
    rest: tuple[str, str]  # Text of configuration and external axes: numbers in brackets, or names

    def value(self, evaluated: Callable[[str], object]) -> list[object]:
        """Return it as a list of lists."""
        x, y, z, q1, q2, q3, q4 = self.values
        return [[x, y, z], [q1, q2, q3, q4], *(numbers_of(text) or evaluated(text) for text in self.rest)]


def robtarget_literal(code: str, start: int) -> RobtargetLiteral | None:
    """Return the robtarget that begins at an index; None where none begins, or it is computed."""
    match = _ROBTARGET.match(code, start)
    if match is None:
        return None
    spans = tuple(match.span(group) for group in range(1, 8))
    return RobtargetLiteral(
        match.start(), match.end(), spans, tuple(map(float, match.groups()[:7])), (match[8], match[9])
    )


def numbers_of(text: str) -> list[object] | None:
    """Return the numbers of ``[1,2,3]``; None where it holds anything else."""
    try:
        return [float(part) for part in text.strip()[1:-1].split(",")] if text.startswith("[") else None
    except ValueError:
        return None


@dataclass(frozen=True, slots=True)
class CallArgument:
    """An argument of an instruction."""

    text: str  # As written, without blanks around it
    start: int  # Index of its first character in the text
    end: int  # Index behind its last one
    # By name in capitals: text and place of what stands behind ``:=``; empty text of a switch
    options: dict[str, tuple[str, int, int]]
    behind: int  # Index behind its options

    @classmethod
    def of(cls, code: str, start: int, end: int) -> CallArgument:
        """Read an argument of a call."""
        pieces = list(_divided(code, start, end, "\\"))
        first, options = pieces[0], {}
        behind = _trimmed(code, *first)[1]
        for a, b in pieces[1:]:
            match = _OPTION.match(code, a - 1, b)
            place = _trimmed(code, a if match is None else match.end(), b)
            key = code[a:b].strip().upper() if match is None else match[1].upper()
            options[key] = (code[place[0] : place[1]], *place)
            behind = max(behind, place[1], 0 if match is None else match.end(1))
        a, b = _trimmed(code, *first)
        return cls(code[a:b], a, b, options, behind)


def arguments(code: str, start: int, end: int) -> list[CallArgument]:
    """Arguments between two indices of a text: divided by commas outside of brackets, each with its options."""
    return [CallArgument.of(code, a, b) for a, b in _divided(code, start, end, ",")]


def _trimmed(code: str, start: int, end: int) -> tuple[int, int]:
    while start < end and code[start].isspace():
        start += 1
    while end > start and code[end - 1].isspace():
        end -= 1
    return start, end


def _divided(code: str, start: int, end: int, sign: str) -> Iterator[tuple[int, int]]:
    """Pieces between signs that stand outside of brackets and strings."""
    depth, quoted, begin = 0, False, start
    for at in range(start, end):
        character = code[at]
        if character == '"':
            quoted = not quoted
        elif quoted:
            continue
        elif character in "[({":
            depth += 1
        elif character in "])}":
            depth -= 1
        elif character == sign and depth == 0:
            yield begin, at
            begin = at + 1
    yield begin, end

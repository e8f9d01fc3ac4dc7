"""Literals of KRL, ``{X 1.0,Y 2.0,...}``, with the place of every number; code and comment of a line."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.integrations.kuka.language.program import LETTERS, Component
from counterflex.programs.robot_text.process_words import NUMBER

_FULL: Final = re.compile(NUMBER)
_COMPONENT: Final = re.compile(rf"\s*([A-Za-z_]\w*)\s*(?:({NUMBER})|'([BH]?)([0-9A-Fa-f]+)')\s*")
_OTHER: Final = re.compile(
    r"\s*[A-Za-z_]\w*\s*(?:\[\s*\])?\s*(?:#\s*\w+|\bTRUE\b|\bFALSE\b|\"[^\"]*\")\s*", re.IGNORECASE
)
_TYPE: Final = re.compile(r"\s*(\w+)\s*:")
CARTESIAN: Final = frozenset((*LETTERS, "S", "T", *(f"E{i}" for i in range(1, 7))))
_LARGEST_MM: Final = 100_000.0


def code_of(line: str) -> str:
    """The part of a line before its comment; a semicolon within quotes begins none."""
    if ";" not in line:
        return line
    quoted = False
    for index, character in enumerate(line):
        if character == '"':
            quoted = not quoted
        elif character == ";" and not quoted:
            return line[:index]
    return line


def number_of(text: str) -> float | None:
    """Value of a number; None where the text is none."""
    text = text.strip()
    return float(text) if _FULL.fullmatch(text) else None


class NoNumber(ProgramError):
    """A component of a literal is no number, but may be an expression."""


def simple_record(text: str, start: int) -> dict[str, object] | None:
    """Return a literal of numbers alone that begins at a brace and ends the statement; None where it is another."""
    if text[start : start + 1] != "{":
        return None
    try:
        parts, close = components(text, start, "")
    except ProgramError:
        return None
    if code_of(text[close + 1 :]).strip():
        return None
    return {name: component.value for name, component in parts.items()}


def components(line: str, start: int, where: str, *, mixed: bool = False) -> tuple[dict[str, Component], int]:
    """Components of the literal that begins at a brace.

    Args:
        start: Index of the opening brace.
        where: Its file and line, for errors.
        mixed: The literal may hold names (``IPO_FRAME #BASE``), truth values and texts (``POINT2[] " "``) as well, as
            FDAT, LDAT and PDAT do; they are passed over.

    Returns:
        Components by name, and the index of the closing brace.

    Raises:
        ProgramError: The literal is not closed, or a component is no number.
    """
    close = line.find("}", start)
    if close < 0:
        raise ProgramError(
            "a literal is not closed: the line may be cut off",
            where=f"{where}:{start + 1}", value=line[start:].strip()[:60], limit="{X 0.0,Y 0.0,...}",
            hint="Post the program again",
        )  # fmt: skip
    at = start + 1
    if (match := _TYPE.match(line, at, close)) is not None:
        at = match.end()
    out: dict[str, Component] = {}
    while at < close:
        other = _OTHER.match(line, at, close) if mixed else None
        if other is not None and (other.end() == close or line[other.end()] == ","):
            at = other.end() + 1
            continue
        match = _COMPONENT.match(line, at, close)
        if match is None or (match.end() < close and line[match.end()] != ","):
            raise NoNumber(
                "a component of a literal is no number",
                where=f"{where}:{at + 1}", value=line[at:close].strip()[:40], limit="a name and a number: X 12.5",
                hint="Write the numbers themselves",
            )  # fmt: skip
        name = match[1].upper()
        if name in out:
            raise ProgramError(f"{name} stands twice in a literal", where=f"{where}:{at + 1}", value=line[start:close])
        group = 2 if match[2] is not None else 4
        value = float(match[2]) if group == 2 else _integer(match[4], match[3])
        out[name] = Component(value, match.start(group), match.end(group))
        at = match.end() + 1
    return out, close


def _integer(digits: str, base: str) -> float:
    """Value of an integer of KRL in quotes: binary (``'B101'``), hexadecimal (``'H1F'``) or decimal."""
    try:
        return float(int(digits, {"B": 2, "H": 16}.get(base.upper(), 10)))
    except ValueError:
        return float("nan")


def require_cartesian(parts: Mapping[str, Component], text: str, where: str) -> None:
    """Refuse components that a Cartesian target does not have, or that no robot reaches.

    Raises:
        ProgramError: There is one.
    """
    for name, component in parts.items():
        if name not in CARTESIAN:
            raise ProgramError(
                f"{name} is no component of a Cartesian target", where=where, value=text[:60],
                limit="X Y Z A B C S T E1 to E6",
            )  # fmt: skip
        if not abs(component.value) <= _LARGEST_MM:
            raise ProgramError(
                f"{name} is beyond every robot", where=where, value=f"{component.value:g}", limit=f"{_LARGEST_MM:g}"
            )

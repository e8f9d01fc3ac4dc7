"""Language of a text that is no G-code: robots, other controls, files of CAM systems, told by words of their own.

Only asked when a text could not be read as G-code, so a program that can be read is never accused of another language.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

from counterflex.programs.language import LANGUAGES, Signs

_LOOKED_AT: Final = 120  # Lines that are not empty, from the first one on
_POST: Final = "Post the tool path as three-axis G-code (a post for LinuxCNC fits)"
_LANGUAGE: Final = "Read it as what it is: --dialect {0}, or give the file the ending {1}"
_UNROLL: Final = "Post it without macros, cycles and frames of this control, as plain three-axis G-code"


@dataclass(frozen=True)
class Foreign:
    """A language that was recognised."""

    name: str  # As people call it
    line: int  # 1-based line that tells it
    text: str  # What stands there
    hint: str  # What to do


def _robot(name: str) -> str:
    return f"Give the G-code that it was made from, or post the tool path as G-code. {name} is not read"


_UNREAD: Final = (
    Signs(
        "a cell file of counterflex",
        (r'^format\s*=\s*"counterflex-',),
        (),
        "Give the program first and the cell file with --cell",
    ),
    Signs(
        "Universal Robots script",
        (r"^def\s+\w+\s*:$", r"^move[lpjc]\s*\(?\s*p\["),
        (r"^move[lpjc]$", r"^end$"),
        _robot("It"),
    ),
    Signs(
        "Kawasaki AS or Adept V+", (r"^\.PROGRAM\b", r"^\.(TRANS|JOINTS|REALS)$"), (r"^L(MOVE|APPRO)\b",), _robot("It")
    ),
    Signs("Comau PDL2", (r"^PROGRAM\s+\w+", r"^MOVE\s+(LINEAR|JOINT|CIRCULAR)\b"), (r"^ROUTINE\s+\w+",), _robot("It")),
    Signs("Mitsubishi MELFA BASIC", (r"^(\d+\s+)?Mv[scr]\s+P", r"^(\d+\s+)?(Ovrd|Spd|Servo)\s+\w+"), (), _robot("It")),
    Signs("Heidenhain ISO", (r"^%\S+\s+G7[01]\s*\*$",), (r"^N\d+\s.*\*$", r"\bG99\s+T\d", r"\bG7[01]\s*\*$"), _POST),
    Signs(
        "Okuma OSP",
        (r"^\$\S+\.(MIN|SSB|SUB|LIB)%?$", r"\bVC\d+\s*=", r"\bVZOF", r"\bG15\s*H\d", r"\bNCYL\b", r"\bG116\s*T\d"),
        (r"\bCALL\s+O\w+", r"\bGOTO\s+N\w+", r"^(N\d+\s*)?IF\s*\[", r"\bRTS\b", r"\bMODIN\b", r"\bG56\s*H\d"),
        _UNROLL,
    ),
    Signs(
        "Fagor", (r"^%\w+\s*,\s*MX", r"^#(TSAFE|HSC|TANGCTRL|RTCP|CS|ACS)\b", r"^\$(IF|WHILE|FOR|GOTO)\b"), (), _UNROLL
    ),
    Signs("NUM", (r"\bG7[79]\s*[NH]\d", r"\bG997\b"), (r"\bL\d+\s*=", r"\bE\d{5}\s*="), _UNROLL),
    Signs("STEP (ISO 10303-21)", (r"^ISO-10303-21",), (), _POST),
    Signs("a drawing (DXF)", (r"^SECTION$",), (r"^HEADER$", r"^ENTITIES$", r"^EOF$"), _POST),
    Signs("a mesh (STL)", (r"^solid(\s|$)",), (r"^facet normal\b", r"^outer loop$"), _POST),
    Signs("HPGL", (r"^IN;.*(SP|PU|PA)\d",), (), _POST),
    Signs("a web page or XML", (r"^<(\?xml|!DOCTYPE|html)\b",), (), "Give the file itself, not a page that shows it"),
)
"""Languages that are not read."""
_COMMENT: Final = re.compile(r"\([^()]*\)")


@functools.cache
def _compiled() -> tuple[tuple[Signs, tuple[re.Pattern[str], ...], tuple[re.Pattern[str], ...]], ...]:
    """Signs of robots' languages, of those that are not read, and of machines' languages, whose words are of many."""
    known: dict[bool, list[Signs]] = {True: [], False: []}
    for name, one in LANGUAGES.items():
        if one.signs is not None:
            hint = one.signs.hint or _LANGUAGE.format(name, next(iter(one.endings), "of its language"))
            known[one.robot].append(replace(one.signs, hint=hint))
    read = {signs.name for group in known.values() for signs in group}
    unread = [signs for signs in _UNREAD if signs.name not in read]
    return tuple(
        (
            signs,
            tuple(re.compile(sign, re.IGNORECASE) for sign in signs.sure),
            tuple(re.compile(sign, re.IGNORECASE) for sign in signs.likely),
        )
        for signs in (*known[True], *unread, *known[False])
    )


def foreign_language(lines: Sequence[str]) -> Foreign | None:
    """Recognise a text that is no G-code.

    Returns:
        The language, or None where nothing tells it.
    """
    plain = list(_shown(lines))
    whole = [*plain, *((number, lines[number - 1].strip()) for number, _ in plain)]
    robots = {one.signs.name for _, one in LANGUAGES.items() if one.robot and one.signs is not None}
    for signs, sure, likely in _compiled():
        # Brackets hold no comments in languages of robots
        told_by = _first_sign(whole if signs.name in robots else plain, sure, likely)
        if told_by is not None:
            return Foreign(signs.name, told_by[0], told_by[1][:60], signs.hint)
    return None


def _first_sign(
    lines: Sequence[tuple[int, str]], sure: Sequence[re.Pattern[str]], likely: Sequence[re.Pattern[str]]
) -> tuple[int, str] | None:
    """The line with one sure sign, or else the first of those with two likely ones."""
    first = next((item for item in lines if any(sign.search(item[1]) for sign in sure)), None)
    if first is not None:
        return first
    match = [next((item for item in lines if sign.search(item[1])), None) for sign in likely]
    hits = sorted(item for item in match if item is not None)
    return hits[0] if len(hits) > 1 else None


def language_among(lines: Sequence[str], dialects: Sequence[str]) -> str | None:
    """Return the dialect out of several whose signs stand in a text; None where those of none do."""
    foreign, signs = foreign_language(lines), {name: LANGUAGES[name].signs for name in dialects}
    return next((name for name, one in signs.items() if foreign and one and one.name == foreign.name), None)


def _shown(lines: Sequence[str]) -> Iterator[tuple[int, str]]:
    """First lines that are not empty, each with its number, without what G-code takes for a comment."""
    count = 0
    for number, line in enumerate(lines, start=1):
        text = _COMMENT.sub(" ", line.lstrip("\ufeff")).strip()
        if not text.startswith((";FOLD", ";$PATH")):
            text = text.split(";")[0].strip() if not text.upper().startswith("IN;") else text
        if not text:
            continue
        yield number, text
        count += 1
        if count == _LOOKED_AT:
            return

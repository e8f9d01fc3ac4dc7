"""Diameters of the tools that a program names in comments or statements: those that its post-processor was given.

Forms: ``(T1 D=16. CR=0. - flat end mill)`` of Fusion and its relatives, ``(Compensated Tool Path. Diameter: 16.0 mm)``
of FreeCAD, ``(TOOL - 1 DIA. OFF. - 1 LEN. - 1 DIA. - 16.)`` of Mastercam, ``(T1: end mill D16, 3 flutes)`` of people;
``CUTTER/16`` and ``TLDATA/MILL,16`` of APT.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from typing import Final

from counterflex.core.units import MM
from counterflex.programs.language import LANGUAGES, object_at
from counterflex.programs.program import Program

_NUMBER: Final = r"(\d+(?:\.\d*)?|\.\d+)"
_COMMENT: Final = re.compile(r"\(([^()]*)\)|(?:;|!|\$\$|//)\s?(.*)$")
_TOOL: Final = re.compile(r"\bT(?:OOL)?\s*[-:#=]?\s*(\d+)\b", re.IGNORECASE)
_DIAMETER: Final = re.compile(
    rf"(?:\bDIA(?:M(?:ETER)?)?\b\.?\s*[-:=]?\s*|\bD\s*=\s*|\b(?:MILL|CUTTER|DRILL|BALL|FLAT)\s+D\s?|[\u00d8\u2300]\s?)"
    rf"{_NUMBER}\s*(MM|IN(?:CH)?\b|\")?",
    re.IGNORECASE,
)
_OF_A_TOOL: Final = re.compile(r"\bTOOL\b", re.IGNORECASE)
_FEATURE: Final = re.compile(
    r"POCKET|HOLE|BORE|BORING|BOSS|GROOVE|CIRC|RING|HUB|THREAD|SHAFT|PART|BLANK", re.IGNORECASE
)
"""Words of what is cut: a diameter behind them is not that of a tool."""
_INCH_M: Final = 25.4 * MM


def diameters_of(program: Program) -> dict[int, tuple[float, int]]:
    """Return the diameter of each tool that a comment or a statement of APT names, m, and its line.

    A comment that names no tool is about the one in the spindle. Without a unit, lengths are in that of the program.

    Args:
        program: As read.
    """
    unit = program.blocks[-1].modal.unit_m if program.blocks else MM
    out: dict[int, tuple[float, int]] = {}
    place = LANGUAGES[program.dialect].diameters
    for tool, diameter, line in object_at(place)(program) if place is not None else ():
        if tool != 0 and diameter > 0.0:
            out.setdefault(tool, (diameter * unit, line))
    for line, text, tool in _comments(program):
        starts = [match.start() for match in _TOOL.finditer(text)]
        for begin, end in itertools.pairwise([0, *starts, len(text)]):
            named, match = _TOOL.match(text, begin), _DIAMETER.search(text, begin, end)
            number = tool if named is None else int(named[1])
            if match is None or number == 0 or _FEATURE.search(text, begin, match.start()):
                continue
            if named is None and not _OF_A_TOOL.search(text):
                continue
            of_text = {"": unit, "MM": MM}.get((match[2] or "").upper(), _INCH_M)
            out.setdefault(number, (float(match[1]) * of_text, line))
    return out


def _comments(program: Program) -> Iterator[tuple[int, str, int]]:
    """Line, text, and number of the tool in the spindle of each comment, those before the first block included."""
    tool_of_line = {block.line: block.modal.tool for block in program.blocks if not block.file}
    tool = 0
    for number, text in enumerate(program.lines, start=1):
        tool = tool_of_line.get(number, tool)
        for match in _COMMENT.finditer(text):
            yield number, match[1] or match[2] or "", tool

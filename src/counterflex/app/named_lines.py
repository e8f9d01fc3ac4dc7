"""Name the file beside each line number of a result, for programs whose motions stand in several files."""

from __future__ import annotations

import re
from typing import Any, Final

from counterflex.programs.program import Program

_LINES: Final = re.compile(r"\b(?:in )?lines? (\d+(?:(?:, | and | to )\d+)*)(?![\d.])")


def with_files(data: Any, program: Program) -> Any:
    """Return a result with the files of its lines; unchanged where all motions stand in one file.

    Args:
        data: Plain values. A row with a whole number as ``line`` gets ``place`` (``cut.src:8``), ``lines`` get
            ``places``, and ``line 8`` in a sentence becomes the place.
    """
    if not any(program.blocks[motion.block].file for motion in program.motions):
        return data
    return _named(data, program)


def _named(data: Any, program: Program) -> Any:
    if isinstance(data, str):
        return _LINES.sub(lambda match: _places(match[0], match[1], program), data)
    if isinstance(data, list | tuple):
        return type(data)(_named(item, program) for item in data)
    if not isinstance(data, dict):
        return data
    out = {key: _named(value, program) for key, value in data.items()}
    line, lines = data.get("line"), data.get("lines")
    if isinstance(line, int):
        out.setdefault("place", program.place(line))
    if isinstance(lines, list) and all(isinstance(item, int) for item in lines):
        out.setdefault("places", [program.place(item) for item in lines])
    return out


def _places(text: str, numbers: str, program: Program) -> str:
    begin = "in " if text.startswith("in ") else ""
    return begin + re.sub(r"\d+", lambda number: program.place(int(number[0])), numbers)

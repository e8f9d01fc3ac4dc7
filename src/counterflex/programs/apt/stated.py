"""Return what an APT file states beside its motions: diameters of tools, and lines that a switch may skip."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

from counterflex.programs.program import Program

_TOOL_DATA: Final = re.compile(
    r"\s*(?:CUTTER\s*/|TLDATA\s*/\s*(?:MILL|BALL|DRILL)\w*\s*,)\s*(\d+(?:\.\d*)?|\.\d+)", re.IGNORECASE
)
_OPTIONAL: Final = re.compile(r"\s*OPSKIP\s*/\s*ON\b", re.IGNORECASE)


def cutter_diameters(program: Program) -> Iterator[tuple[int, float, int]]:
    """Tool, diameter in program units and line of each CUTTER and TLDATA: of the next motion's tool."""
    stated: tuple[float, int] | None = None
    for block in program.blocks:
        match = _TOOL_DATA.match(block.text)
        if match is not None:
            stated = float(match[1]), block.line
        elif block.motion_count and stated is not None:
            yield block.modal.tool, *stated
            stated = None


def skipped_by_switch(program: Program) -> list[str]:
    """Return one sentence where OPSKIP marks what the switch for block delete may skip."""
    switched = next((b for b in program.blocks if _OPTIONAL.match(b.text)), None)
    if switched is None:
        return []
    return [f"OPSKIP in line {switched.line}: what the switch for block delete may skip is read as executed"]

"""Second readings of Klartext: blocks that the control may hide."""

from __future__ import annotations

import re
from typing import Final

from counterflex.programs.program import Program

_HIDDEN: Final = re.compile(r"\s*\d+\s*/")


def hidden_blocks(program: Program) -> list[str]:
    """Return one sentence where blocks with motions are marked with / behind their number."""
    lines = [block.line for block in program.blocks if block.motion_count and _HIDDEN.match(block.text)]
    if not lines:
        return []
    more = f" and {len(lines) - 1} more" if len(lines) > 1 else ""
    return [
        f"line {lines[0]}{more}: a block with / behind its number is read as executed; leave the switch that hides "
        "blocks off, or take it out and plan again"
    ]

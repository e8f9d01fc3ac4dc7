"""Dwells so long that their P may have been meant in milliseconds, as many controls read it."""

from __future__ import annotations

from typing import Final

from counterflex.core.units import MINUTE
from counterflex.programs.gcode.read.codes import CYCLES, code_name
from counterflex.programs.program import Block, Program

LONG_S: Final = 60.0
"""Longer than a spindle takes to run up or a chip to break; as milliseconds less than that is next to nothing."""
_CYCLES: Final = frozenset(code_name("G", code) for code in CYCLES)


def long_dwells(program: Program) -> list[str]:
    """Return one sentence for each length of dwell above :data:`LONG_S`: where, how long, and the other reading."""
    found: dict[tuple[str, float], list[int]] = {}
    for motion in program.motions:
        if motion.kind == "dwell" and motion.duration_s > LONG_S:
            block = program.blocks[motion.block]
            found.setdefault((_code(block), motion.duration_s), []).append(block.line)
    return [
        f"{code} P{time_s:g} in line {lines[0]} waits {time_s:g} s ({time_s / MINUTE:.1f} min)"
        + (f", {len(lines)} times in all" if len(lines) > 1 else "")
        + ": P is in seconds here, as LinuxCNC reads it; where it was meant in milliseconds, as many controls read it, "
        + f"write P{time_s * 1e-3:g}"
        for (code, time_s), lines in found.items()
    ]


def _code(block: Block) -> str:
    """Code that dwells: the cycle, or G4."""
    by_hand = any(word.letter == "G" and word.value == 4.0 for word in block.words)
    return block.modal.motion if block.modal.motion in _CYCLES and not by_hand else "G4"

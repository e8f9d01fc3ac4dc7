"""What a program may have meant otherwise than it was read, in words.

A dwell so long that its P may have been meant in milliseconds, as many controls read it; lines that begin with a slash,
which the operator's switch decides about.
"""

from __future__ import annotations

from typing import Final

from counterflex.core.units import MINUTE
from counterflex.programs.gcode.read.codes import CYCLES, code_name
from counterflex.programs.program import Block, Program

LONG_S: Final = 60.0
"""Longer than a spindle takes to run up or a chip to break; as milliseconds less than that is next to nothing."""
_CYCLES: Final = frozenset(code_name("G", code) for code in CYCLES)


def doubtful_readings(program: Program) -> list[str]:
    """Return one sentence for each: where, how it was read, and the other reading."""
    return [*_long_dwells(program), *_skipped_by_switch(program)]


def _long_dwells(program: Program) -> list[str]:
    """Dwells above :data:`LONG_S`, one sentence for each length."""
    results: dict[tuple[str, float], list[int]] = {}
    for motion in program.motions:
        if motion.kind == "dwell" and motion.duration_s > LONG_S:
            block = program.blocks[motion.block]
            results.setdefault((_code(block), motion.duration_s), []).append(block.line)
    return [
        f"{code} P{time_s:g} in line {lines[0]} waits {time_s:g} s ({time_s / MINUTE:.1f} min)"
        + (f", {len(lines)} times in all" if len(lines) > 1 else "")
        + ": P is in seconds here, as LinuxCNC reads it; where it was meant in milliseconds, as many controls read it, "
        + f"write P{time_s * 1e-3:g}"
        for (code, time_s), lines in results.items()
    ]


def _skipped_by_switch(program: Program) -> list[str]:
    """Lines with motions that begin with a slash."""
    lines = [b.line for b in program.blocks if b.motion_count and b.text.lstrip().startswith("/")]
    if not lines:
        return []
    more = f" and {len(lines) - 1} more" if len(lines) > 1 else ""
    return [
        f"line {lines[0]}{more} begin{'s' * (len(lines) == 1)} with / and {'is' if len(lines) == 1 else 'are'} read as "
        "executed: leave the switch for block delete off, or take these lines out and plan again"
    ]


def _code(block: Block) -> str:
    """Code that dwells: the cycle, or G4."""
    by_hand = any(word.letter == "G" and word.value == 4.0 for word in block.words)
    return block.modal.motion if block.modal.motion in _CYCLES and not by_hand else "G4"

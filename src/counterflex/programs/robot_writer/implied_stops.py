"""Starts and stops of spindle and coolant that a program does not write: at a tool change, at its end, inside a cycle.

RS274/NGC stops the spindle when a tool is changed (M6) and spindle and coolant when the program ends; G86 stops the
spindle for the way out of a hole; S0 and the other direction of turning stop it too. A robot controller does none of
that by itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from counterflex.programs.program import Block, Program, Word


@dataclass(frozen=True)
class ImpliedStops:
    """Blocks that stand for what is implied, each with the one M-code that does it."""

    before: dict[int, list[Block]] = field(default_factory=dict)  # By number of a block, before its own
    within: dict[int, Block] = field(default_factory=dict)  # By number of a motion, before it
    behind: dict[int, list[Block]] = field(default_factory=dict)  # By number of a block, behind its motions

    def all(self) -> Iterator[Block]:
        """Every one of them."""
        for result in (*self.before.values(), self.within.values(), *self.behind.values()):
            yield from result


def implied_stops(program: Program) -> ImpliedStops:
    """Find them.

    What counts is what the robot was told: a spindle that was started stays started until something stops it, also
    where the program gives it no speed (``S0``). It is stopped before it is started the other way round.
    """
    out = ImpliedStops()
    direction, cooled = 0, False
    for number, block in enumerate(program.blocks):
        codes = {word.value for word in block.words if word.letter == "M"}
        requested = _requested_direction(block, codes, direction)
        if direction != 0 and 5.0 not in codes and (6.0 in codes or requested != direction):
            out.before[number] = [_saying(5, block)]
            requested = 0 if 6.0 in codes and not codes & {3.0, 4.0} else requested
        within = _within(program, block)
        if (restart := within.pop(block.motions.stop, None)) is not None:
            out.behind[number] = [restart]
        out.within.update(within)
        direction = requested
        cooled = 9.0 not in codes and (cooled or bool(codes & {7.0, 8.0}))
    if left := [9] * cooled + [5] * (direction != 0):
        last = len(program.blocks) - 1
        out.behind[last] = out.behind.get(last, []) + [_saying(code, program.blocks[last]) for code in left]
    return out


def _requested_direction(block: Block, codes: set[float], direction: int) -> int:
    """Direction in which a block wants the spindle: 1 for M3, -1 for M4, 0 stopped."""
    if 5.0 in codes:
        return 0
    if 3.0 in codes or 4.0 in codes:
        return 1 if 3.0 in codes else -1
    if any(word.letter == "S" for word in block.words):
        rpm = block.modal.spindle_rpm
        return 0 if rpm == 0.0 else 1 if rpm > 0.0 else -1
    return direction


def _within(program: Program, block: Block) -> dict[int, Block]:
    """Stops and starts of the spindle inside a cycle, by motion; behind its last by the number after that."""
    results: dict[int, Block] = {}
    turning = block.modal.spindle_rpm != 0.0
    if block.motion_count < 2 or not turning:
        return results
    start = 3 if block.modal.spindle_rpm > 0.0 else 4
    for index in (*block.motions, block.motions.stop):
        now = index == block.motions.stop or program.motions[index].spindle_rad_s != 0.0
        if now != turning:
            turning = now
            results[index] = _saying(start if now else 5, block)
    return results


def _saying(code: int, block: Block) -> Block:
    """A block that says one M-code where another one stands."""
    modal = replace(block.modal, spindle_rpm=0.0) if code == 5 else block.modal
    word = Word("M", float(code), 0, 0)
    return replace(block, text="", words=(word,), modal=modal, motion_count=0)

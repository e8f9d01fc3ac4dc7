"""Steps of a program in order, whatever its language: moves, waits, process words, comments."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.programs.language import LANGUAGES
from counterflex.programs.program import TOOL_VECTOR, Block, Motion, Program, Word, has_g
from counterflex.programs.robot_text.program import RobotProgram
from counterflex.programs.robot_writer.machine_functions import BEHIND
from counterflex.programs.robot_writer.spaced_points import ImpliedStops, implied_stops

ENDS: Final = frozenset((2, 17, 30, 60, 97, 98, 99))
_ORDER: Final = (6, 3, 4, 7, 8, 9, 5)
_NO_EFFECT: Final = frozenset((48, 49))
_TOGETHER: Final = frozenset("SPQER")


@dataclass(frozen=True)
class Move:
    """A motion, or a wait."""

    index: int  # In the motions of the program
    motion: Motion  # As read
    R_part_tcp: Float  # (3, 3) orientation of the cell's TCP frame at its end, in the part
    R_part_start: Float  # (3, 3) the same at its start
    named: str  # Axes whose end is known: fewer than three at the beginning of programs for machines
    exact: bool  # The program stops there
    line: int  # Of the program

    @property
    def axis(self) -> Float:
        """(3,) from the tip to the spindle, at its end."""
        out: Float = -self.R_part_tcp[:, 2]
        return out

    def at(self, share: float) -> Float:
        """(3,) m, point at a share of the way."""
        motion = self.motion
        p_start, p_end = np.asarray(motion.p_start), np.asarray(motion.p_end)
        if share >= 1.0:
            return p_end
        if motion.p_centre is None or motion.normal is None:
            out: Float = p_start + share * (p_end - p_start)
            return out
        normal = np.asarray(motion.normal)
        spoke = p_start - motion.p_centre
        lift = float(spoke @ normal)
        spoke = spoke - lift * normal
        angle = share * motion.turn_rad
        rise = float((p_end - p_start) @ normal)
        around: Float = motion.p_centre + math.cos(angle) * spoke + math.sin(angle) * np.cross(normal, spoke)
        return around + (lift + share * rise) * normal

    @property
    def rise_m(self) -> float:
        """Climb of a helix along its axis, m; 0 of others."""
        if self.motion.normal is None:
            return 0.0
        return float((np.asarray(self.motion.p_end) - np.asarray(self.motion.p_start)) @ self.motion.normal)


@dataclass(frozen=True)
class MachineFunction:
    """A machine function."""

    code: int  # M-code
    block: Block  # With that code alone, the words that belong to it, and the modal state of its place
    line: int  # Of the program

    @property
    def words(self) -> tuple[tuple[str, float], ...]:
        """Words: code, speed or tool, and words of the code."""
        out = [("M", float(self.code))]
        if self.code in (3, 4):
            out.append(("S", abs(self.block.modal.spindle_rpm)))
        if self.code == 6:
            out.append(("T", float(self.block.modal.tool)))
        own = [(word.letter, word.value) for word in self.block.words if word.letter in "PQER"]
        return (*out, *sorted(own))


Step = Move | MachineFunction | str
"""A string is a comment."""


def steps(
    program: Program, R_part_tcp: Callable[[int], Float], *, to_robot: bool, comments: bool = True
) -> Iterator[Step]:
    """Yield the steps of a program, in order.

    Args:
        R_part_tcp: Orientation (3, 3) of the cell's TCP frame at the end of a motion, by its index.
        to_robot: Say what a machine does without being told, too: M6 and the end stop the spindle.
        comments: Comments too.

    Raises:
        ProgramError: Rotary words, whose meaning belongs to a machine.
    """
    implied, stops, named = implied_stops(program), frozenset[int](), set[str]()
    if isinstance(program, RobotProgram):
        implied, stops, named = ImpliedStops(), program.stops(), set("XYZ")
    for number, block in enumerate(program.blocks):
        if comments and (remark := _remark(program, block)):
            yield remark
        if to_robot:
            yield from _processes(implied.before.get(number, ()))
        codes = list(_process(block))
        yield from itertools.filterfalse(_acts_behind, codes)
        if block.motion_count:
            named |= {"X", "Y", "Z"} & {word.letter for word in block.words}
        whole = to_robot or block.motion_count > 1
        for index in block.motions:
            if whole and index in implied.within:
                yield from _process(implied.within[index])
            yield _move(program, index, R_part_tcp, "".join(sorted(named)), stops)
        yield from filter(_acts_behind, codes)
        if whole:
            yield from _processes(implied.behind.get(number, ()))


def _move(program: Program, index: int, R_part_tcp: Callable[[int], Float], named: str, stops: frozenset[int]) -> Move:
    motion = program.motions[index]
    block = program.blocks[motion.block]
    if block.modal.tool_centre != TOOL_VECTOR and any(motion.abc_end):
        raise ProgramError(
            "rotary words A B C belong to the machine that the program was posted for, which the cell file does not "
            "describe", where=block.where(Path(program.name).name), value=block.text.strip()[:60],
            limit="the tool axis as a vector: G43.5 with I J K, TRAORI with A3 B3 C3, GOTO with six numbers",
            hint="Describe its axes in [machine], or post it with tool vectors",
        )  # fmt: skip
    R = R_part_tcp(index)
    before = R if index == 0 else R_part_tcp(index - 1)
    return Move(index, motion, R, before, named, index in stops, block.line)


def _acts_behind(step: MachineFunction) -> bool:
    return step.code in BEHIND


def _processes(blocks: Iterable[Block]) -> Iterator[MachineFunction]:
    return itertools.chain.from_iterable(map(_process, blocks))


def _process(block: Block) -> Iterator[MachineFunction]:
    """Machine functions of a block, each by itself, in the order in which they act."""
    rpm = block.modal.spindle_rpm
    codes = [word.value for word in block.words if word.letter == "M"]
    codes = [code for code in codes if code == int(code) and code not in ENDS | _NO_EFFECT]
    if not codes and rpm != 0.0 and not has_g(block.words, 4.0) and any(word.letter == "S" for word in block.words):
        codes = [3.0 if rpm > 0.0 else 4.0]
    for code in sorted(codes, key=lambda item: _ORDER.index(item) if item in _ORDER else len(_ORDER)):
        words = (Word("M", code, 0, 0), *_own_words(int(code), block))
        yield MachineFunction(int(code), replace(block, text="", words=words, motion_count=0), block.line)


def _own_words(code: int, block: Block) -> tuple[Word, ...]:
    """Words that belong to an M-code."""
    if code in (3, 4):
        return (Word("S", abs(block.modal.spindle_rpm), 0, 0),)
    if code == 6:
        return (Word("T", float(block.modal.tool), 0, 0),)
    return () if code == 5 else tuple(word for word in block.words if word.letter in _TOGETHER)


def _remark(program: Program, block: Block) -> str:
    """Comment of a block, as plain text."""
    pattern = LANGUAGES[program.dialect].comment
    match = None if pattern is None else pattern.search(block.text)
    text = "" if match is None else next((part for part in match.groups() if part), "")
    plain = "".join(c if 32 <= ord(c) < 127 and c not in "()" else " " for c in text)
    return " ".join(plain.split())[:100]

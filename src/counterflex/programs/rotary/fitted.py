"""A program held against the machine it was written for: words that do not fit, starts in the active coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import DEG, MM
from counterflex.programs.language import is_robot
from counterflex.programs.program import TOOL_CENTRE, TOOL_VECTOR, Block, Motion, Program
from counterflex.programs.rotary.machine import LETTERS, RotaryMachine

_ZERO: Final = (0.0, 0.0, 0.0)
_SAME_M: Final = 1e-9
_SAME_RAD: Final = 1e-9
_TABLE: Final = "[machine] of the cell file"


def turns(program: Program) -> bool:
    """Return whether a program turns the tool: a rotary word other than 0, or a tool axis given as I J K (G43.5)."""
    return any(motion.abc_end != _ZERO for motion in program.motions)


def fitted(program: Program, machine: RotaryMachine | None) -> Program:
    """Check that every word fits the machine, and let each motion start where the tool really is.

    Where G43.4 begins or ends with the rotary axes turned, XYZ changes its meaning while nothing moves. The next motion
    then has to name X, Y and Z; its start is the old place in the new coordinates.

    Args:
        program: As read; it turns the tool.
        machine: The machine that it was written for; needed unless all directions are given as I J K (G43.5).

    Returns:
        The program, its motions changed where they had to be.

    Raises:
        ProgramError: A word that the machine does not have or that is beyond its limits, rotary words under G91 or with
            a rotary offset, an arc or a canned cycle with the tool turned, a motion of rotary axes alone at a feed per
            minute, or coordinates that cannot be known.
    """
    for motion in program.motions:
        _check(program, program.blocks[motion.block], motion, machine)
    program = _with_known_start(program)
    motions: list[Motion] = []
    for index, motion in enumerate(program.motions):
        block = program.blocks[motion.block]
        before = motions[-1] if motions else None
        if before is not None and machine is not None:
            motion = _started(program, motion, before, machine)
        if index and motions[-1].abc_end != motion.abc_start and block.modal.tool_centre != TOOL_VECTOR:
            _check_vector_end(program, block, motions[-1])
        motions.append(motion)
    return replace(program, motions=tuple(motions))


def _with_known_start(program: Program) -> Program:
    """Let axes that a program has not named yet stand where it first sends them."""
    # A program begins wherever the machine is; without this it would begin at zero, in the stock, with the tool along
    # z.
    places = np.array([(*m.p_start, *m.abc_start, *m.p_end, *m.abc_end) for m in program.motions]).reshape(-1, 12)
    changed = np.zeros(len(places), dtype=np.bool_)
    for axis, letter in enumerate("XYZ" + LETTERS):
        vector = "IJK"[axis - 3] if axis > 2 else letter
        for block in program.blocks:
            named = vector if block.modal.tool_centre == TOOL_VECTOR else letter
            if block.motion_count and any(word.letter == named for word in block.words):
                first = block.first_motion
                places[:first, [axis, axis + 6]] = places[first, axis + 6]
                places[first, axis] = places[first, axis + 6]
                changed[: first + 1] = True
                break
    motions = list(program.motions)
    for index in np.flatnonzero(changed):
        p_start, abc_start, p_end, abc_end = np.split(places[index], 4)
        motions[index] = replace(
            motions[index], p_start=p_start, abc_start=_three(abc_start), p_end=p_end, abc_end=_three(abc_end)
        )
    return replace(program, motions=tuple(motions))


def _three(values: Float) -> tuple[float, float, float]:
    return (float(values[0]), float(values[1]), float(values[2]))


def _fault(program: Program, block: Block, what: str, letters: str, **more: str | None) -> ProgramError:
    """An error at the first word of a block with one of these letters."""
    column = next((word.start + 1 for word in block.words if word.letter in letters), 1)
    return ProgramError(what, where=f"{block.where(program.name)}:{column}", **more)


def _check(program: Program, block: Block, motion: Motion, machine: RotaryMachine | None) -> None:
    vector = block.modal.tool_centre == TOOL_VECTOR
    turned = motion.abc_end != _ZERO or motion.abc_start != _ZERO
    if turned and (motion.kind == "arc" or block.cycle) and not is_robot(program.dialect):
        raise _fault(
            program, block, "an arc or a canned cycle while the tool is turned is not read", "G",
            value=block.text.strip(), hint="Let the CAM system write straight moves",
        )  # fmt: skip
    if vector:
        return
    if turned and machine is None:
        raise _fault(
            program, block, "the program turns a rotary axis, and the machine that it was written for is not described",
            LETTERS, value=_words(motion.abc_end), limit=f"a table {_TABLE}",
            hint="Describe its rotary axes, or post the program as three-axis milling",
        )  # fmt: skip
    if machine is None:
        return
    _check_words(program, block, motion, machine)
    only_turns = (
        motion.kind == "feed" and motion.abc_end != motion.abc_start and np.array_equal(motion.p_start, motion.p_end)
    )
    if only_turns and block.modal.feed_mode != 93:
        raise _fault(
            program, block, "a block that only turns at a feed per minute: controllers differ in what its F means",
            LETTERS, value=block.text.strip(), hint="Post it in inverse time (G93), or as a rapid (G0)",
        )  # fmt: skip


def _check_words(program: Program, block: Block, motion: Motion, machine: RotaryMachine) -> None:
    known = {axis.letter: axis for axis in machine.axes}
    for word in block.words:
        if word.letter not in LETTERS:
            continue
        name = f"{word.letter}{word.value:g}"
        axis, angle = known.get(word.letter), motion.abc_end[LETTERS.index(word.letter)]
        if axis is None and angle != 0.0:
            raise _fault(
                program, block, f"the machine has no rotary axis {word.letter}", word.letter, value=name,
                limit=f"{' '.join(known)} ({machine.kind}, {_TABLE})",
                hint="Give the machine that the program was posted for",
            )  # fmt: skip
        if axis is None:
            continue
        if not block.modal.absolute:
            raise _fault(
                program, block, "rotary words under G91 are not read", word.letter, value=name, hint="Write G90"
            )
        if abs(word.value * DEG - angle) > _SAME_RAD:
            raise _fault(
                program, block, "the program shifts a rotary axis (work offset, G92)", word.letter,
                value=f"{name} means {angle / DEG:g} deg", hint="Post it with rotary offsets of zero",
            )  # fmt: skip
        low, high = axis.limits_rad
        if not low - _SAME_RAD <= angle <= high + _SAME_RAD:
            raise _fault(
                program, block, "the rotary axis goes beyond its limits", word.letter, value=f"{name} deg",
                limit=f"{low / DEG:g} to {high / DEG:g} deg ({_TABLE})",
                hint="The direction cannot be reached: turn the part, or give the limits of the machine",
            )  # fmt: skip


def _check_vector_end(program: Program, block: Block, before: Motion) -> None:
    """A program that goes from I J K to rotary words: where the tool is tilted the angles are not known then."""
    was = program.blocks[before.block].modal.tool_centre
    if was == TOOL_VECTOR and before.abc_end[:2] != (0.0, 0.0):
        raise _fault(
            program, block, "G43.5 ends with the tool tilted: the rotary positions are not known then", "G",
            value=f"I J K = {' '.join(f'{c:g}' for c in before.abc_end)}", hint="Turn the tool back to K1 before",
        )  # fmt: skip


def _started(program: Program, motion: Motion, before: Motion, machine: RotaryMachine) -> Motion:
    """The motion with its start in the coordinates that are active in it."""
    block, was = program.blocks[motion.block], program.blocks[before.block].modal.tool_centre
    now = block.modal.tool_centre
    if now == was or TOOL_VECTOR in (now, was) or before.abc_end == _ZERO:
        return motion
    angle = np.array([before.abc_end])
    tip = machine.tip(before.p_end[None], angle, np.array([was == TOOL_CENTRE]))
    start: Float = machine.program_point(tip, angle, np.array([now == TOOL_CENTRE]))[0]
    named = {word.letter for word in block.words}
    for axis, letter in enumerate("XYZ"):
        if letter not in named and abs(start[axis] - motion.p_start[axis]) > _SAME_M:
            raise _fault(
                program, block, f"XYZ means other coordinates here, and this motion does not name {letter}", "XYZ",
                value=f"{letter}{start[axis] / MM:.4f} mm in the new coordinates",
                hint="Name X, Y and Z in the first motion after G43.4 or G49, or switch at A0 B0 C0",
            )  # fmt: skip
    if float(np.abs(start - motion.p_start).max()) <= _SAME_M:
        return motion
    return replace(motion, p_start=start)


def _words(angles: Sequence[float]) -> str:
    return " ".join(f"{letter}{angle / DEG:g}" for letter, angle in zip(LETTERS, angles, strict=True) if angle)

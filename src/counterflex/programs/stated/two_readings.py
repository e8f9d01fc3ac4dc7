"""Second readings of a program: words that controllers read in two ways, and what it leaves unsaid.

Sources: FANUC Series 30i, Operator's Manual, "Decimal point programming" (parameter DPI; least increments of IS-B:
0.001 mm, 0.0001 inch) and G04 P; Haas, Mill Operator's Manual (numbers without a decimal point, G04 P).

Posture of the arm that a robot program asks for, by the words of its language.

A pose is reached with the wrist centre ahead of or behind axis 1, with the arm bent to either side of the straight
forearm, and with axis 5 to either side of zero. Words: ``S`` of KRL in PTP motions (bit 0: behind axis 1; bit 1: axis 3
above the angle at which the arm is straight; bit 2: axis 5 negative), ``cfx`` of RAPID while ConfJ or ConfL is on (0
to 7: behind axis 1, wrist behind the lower arm, axis 5 negative), CONFIG of FANUC (N F, U D, T B), shoulder, elbow and
wrist of VAL3.

Sources: KUKA System Software, Operating and programming instructions, "Status" and its poses (A1 0, A2 -90, A3 90 is S
2); ABB Technical reference manual, RAPID, ``confdata``; FANUC R-30iB, Operator's manual, "Position data"; Staubli, VAL3
Reference manual, type ``config``.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final

from counterflex.core.units import INCH, MINUTE
from counterflex.programs.gcode.read.codes import CYCLES, code_name
from counterflex.programs.gcode.read.reader import COMMENT, FANUC, FURTHER_OFFSET
from counterflex.programs.language import GCODE, LANGUAGES, object_at
from counterflex.programs.program import Block, Program, Word, has_g
from counterflex.programs.robot_text.program import RobotProgram, Stated
from counterflex.programs.stated.offsets import NONE, UNSAID, codes_of, offset_reader


def stated_postures(program: Program) -> dict[int, Stated]:
    """Return the posture that motions ask for, by index of the motion.

    Args:
        program: As read; of a language without such words nothing is stated.
    """
    return program.postures() if isinstance(program, RobotProgram) else {}


def other_postures(program: Program, branch: str) -> list[str]:
    """Return one sentence where motions ask for another posture than the one that is planned in, such as a ``flip``."""
    others = {i: words for i, (posture, words) in stated_postures(program).items() if not posture.agrees(branch)}
    if not others:
        return []
    first = min(others)
    place = program.blocks[program.motions[first].block].where(program.name)
    return [
        f"{place}: the program asks for another posture ({others[first]}; {len(others)} targets) than the one planned "
        f"in, {branch}: set shoulder, elbow and wrist of [posture] to those of the program"
    ]


_LENGTHS: Final = frozenset("XYZIJKR")
_HALF_INCH: Final = 0.5 * INCH
_CANCELS: Final = re.compile(r"G49(?![\d.])|[HD]\s*=?\s*0+(?![\d.])", re.IGNORECASE)
LONG_S: Final = 60.0
"""Longer than a spindle takes to run up or a chip to break; as milliseconds less than that is next to nothing."""
_CYCLES: Final = frozenset(code_name("G", code) for code in CYCLES)


def doubtful_readings(program: Program) -> list[str]:
    """Return one sentence for each: where, how it was read, and the other reading."""
    of_language = LANGUAGES[program.dialect].doubts
    own: list[str] = [] if of_language is None else object_at(of_language)(program)
    if isinstance(program, RobotProgram):
        return own
    checks: tuple[Callable[[Program], list[str]], ...] = (
        _unit,
        _least_increments,
        _dwells,
        _skipped_by_switch,
        lambda _: own,
        _part_zero,
        _tool_taken,
        _zeros_set_here,
        _without_length,
    )
    return [sentence for check in checks for sentence in check(program)]


def _part_zero(program: Program) -> list[str]:
    """The work offset that was taken as the part frame, where it is another than the first one of a control."""
    if program.part_zero is None or program.part_zero[0] == "G54":
        return []
    name, line = program.part_zero
    return [
        f"{name} (line {line}) is taken as the zero of the part; where it lies is not known. To state it: "
        "part.work_offsets_mm in the cell file, or --parameters"
    ]


def _tool_taken(program: Program) -> list[str]:
    """Return that the program names no tool."""
    if not program.tool_taken:
        return []
    return [
        f"the program names no tool: T{program.tool_taken} is taken, the only one of the cell; whether it is the one "
        "in the spindle was not looked at"
    ]


def _zeros_set_here(program: Program) -> list[str]:
    """G10 L20, which LinuxCNC and Fanuc read in different ways."""
    for block in program.blocks:
        words = {word.letter: word.value for word in block.words}
        tens = has_g(block.words, 10.0)
        if (
            tens
            and words.get("L") == 20.0
            and program.dialect == GCODE
            and not any(FURTHER_OFFSET.search(line) for line in program.lines)
        ):
            return [
                f"G10 L20 in line {block.line} is read as LinuxCNC does: program zero from where the tool stands; "
                "Fanuc sets an offset of G54.1 P with it"
            ]
    return []


def _dwells(program: Program) -> list[str]:
    """Dwells that may be in milliseconds: above :data:`LONG_S`, or whole numbers in a program for Fanuc or Haas."""
    if program.dialect != GCODE:  # elsewhere the unit is beyond doubt
        return []
    fanuc = _is_fanuc(program)
    results: dict[tuple[str, float], list[int]] = {}
    for motion in program.motions:
        if motion.kind != "dwell":
            continue
        block = program.blocks[motion.block]
        if motion.duration_s > LONG_S or (fanuc and any(_is_whole(block, word) for word in block.words
                                                        if word.letter == "P")):  # fmt: skip
            results.setdefault((_code(block), motion.duration_s), []).append(block.line)
    return [
        f"{code} P{time_s:g} in line {lines[0]} waits {time_s:g} s"
        + (f" ({time_s / MINUTE:.1f} min)" if time_s > LONG_S else "")
        + (f", {len(lines)} times in all" if len(lines) > 1 else "")
        + ": P is in seconds here, as LinuxCNC reads it; where it was meant in milliseconds, as many controls read it, "
        + f"write P{time_s * 1e-3:g}"
        for (code, time_s), lines in results.items()
    ]


def _unit(program: Program) -> list[str]:
    """Lengths before the program says its unit."""
    words = LANGUAGES[program.dialect].units
    if words is None:
        return []
    for block in program.blocks:
        if block.words:
            is_stated = bool(codes_of(block, "G") & words.codes)
        else:
            is_stated = words.form is not None and words.form.match(block.text) is not None
        if is_stated:
            return []
        if block.motion_count:
            return [
                f"line {block.line} moves, and no line before it says the unit ({words.shown}): lengths are read as mm"
            ]
    return []


def _is_fanuc(program: Program) -> bool:
    """Return whether the program has a number, or codes that Fanuc and its relatives have alone."""
    return program.dialect == GCODE and any(FANUC.search(COMMENT.sub("", line)) for line in program.lines)


def _is_whole(block: Block, word: Word) -> bool:
    """Return whether a literal number other than zero has no decimal point."""
    return word.literal and word.value != 0.0 and "." not in block.text[word.start : word.end]


def _least_increments(program: Program) -> list[str]:
    """Coordinates without a decimal point in a program for Fanuc or Haas."""
    if not _is_fanuc(program):
        return []
    lines, first = 0, None
    for block in program.blocks:
        if not block.motion_count:
            continue
        word = next((one for one in block.words if one.letter in _LENGTHS and _is_whole(block, one)), None)
        if word is not None:
            lines, first = lines + 1, first or (block, word)
    if first is None:
        return []
    block, word = first
    text, unit = block.text[word.start : word.end].strip(), "inch" if block.modal.unit_m > _HALF_INCH else "mm"
    least = "0.0001 inch" if unit == "inch" else "0.001 mm"
    more = f" and {lines - 1} more" if lines > 1 else ""
    return [
        f"{text} in line {block.line}{more} has no decimal point and is read as {word.value:g} {unit}; a control that "
        f"counts such numbers in least increments (Fanuc, Haas, unless set otherwise) goes {word.value:g} times {least}"
    ]


def _without_length(program: Program) -> list[str]:
    """Cuts without a tool length offset in a program that has one elsewhere, or cancels it on its way."""
    # G49 in the line of a safe start cancels nothing: a program without any offset is written for the tool tip.
    reader, bare, other, cancel = offset_reader(program.dialect), 0, False, 0
    moved = False
    for block in program.blocks:
        before = reader.length
        reader.take(block)
        if moved and reader.length == NONE and _CANCELS.search(block.text):
            cancel = block.line
        moved = moved or block.motion_count > 0
        other = other or reader.length not in (NONE, UNSAID) or before not in (NONE, UNSAID)
        if reader.length == NONE and not bare and _cuts(program, block):
            bare = block.line
    if not bare or not (other or cancel):
        return []
    return [f"line {bare} moves at feed with no tool length offset in force: Z is read as the height of the tool tip"]


def _cuts(program: Program, block: Block) -> bool:
    return any(program.motions[index].kind in ("feed", "arc") for index in block.motions)


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
    by_hand = has_g(block.words, 4.0)
    return block.modal.motion if block.modal.motion in _CYCLES and not by_hand else "G4"

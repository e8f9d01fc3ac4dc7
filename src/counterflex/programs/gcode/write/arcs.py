"""Writes one arc: as an arc where the commanded points lie on one, else in pieces."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float
from counterflex.programs.gcode.write.arc_fit import PLANE_AXES, arc_error, radii_agree, radius_centre, written_turn
from counterflex.programs.gcode.write.arc_pieces import ArcPiece, nominal_share, written_pieces
from counterflex.programs.gcode.write.machine import WrittenMachine, work_axes
from counterflex.programs.gcode.write.written_line import WrittenLine, number
from counterflex.programs.program import Block, Motion, Word

_ROUNDINGS = 3.0  # Last decimals that start, end and centre together may shift a written arc by


_CENTRE_WORDS = ("I", "J", "K", "R", "AR")


@dataclass(frozen=True)
class _Commanded:
    """Commanded points of an arc: (n, 3) m in part axes and in plane axes (u, v, w), and their share of the turn."""

    p_part: Float
    plane: Float
    share: Float

    def whole(self, piece: ArcPiece) -> bool:
        """Return whether a piece covers the arc from start to end."""
        return piece.first == 0 and piece.last == len(self.share) - 1

    def time(self, piece: ArcPiece, feed: Word | None) -> str:
        """Value of F in inverse time for a piece; empty where the word of the block, or none, stays."""
        if feed is None or self.whole(piece):
            return ""
        return number(feed.value / max(float(self.share[piece.last] - self.share[piece.first]), 1e-6), 4)


@dataclass(frozen=True)
class _Rounded:
    """A piece of an arc between rounded ends."""

    points: Float  # (n, 3) m in plane axes
    share: Float  # (n,) of its turn
    turn_rad: float  # As planned
    turns: int  # Word P
    bound_m: float  # Largest distance from the points

    @property
    def sense(self) -> float:
        """1 counter-clockwise, -1 clockwise."""
        return math.copysign(1.0, self.turn_rad)

    def holds(self, machine: WrittenMachine, centre: tuple[float, float]) -> bool:
        """Return whether the arc about a rounded centre, m, stays at the points; notes how far it leaves them."""
        start, end = self.points[0], self.points[-1]
        turned = written_turn(start, end, centre, self.sense, self.turns)
        if abs(turned - self.turn_rad) > 0.25 * abs(self.turn_rad) or not radii_agree(start, end, centre):
            return False
        error = arc_error(self.points, self.share, centre, turned)
        if error <= self.bound_m:
            machine.arc_error_m = max(machine.arc_error_m, error)
        return error <= self.bound_m


def emit_arc(machine: WrittenMachine, block: Block, line: WrittenLine, index: int, motion: Motion) -> None:
    """Write a block that moves on an arc.

    Raises:
        ProgramError: The block must be changed but its words do not lead to its target.
    """
    modal, rows = block.modal, machine.rows
    corrected, inherits = bool(rows.moved[index]), machine.inherits(modal)
    if not corrected and not inherits:
        machine.completed_blocks += machine.state_motion(block, line, modal.motion)
        machine.keep(line, modal)
        machine.lines.append(line.render())
        machine.arrive(index, motion)
        return
    machine.check_words(block, motion)
    axes = list(PLANE_AXES[modal.plane])
    first, last = int(rows.first[index]), int(rows.last[index])
    turn = math.copysign(motion.turn_rad, -1.0 if modal.motion == "G2" else 1.0)
    centre = work_axes(modal, np.asarray(motion.p_start if motion.p_centre is None else motion.p_centre))[axes]
    nominal = work_axes(modal, np.vstack([motion.p_start, rows.nominal[first : last + 1]]))[:, axes]
    p_part = np.vstack([machine.here(), rows.command[first : last + 1]])
    plane = np.ascontiguousarray(work_axes(modal, p_part)[:, axes])
    points = _Commanded(p_part, plane, nominal_share(nominal, centre, turn))
    machine.completed_blocks += not corrected
    _emit_pieces(machine, block, line, points, turn, first)
    machine.off = [machine.current(axis) - float(motion.p_end[axis]) for axis in range(3)]
    machine.arrive(index, motion)


def _emit_pieces(
    machine: WrittenMachine, block: Block, line: WrittenLine, points: _Commanded, turn_rad: float, first: int
) -> None:
    """Write the pieces of an arc: the first on the source's own line, the others on added lines."""
    modal = block.modal
    feed = line.find("F") if modal.feed_mode == 93 else None
    stop: str | None = None
    kept: list[bool] = []  # By piece: it is an arc
    for piece, fitted in written_pieces(
        points.plane, points.share, turn_rad, machine.tolerance_m,
        lambda piece: _arc_words(machine, block, line, piece, points) or None,
    ):  # fmt: skip
        words = fitted or {}
        code, whole, time = modal.motion if words else "G1", points.whole(piece), points.time(piece, feed)
        target = points.p_part[piece.last]
        if piece.first == 0:
            machine.state_motion(block, line, code)
            stop = None if whole else machine.stop_word(line)
            _edit_words(line, code, words, keep_turns=whole)
            if time:
                line.set("F", time)
            machine.go(line, modal, target)
            machine.lines.append(line.render())
        else:
            centre = "".join(" " + machine.spelling.word(letter, text) for letter, text in words.items())
            machine.lines.append(f"{code}{machine.added(modal, target)}{centre}{time and ' F'}{time}")
        machine.written_motion = code if code != modal.motion else None
        row = first - 1 + piece.last
        machine.written[row] = machine.here()
        kept.append(bool(words))
        if not words:
            machine.checked[first + piece.first : row + 1] = True
    if stop:
        machine.lines.append(stop)
    machine.count_arc(kept)


def _edit_words(line: WrittenLine, code: str, words: dict[str, str], keep_turns: bool) -> None:
    """Put centre or radius words on the source's line, or turn it into a straight move."""
    reserved = line.taken_elsewhere()
    for word in line.words:
        stale = word.letter in _CENTRE_WORDS and word.letter not in words
        if stale or (word.letter == "P" and word.letter not in reserved and not (keep_turns and words)):
            line.remove(word)
        elif word.letter == "G" and word.value in (2.0, 3.0) and not words:
            line.replace(word, code)
    for letter, text in words.items():
        line.set(letter, text)


def _arc_words(
    machine: WrittenMachine, block: Block, line: WrittenLine, piece: ArcPiece, points: _Commanded
) -> dict[str, str]:
    """Words for the centre (or radius) of a piece after rounding; none where rounding breaks the arc."""
    if piece.centre is None:
        return {}
    modal = block.modal
    axes = PLANE_AXES[modal.plane]
    digits, unit = machine.digits(modal), modal.unit_m
    here = work_axes(modal, machine.here())
    end = work_axes(modal, machine.reached(line if piece.first == 0 else None, modal, points.p_part[piece.last]))
    turns = line.find("P") if points.whole(piece) and "P" not in line.taken_elsewhere() else None
    part = points.plane[piece.first : piece.last + 1].copy()
    part[0], part[-1] = here[list(axes)], end[list(axes)]
    share = points.share[piece.first : piece.last + 1]
    rounded = _Rounded(
        part, (share - share[0]) / (share[-1] - share[0]), piece.turn_rad, int(turns.value) if turns else 1,
        machine.tolerance_m + _ROUNDINGS * unit * 10.0**-digits,
    )  # fmt: skip
    if line.find("R") is not None:
        size = math.hypot(part[0, 0] - piece.centre[0], part[0, 1] - piece.centre[1])
        value = round(math.copysign(size, math.pi - abs(piece.turn_rad)) / unit, digits)
        by_radius = radius_centre(part[0], part[-1], value * unit, rounded.sense)
        if by_radius is not None and rounded.holds(machine, by_radius):
            return {"R": number(value, digits)}
        machine.radius_replaced += 1
    words: dict[str, str] = {}
    centre: list[float] = []
    zero = work_axes(modal, np.array(modal.p_part_origin))
    for axis, requested in zip(axes[:2], piece.centre, strict=True):
        base = float(zero[axis] if modal.arc_absolute else here[axis])
        value = round((requested - base) / unit, digits)
        words["IJK"[axis]] = number(value, digits)
        centre.append(base + value * unit)
    return words if rounded.holds(machine, (centre[0], centre[1])) else {}

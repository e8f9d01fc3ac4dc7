"""The text of a program with soft entries: lines put in before and behind those that cut."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from counterflex.app.strategy.entries import Entry
from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.plan.strategy.entry_moves import EntryArc, arc_in, arc_out, ramp
from counterflex.programs.program import Block, Program, has_g

_LEVEL_M = 1e-9
_STEP = 0.25  # Depth of a pass of a ramp, in radii of the cutter
_CLEAR_M = 0.5 * MM  # A ramp begins so far above where the plunge meets material


@dataclass(frozen=True)
class Moves:
    """Moves that are asked for."""

    radius_m: float | None = None  # Of the arcs; None is the radius of the cutter
    angle_rad: float = 0.5 * np.pi
    slope_rad: float = np.pi / 18.0
    edges: bool = False  # Slots that begin over an edge of the blank get a ramp, too
    # Way through the air in the direction of the cut with which other cuts over an edge begin: the axes then move as
    # they will in the cut, and what they lose at a reversal is lost before the first contact
    run_up_m: float = 10.0 * MM


@dataclass
class _Lines:
    """Lines of a program: the text of each, and what stands before and behind it."""

    text: dict[int, str] = field(default_factory=dict)
    before: dict[int, list[str]] = field(default_factory=dict)
    behind: dict[int, list[str]] = field(default_factory=dict)

    def restate(self, block: Block) -> None:
        """Write the motion code into a line that relied on the one before."""
        if block.line in self.text or has_g(block.words, 0, 1, 2, 3):
            return
        at = min((word.start for word in block.words if word.letter != "N"), default=len(block.text))
        self.text[block.line] = f"{block.text[:at]}{block.modal.motion} {block.text[at:]}"


def rewritten(program: Program, entries: list[Entry], moves: Moves) -> str:
    """The program with soft moves at some entries."""
    lines = _Lines()
    for entry in entries:
        if entry.kind == "wall in":
            _write_arc_in(program, entry, moves, lines)
        elif entry.kind == "wall out":
            _write_arc_out(program, entry, moves, lines)
        elif entry.kind == "run-up":
            _write_run_up(program, entry, moves, lines)
        else:
            _write_ramp(program, entry, moves, lines)
    out: list[str] = []
    for number, line in enumerate(program.lines, start=1):
        out += [*lines.before.get(number, []), lines.text.get(number, line), *lines.behind.get(number, [])]
    return program.newline.join(out)


def _write_arc_in(program: Program, entry: Entry, moves: Moves, lines: _Lines) -> None:
    block, down = _block(program, entry.motion), _block(program, entry.vertical)
    radius = entry.radius_m if moves.radius_m is None else moves.radius_m
    arc = arc_in(entry.point[:2], entry.tangent, entry.free, radius, moves.angle_rad)
    words = _Words(block)
    straight = program.motions[entry.vertical]
    if np.linalg.norm(straight.p_end[:2] - straight.p_start[:2]) > _LEVEL_M:
        lines.text[down.line] = f"G1 {words.plane(arc.start)} {words.feed(straight.feed_m_s)}"
    else:
        lines.before.setdefault(down.line, []).append(f"G0 {words.plane(arc.start)}")
        lines.restate(down)
    feed = program.motions[entry.motion].feed_m_s
    lines.before.setdefault(block.line, []).append(f"{words.arc(arc)} {words.feed(feed)}")
    lines.restate(block)


def _write_arc_out(program: Program, entry: Entry, moves: Moves, lines: _Lines) -> None:
    block, up = _block(program, entry.motion), _block(program, entry.vertical)
    radius = entry.radius_m if moves.radius_m is None else moves.radius_m
    words, arc = _Words(block), arc_out(entry.point[:2], entry.tangent, entry.free, radius, moves.angle_rad)
    lines.behind.setdefault(block.line, []).append(words.arc(arc))
    lines.restate(up)
    back = "G0" if program.motions[entry.vertical].kind == "rapid" else "G1"
    lines.behind.setdefault(up.line, []).append(f"{back} {words.plane(entry.point[:2])}")


def _write_ramp(program: Program, entry: Entry, moves: Moves, lines: _Lines) -> None:
    block, down = _block(program, entry.motion), _block(program, entry.vertical)
    motion, plunge = program.motions[entry.motion], program.motions[entry.vertical]
    words, top = _Words(block), min(entry.top_m + _CLEAR_M, float(plunge.p_start[2]))
    points = ramp(entry.point, motion.p_end, top, moves.slope_rad, _STEP * entry.radius_m)
    text = [f"G1 {words.space(points[0])} {words.feed(motion.feed_m_s)}"]
    text += [f"G1 {words.space(point)}" for point in points[1:]]
    if np.linalg.norm(motion.p_start - entry.point) > _LEVEL_M:
        text.append(f"G1 {words.space(motion.p_start)}")
    lines.text[down.line] = f"G1 {words.height(top)} {words.feed(plunge.feed_m_s)}"
    lines.behind.setdefault(down.line, []).extend(text)
    lines.restate(block)


def _write_run_up(program: Program, entry: Entry, moves: Moves, lines: _Lines) -> None:
    block, down = _block(program, entry.motion), _block(program, entry.vertical)
    words, motion = _Words(block), program.motions[entry.motion]
    begin = entry.point[:2] - (moves.run_up_m - entry.air_m) * entry.tangent
    lines.before.setdefault(down.line, []).append(f"G0 {words.plane(begin)}")
    lines.restate(down)
    text = f"G1 {words.plane(entry.point[:2])} {words.feed(motion.feed_m_s)}"
    lines.before.setdefault(block.line, []).append(text)
    lines.restate(block)


def _block(program: Program, motion: int) -> Block:
    return program.blocks[program.motions[motion].block]


class _Words:
    """Words in the units and offsets of a block."""

    def __init__(self, block: Block) -> None:
        self.unit = block.modal.unit_m
        self.origin = np.array(block.modal.p_part_origin)
        self.digits = 4 if self.unit == MM else 5

    def _word(self, letter: str, value: float) -> str:
        return f"{letter}{round(value, self.digits) + 0.0:.{self.digits}f}"

    def _at(self, point: Float) -> Float:
        out: Float = np.round((point - self.origin[: len(point)]) / self.unit, self.digits)
        return out

    def plane(self, point: Float) -> str:
        """X and Y."""
        return " ".join(self._word(c, v) for c, v in zip("XY", self._at(point).tolist(), strict=True))

    def space(self, point: Float) -> str:
        """X, Y and Z."""
        return " ".join(self._word(c, v) for c, v in zip("XYZ", self._at(point).tolist(), strict=True))

    def height(self, z: float) -> str:
        """Z alone."""
        return self._word("Z", (z - float(self.origin[2])) / self.unit)

    def arc(self, arc: EntryArc) -> str:
        """G2 or G3 with its end and its centre from the start."""
        arms = (arc.centre - self.origin[:2]) / self.unit - self._at(arc.start)
        centre = " ".join(self._word(c, v) for c, v in zip("IJ", arms.tolist(), strict=True))
        return f"{'G3' if arc.left else 'G2'} {self.plane(arc.end)} {centre}"

    def feed(self, feed_m_s: float) -> str:
        """F, per minute."""
        return f"F{feed_m_s * 60.0 / self.unit:.3f}"

"""Points and events of a robot program: few enough for the controller's cycle, in the order of execution."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import MINUTE, MM, MS, UM
from counterflex.geometry import rotation
from counterflex.path.sampling import point_spacing
from counterflex.path.toolpath import RAPID, ToolPath
from counterflex.programs.motion_rows import feed_factor, relieved_along_axis, simplify
from counterflex.programs.program import Block, Program
from counterflex.programs.robot_writer.machine_functions import BEHIND
from counterflex.programs.robot_writer.spaced_points import implied_stops, refined, spaced

BlockLines = Callable[[Block], Sequence[str]]
"""Lines of the robot's language for a block that is not (only) motion; empty for none."""

_SPEED_STEP: Final = 0.02
_CAUTION: Final = 0.8  # Of the feed at which the tolerance would just be held
_BACK: Final = -0.5  # Cosine of the angle between two steps beyond which the path turns back: 120 degrees
_MODAL_ONLY: Final = frozenset("GXYZABCIJKRPQLFN")
_STOPS: Final = frozenset((0.0, 1.0, 60.0))


@dataclass(frozen=True)
class RobotText:
    """Files of a robot program and what became of the path."""

    files: dict[str, str]  # File name to text, the program to start first
    points: int  # Motion instructions written
    merged_points: int  # Points left out because they follow closer than the controller's cycle allows
    too_close: int  # Remaining points that follow closer than that (ends of operations cannot be merged)
    # Largest distance of a commanded feed row from the written polyline at the same place of the way, merging included
    largest_position_error_m: float
    largest_angle_error_rad: float  # The same for the orientation
    warnings: tuple[str, ...]  # What the user should know, one sentence each
    largest_position_error_line: int = 0  # Line of the source where that is


@dataclass(frozen=True)
class RobotPoints:
    """Rows chosen as points of the robot program."""

    row: Int  # (m,) row of the path that each point lies at or before, non-decreasing
    Ts_part_tcp: Float  # (m, 4, 4) commanded poses
    speed_m_s: Float  # (m,) speed along the segment that ends there
    exact: Bool  # (m,) True where the point must be reached without blending (before events and at the end)
    motion: Int  # (m,) program motion of the row
    place: Int  # (m,) number of the place of the external axes
    merged: int  # Points dropped for the controller's cycle
    too_close: int  # Points closer than the cycle allows that had to stay
    largest_position_error_m: float  # See :class:`RobotText`
    largest_angle_error_rad: float  # See :class:`RobotText`
    worst_motion: int  # Motion of the largest position error
    cycle_s: float  # Time the controller needs per point, s
    feed_m_s: float  # Feed at the largest position error

    def line(self, program: Program) -> int:
        """Source line of the largest position error."""
        return program.blocks[program.motions[self.worst_motion].block].line

    def warnings(self, program: Program, tolerance_m: float) -> tuple[str, ...]:
        """Warnings where the written path is coarser than the tolerance, with cause and remedy."""
        out = []
        error = self.largest_position_error_m
        if error > tolerance_m:
            # The error of a chord of the length f DT grows with the square of that length.
            share = _CAUTION * math.sqrt(tolerance_m / error)
            feed, cycle = share * self.feed_m_s * MINUTE / MM, share * self.cycle_s / MS
            out.append(
                f"the written path is up to {error / MM:.4f} mm from the planned one (tolerance "
                f"{tolerance_m / MM:.4f} mm), most in line {self.line(program)}: the points would have to be closer "
                f"together than feed times controller cycle, {self.feed_m_s * self.cycle_s / MM:.2g} mm; {self.merged} "
                f"were merged. F{feed:.0f} there would hold it, or controller.cycle_ms = {cycle:.2g} if the controller "
                f"takes points that fast; compensation.tolerance_um = {math.ceil(error / UM)} accepts it"
            )
        if self.too_close:
            out.append(f"{self.too_close} points are closer together than feed times controller cycle and had to stay")
        return tuple(out)


def choose_points(
    program: Program,
    path: ToolPath,
    Ts_part_tcp: Float,
    *,
    tolerance_m: float,
    tolerance_rad: float,
    cycle_s: float,
    rapid_m_s: float,
    events: frozenset[int],
) -> RobotPoints:
    """Choose the rows that a robot program needs.

    Straight stretches are reduced within the tolerances at the same place of the way, with points at least
    ``DS = f DT`` apart (Berger2013 eq. 5); where the tolerance would need them closer, they lie at that distance, also
    between rows. Ends of rapids, changes of speed, dwells and rows before an event stay; so does the point from which a
    correction is taken back at the end of a cut, and it is approached exactly, as are the places where the path turns
    back and the corners of canned cycles. The first row is left out: it is where the program happens to start, which
    G-code does not say, and a robot must not be sent there.

    Args:
        program: The program the path was sampled from.
        path: Nominal rows.
        Ts_part_tcp: (n, 4, 4) commanded poses in the part frame.
        tolerance_m: Position tolerance, m.
        tolerance_rad: Orientation tolerance, rad.
        cycle_s: Time the controller needs per point, s.
        rapid_m_s: Speed of rapids, m/s.
        events: Motions before which something else than motion happens.

    Raises:
        InputError: Shapes do not fit, or a value is out of range.
    """
    n = len(path)
    T = as_float("Ts_part_tcp", Ts_part_tcp, (n, 4, 4))
    as_positive("rapid_m_s", rapid_m_s)
    as_positive("cycle_s", cycle_s)
    if n == 0:
        raise InputError("the path has no points")
    if path.motion[-1] >= len(program.motions):
        raise InputError("the path was not sampled from this program", value=int(path.motion[-1]))
    p, R = np.ascontiguousarray(T[:, :3, 3]), T[:, :3, :3]
    turned = np.zeros((n, 3))
    turned[1:] = np.cumsum(rotation.log(np.swapaxes(R[:-1], 1, 2) @ R[1:]), axis=0)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.p_part_tcp, axis=0), axis=1))])
    rapid = path.kind == RAPID
    speed = np.where(rapid, rapid_m_s, path.feed_m_s)
    moving = np.concatenate([[True], np.linalg.norm(np.diff(p, axis=0), axis=1) > 0.0])
    moving[1:] |= np.any(np.diff(turned, axis=0) != 0.0, axis=1)
    ends = np.concatenate([path.motion[1:] != path.motion[:-1], [True]])
    exact = _exact(program, path, ends, events)
    exact[:-1] |= (way[1:] == way[:-1]) & moving[1:]  # the nominal path stands still, the commanded one moves back
    whole = _standing(path, exact)
    stays = exact | (rapid & ends)
    stays[:-1] |= (speed[1:] != speed[:-1]) | (rapid[1:] != rapid[:-1])
    stays[0] = True
    dwells = np.array([motion.kind == "dwell" for motion in program.motions], dtype=np.bool_)[path.motion]
    for at in np.flatnonzero(dwells & moving).tolist():
        if at > 0 and relieved_along_axis(path, p, at):
            exact[at] = stays[at] = True
    usable = whole & ((moving & ~dwells) | (stays & (~dwells | exact)))
    travel = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    spacing = np.where(rapid | dwells, 0.0, point_spacing(1.0, cycle_s) * path.feed_m_s)
    vertices = simplify(way, p, tolerance_m, rotvec=turned, tolerance_rad=tolerance_rad, fixed=stays)
    fine = FineRows(refined(travel, spacing, vertices))
    way, p, travel = fine.between(way), fine.between(p), fine.between(travel)
    turned_fine, spacing = fine.between(turned), spacing[fine.row]
    chosen = spaced(way, p, turned_fine, travel, spacing, fine.at_rows(stays), tolerance_m, tolerance_rad)
    keep = np.zeros(len(way), dtype=np.bool_)
    keep[chosen] = True
    keep &= usable[fine.row]
    keep[0] = n == 1
    at_point = np.flatnonzero(keep)
    row = fine.row[at_point]
    feed = ~rapid & ~dwells
    position, angle, worst = _errors(at_point, way, p, turned_fine, feed[fine.row])
    point_speed = _held_speed(at_point, speed[fine.row], rapid[fine.row], way, travel)
    step = turned_fine[at_point] - turned[np.maximum(row - 1, 0)]
    return RobotPoints(
        row=row,
        Ts_part_tcp=_poses(T, p[at_point], row, step, fine.share[at_point] < 1.0),
        speed_m_s=point_speed,
        exact=fine.at_rows(exact)[at_point],
        motion=path.motion[row],
        place=path.place[row].astype(np.int64),
        merged=max(0, int(usable[vertices].sum()) - int(usable[0]) - len(row)) if n > 1 else 0,
        too_close=_too_close(at_point, travel, spacing),
        largest_position_error_m=position,
        largest_angle_error_rad=angle,
        worst_motion=int(path.motion[fine.row[worst]]),
        cycle_s=cycle_s,
        feed_m_s=float(path.feed_m_s[fine.row[worst]]),
    )


def _poses(T: Float, p: Float, row: Int, step: Float, part: Bool) -> Float:
    """(k, 4, 4) m of points: places (k, 3) m, orientation that of a row, or a step (k, 3) rad behind the row before."""
    Ts = T[row].copy()
    Ts[:, :3, 3] = p
    Ts[part, :3, :3] = T[np.maximum(row[part] - 1, 0), :3, :3] @ rotation.exp(step[part])
    return Ts


def _exact(program: Program, path: ToolPath, ends: Bool, events: frozenset[int]) -> Bool:
    """Rows (n,) that must be reached without blending: where something else happens, at turns back and at the end."""
    following = np.concatenate([path.motion[1:], [-1]])
    exact: Bool = ends & np.isin(following, np.fromiter(events, dtype=np.int64, count=len(events)))
    exact |= ends & (_turns_back(path) | _in_cycle(program)[path.motion])
    exact[-1] = True
    return exact


def _standing(path: ToolPath, exact: Bool) -> Bool:
    """(n,) rows at which external axes stand; the two beside each of their moves become exact."""
    moved = np.diff(path.place) != 0.0
    whole: Bool = path.place == np.round(path.place)
    exact[:-1] |= moved & whole[:-1]
    exact[1:] |= moved & whole[1:]
    return whole


def _turns_back(path: ToolPath) -> Bool:
    """(n,) rows from which the path goes back the way it came: a blended corner would not get there."""
    step = np.diff(path.p_part_tcp, axis=0)
    size = np.linalg.norm(step, axis=1)
    out = np.zeros(len(path), dtype=np.bool_)
    out[1:-1] = np.sum(step[:-1] * step[1:], axis=1) < _BACK * size[:-1] * size[1:]
    return out


def _in_cycle(program: Program) -> Bool:
    """By motion: it is part of a canned cycle, which stops at every corner."""
    out = np.zeros(len(program.motions), dtype=np.bool_)
    for block in program.blocks:
        if block.cycle:
            out[block.first_motion : motions_end(block)] = True
    return out


class FineRows:
    """A path with more rows: each segment cut into equal pieces.

    Args:
        pieces: (n,) of the segment that ends at each row, >= 1.
    """

    def __init__(self, pieces: Int) -> None:
        # (m,) row at which the segment ends that a finer row lies on
        self.row: Int = np.repeat(np.arange(len(pieces)), pieces)
        behind = np.cumsum(pieces)[self.row] - np.arange(1, len(self.row) + 1)
        self.share: Float = 1.0 - behind / pieces[self.row]  # (m,) of that segment, 1 at the row itself

    def between(self, values: Float) -> Float:
        """Values at the finer rows, linear along each segment."""
        before = values[np.maximum(self.row - 1, 0)]
        share = self.share.reshape(-1, *([1] * (values.ndim - 1)))
        out: Float = np.where(share == 1.0, values[self.row], before + share * (values[self.row] - before))
        return out

    def at_rows(self, flags: Bool) -> Bool:
        """Flags at the rows themselves, False between them."""
        out: Bool = flags[self.row] & (self.share == 1.0)
        return out


def _held_speed(row: Int, speed: Float, rapid: Bool, way: Float, travel: Float) -> Float:
    """Speed along each segment, in steps of 2 per cent of the programmed one so that few speeds are declared."""
    factor = feed_factor(np.diff(way[row], prepend=way[0]), np.diff(travel[row], prepend=travel[0]))
    out: Float = speed[row] * np.where(rapid[row], 1.0, np.round(factor / _SPEED_STEP) * _SPEED_STEP)
    return out


def _too_close(row: Int, travel: Float, spacing: Float) -> int:
    """Points that follow closer than the controller's cycle takes, because both have to be there."""
    length = np.diff(travel[row])
    return int(np.sum((length > 0.0) & (length < spacing[row[1:]] * (1.0 - 1e-9))))


def _errors(row: Int, way: Float, p: Float, turned: Float, feed: Bool) -> tuple[float, float, int]:
    """Largest position and orientation error of feed rows against the polyline through the chosen rows, and where."""
    k = np.flatnonzero(feed)
    if len(k) == 0:
        return 0.0, 0.0, 0
    b = row[np.minimum(np.searchsorted(row, k), len(row) - 1)]
    a = row[np.maximum(np.searchsorted(row, k, side="right") - 1, 0)]
    span = way[b] - way[a]
    share = np.where(span > 0.0, (way[k] - way[a]) / np.where(span > 0.0, span, 1.0), 0.0)[:, None]
    gap = p[a] + share * (p[b] - p[a]) - p[k]
    twist = turned[a] + share * (turned[b] - turned[a]) - turned[k]
    size = np.linalg.norm(gap, axis=1)
    worst = int(np.argmax(size))
    return float(size[worst]), float(np.linalg.norm(twist, axis=1).max()), int(k[worst])


def event_motions(program: Program, lines: BlockLines) -> frozenset[int]:
    """Motions before which a block makes something happen that must find the tool in its place."""
    motions = program.motions
    out = set()
    for block in program.blocks:
        if acts(block) or lines(block):
            out.add(block.first_motion)
            if _split(program, block)[1] is not None:
                out.add(motions_end(block))
    out |= {index for index, motion in enumerate(motions) if motion.kind == "dwell"}
    out |= set(implied_stops(program).within)
    return frozenset(out)


def motions_end(block: Block) -> int:
    """Index behind the last motion of a block."""
    return block.first_motion + block.motion_count


def stops(block: Block) -> bool:
    """Return whether a block stops the program: M0, M1, M60."""
    return any(word.letter == "M" and word.value in _STOPS for word in block.words)


def acts(block: Block) -> bool:
    """Return whether a block does more than move: spindle, coolant, tool, stop."""
    return any(word.letter not in _MODAL_ONLY and word.letter != "O" for word in block.words)


def steps(program: Program, points: RobotPoints) -> Iterator[Block | float | int]:
    """The program in the order of execution.

    Yields:
        A block (its text and M-codes belong here), a dwell time in s (float), or the index of a point (int).
    """
    at = 0
    m = len(points.row)
    motion = points.motion
    implied = implied_stops(program)
    for number, block in enumerate(program.blocks):
        yield from implied.before.get(number, ())
        first, last = _split(program, block)
        yield first
        for index in range(block.first_motion, motions_end(block)):
            if index in implied.within:
                yield implied.within[index]
            while at < m and motion[at] <= index:
                yield at
                at += 1
            if program.motions[index].kind == "dwell":
                yield float(program.motions[index].duration_s)
        if last is not None:
            yield last
        yield from implied.behind.get(number, ())


def _split(program: Program, block: Block) -> tuple[Block, Block | None]:
    """Return functions of a block before its motions, and those behind them (:data:`BEHIND`); dwells are none."""
    motions = program.motions[block.first_motion : motions_end(block)]
    behind = _STOPS if all(motion.kind == "dwell" for motion in motions) else BEHIND
    late = tuple(word for word in block.words if word.letter == "M" and word.value in behind)
    if not late or not motions:
        return block, None
    before = replace(block, words=tuple(word for word in block.words if word not in late))
    text = " ".join(f"M{word.value:.0f}" for word in late)
    return before, replace(block, text=text, words=late, motion_count=0)


def carried_text(block: Block) -> str:
    """Text of a block as a comment of the robot program; empty for pure motion and pure modal blocks."""
    text = block.text.strip()
    plain = "".join(c if 32 <= ord(c) < 127 else "?" for c in text)
    if "(" in plain or ";" in plain or acts(block):
        return plain[:200]
    return ""

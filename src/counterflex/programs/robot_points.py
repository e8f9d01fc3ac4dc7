"""Points and events of a robot program: few enough for the controller's cycle, in the order of execution."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.geometry import rotation
from counterflex.path.sampling import point_spacing
from counterflex.path.toolpath import RAPID, ToolPath
from counterflex.programs.feed_hold import feed_factor
from counterflex.programs.implied_stops import implied_stops
from counterflex.programs.motion_rows import relieved_along_axis
from counterflex.programs.program import Block, Program
from counterflex.programs.simplify import simplify

BlockLines = Callable[[Block], Sequence[str]]
"""Lines of the robot's language for a block that is not (only) motion; empty for none."""

_SPEED_STEP: Final = 0.02
_MODAL_ONLY: Final = frozenset("GXYZABCIJKRPQLFN")


@dataclass(frozen=True)
class RobotText:
    """Files of a robot program and what became of the path.

    Attributes:
        files: File name to text, the program to start first.
        points: Motion instructions written.
        merged_points: Points left out because they follow closer than the controller's cycle allows.
        too_close: Remaining points that follow closer than that (ends of operations cannot be merged).
        largest_position_error_m: Largest distance of a commanded feed row from the written polyline at the same
            place of the way, merging included.
        largest_angle_error_rad: The same for the orientation.
        warnings: What the user should know, one sentence each.
    """

    files: dict[str, str]
    points: int
    merged_points: int
    too_close: int
    largest_position_error_m: float
    largest_angle_error_rad: float
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class RobotPoints:
    """Rows chosen as points of the robot program.

    Attributes:
        row: (m,) indices of the path's rows, rising.
        Ts_part_tcp: (m, 4, 4) commanded poses.
        speed_m_s: (m,) speed along the segment that ends there.
        exact: (m,) True where the point must be reached without blending (before events and at the end).
        motion: (m,) program motion of the row.
        merged: Points dropped for the controller's cycle.
        too_close: Points closer than the cycle allows that had to stay.
        largest_position_error_m: See :class:`RobotText`.
        largest_angle_error_rad: See :class:`RobotText`.
    """

    row: Int
    Ts_part_tcp: Float
    speed_m_s: Float
    exact: Bool
    motion: Int
    merged: int
    too_close: int
    largest_position_error_m: float
    largest_angle_error_rad: float

    def warnings(self, tolerance_m: float) -> tuple[str, ...]:
        """What merging did, in words."""
        out = []
        if self.merged:
            out.append(
                f"{self.merged} points closer together than feed times controller cycle were merged; the written path "
                f"is up to {self.largest_position_error_m / MM:.4f} mm from the commanded points "
                f"(tolerance {tolerance_m / MM:.4f} mm)"
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

    Straight stretches are reduced within the tolerances at the same place of the way; then points that follow the one
    before closer than ``DS = f DT`` are merged into their neighbours (Berger2013 eq. 5). Ends of rapids, changes of
    speed, dwells and rows before an event stay; so does the point from which a correction is taken back at the end of
    a cut, and it is approached exactly. The first row is left out: it is where the program happens to start,
    which G-code does not say, and a robot must not be sent there.

    Args:
        program: The program the path was sampled from.
        path: Nominal rows.
        Ts_part_tcp: (n, 4, 4) commanded poses in the part frame.
        tolerance_m: Position tolerance, m.
        tolerance_rad: Orientation tolerance, rad.
        cycle_s: Time the controller needs per point, s.
        rapid_m_s: Speed of rapids, m/s.
        events: Motions before which something else than motion happens.

    Returns:
        The points.

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
    exact = np.zeros(n, dtype=np.bool_)
    exact[-1] = True
    following = np.concatenate([path.motion[1:], [-1]])
    exact |= ends & np.isin(following, np.fromiter(events, dtype=np.int64, count=len(events)))
    relieved = np.zeros(n, dtype=np.bool_)  # the nominal path stands still while the commanded one moves back
    relieved[:-1] = (way[1:] == way[:-1]) & moving[1:]
    exact |= relieved
    stays = exact | (rapid & ends)
    stays[:-1] |= (speed[1:] != speed[:-1]) | (rapid[1:] != rapid[:-1])
    stays[0] = True
    keep = np.zeros(n, dtype=np.bool_)
    keep[simplify(way, p, tolerance_m, rotvec=turned, tolerance_rad=tolerance_rad, fixed=stays)] = True
    dwells = np.array([motion.kind == "dwell" for motion in program.motions], dtype=np.bool_)[path.motion]
    keep &= (moving | stays) & ~dwells
    for at in np.flatnonzero(dwells & moving).tolist():
        if at > 0 and relieved_along_axis(path, p, at):
            keep[at] = exact[at] = stays[at] = True
    keep[0] = n == 1
    travel = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    merged, close = _merge(keep, stays, travel, np.where(rapid, 0.0, path.feed_m_s), cycle_s)
    row = np.flatnonzero(keep)
    position, angle = _errors(row, way, p, turned, ~rapid & ~dwells)
    held = _held_speed(row, speed, rapid, way, travel)
    return RobotPoints(row, T[row], held, exact[row], path.motion[row], merged, close, position, angle)


def _held_speed(row: Int, speed: Float, rapid: Bool, way: Float, travel: Float) -> Float:
    """Speed along each segment, in steps of 2 per cent of the programmed one so that few speeds are declared."""
    factor = feed_factor(np.diff(way[row], prepend=way[0]), np.diff(travel[row], prepend=travel[0]))
    out: Float = speed[row] * np.where(rapid[row], 1.0, np.round(factor / _SPEED_STEP) * _SPEED_STEP)
    return out


def _merge(keep: Bool, stays: Bool, travel: Float, feed_m_s: Float, cycle_s: float) -> tuple[int, int]:
    """Drop kept rows that are too close to the one before; returns how many were dropped and how many stay close."""
    merged = close = 0
    before = -1
    for row in np.flatnonzero(keep):
        feed = float(feed_m_s[row])
        if before >= 0 and feed > 0.0 and travel[row] - travel[before] < point_spacing(feed, cycle_s) * (1.0 - 1e-9):
            if not stays[row]:
                keep[row] = False
                merged += 1
                continue
            if not stays[before]:
                keep[before] = False
                merged += 1
            elif travel[row] > travel[before]:
                close += 1
        before = int(row)
    return merged, close


def _errors(row: Int, way: Float, p: Float, turned: Float, feed: Bool) -> tuple[float, float]:
    """Largest position and orientation error of feed rows against the polyline through the chosen rows."""
    k = np.flatnonzero(feed)
    if len(k) == 0:
        return 0.0, 0.0
    b = row[np.minimum(np.searchsorted(row, k), len(row) - 1)]
    a = row[np.maximum(np.searchsorted(row, k, side="right") - 1, 0)]
    span = way[b] - way[a]
    share = np.where(span > 0.0, (way[k] - way[a]) / np.where(span > 0.0, span, 1.0), 0.0)[:, None]
    gap = p[a] + share * (p[b] - p[a]) - p[k]
    twist = turned[a] + share * (turned[b] - turned[a]) - turned[k]
    return float(np.linalg.norm(gap, axis=1).max()), float(np.linalg.norm(twist, axis=1).max())


def event_motions(program: Program, lines: BlockLines) -> frozenset[int]:
    """Motions before which a block makes something happen that must find the tool in its place."""
    motions = program.motions
    out = set()
    for block in program.blocks:
        if acts(block) or lines(block):
            out.add(block.first_motion)
            if any(word.letter == "M" and word.value in (0.0, 1.0, 60.0) for word in block.words):
                out.add(motions_end(block))
    out |= {index for index, motion in enumerate(motions) if motion.kind == "dwell"}
    out |= set(implied_stops(program).within)
    return frozenset(out)


def motions_end(block: Block) -> int:
    """Index behind the last motion of a block."""
    return block.first_motion + block.motion_count


def acts(block: Block) -> bool:
    """Whether a block does more than move: spindle, coolant, tool, stop."""
    return any(word.letter not in _MODAL_ONLY and word.letter != "O" for word in block.words)


def steps(program: Program, points: RobotPoints) -> Iterator[Block | float | int]:
    """The program in the order of execution.

    Args:
        program: The program.
        points: Its points.

    Yields:
        A block (its text and M-codes belong here), a dwell time in s (float), or the index of a point (int).
    """
    at = 0
    m = len(points.row)
    motion = points.motion
    implied = implied_stops(program)
    for number, block in enumerate(program.blocks):
        yield from implied.before.get(number, ())
        yield block
        for index in range(block.first_motion, motions_end(block)):
            if index in implied.within:
                yield implied.within[index]
            while at < m and motion[at] <= index:
                yield at
                at += 1
            if program.motions[index].kind == "dwell":
                yield float(program.motions[index].duration_s)
        yield from implied.behind.get(number, ())


def carried_text(block: Block) -> str:
    """Text of a block as a comment of the robot program; empty for pure motion and pure modal blocks."""
    text = block.text.strip()
    plain = "".join(c if 32 <= ord(c) < 127 else "?" for c in text)
    if "(" in plain or ";" in plain or acts(block):
        return plain[:200]
    return ""

"""The rows of a compensated path sorted by program motion, and the feed of the corrected pieces.

Fewest polyline vertices that keep every sample, at its own place along the path, within a tolerance.

Geometric line simplification (Douglas-Peucker) bounds the distance from a sample to the nearest point of the polyline.
Here a force belongs to every place, so the bound holds at the same path parameter: the point that the controller
commands when it has covered the share ``s`` of the way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel
from counterflex.core.units import MM
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.programs.compensated import CompensatedPath
from counterflex.programs.program import Program


@kernel("b1(f8[:], f8[:,:], f8[:,:], i8, i8, f8, f8)")
def fits(s: Float, p: Float, r: Float, a: int, b: int, tol2: float, tol2_r: float) -> bool:
    """Return whether all samples between a and b lie within the tolerance of the chord a-b at their own parameter."""
    span = s[b] - s[a]
    for k in range(a + 1, b):
        f = (s[k] - s[a]) / span if span > 0.0 else 0.0
        e = 0.0
        g = 0.0
        for c in range(3):
            d = p[a, c] + f * (p[b, c] - p[a, c]) - p[k, c]
            e += d * d
            d = r[a, c] + f * (r[b, c] - r[a, c]) - r[k, c]
            g += d * d
        if e > tol2 or g > tol2_r:
            return False
    return True


@kernel("void(f8[:], f8[:,:], f8[:,:], b1[:], f8, f8)", entry=True)
def _open_window(s: Float, p: Float, r: Float, keep: Bool, tol2: float, tol2_r: float) -> None:
    """Greedy opening window: gallop to the first chord that fails, then bisect; ``keep`` holds the fixed vertices."""
    n = len(s)
    a = 0
    while a < n - 1:
        stop = a + 1
        while not keep[stop]:
            stop += 1
        while a < stop:
            good = a + 1
            step = 1
            bad = stop + 1
            while good < stop:
                candidate = min(a + 1 + step, stop)
                if fits(s, p, r, a, candidate, tol2, tol2_r):
                    good = candidate
                    step *= 2
                else:
                    bad = candidate
                    break
            while bad - good > 1 and good < stop:
                middle = (good + bad) // 2
                if fits(s, p, r, a, middle, tol2, tol2_r):
                    good = middle
                else:
                    bad = middle
            keep[good] = True
            a = good


def simplify(
    s: Float,
    p: Float,
    tolerance_m: float,
    *,
    rotvec: Float | None = None,
    tolerance_rad: float = 1e-5,
    fixed: Bool | None = None,
) -> Int:
    """Choose the samples that become polyline vertices.

    Greedy opening window with galloping search, O(n log n). For every sample k between neighbouring vertices a, b:
    ``|p_a + (s_k - s_a)/(s_b - s_a) (p_b - p_a) - p_k| <= tolerance_m``, likewise for the rotation vectors. The
    bound is checked on every sample of every chosen chord, so it is never broken; the number of vertices is the
    smallest where a chord that fails stays failing when it is lengthened, and close to it elsewhere.

    Args:
        s: (n,) path parameter (length, time, angle), non-decreasing.
        p: (n, 3) m, positions.
        tolerance_m: Largest allowed position error, > 0, m.
        rotvec: (n, 3) rad, orientation as rotation vectors from a common (nearby) orientation; none when left out.
        tolerance_rad: Largest allowed orientation error, > 0, rad.
        fixed: (n,) True where a sample must stay a vertex (ends of motions). The first and last always stay.

    Returns:
        (m,) indices of the vertices, rising, from 0 to n-1.

    Raises:
        InputError: Shapes differ, ``s`` falls, or a tolerance is not positive.
    """
    s = as_float("s", s, (None,))
    n = len(s)
    p = as_float("p", p, (n, 3))
    r = np.zeros((n, 3)) if rotvec is None else as_float("rotvec", rotvec, (n, 3))
    tol, tol_r = as_positive("tolerance_m", tolerance_m), as_positive("tolerance_rad", tolerance_rad)
    if n == 0:
        return np.zeros(0, dtype=np.int64)
    if np.any(np.diff(s) < 0.0):
        raise InputError("the path parameter falls", where=f"sample {int(np.argmax(np.diff(s) < 0.0)) + 1}")
    keep = np.zeros(n, dtype=np.bool_)
    if fixed is not None:
        if fixed.shape != (n,):
            raise InputError("fixed has the wrong shape", value=fixed.shape, limit=(n,))
        keep |= fixed
    keep[0] = keep[-1] = True
    _open_window(s, p, r, keep, tol * tol, tol_r * tol_r)
    out: Int = np.flatnonzero(keep)
    return out


MOST_CHANGE: Final = 2.0
"""Largest factor, up or down. Steeper pieces take a correction back while the tool hardly moves: no chip depends on
their feed."""
LEAST_FEED_CHANGE: Final = 0.01
"""Change of feed that is worth a word."""


def feed_factor(nominal_m: Float, commanded_m: Float) -> Float:
    """Factor for the feed of corrected pieces of path: commanded over nominal length.

    The loaded tool covers the nominal piece while the controller runs along the commanded one.

    Args:
        nominal_m: (k,) m.
        commanded_m: (k,) m.

    Returns:
        (k,) 0.5 to 2; 1 for pieces without nominal length.
    """
    whole = nominal_m > 0.0
    ratio = np.where(whole, commanded_m / np.where(whole, nominal_m, 1.0), 1.0)
    out: Float = np.clip(ratio, 1.0 / MOST_CHANGE, MOST_CHANGE)
    return out


_RELIEVED_M: Final = 2e-6  # Less than that is not worth a block
_SIDEWAYS_M: Final = 1e-9
_TURN_LEVER_M: Final = 0.3  # A turn by 1 rad counts as this much path: the reach of a tool and its holder
_NOT_THE_PROGRAM: Final = "the compensated path was not sampled from this program"


@dataclass(frozen=True)
class MotionRows:
    """Rows of the compensated path by motion, and the vertices chosen among them."""

    first: Int  # (motions,) first row behind the start of the motion (row 0, the start of all, belongs to none)
    last: Int  # (motions,) last row, the motion's end; -1 when the motion has no rows
    moved: Bool  # (motions,) True when a row is corrected
    nominal: Float  # (n, 3) m
    # (n, 3) m; a dwell keeps the correction of the row before it, because a dwell cannot move, unless what is planned
    # there lies straight up or down the tool axis from it; the start of a motion that begins elsewhere (another tool
    # length) keeps it too
    command: Float
    shift: Float  # (n, 3) m, command minus nominal, exactly zero where nothing is corrected
    way: Float  # (n,) m, nominal length up to the row
    vertex: Bool  # (n,) True where a straight motion needs a vertex
    dwell_error_m: float  # Largest distance of a commanded row of a dwell from where the dwell is held, m
    share: Float  # (n,) of the programmed feed, of the segment that ends at each row
    along: Float  # (n,) m, as ``way``, with what turning alone counts as
    # (n, 3) rad, rotary angles to command (or components of the tool axis); None where nothing turns
    angles: Float | None = None

    def share_of(self, first: int, last: int) -> float:
        """Share of the programmed feed over the segments that end at rows ``first`` to ``last``: way by time."""
        if last < first:
            return 1.0
        share = self.share[first : last + 1]
        steps = np.diff(self.way[first - 1 : last + 1]) if first > 0 else np.ones(len(share))
        total = float(steps.sum())
        return total / float(np.sum(steps / share)) if total > 0.0 else float(share[-1])

    def inner(self, index: int) -> list[int]:
        """Rows before its end at which a straight feed motion is split."""
        first = int(self.first[index])
        return [int(row) for row in np.flatnonzero(self.vertex[first : max(int(self.last[index]), first)]) + first]

    def factor(self, before: int, row: int, p_before: Float, p: Float) -> float:
        """Factor for the feed of one written piece between two rows, from and to places (3,) m."""
        way, step = float(self.way[row] - self.way[before]), float(np.linalg.norm(p - p_before))
        return float(feed_factor(np.array([way]), np.array([step]))[0]) * self.share_of(before + 1, row)

    def relieved(self, index: int) -> Float | None:
        """(3,) m, where a dwell is planned; None where the motion before it ends there."""
        first, last = int(self.first[index]), int(self.last[index])
        planned = self.command[last] if last >= first >= 1 else None
        return planned if planned is not None and np.any(planned != self.command[first - 1]) else None


def motion_rows(
    program: Program, compensated: CompensatedPath, tolerance_m: float, angles: tuple[Float, Float] | None = None
) -> MotionRows:
    """Sort the rows of a compensated path by motion and choose the vertices of straight motions.

    Args:
        program: The program the path was sampled from.
        compensated: Nominal and commanded rows.
        tolerance_m: See :func:`write_gcode`.
        angles: (n, 3) rad each, rotary angles of the program and those to command; None where nothing turns.

    Raises:
        InputError: The path names motions that the program lacks, or ends a motion elsewhere than the program.
    """
    path = compensated.path
    n, count = len(path), len(program.motions)
    motion = path.motion
    if n and (motion[0] < 0 or motion[-1] >= count):
        raise InputError(_NOT_THE_PROGRAM, value=int(motion[-1]), limit=f"motion 0 .. {count - 1}")
    last = np.full(count, -1, dtype=np.int64)
    last[motion[1:]] = np.arange(1, n)
    first = np.zeros(count, dtype=np.int64)
    first[motion[1:][::-1]] = np.arange(1, n)[::-1]
    have = last >= 0
    joint = np.zeros(0, dtype=np.int64)
    starts = np.array([m.p_start for m in program.motions]).reshape(count, 3)
    if count > 1:
        jump = np.abs(starts[1:] - np.array([m.p_end for m in program.motions[:-1]])).max(axis=1) > 1e-9
        jump &= first[1:] < last[1:]
        joint = first[1:][jump]
        first[1:] += jump
    if n > 1:
        _check_ends(program, path, last)
    command = compensated.p_part_command.copy()
    command[:1] = path.p_part_tcp[:1]
    dwells = [index for index, source in enumerate(program.motions) if source.kind == "dwell"]
    for index in dwells:
        if last[index] >= first[index] >= 1 and not relieved_along_axis(path, command, int(first[index])):
            command[first[index] : last[index] + 1] = command[first[index] - 1]
    largest = float(np.linalg.norm(command[1:] - compensated.p_part_command[1:], axis=1).max(initial=0.0))
    shift = command - path.p_part_tcp
    shift[joint] = shift[joint - 1]
    command[joint] = path.p_part_tcp[joint] + shift[joint]
    row_moved = np.any(shift != 0.0, axis=1)
    row_moved[joint] = False
    moved = np.zeros(count, dtype=np.bool_)
    np.logical_or.at(moved, motion, row_moved)
    share = _shares(program, path)
    slowed = np.zeros(count, dtype=np.bool_)
    np.logical_or.at(slowed, motion, share != 1.0)
    straight = np.array([single_straight(program, index) for index in range(count)], dtype=np.bool_)
    moved |= slowed & straight
    if angles is not None:
        np.logical_or.at(moved, motion, np.any(angles[0] != angles[1], axis=1))
    moved[dwells] = False
    steps = np.linalg.norm(np.diff(path.p_part_tcp, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])[:n]
    along, turned = _turning_counted(way, angles)
    stays = np.zeros(n, dtype=np.bool_)
    stays[last[have]] = True
    stays[np.maximum(first[have] - 1, 0)] = True
    vertex = _vertices(stays, share, (along, command, turned), tolerance_m)
    return MotionRows(first, last, moved, path.p_part_tcp, command, shift, way, vertex, largest, share, along, turned)


def _turning_counted(way: Float, angles: tuple[Float, Float] | None) -> tuple[Float, Float | None]:
    """(n,) m, the way with turning alone counted as some; and the angles to command, if any."""
    if angles is None:
        return way, None
    swept = np.abs(np.diff(angles[0], axis=0, prepend=angles[0][:1])).max(axis=1)
    return np.cumsum(np.diff(way, prepend=0.0) + _TURN_LEVER_M * swept), angles[1]


def _vertices(stays: Bool, share: Float, rows: tuple[Float, Float, Float | None], tolerance_m: float) -> Bool:
    """(n,) True where a straight motion needs a vertex; ``rows`` are way, points and angles."""
    along, command, turned = rows
    vertex = stays.copy()
    vertex[:1] = True
    vertex[:-1] |= share[1:] != share[:-1]
    tolerance_rad = tolerance_m / _TURN_LEVER_M
    vertex[simplify(along, command, tolerance_m, rotvec=turned, tolerance_rad=tolerance_rad, fixed=vertex)] = True
    return vertex


def _check_ends(program: Program, path: ToolPath, last: Int) -> None:
    """Refuse a path whose motions end elsewhere than those of the program; ``last`` is the last row of each, or -1."""
    have = np.flatnonzero(last >= 0)
    ends = np.array([m.p_end for m in program.motions])[have]
    gap = np.abs(ends - path.p_part_tcp[last[have]]).max(axis=1)
    if gap.max() > 1e-7:
        at = int(have[int(np.argmax(gap))])
        raise InputError(
            _NOT_THE_PROGRAM,
            where=program.blocks[program.motions[at].block].where(program.name),
            value=f"end point off by {gap.max() / MM:.6f} mm",
        )


def relieved_along_axis(path: ToolPath, command: Float, row: int) -> bool:
    """Return whether a dwell is planned straight above or below the place that it is reached at.

    The force of a plunge goes when the tool stops: what was commanded against it along the axis is taken back there,
    or the hole gets deeper by it. That moves nothing sideways.

    Args:
        path: Nominal rows.
        command: (n, 3) m, commanded positions.
        row: First row of the dwell.
    """
    step = command[row] - command[row - 1] - (path.p_part_tcp[row] - path.p_part_tcp[row - 1])
    along = float(step @ path.axis_part[row])
    return abs(along) > _RELIEVED_M and float(np.linalg.norm(step - along * path.axis_part[row])) < _SIDEWAYS_M


def single_straight(program: Program, index: int) -> bool:
    """Return whether a motion is a straight feed and a block alone: only such a one may have several feeds."""
    motion = program.motions[index]
    block = program.blocks[motion.block]
    return motion.kind == "feed" and block.motion_count == 1 and not block.cycle


def _shares(program: Program, path: ToolPath) -> Float:
    """(n,) sampled by programmed feed; 1 for rapids, dwells and the first row."""
    programmed = np.array([motion.feed_m_s for motion in program.motions])[path.motion]
    feed = (path.kind == FEED) & (programmed > 0.0)
    feed[:1] = False
    ratio = np.where(feed, path.feed_m_s / np.where(feed, programmed, 1.0), 1.0)
    out: Float = np.where(np.abs(ratio - 1.0) < 1e-9, 1.0, ratio)
    return out


def written_error(rows: MotionRows, p_written: Float, checked: Bool) -> float:
    """Largest distance of the checked commanded rows from the written polyline at the same length of the way, m.

    Args:
        rows: The compensated path by motion.
        p_written: (n, 3) m, written points at their rows; nan elsewhere.
        checked: (n,) True where a row counts.
    """
    at = np.flatnonzero(np.isfinite(p_written[:, 0]))
    k = np.flatnonzero(checked)
    if len(at) == 0 or len(k) == 0:
        return 0.0
    b = at[np.minimum(np.searchsorted(at, k), len(at) - 1)]
    a = at[np.maximum(np.searchsorted(at, k, side="right") - 1, 0)]
    span = rows.along[b] - rows.along[a]
    share = np.where(span > 0.0, (rows.along[k] - rows.along[a]) / np.where(span > 0.0, span, 1.0), 0.0)
    gap = p_written[a] + share[:, None] * (p_written[b] - p_written[a]) - rows.command[k]
    return float(np.sqrt(np.sum(gap * gap, axis=1)).max())

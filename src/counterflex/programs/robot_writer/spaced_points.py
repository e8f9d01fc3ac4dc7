"""Vertices of a polyline that a controller with a cycle can take: within a tolerance, and never too close together.

Starts and stops of spindle and coolant that a program does not write: at a tool change, at its end, inside a cycle.

RS274/NGC stops the spindle when a tool is changed (M6) and spindle and coolant when the program ends; G86 stops the
spindle for the way out of a hole; S0 and the other direction of turning stop it too. A robot controller does none of
that by itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.jit import kernel
from counterflex.programs.motion_rows import fits
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


FINER = 4
"""Places for a vertex within the smallest distance, where vertices would come too close together."""


@kernel("void(f8[:], f8[:,:], f8[:,:], f8[:], f8[:], b1[:], f8, f8)", entry=True)
def _open_window(
    s: Float, p: Float, r: Float, travel: Float, spacing: Float, keep: Bool, tol2: float, tol2_r: float
) -> None:
    """Greedy opening window; ``keep`` holds the fixed vertices."""
    # A chord is as long as the tolerance allows, but never shorter than ``spacing``; where the last one before a fixed
    # vertex would be shorter, the one before it is cut.
    n = len(s)
    a = 0
    while a < n - 1:
        stop = a + 1
        while not keep[stop]:
            stop += 1
        while a < stop:
            least = a + 1
            while least < stop and travel[least] - travel[a] < spacing[least]:
                least += 1
            good = least
            step = 1
            bad = stop + 1
            while good < stop:
                candidate = min(least + step, stop)
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
            if good < stop and travel[stop] - travel[good] < spacing[stop]:
                while good > least and travel[stop] - travel[good] < spacing[stop]:
                    good -= 1
                if travel[stop] - travel[good] < spacing[stop]:
                    good = stop
            keep[good] = True
            a = good


def spaced(
    way: Float,
    p: Float,
    rotvec: Float,
    travel_m: Float,
    apart_m: Float,
    fixed: Bool,
    tolerance_m: float,
    tolerance_rad: float,
) -> Int:
    """Choose vertices within a tolerance and at least a distance apart; where the two contradict, the distance wins.

    Args:
        way: (n,) m, nominal length: samples and polyline are compared at the same one.
        p: (n, 3) m, commanded positions.
        rotvec: (n, 3) rad, commanded orientations.
        travel_m: (n,) m, commanded length.
        apart_m: (n,) m, least commanded length of a chord that ends there.
        fixed: (n,) True where a sample must be a vertex, close to another or not.
        tolerance_m: Largest position error, m.
        tolerance_rad: Largest orientation error, rad.

    Returns:
        Indices of the vertices, rising; the first and the last sample are among them.
    """
    keep = fixed.copy()
    keep[0] = keep[-1] = True
    _open_window(way, p, rotvec, travel_m, apart_m, keep, tolerance_m**2, tolerance_rad**2)
    return np.flatnonzero(keep)


def refined(travel_m: Float, apart_m: Float, vertices: Int) -> Int:
    """Into how many pieces each segment is cut so that vertices find places where they would come too close together.

    Args:
        travel_m: (n,) m, commanded length.
        apart_m: (n,) m, least distance of vertices.
        vertices: Chosen without regard to that.

    Returns:
        (n,) pieces of the segment that ends at a sample; 1 where nothing is wrong.
    """
    n = len(travel_m)
    pieces = np.ones(n, dtype=np.int64)
    a, b = vertices[:-1], vertices[1:]
    close = travel_m[b] - travel_m[a] < apart_m[b] * (1.0 - 1e-9)
    near = np.zeros(n + 1, dtype=np.int64)
    reach = 2.0 * apart_m[b[close]]
    low = np.searchsorted(travel_m, travel_m[a[close]] - reach)
    high = np.searchsorted(travel_m, travel_m[b[close]] + reach, side="right")
    np.add.at(near, low, 1)
    np.add.at(near, high, -1)
    inside = np.cumsum(near[:n]) > 0
    length = np.diff(travel_m, prepend=travel_m[:1])
    refinable = inside & (apart_m > 0.0)
    pieces[refinable] = np.maximum(1, np.ceil(FINER * length[refinable] / apart_m[refinable])).astype(np.int64)
    return np.minimum(pieces, 64)

"""Kernel: how much of a line along the tool axis lies in the material at a moment of a program, without any grid.

The material is the blank, a box, less the sweeps of the motions before that moment. Each sweep meets the line in one
stretch (:mod:`swept_solid`), so what is left is the length of the blank's stretch less that of their union.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.cutting.tridexel.lattice_kernels import GROUP, TILES, Tiles, tile_of
from counterflex.cutting.tridexel.swept_solid import stretch

Real = Any
_ROOM: Final = 256
"""Stretches of sweeps along one line that are held apart; beyond, they are joined by their hull."""
_GONE_M: Final = 1.0e-9


@kernel()
def _cross(ux: Real, uy: Real, uz: Real, basis: Float) -> None:
    """Write a basis (3, 3) whose third row is the unit vector u."""
    if abs(ux) < 0.7:
        ax, ay, az = 0.0, uz, -uy
    else:
        ax, ay, az = -uz, 0.0, ux
    size = math.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax / size, ay / size, az / size
    basis[0, 0], basis[0, 1], basis[0, 2] = ax, ay, az
    basis[1, 0], basis[1, 1], basis[1, 2] = uy * az - uz * ay, uz * ax - ux * az, ux * ay - uy * ax
    basis[2, 0], basis[2, 1], basis[2, 2] = ux, uy, uz


@kernel()
def _in_box(base: Float, axis: Float, box: Float, turn: Float, low: Real, high: Real) -> tuple[float, float]:
    """Part of [low, high] along a line that lies in a box (2, 3) whose axes are the rows of ``turn``."""
    for c in range(3):
        b = turn[c, 0] * base[0] + turn[c, 1] * base[1] + turn[c, 2] * base[2]
        u = turn[c, 0] * axis[0] + turn[c, 1] * axis[1] + turn[c, 2] * axis[2]
        if abs(u) < 1.0e-12:
            if b < box[0, c] or b > box[1, c]:
                return 1.0, -1.0
            continue
        one, two = (box[0, c] - b) / u, (box[1, c] - b) / u
        low, high = max(low, min(one, two)), min(high, max(one, two))
    return low, high


@kernel()
def _taken(ends: Float, n: int, low: Real, high: Real) -> float:
    """Length of the union of n stretches (n, 2) within [low, high]; they are sorted in place."""
    for k in range(1, n):
        one, two = ends[k, 0], ends[k, 1]
        m = k
        while m > 0 and ends[m - 1, 0] > one:
            ends[m, 0], ends[m, 1] = ends[m - 1, 0], ends[m - 1, 1]
            m -= 1
        ends[m, 0], ends[m, 1] = one, two
    total, at = 0.0, low
    for k in range(n):
        one, two = max(ends[k, 0], at), min(ends[k, 1], high)
        if two > one:
            total += two - one
            at = two
    return total


@kernel(
    "void(Tiles, float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, "
    "::1], int64[::1], float64[::1])",
    entry=True,
    Tiles=TILES,
)
def engaged_lengths(
    tiles: Tiles, box: Float, turn: Float, base: Float, axis: Float, span: Float, before: Int, out: Float
) -> None:
    """Lengths of lines that lie in the material.

    Args:
        tiles: The motions, within reach of the longest line.
        box: (2, 3) m, lowest and highest corner of the blank in its own axes.
        turn: (3, 3) rows are the axes of the blank.
        base: (n, 3) m, a point of each line.
        axis: (n, 3) unit vectors along the lines.
        span: (n, 2) m, stretch of each line that is asked for, from its point.
        before: (n,) only motions with smaller numbers were cut.
        out: (n,) m, receives the lengths.
    """
    ends, basis = np.empty((_ROOM, 2)), np.empty((3, 3))
    q, motion = np.empty(3), np.zeros(12)
    for n in range(len(base)):
        low, high = _in_box(base[n], axis[n], box, turn, span[n, 0], span[n, 1])
        out[n] = 0.0
        if not high - low > _GONE_M:
            continue
        _cross(axis[n, 0], axis[n, 1], axis[n, 2], basis)
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        x, y, z = (base[n, 0] + middle * axis[n, 0], base[n, 1] + middle * axis[n, 1], base[n, 2] + middle * axis[n, 2])
        hx, hy, hz = half * abs(axis[n, 0]), half * abs(axis[n, 1]), half * abs(axis[n, 2])
        tile = tile_of(tiles, x, y)
        count, whole = 0, False
        for place in range(tiles.first[tile], tiles.first[tile + 1]):
            group = tiles.members[place]
            if group * GROUP >= before[n] or whole:
                break
            for k in range(group * GROUP, min(before[n], (group + 1) * GROUP)):
                b = tiles.boxes[k]
                if x + hx < b[0] or x - hx > b[3] or y + hy < b[1] or y - hy > b[4] or z + hz < b[2] or z - hz > b[5]:
                    continue
                m = tiles.motions[k]
                for c in range(3):
                    q[c], motion[3 + c], motion[6 + c], motion[9 + c] = 0.0, 0.0, 0.0, 0.0
                    for a in range(3):
                        q[c] += basis[c, a] * (base[n, a] - m[a])
                        motion[3 + c] += basis[c, a] * m[3 + a]
                        motion[6 + c] += basis[c, a] * m[6 + a]
                        motion[9 + c] += basis[c, a] * m[9 + a]
                one, two = stretch(q, 2, motion, tiles.shapes[k])
                one, two = max(one, low), min(two, high)
                if not two - one > _GONE_M:
                    continue
                if count == _ROOM:
                    ends[0, 0], ends[0, 1] = min(ends[0, 0], one), max(ends[0, 1], two)
                else:
                    ends[count, 0], ends[count, 1] = one, two
                    count += 1
                if one <= low + _GONE_M and two >= high - _GONE_M:
                    whole = True
                    break
        out[n] = 0.0 if whole else max(0.0, (high - low) - _taken(ends, count, low, high))

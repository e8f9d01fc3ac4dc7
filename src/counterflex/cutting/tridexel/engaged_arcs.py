"""Arcs of engagement along a program, without any grid: closed forms of sweeps in a blank that is a box.

At a point of the path the outline of the cutter is met by the material over some immersion angles and heights. The
length of the material along the axis is sampled at 64 angles of every level, and where it changes the angle of the
change is bisected. So an arc follows the radial width of cut continuously, where cells of a stock jump by their size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.units import MM, UM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import BlankBox
from counterflex.cutting.tridexel.cut_log import CutLog
from counterflex.cutting.tridexel.engaged_kernels import engaged_lengths
from counterflex.cutting.tridexel.lattice_kernels import Tiles

ANGLES: Final = 64
_HALVINGS: Final = 12
"""Of a step between two angles: 12 leave 1e-5 rad."""
_ENGAGED_M: Final = 1.0 * UM
"""Shorter lengths count as none."""
_CHANGE: Final = 0.01
"""Change of the length from angle to angle, of the longest, whose place is bisected."""


@dataclass(frozen=True, eq=False)
class EngagedArcs:
    """A program and its blank, as arcs of engagement need them. Made by :meth:`of`."""

    tiles: Tiles  # motions of the whole program
    blank: BlankBox
    motion_of: Int  # (n,) the motion in which each segment of the path lies
    top_m: Float  # (n,) height above the tip up to which its tool cuts

    @classmethod
    def of(
        cls, p_part_tcp: Float, axis_part: Float, runs: Sequence[tuple[int, int, Cutter, float]], blank: BlankBox
    ) -> EngagedArcs:
        """The program as runs of one tool each.

        Args:
            p_part_tcp: (n, 3) m, tool tips.
            axis_part: (n, 3) unit vectors from the tip to the spindle.
            runs: First and last row of each, its cutter, and the height up to which that cuts.
        """
        logs, motion_of, top = [], np.zeros(len(p_part_tcp), dtype=np.int64), np.zeros(len(p_part_tcp))
        count = 0
        for first, last, cutter, top_m in runs:
            log, rows = CutLog.with_rows(p_part_tcp[first : last + 1], axis_part[first : last + 1], cutter, top_m=top_m)
            motion_of[first + 1 : last + 1], top[first + 1 : last + 1] = rows + count, top_m
            logs.append(log)
            count += len(log.motions)
        reach = float(max(top.max(initial=0.0), 5.0 * MM))
        return cls(CutLog.joined(logs).tiles(reach), blank, motion_of, top)

    def at(self, row: int, tip: Float, axis: Float, direction: Float, cutter: Cutter) -> Float:
        """Arcs of engagement as the tool comes to a row of the path.

        Args:
            row: Of the path; motions before its own were cut.
            tip: (3,) m.
            axis: (3,) unit vector from the tip to the spindle.
            direction: (3,) unit vector of the feed, square to the axis.

        Returns:
            (m, 4) start and end of the immersion angle, rad, axial length, m, and inclination kappa, rad.
        """
        bounds, kappa = np.minimum(cutter.levels(), self.top_m[row]), cutter.level_inclinations()
        lengths = partial(self._lengths, row, tip, axis, direction, bounds, cutter.level_radii())
        levels = np.flatnonzero(bounds[1:] > bounds[:-1])
        step = np.pi / ANGLES
        phi = (np.arange(ANGLES) + 0.5) * step
        grid = lengths(np.repeat(levels, ANGLES), np.tile(phi, len(levels))).reshape(len(levels), ANGLES)
        padded = np.pad(grid, ((0, 0), (1, 1)))
        edges = np.tile(np.arange(ANGLES + 1) * step, (len(levels), 1))
        change = np.abs(np.diff(padded, axis=1)) > _CHANGE * max(float(grid.max(initial=0.0)), _ENGAGED_M)
        some, place = np.nonzero(change)
        if len(some):
            low, high = np.maximum(place - 0.5, 0.0) * step, np.minimum(place + 0.5, ANGLES) * step
            one, two = padded[some, place], padded[some, place + 1]
            for _ in range(_HALVINGS):
                middle = 0.5 * (low + high)
                length = lengths(levels[some], middle)
                early = np.abs(length - one) < np.abs(length - two)
                low, high = np.where(early, middle, low), np.where(early, high, middle)
            edges[some, place] = 0.5 * (low + high)
        out = np.stack(
            [edges[:, :-1], edges[:, 1:], grid, np.broadcast_to(kappa[levels][:, None], grid.shape)], axis=2
        ).reshape(-1, 4)
        return _merged(out[(out[:, 2] > 0.0) & (out[:, 1] > out[:, 0] + 1e-9)])

    def _lengths(
        self, row: int, tip: Float, axis: Float, direction: Float, bounds: Float, radii: Float, level: Int, phi: Float
    ) -> Float:
        """Length (n,) of material on the cutter's surface at levels and immersion angles."""
        aside = np.sin(phi)[:, None] * direction + np.cos(phi)[:, None] * np.cross(axis, direction)
        n, out = len(phi), np.empty(len(phi))
        engaged_lengths(
            self.tiles, np.stack([self.blank.low_m, self.blank.high_m]), self.blank.turn,
            np.ascontiguousarray(tip + radii[level][:, None] * aside), np.tile(axis, (n, 1)),
            np.ascontiguousarray(np.stack([bounds[level], bounds[level + 1]], axis=1)),
            np.full(n, self.motion_of[row]), out,
        )  # fmt: skip
        return np.where(out > _ENGAGED_M, out, 0.0)


def _merged(arcs: Float) -> Float:
    """Arcs that follow one another at one level with one length as one."""
    if len(arcs) < 2:
        return arcs
    same = (
        (np.abs(arcs[1:, 0] - arcs[:-1, 1]) < 1e-9)
        & (arcs[1:, 3] == arcs[:-1, 3])
        & (np.abs(arcs[1:, 2] - arcs[:-1, 2]) < 1e-7)
    )
    first = np.flatnonzero(np.concatenate([[True], ~same]))
    out: Float = arcs[first].copy()
    out[:, 1] = arcs[np.append(first[1:], len(arcs)) - 1, 1]
    return out

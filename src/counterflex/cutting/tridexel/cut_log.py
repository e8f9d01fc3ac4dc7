"""Log of the cut: every motion of the tools that took part, listed by place."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.tridexel import lattice_kernels
from counterflex.cutting.tridexel.columns import ENGAGED_M, motions_of
from counterflex.cutting.tridexel.swept_solid import tool_shape

REACH_M: Final = 5.0 * MM
"""Distance to what was cut up to which it is computed."""
_SIDE_M: Final = 4.0 * MM
_STRAIGHT: Final = 1e-12


@dataclass(frozen=True, eq=False)
class CutLog:
    """Motions that took material away."""

    motions: Float  # (k, 12) start of the tip in the part frame, displacement (m), tool axis in the middle, its turn
    shapes: Float  # (k, 3) radius, corner radius, top of the tool of each, m

    @classmethod
    def of(
        cls, p_part_tcp: Float, axis_part: Float, cutter: Cutter, *, top_m: float, engaged_m: float = ENGAGED_M
    ) -> CutLog:
        """The motions of a path; those in one straight line with one axis are joined.

        Args:
            p_part_tcp: (n + 1, 3) tool tip, m, part frame.
            axis_part: (n + 1, 3) unit vectors from the tip to the spindle.
            top_m: Height above the tip up to which the tool takes material away.
            engaged_m: See :func:`counterflex.cutting.tridexel.columns.motions_of`.
        """
        return cls.with_rows(p_part_tcp, axis_part, cutter, top_m=top_m, engaged_m=engaged_m)[0]

    @classmethod
    def with_rows(
        cls, p_part_tcp: Float, axis_part: Float, cutter: Cutter, *, top_m: float, engaged_m: float = ENGAGED_M
    ) -> tuple[CutLog, Int]:
        """As :meth:`of`, and the motion in which each segment begins (n,): those before it were cut before."""
        path, axis = as_float("p_part_tcp", p_part_tcp, (None, 3)), as_float("axis_part", axis_part, (None, 3))
        if len(path) < 2 or len(axis) != len(path):
            raise InputError("path and axes do not fit", value=f"{len(path)} points, {len(axis)} axes", limit=">= 2")
        all_motions, owner = motions_of(path, axis, engaged_m)
        motions, first = _joined(all_motions)
        begins = np.searchsorted(owner, np.arange(len(path) - 1))
        shape = tool_shape(cutter.radius_m, cutter.radius_m if cutter.is_ball else cutter.corner_radius_m, top_m)
        row: Int = np.maximum(np.searchsorted(first, begins, side="right") - 1, 0)
        return cls(motions, np.tile(shape, (len(motions), 1))), row

    @classmethod
    def joined(cls, logs: Iterable[CutLog]) -> CutLog:
        """One after the other."""
        several = list(logs)
        return cls(np.concatenate([log.motions for log in several]), np.concatenate([log.shapes for log in several]))

    @cached_property
    def boxes(self) -> Float:
        """(k, 6) m: lower and upper corners of boxes about the sweeps."""
        start, step, middle, turn = np.split(self.motions, 4, axis=1)
        radius, top = self.shapes[:, :1], self.shapes[:, 2:]
        corners, sides = [], []
        for tip, axis in ((start, middle - 0.5 * turn), (start + step, middle + 0.5 * turn)):
            unit = axis / np.linalg.norm(axis, axis=1, keepdims=True)
            corners += [tip, tip + top * unit]
            sides.append(radius * np.sqrt(np.maximum(0.0, 1.0 - unit**2)))  # how far a disc square to the axis reaches
        bulge = (top + radius) * np.sum(turn**2, axis=1, keepdims=True) / 8.0
        ends, side = np.stack(corners), np.maximum(*sides) + bulge
        out: Float = np.concatenate([ends.min(axis=0) - side, ends.max(axis=0) + side], axis=1)
        return out

    def tiles(self, reach_m: float) -> lattice_kernels.Tiles:
        """The motions listed by tiles from which their sweeps are within reach."""
        boxes, starts = self.boxes, np.arange(0, len(self.motions), lattice_kernels.GROUP)
        tip = np.stack([self.motions[:, :3], self.motions[:, :3] + self.motions[:, 3:6]])
        corners = [boxes[:, :3], boxes[:, 3:], tip.min(axis=0), tip.max(axis=0)]
        groups = np.concatenate(
            [(np.minimum, np.maximum)[k % 2].reduceat(part, starts) for k, part in enumerate(corners)], axis=1
        )
        low, high = groups[:, :2].min(axis=0) - reach_m, groups[:, 3:5].max(axis=0) + reach_m
        side = max(_SIDE_M, float(np.max(high - low)) / 2000.0)
        shape = np.maximum(1, np.ceil((high - low) / side)).astype(np.int64)
        first = np.clip(np.floor((groups[:, :2] - reach_m - low) / side), 0, shape - 1).astype(np.int64)
        last = np.clip(np.floor((groups[:, 3:5] + reach_m - low) / side), 0, shape - 1).astype(np.int64)
        ranges: Int = np.ascontiguousarray(np.stack([first[:, 0], last[:, 0], first[:, 1], last[:, 1]], axis=1))
        columns = int(shape[0])
        count = np.zeros(int(shape.prod()), np.int64)
        lattice_kernels.count_members(ranges, columns, count)
        begin = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
        members = np.empty(int(begin[-1]), np.int64)
        lattice_kernels.fill_members(ranges, columns, begin[:-1].copy(), members)
        upright = bool(np.all((self.motions[:, 8] >= 1.0 - 1e-12) & ~np.any(self.motions[:, 9:], axis=1)))
        ceiling = float((tip[:, :, 2].min(axis=0) + self.shapes[:, 2]).min()) if upright else -np.inf
        x0, y0 = float(low[0]), float(low[1])
        return lattice_kernels.Tiles(
            self.motions, self.shapes, boxes, groups, begin, members, x0, y0, side, columns, ceiling
        )

    @cached_property
    def _within_reach(self) -> lattice_kernels.Tiles:
        return self.tiles(REACH_M)

    def ends(self, along: int, start: Float, length_m: float, filled: Bool) -> Float:
        """Exact ends of material on lines; see :func:`~counterflex.cutting.tridexel.lattice_kernels.ends_on_lines`."""
        out = np.empty(len(start))
        tiles = self.tiles(length_m)
        lattice_kernels.ends_on_lines(
            tiles, along, np.ascontiguousarray(start), length_m, np.ascontiguousarray(filled), out
        )
        return out

    def distance(self, points_part: Float) -> Float:
        """Signed distance of points (n, 3) m to the surface that was cut, along its normal.

        Negative: the point lies in what was swept, so that material there was left; positive: it lies beyond, in what
        should have stayed. Of overlapping motions the deepest counts, which is exact outside and never too shallow
        inside. nan beyond :data:`REACH_M`.
        """
        out = np.empty(len(points_part))
        lattice_kernels.distances(self._within_reach, as_float("points_part", points_part, (None, 3)), REACH_M, out)
        return out


def _joined(motions: Float) -> tuple[Float, Int]:
    """Motions of one axis that follow one another in one straight line as one, and where each of these begins."""
    # Motions that stand still are left out.
    turns = np.any(motions[:, 9:] != 0.0, axis=1)
    moves = np.any(motions[:, 3:6] != 0.0, axis=1) | turns
    moves |= np.any(np.diff(motions[:, 6:9], axis=0, prepend=np.nan) != 0.0, axis=1)
    place: Int = np.flatnonzero(moves)
    motions, turns = motions[moves], turns[moves]
    if len(motions) < 2:
        return motions, place
    step, axis = motions[:, 3:6], motions[:, 6:9]
    length = np.linalg.norm(step, axis=1)
    aside = np.linalg.norm(np.cross(step[:-1], step[1:]), axis=1)
    straight = (
        (aside <= 1e-9 * length[:-1] * length[1:] + _STRAIGHT * _STRAIGHT)
        & (np.sum(step[:-1] * step[1:], axis=1) >= 0.0)
        & np.all(axis[:-1] == axis[1:], axis=1)
        & ~(turns[:-1] | turns[1:])
    )
    first = np.flatnonzero(np.concatenate([[True], ~straight]))
    out = motions[first].copy()
    out[:, 3:6] = np.add.reduceat(step, first, axis=0)
    return out, place[first]

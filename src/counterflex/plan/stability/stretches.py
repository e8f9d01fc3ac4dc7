"""Stretches of a path, a millimetre or a few cells long: arcs of engagement, feed, direction.

In a blank that is a box the arcs are closed forms (:mod:`counterflex.cutting.tridexel.engaged_arcs`), taken in the
middle of the stretch. In any other blank they are booked on its cells, and jump with the radial width by up to a
cell. A tool that is tilted or turns is cut out of columns; its feed is the motion square to its axis.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import ModelError, ProgramError
from counterflex.core.progress import Progress, share_of, silent
from counterflex.core.units import DEG, MM
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.engagement import accumulate
from counterflex.cutting.removal import RemovalResult, remove_path
from counterflex.cutting.stability.process import Process, arcs_of_engagement, process_of_arcs
from counterflex.cutting.stock import BlankBox, HeightMap
from counterflex.cutting.tridexel.columns import ColumnStock, remove_turning
from counterflex.cutting.tridexel.engaged_arcs import EngagedArcs
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.turning_cut.cut import reach_of

LENGTH_M: Final = 1.0 * MM
"""Length over which the engagement is averaged at least,"""
CELLS: Final = 5
"""and in cells of the stock: with fewer, whole rows of cells fall into one stretch or the next."""
_ALIKE: Final = float(np.cos(5.0 * DEG))
_STILL_M: Final = 1e-12
_PLUNGE: Final = 1e-3
"""Share of the way square to the axis up to which a motion is a plunge."""
_UPRIGHT: Final = 1.0 - 1e-12
_CONTACT_M3: Final = 1e-12


@dataclass(frozen=True, eq=False)
class Stretch:
    """A piece of the path with nearly one direction, one tool and one spindle speed."""

    row: int  # point of the path in its middle
    tool: int  # number of the tool
    arcs: Float  # (m, 4) arcs of engagement, see counterflex.cutting.stability.process.Process
    direction_part: Float  # (3,) unit vector of the feed, square to the axis
    axis_part: Float  # (3,) unit vector from the tip to the spindle
    feed_per_tooth_m: float  # square to the axis, m
    period_s: float  # tooth period, s

    @property
    def R_part_feed(self) -> Float:
        """(3, 3) feed frame in part axes: x along the feed, y to its left, z along the axis."""
        left = np.cross(self.axis_part, self.direction_part)
        return np.stack([self.direction_part, left, self.axis_part], axis=1)

    def process(self, law: ForceLaw, teeth: int) -> Process:
        """The process, feed frame."""
        return process_of_arcs(self.arcs, law, self.feed_per_tooth_m, teeth)


def stretches_of(
    path: ToolPath,
    stock: HeightMap,
    cutter_of: Callable[[int], Cutter],
    blank: BlankBox | None = None,
    *,
    progress: Progress = silent,
) -> list[Stretch]:
    """Cut the path into the stock and collect what is engaged.

    Plunges have no side engagement and give no stretch; what the end face does on a ramp is left out.

    Args:
        stock: The blank; it is cut in place.
        cutter_of: Gives the cutter of a tool number.
        blank: The blank as a box, for arcs that do not depend on cells; None: it is none.
        progress: Progress callback, fraction 0 to 1.

    Raises:
        ModelError: The spindle turns backwards in the cut, or the stock cannot be cut.
        ProgramError: Material is cut at feed with the spindle stopped.
    """
    runs = _runs(path, stock, cutter_of)
    out: list[Stretch] = []
    engaged: _Exact | _Booked
    if blank is not None and runs:
        engaged = _Exact(path, EngagedArcs.of(path.p_part_tcp, path.axis_part, runs, blank))
    else:
        engaged = _Booked(path, stock)
    for first, last, cutter, top_m in runs:
        begin, end = first + 1, last + 1
        part = share_of(progress, begin / len(path), end / len(path))
        contact = engaged.contact(begin, end, cutter, top_m, part)
        pieces = list(_collected(path, begin, contact, engaged, cutter, max(LENGTH_M, CELLS * stock.cell_m)))
        _check_spindle(path, np.array([piece.row for piece in pieces], dtype=np.int64))
        out += [piece for piece in pieces if piece.feed_per_tooth_m > 0.0]
        part(1.0)
    return out


def _runs(path: ToolPath, stock: HeightMap, cutter_of: Callable[[int], Cutter]) -> list[tuple[int, int, Cutter, float]]:
    """First and last row of each run of one tool that may cut, its cutter, and how high above its tip that cuts."""
    out = []
    changes = [1, *(np.flatnonzero(np.diff(path.tool[1:])) + 2).tolist(), len(path)]
    for begin, end in itertools.pairwise(changes):
        above = float(path.p_part_tcp[begin - 1 : end, 2].min()) > float(stock.z.max())
        upright = bool(np.all(path.axis_part[begin - 1 : end, 2] > _UPRIGHT))
        if above and upright and not np.any(path.kind[begin:end] == FEED):
            continue
        cutter = cutter_of(int(path.tool[begin]))
        out.append((begin - 1, end - 1, cutter, reach_of(cutter, stock)))
    return out


def _aside(path: ToolPath, begin: int, end: int) -> Float:
    """(n, 3) m, segments of rows [begin, end) square to the tool axis."""
    step = np.diff(path.p_part_tcp[begin - 1 : end], axis=0)
    axis = path.axis_part[begin:end]
    out: Float = step - np.sum(step * axis, axis=1)[:, None] * axis
    return out


class _Exact:
    """Engagement in closed form: every segment that feeds aside may be in contact, its arcs tell."""

    def __init__(self, path: ToolPath, arcs: EngagedArcs) -> None:
        self._path, self._arcs = path, arcs

    def contact(self, begin: int, end: int, cutter: Cutter, top_m: float, progress: Progress) -> Bool:
        """(n,) segments of rows [begin, end) that may cut."""
        del cutter, top_m, progress
        length = np.linalg.norm(_aside(self._path, begin, end), axis=1)
        out: Bool = (self._path.kind[begin:end] == FEED) & (length > _STILL_M)
        return out

    def arcs(self, first: int, last: int, row: int, direction: Float, cutter: Cutter) -> Float:
        """Arcs of segments [first, last) of the run, in the middle of them."""
        del first, last
        return self._arcs.at(row, self._path.p_part_tcp[row], self._path.axis_part[row], direction, cutter)


class _Booked:
    """Engagement booked on cells: a height map for upright tools, columns where any tool is tilted."""

    def __init__(self, path: ToolPath, stock: HeightMap) -> None:
        self._path, self._stock = path, stock
        self._columns = None if np.all(path.axis_part[:, 2] > _UPRIGHT) else ColumnStock.of(stock)
        self._result: RemovalResult | None = None

    def contact(self, begin: int, end: int, cutter: Cutter, top_m: float, progress: Progress) -> Bool:
        """(n,) segments of rows [begin, end) that cut, once they have been cut."""
        points, kind = self._path.p_part_tcp[begin - 1 : end], self._path.kind[begin:end]
        if self._columns is None:
            self._result = remove_path(self._stock, points, kind, cutter, progress=progress)
        else:
            axes = self._path.axis_part[begin - 1 : end]
            self._result = remove_turning(self._columns, points, axes, kind, cutter, top_m=top_m)
        out: Bool = (kind == FEED) & (self._result.volume_m3 > _CONTACT_M3)
        return out

    def arcs(self, first: int, last: int, row: int, direction: Float, cutter: Cutter) -> Float:
        """Arcs of segments [first, last) of the run, the mean over them."""
        del row, direction
        assert self._result is not None
        assert self._result.engagement is not None
        depth = accumulate(self._result.engagement, self._result.length_m, first, last)
        return arcs_of_engagement(smoothed(depth, self._stock.cell_m / cutter.radius_m), cutter)


def _check_spindle(path: ToolPath, rows: Int) -> None:
    wrong = rows[path.spindle_rad_s[rows] <= 0.0]
    if len(wrong) == 0:
        return
    row = int(wrong[0])
    place, motion = f"motion {int(path.motion[row])}", int(path.motion[row])
    if path.spindle_rad_s[row] < 0.0:
        raise ModelError(
            "the force model is that of a spindle turning clockwise (M3)",
            where=place, value="M4", hint="Cut with M3", motion=motion,
        )  # fmt: skip
    raise ProgramError(
        "the program cuts material with the spindle stopped",
        where=place, hint="Start the spindle (M3 S...) before the first cut", motion=motion,
    )  # fmt: skip


def _collected(
    path: ToolPath, begin: int, contact: Bool, engaged: _Exact | _Booked, cutter: Cutter, enough_m: float
) -> Iterator[Stretch]:
    aside = _aside(path, begin, begin + len(contact))
    for first, last in _pieces(path, begin, contact, aside, enough_m):
        step = path.p_part_tcp[begin + last - 1] - path.p_part_tcp[begin + first - 1]
        row = begin + (first + last) // 2
        axis = path.axis_part[row]
        level = step - float(step @ axis) * axis
        size, way = float(np.linalg.norm(level)), float(np.linalg.norm(step))
        if size <= _PLUNGE * way:
            continue
        arcs = engaged.arcs(first, last, row, level / size, cutter)
        if len(arcs):
            turns = abs(float(path.spindle_rad_s[row]))
            # A spindle that stands is refused behind this loop (_check_spindle); until then its period must not divide
            # by zero.
            period = 2.0 * np.pi / (cutter.flutes * turns) if turns > 0.0 else np.inf
            feed = float(path.feed_m_s[row]) * size / way * period
            yield Stretch(row, int(path.tool[row]), arcs, level / size, axis, feed, period)


def _pieces(path: ToolPath, begin: int, contact: Bool, aside: Float, enough_m: float) -> list[tuple[int, int]]:
    """Segments [first, last) in contact, up to a length, not around a corner nor over a change of feed or speed."""
    # A rest shorter than half the length is added to the piece before.
    length = np.linalg.norm(aside, axis=1)
    heading = aside / np.maximum(length, _STILL_M)[:, None]
    alike = partial(_alike, path, begin, heading)
    out: list[tuple[int, int]] = []
    at = 0
    while at < len(length):
        if not contact[at]:
            at += 1
            continue
        end, total = at, 0.0
        while end < len(length) and contact[end] and alike(end, at) and total < enough_m * (1.0 - 1e-9):
            total += float(length[end])
            end += 1
        if total < 0.5 * enough_m and out and out[-1][1] == at and alike(at, out[-1][0]):
            out[-1] = (out[-1][0], end)
        else:
            out.append((at, end))
        at = end
    return out


def _alike(path: ToolPath, begin: int, heading: Float, i: int, j: int) -> bool:
    """Return whether two segments run the same way, with one axis, feed and speed."""
    a, b = begin + i, begin + j
    turned = min(float(heading[i] @ heading[j]), float(path.axis_part[a] @ path.axis_part[b])) < _ALIKE
    same = path.feed_m_s[a] == path.feed_m_s[b] and path.spindle_rad_s[a] == path.spindle_rad_s[b]
    return bool(not turned and same)


def smoothed(depth: Float, cell_share: float) -> Float:
    """Spread the engagement of each bin across the feed by the width of a cell of the stock.

    The removal books a cell to the bin of its centre; near the sides of the tool a bin of the immersion angle is
    narrower than a cell, and one gets all, the next nothing. Here the volume of a bin lies evenly over the bin widened
    by half a cell on each side, mirrored at the sides of the tool; the sum stays what it is.

    Args:
        depth: (n_levels, n_bins) engaged axial length, m.
        cell_share: Width of a cell over the radius of the tool.
    """
    across = np.cos(np.linspace(0.0, np.pi, depth.shape[1] + 1))  # 1 on the left to -1 on the right
    width = -np.diff(across)
    high, low = across[:-1], across[1:]
    below = partial(_below, low, high, width, cell_share)
    share = below(high) - below(low) + below(2.0 - low) - below(2.0 - high) + below(-2.0 - low) - below(-2.0 - high)
    out: Float = ((depth * width) @ share.T) / width
    return out


def _below(low: Float, high: Float, width: Float, cell_share: float, x: Float) -> Float:
    """Share of each bin's volume at offsets below x, (bins of x, bins)."""
    half, x = 0.5 * cell_share, x[:, None]
    ramps = [np.maximum(x - edge, 0.0) ** 2 for edge in (low - half, high - half, low + half, high + half)]
    out: Float = (ramps[0] - ramps[1] - ramps[2] + ramps[3]) / (2.0 * width * cell_share)
    return out

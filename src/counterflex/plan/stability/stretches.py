"""What the tool meets along a path, in stretches of a millimetre or a few cells: booked engagement, feed, direction."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import ModelError, ProgramError
from counterflex.core.progress import Progress, share_of, silent
from counterflex.core.units import DEG, MM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.engagement import accumulate
from counterflex.cutting.removal import Engagement, remove_path
from counterflex.cutting.stock import HeightMap, require_vertical
from counterflex.path.toolpath import FEED, ToolPath

LENGTH_M: Final = 1.0 * MM
"""Length over which the engagement is averaged at least,"""
CELLS: Final = 5
"""and in cells of the stock: with fewer, whole rows of cells fall into one stretch or the next."""
_TURN_RAD: Final = 5.0 * DEG
_CONTACT_M3: Final = 1e-12


@dataclass(frozen=True, eq=False)
class Stretch:
    """A piece of the path with nearly one direction, one tool and one spindle speed.

    Attributes:
        row: Point of the path in its middle.
        tool: Number of the tool.
        depth_m: (n_levels, 64) engaged axial length, m, mean over the piece.
        direction_part: (3,) horizontal unit vector of the feed.
        feed_per_tooth_m: Horizontal, m.
        period_s: Tooth period, s.
    """

    row: int
    tool: int
    depth_m: Float
    direction_part: Float
    feed_per_tooth_m: float
    period_s: float


def stretches_of(
    path: ToolPath, stock: HeightMap, cutter_of: Callable[[int], Cutter], *, progress: Progress = silent
) -> list[Stretch]:
    """Cut the path into the stock and collect what is engaged.

    Plunges have no side engagement and give no stretch; what the end face does on a ramp is left out.

    Args:
        path: As machined.
        stock: The blank; it is cut in place.
        cutter_of: Gives the cutter of a tool number.
        progress: Progress callback, fraction 0 to 1.

    Raises:
        ModelError: The tool axis is tilted, or the spindle turns backwards in the cut.
        ProgramError: Material is cut at feed with the spindle stopped.
    """
    require_vertical(path.axis_part)
    out: list[Stretch] = []
    changes = [1, *(np.flatnonzero(np.diff(path.tool[1:])) + 2).tolist(), len(path)]
    for begin, end in itertools.pairwise(changes):
        number = int(path.tool[begin])
        above = float(path.p_part_tcp[begin - 1 : end, 2].min()) > float(stock.z.max())
        if above and not np.any(path.kind[begin:end] == FEED):
            continue
        cutter = cutter_of(number)
        result = remove_path(
            stock,
            path.p_part_tcp[begin - 1 : end],
            path.kind[begin:end],
            cutter,
            progress=share_of(progress, begin / len(path), end / len(path)),
        )
        contact = (path.kind[begin:end] == FEED) & (result.volume_m3 > _CONTACT_M3)
        _check_spindle(path, begin + np.flatnonzero(contact))
        assert result.engagement is not None
        out += _collected(path, begin, contact, result.length_m, result.engagement, cutter, stock.cell_m)
    return out


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
    path: ToolPath, begin: int, contact: Bool, length: Float, engagement: Engagement, cutter: Cutter, cell_m: float
) -> Iterator[Stretch]:
    for first, last in _pieces(path, begin, contact, length, max(LENGTH_M, CELLS * cell_m)):
        depth = smoothed(accumulate(engagement, length, first, last), cell_m / cutter.radius_m)
        step = path.p_part_tcp[begin + last - 1] - path.p_part_tcp[begin + first - 1]
        level = float(np.hypot(step[0], step[1]))
        row = begin + (first + last) // 2
        period = 2.0 * np.pi / (cutter.flutes * float(path.spindle_rad_s[row]))
        share = level / float(np.linalg.norm(step)) if level > 0.0 else 0.0
        feed = float(path.feed_m_s[row]) * share * period
        if depth.sum() > 0.0 and level > 0.0 and feed > 0.0:
            yield Stretch(row, int(path.tool[row]), depth, np.array([step[0], step[1], 0.0]) / level, feed, period)


def _pieces(path: ToolPath, begin: int, contact: Bool, length: Float, enough_m: float) -> list[tuple[int, int]]:
    """Segments [first, last) in contact, up to a length, not around a corner nor over a change of feed or speed.

    A rest shorter than half the length is added to the piece before.
    """
    step = np.diff(path.p_part_tcp[begin - 1 : begin + len(length)], axis=0)
    heading = np.arctan2(step[:, 1], step[:, 0])
    feed, speed = path.feed_m_s[begin : begin + len(length)], path.spindle_rad_s[begin : begin + len(length)]

    def alike(i: int, j: int) -> bool:
        turned = abs((heading[i] - heading[j] + np.pi) % (2.0 * np.pi) - np.pi)
        return bool(turned <= _TURN_RAD and feed[i] == feed[j] and speed[i] == speed[j])

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

    def below(x: Float) -> Float:
        """Share of each bin's volume at offsets below x, (bins of x, bins)."""
        half, x = 0.5 * cell_share, x[:, None]
        ramps = [np.maximum(x - edge, 0.0) ** 2 for edge in (low - half, high - half, low + half, high + half)]
        out: Float = (ramps[0] - ramps[1] - ramps[2] + ramps[3]) / (2.0 * width * cell_share)
        return out

    share = below(high) - below(low) + below(2.0 - low) - below(2.0 - high) + below(-2.0 - low) - below(-2.0 - high)
    out: Float = ((depth * width) @ share.T) / width
    return out

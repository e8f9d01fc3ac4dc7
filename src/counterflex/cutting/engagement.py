"""Booked engagement in the words of milling: entry, exit, depth, width, chip area."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.cutting.booking_kernels import BINS
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.removal import Engagement, bin_edges_rad, unit_widths


@dataclass(frozen=True)
class EngagementFigures:
    """Engagement of path stretches in one number each; stretch i covers segments ``first[i]`` to ``last[i] - 1``."""

    first: Int  # (n,) first segment
    last: Int  # (n,) one behind the last segment
    length_m: Float  # (n,) horizontal length, m
    volume_m3: Float  # (n,) volume removed by the side of the cutter, m^3
    entry_rad: Float  # (n,) immersion angle at which an edge enters, rad; NaN where nothing is cut
    exit_rad: Float  # (n,) immersion angle at which it leaves, rad; NaN where nothing is cut
    # (n,) sum of the engaged angles, rad; less than exit - entry where there are gaps (re-entry, islands)
    arc_rad: Float
    axial_depth_m: Float  # (n,) axial depth: the engaged edge length averaged over the engaged chip width, m
    radial_width_m: Float  # (n,) width across the feed a_e: chip area over axial depth, m
    chip_area_m2: Float  # (n,) cross-section of the cut normal to the feed, volume / length, m^2


def stretches(length_m: Float, least_m: float = 1e-3) -> tuple[Int, Int]:
    """Group consecutive segments into stretches of at least a given length (the last may be shorter).

    Engagement from cells of side c is noisy over steps of a few cells; averaging over 1 mm of path brings the mean
    force of a cut as shallow as 0.05 D within some percent.

    Args:
        length_m: (n,) horizontal length of each segment, m.
        least_m: Least length of a stretch, m.

    Returns:
        First segment and one behind the last segment of each stretch.

    Raises:
        InputError: The least length is negative.
    """
    lengths = as_float("length_m", length_m, (None,))
    if not least_m >= 0.0:
        raise InputError("stretch length is out of range", value=least_m, limit=">= 0 m")
    first, last = [], []
    begin, total = 0, 0.0
    for i, value in enumerate(lengths):
        total += float(value)
        if total >= least_m * (1.0 - 1e-9) or i == len(lengths) - 1:
            first.append(begin)
            last.append(i + 1)
            begin, total = i + 1, 0.0
    return np.array(first, dtype=np.int64), np.array(last, dtype=np.int64)


def accumulate(engagement: Engagement, length_m: Float, first: int, last: int) -> Float:
    """Mean engaged edge length over segments [first, last), weighted with their lengths, (n_levels, 64) m.

    Raises:
        InputError: The range lies outside the path.
    """
    lengths = as_float("length_m", length_m, (len(engagement),))
    depth = engagement.dense(first, last)
    weight = lengths[first:last]
    total = float(weight.sum())
    out: Float = np.einsum("i,ilj->lj", weight, depth) / total if total > 0.0 else depth.sum(axis=0) * 0.0
    return out


def figures(
    engagement: Engagement,
    length_m: Float,
    cutter: Cutter,
    *,
    least_m: float = 1e-3,
    smallest_m: float = 1e-6,
    cell_m: float = 0.0,
) -> EngagementFigures:
    """Entry and exit angle, arc, depth, width and chip area over stretches of the path.

    The angles have sub-bin resolution: the first and last engaged bin count with the share of their full depth, where
    full is the depth of the neighbouring bin, and the share is taken across the feed (in cos phi), as volume fills.

    Args:
        engagement: Booked engagement of n segments.
        length_m: (n,) horizontal lengths of the segments, m.
        cutter: The cutter it was booked for.
        least_m: Least length of a stretch, m; see :func:`stretches`.
        smallest_m: Bins with less engaged length are taken as empty, m.
        cell_m: Cell of the stock, m: volume is booked cell by cell, so that a gap in the arc that is narrower than one
            cell across the feed is no gap.

    Raises:
        InputError: The cutter has another number of levels, or a length is negative.
    """
    if cutter.n_levels != engagement.n_levels:
        raise InputError("engagement was recorded for another cutter", value=engagement.n_levels, limit=cutter.n_levels)
    lengths = as_float("length_m", length_m, (len(engagement),))
    first, last = stretches(lengths, least_m)
    n = len(first)
    radii, width = cutter.level_radii(), unit_widths()
    rows = np.zeros((8, n))
    rows[2:4] = np.nan
    for i in range(n):
        depth = accumulate(engagement, lengths, int(first[i]), int(last[i]))
        rows[0, i] = lengths[first[i] : last[i]].sum()
        area_bins = np.einsum("lj,l,j->j", depth, radii, width)
        area = float(area_bins.sum())
        column = depth.sum(axis=0)
        engaged = column > smallest_m
        rows[1, i] = area * rows[0, i]
        rows[7, i] = area
        if not np.any(engaged):
            continue
        rows[2, i], rows[3, i] = _arc(column, engaged)
        gaps = _gaps(engaged, width * radii.max(), cell_m)
        rows[4, i] = rows[3, i] - rows[2, i] - gaps.sum() * float(bin_edges_rad()[1])
        mean_radius = area / max(float(column @ width), 1e-30)
        span = float(np.cos(rows[2, i]) - np.cos(rows[3, i]) - width[gaps].sum()) * mean_radius
        rows[5, i] = area / span
        rows[6, i] = span
    return EngagementFigures(first, last, *rows)


def _gaps(engaged: Bool, width_m: Float, cell_m: float) -> Bool:
    """Bins that are not engaged between others that are, where they are a cell wide or more."""
    out = np.zeros_like(engaged)
    for before, behind in itertools.pairwise(np.flatnonzero(engaged)):
        out[before + 1 : behind] = width_m[before + 1 : behind].sum() >= cell_m
    return out


def _arc(column: Float, engaged: Bool) -> tuple[float, float]:
    """Entry and exit angle of one stretch, with partial first and last bins."""
    edges = bin_edges_rad()
    cosine = np.cos(edges)
    used = np.flatnonzero(engaged)
    low, high = int(used[0]), int(used[-1])
    first, last = _filled(column, engaged, low, low + 1), _filled(column, engaged, high, high - 1)
    begin = float(np.arccos(cosine[low + 1] + first * (cosine[low] - cosine[low + 1])))
    end = float(np.arccos(cosine[high] - last * (cosine[high] - cosine[high + 1])))
    return begin, end


def _filled(column: Float, engaged: Bool, outer: int, inner: int) -> float:
    """Share of an outermost bin that is engaged, by its depth over that of the next bin inside."""
    if not 0 <= inner < BINS or not engaged[inner]:
        return 1.0
    return float(min(1.0, column[outer] / column[inner]))

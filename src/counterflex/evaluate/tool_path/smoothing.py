"""Deviations along a path smoothed by straight lines over windows as wide as the noise asks for and the path bears.

Never across a corner or a hole; and where the tool swings within a window, the window is smaller.
"""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import MM, UM

WANTED_M: Final = 3.0 * UM
"""Noise that is wanted in a smoothed value."""
WIDEST_M: Final = 2.5 * MM
"""Largest half window."""
AGREE: Final = 2.0
"""Means over windows agree where they are apart by less than so many of their standard deviations added up."""
CORNER: Final = np.cos(np.radians(15.0))
"""Cosine of the turn between two stations beyond which a corner lies between them."""


def half_window_m(noise_m: float, readings_per_m: float) -> float:
    """Half the window whose mean has the wanted noise, m; at most :data:`WIDEST_M`."""
    if noise_m <= WANTED_M:
        return 0.0
    return float(min(0.5 * (noise_m / WANTED_M) ** 2 / max(readings_per_m, 1e-9), WIDEST_M))


def pieces(directions: Float, broken: Bool, kind: Int) -> list[tuple[int, int]]:
    """Runs of stations (first, behind last) without a corner, a hole or a change of kind."""
    turn = np.sum(directions[1:] * directions[:-1], axis=1) < CORNER
    edges = np.flatnonzero(turn | broken[1:] | (kind[1:] != kind[:-1])) + 1
    bounds = [0, *edges.tolist(), len(broken)]
    return list(itertools.pairwise(bounds))


def adapted(
    values: Float, runs: list[tuple[int, int]], half: int, weight: Float, noise_m: float
) -> tuple[Float, Float]:
    """Values smoothed over the widest window about each station that says the same as all narrower ones.

    Intersection of confidence intervals: windows of 1, 2, 4, ... ``half`` stations on either side are tried in turn,
    each gives ``y +- AGREE * sigma``; the last one counts with which all intervals so far have a point in common.

    Args:
        values: (k,) m, at the stations.
        runs: From :func:`pieces`.
        half: Stations on either side of the widest window.
        weight: (k,) how many independent readings a station stands for, at most one.
        noise_m: Standard deviation of one reading, m.

    Returns:
        (k,) smoothed; and (k,) the standard deviation of each.

    Source: Goldenshluger and Nemirovski 1997, "On spatially adaptive estimation of nonparametric regression".
    """
    out, sigma = values.copy(), np.full(len(values), noise_m)
    low, high = values - AGREE * noise_m, values + AGREE * noise_m
    going = np.ones(len(values), np.bool_)
    width = 1
    while width <= half and going.any():
        smooth, factor = smoothed(values, runs, width, weight)
        spread = noise_m * factor
        low = np.maximum(low, smooth - AGREE * spread)
        high = np.minimum(high, smooth + AGREE * spread)
        going &= low <= high
        out[going], sigma[going] = smooth[going], spread[going]
        width = width * 2 if width * 2 <= half or width == half else half
    return out, sigma


def smoothed(values: Float, runs: list[tuple[int, int]], half: int, weight: Float) -> tuple[Float, Float]:
    """Values at stations by a straight line through those in the window about each.

    ``y(i) = a_i`` of the weighted least-squares line ``a_i + b_i (j - i)`` over ``|j - i| <= half`` within the run.

    Args:
        values: (k,) at the stations.
        runs: From :func:`pieces`.
        half: Stations on either side.
        weight: (k,) how many independent readings a station stands for, at most one.

    Returns:
        (k,) smoothed; and (k,) the factor by which the standard deviation of one reading is to be multiplied.
    """
    out, factor = values.copy(), np.ones(len(values))
    if half < 1:
        return out, factor
    for first, end in runs:
        n = end - first
        index = np.arange(n, dtype=np.float64)
        w, y = weight[first:end], values[first:end]
        low = np.maximum(np.arange(n) - half, 0)
        high = np.minimum(np.arange(n) + half + 1, n)

        def over(q: Float, low: Float = low, high: Float = high) -> Float:
            total = np.concatenate([[0.0], np.cumsum(q)])
            result: Float = total[high] - total[low]
            return result

        s0, s1, s2 = over(w), over(w * index), over(w * index * index)
        t0, t1 = over(w * y), over(w * index * y)
        m1, m2 = s1 - index * s0, s2 - 2.0 * index * s1 + index * index * s0  # moments about the station
        r1 = t1 - index * t0
        det = s0 * m2 - m1 * m1
        line = (det > 1e-9 * s0 * s0) & (high - low > 2)
        safe = np.where(line, det, 1.0)
        out[first:end] = np.where(line, (m2 * t0 - m1 * r1) / safe, y)
        factor[first:end] = np.where(line, np.sqrt(np.maximum(m2 / safe, 0.0)), 1.0)
    return out, np.minimum(factor, 1.0)

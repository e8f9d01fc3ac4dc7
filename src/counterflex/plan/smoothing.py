"""Smoothing along the path without delay: planning knows the future, so its filters look both ways."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError


def moving_average(values: Float, station_m: Float, window_m: float, group: Int) -> Float:
    """Centred moving average over path length.

    Each row is taken as constant over the segment that ends at it; the average at row i is taken over
    ``station_i - ds_i / 2 +- window / 2``, cut symmetrically where the group ends, so that its ends are kept.

    Args:
        values: (n, k).
        station_m: (n,) path length up to each row, non-decreasing.
        window_m: Width of the window, m; 0 returns the values.
        group: (n,) rows of different groups are never mixed; non-decreasing.

    Returns:
        (n, k).
    """
    if not window_m >= 0.0:
        raise InputError("window of the moving average is out of range", value=window_m, limit=">= 0 m")
    if window_m == 0.0 or len(values) == 0:
        return values.copy()
    ds = np.diff(station_m, prepend=station_m[0])
    centre = station_m - 0.5 * ds
    total = np.vstack([np.zeros((1, values.shape[1])), np.cumsum(values * ds[:, None], axis=0)])
    knots = np.concatenate([[station_m[0]], station_m])
    out = values.copy()
    starts = np.flatnonzero(np.diff(group, prepend=group[0] - 1))
    for first, last in zip(starts, [*starts[1:], len(group)], strict=True):
        rows = slice(first, last)
        low, high = station_m[first] - ds[first], station_m[last - 1]
        half = np.minimum(0.5 * window_m, np.minimum(centre[rows] - low, high - centre[rows]))
        wide = half > 0.5 * ds[rows]
        if not np.any(wide):
            continue
        a, b = centre[rows] - half, centre[rows] + half
        for column in range(values.shape[1]):
            integral = np.interp(b, knots, total[:, column]) - np.interp(a, knots, total[:, column])
            with np.errstate(invalid="ignore", divide="ignore"):
                mean = integral / (2.0 * half)
            out[rows, column] = np.where(wide, mean, values[rows, column])
    return out

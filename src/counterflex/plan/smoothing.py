"""Smoothing along the path without delay: planning knows the future, so its filters look both ways."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError

_FINEST = 1e-9
"""Windows narrower than this share of the whole path return the value: their integral would be rounding."""


def moving_average(values: Float, station: Float, window: float, group: Int) -> Float:
    """Centred moving average over path length or time.

    Each row is taken as constant over the segment that ends at it; the average at row i is taken over
    ``station_i - ds_i / 2 +- window / 2``, cut symmetrically where the group ends, so that its ends are kept.

    Args:
        values: (n, k).
        station: (n,) path length (m) or time (s) up to each row, non-decreasing.
        window: Width of the window in the same unit; 0 returns the values.
        group: (n,) rows of different groups are never mixed; non-decreasing.

    Returns:
        (n, k).
    """
    if not window >= 0.0:
        raise InputError("window of the moving average is out of range", value=window, limit=">= 0")
    if window == 0.0 or len(values) == 0:
        return values.copy()
    ds = np.diff(station, prepend=station[0])
    centre = station - 0.5 * ds
    total = np.vstack([np.zeros((1, values.shape[1])), np.cumsum(values * ds[:, None], axis=0)])
    knots = np.concatenate([[station[0]], station])
    starts = np.flatnonzero(np.diff(group, prepend=group[0] - 1))
    ends = np.append(starts[1:], len(group))
    low = np.repeat(station[starts] - ds[starts], ends - starts)
    high = np.repeat(station[ends - 1], ends - starts)
    half = np.minimum(0.5 * window, np.minimum(centre - low, high - centre))
    wide = np.flatnonzero(half > 0.5 * ds + _FINEST * (station[-1] - station[0]))
    out = values.copy()
    a, b, span = centre[wide] - half[wide], centre[wide] + half[wide], 2.0 * half[wide]
    for column in range(values.shape[1]):
        integral = np.interp(b, knots, total[:, column]) - np.interp(a, knots, total[:, column])
        out[wide, column] = integral / span
    return out

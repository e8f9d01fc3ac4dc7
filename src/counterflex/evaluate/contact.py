"""Stretches of contact along a path, and where each one enters and leaves the material."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.units import MM

BRIDGE_M = 1.0 * MM  # a shorter break of contact does not end a stretch
PLATEAU = 0.95  # of the level just inside the stretch


def contact_runs(cutting: Bool, broken: Bool, spacing_m: float) -> list[tuple[int, int]]:
    """Stretches of contact as (first, behind last) station.

    Args:
        cutting: (k,) True while material is removed.
        broken: (k,) True where a station does not continue the one before; ends a stretch.
        spacing_m: Distance between stations.

    Returns:
        In order; breaks of contact up to :data:`BRIDGE_M` are bridged.
    """
    runs: list[tuple[int, int]] = []
    inside = np.flatnonzero(cutting)
    if len(inside) == 0:
        return runs
    holes = np.cumsum(broken)
    bridge = max(1, round(BRIDGE_M / spacing_m))
    breaks = (np.diff(inside) > bridge) | (np.diff(holes[inside]) > 0)
    starts = np.concatenate([[0], np.flatnonzero(breaks) + 1])
    ends = np.concatenate([np.flatnonzero(breaks), [len(inside) - 1]])
    return [(int(inside[a]), int(inside[b]) + 1) for a, b in zip(starts, ends, strict=True)]


def entry_exit(runs: list[tuple[int, int]], engagement: Float, spacing_m: float, radius_m: float) -> tuple[Bool, Bool]:
    """Entry and exit stretches of contact.

    The level of the plateau beside an entry is the median engagement between one and four cutter radii after first
    contact. The entry lasts until the engagement first reaches 95 % of it, at least one radius; exits are the same
    read backwards. Where a stretch of contact is too short for both, they share it half and half.

    Args:
        runs: From :func:`contact_runs`.
        engagement: (k,) measure of how much is removed; a constant makes every entry one radius long.
        spacing_m: Distance between stations.
        radius_m: Cutter radius.

    Returns:
        Masks (k,) of entries and exits.
    """
    entry = np.zeros(len(engagement), dtype=np.bool_)
    leave = np.zeros(len(engagement), dtype=np.bool_)
    for first, end in runs:
        level = engagement[first:end]
        a, b = _length(level, spacing_m, radius_m), _length(level[::-1], spacing_m, radius_m)
        n = end - first
        if a + b > n:
            a = min(a, max(n - b, (n + 1) // 2))
            b = n - a
        entry[first : first + a] = True
        leave[end - b : end] = True
    return entry, leave


def _length(level: Float, spacing_m: float, radius_m: float) -> int:
    """Stations from the start of ``level`` to its plateau."""
    radius = max(1, int(np.ceil(radius_m / spacing_m)))
    inner = level[radius : 4 * radius]
    if len(inner) == 0:
        return min(radius, len(level))
    reached = np.flatnonzero(level >= PLATEAU * float(np.median(inner)))
    return min(len(level), max(radius, int(reached[0]) if len(reached) else radius))

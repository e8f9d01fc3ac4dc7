"""Vertices of a polyline that a controller with a cycle can take: within a tolerance, and never too close together."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.jit import kernel
from counterflex.programs.simplify import fits

FINER = 4
"""Places for a vertex within the smallest distance, where vertices would come too close together."""


@kernel("void(f8[:], f8[:,:], f8[:,:], f8[:], f8[:], b1[:], f8, f8)", entry=True)
def _open_window(
    s: Float, p: Float, r: Float, travel: Float, spacing: Float, keep: Bool, tol2: float, tol2_r: float
) -> None:
    """Greedy opening window; ``keep`` holds the fixed vertices."""
    # A chord is as long as the tolerance allows, but never shorter than ``spacing``; where the last one before a fixed
    # vertex would be shorter, the one before it is cut.
    n = len(s)
    a = 0
    while a < n - 1:
        stop = a + 1
        while not keep[stop]:
            stop += 1
        while a < stop:
            least = a + 1
            while least < stop and travel[least] - travel[a] < spacing[least]:
                least += 1
            good = least
            step = 1
            bad = stop + 1
            while good < stop:
                candidate = min(least + step, stop)
                if fits(s, p, r, a, candidate, tol2, tol2_r):
                    good = candidate
                    step *= 2
                else:
                    bad = candidate
                    break
            while bad - good > 1 and good < stop:
                middle = (good + bad) // 2
                if fits(s, p, r, a, middle, tol2, tol2_r):
                    good = middle
                else:
                    bad = middle
            if good < stop and travel[stop] - travel[good] < spacing[stop]:
                while good > least and travel[stop] - travel[good] < spacing[stop]:
                    good -= 1
                if travel[stop] - travel[good] < spacing[stop]:
                    good = stop
            keep[good] = True
            a = good


def spaced(
    way: Float,
    p: Float,
    rotvec: Float,
    travel_m: Float,
    apart_m: Float,
    fixed: Bool,
    tolerance_m: float,
    tolerance_rad: float,
) -> Int:
    """Choose vertices within a tolerance and at least a distance apart; where the two contradict, the distance wins.

    Args:
        way: (n,) m, nominal length: samples and polyline are compared at the same one.
        p: (n, 3) m, commanded positions.
        rotvec: (n, 3) rad, commanded orientations.
        travel_m: (n,) m, commanded length.
        apart_m: (n,) m, least commanded length of a chord that ends there.
        fixed: (n,) True where a sample must be a vertex, close to another or not.
        tolerance_m: Largest position error, m.
        tolerance_rad: Largest orientation error, rad.

    Returns:
        Indices of the vertices, rising; the first and the last sample are among them.
    """
    keep = fixed.copy()
    keep[0] = keep[-1] = True
    _open_window(way, p, rotvec, travel_m, apart_m, keep, tolerance_m**2, tolerance_rad**2)
    return np.flatnonzero(keep)


def refined(travel_m: Float, apart_m: Float, vertices: Int) -> Int:
    """Into how many pieces each segment is cut so that vertices find places where they would come too close together.

    Args:
        travel_m: (n,) m, commanded length.
        apart_m: (n,) m, least distance of vertices.
        vertices: Chosen without regard to that.

    Returns:
        (n,) pieces of the segment that ends at a sample; 1 where nothing is wrong.
    """
    n = len(travel_m)
    pieces = np.ones(n, dtype=np.int64)
    a, b = vertices[:-1], vertices[1:]
    close = travel_m[b] - travel_m[a] < apart_m[b] * (1.0 - 1e-9)
    near = np.zeros(n + 1, dtype=np.int64)
    reach = 2.0 * apart_m[b[close]]
    low = np.searchsorted(travel_m, travel_m[a[close]] - reach)
    high = np.searchsorted(travel_m, travel_m[b[close]] + reach, side="right")
    np.add.at(near, low, 1)
    np.add.at(near, high, -1)
    inside = np.cumsum(near[:n]) > 0
    length = np.diff(travel_m, prepend=travel_m[:1])
    refinable = inside & (apart_m > 0.0)
    pieces[refinable] = np.maximum(1, np.ceil(FINER * length[refinable] / apart_m[refinable])).astype(np.int64)
    return np.minimum(pieces, 64)

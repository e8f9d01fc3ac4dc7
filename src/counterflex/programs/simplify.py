"""Fewest polyline vertices that keep every sample, at its own place along the path, within a tolerance.

Geometric line simplification (Douglas-Peucker) bounds the distance from a sample to the nearest point of the polyline.
Here a force belongs to every place, so the bound holds at the same path parameter: the point that the controller
commands when it has covered the share ``s`` of the way.
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel


@kernel("b1(f8[:], f8[:,:], f8[:,:], i8, i8, f8, f8)")
def fits(s: Float, p: Float, r: Float, a: int, b: int, tol2: float, tol2_r: float) -> bool:
    """Return whether all samples between a and b lie within the tolerance of the chord a-b at their own parameter."""
    span = s[b] - s[a]
    for k in range(a + 1, b):
        f = (s[k] - s[a]) / span if span > 0.0 else 0.0
        e = 0.0
        g = 0.0
        for c in range(3):
            d = p[a, c] + f * (p[b, c] - p[a, c]) - p[k, c]
            e += d * d
            d = r[a, c] + f * (r[b, c] - r[a, c]) - r[k, c]
            g += d * d
        if e > tol2 or g > tol2_r:
            return False
    return True


@kernel("void(f8[:], f8[:,:], f8[:,:], b1[:], f8, f8)", entry=True)
def _open_window(s: Float, p: Float, r: Float, keep: Bool, tol2: float, tol2_r: float) -> None:
    """Greedy opening window: gallop to the first chord that fails, then bisect; ``keep`` holds the fixed vertices."""
    n = len(s)
    a = 0
    while a < n - 1:
        stop = a + 1
        while not keep[stop]:
            stop += 1
        while a < stop:
            good = a + 1
            step = 1
            bad = stop + 1
            while good < stop:
                candidate = min(a + 1 + step, stop)
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
            keep[good] = True
            a = good


def simplify(
    s: Float,
    p: Float,
    tolerance_m: float,
    *,
    rotvec: Float | None = None,
    tolerance_rad: float = 1e-5,
    fixed: Bool | None = None,
) -> Int:
    """Choose the samples that become polyline vertices.

    Greedy opening window with galloping search, O(n log n). For every sample k between neighbouring vertices a, b:
    ``|p_a + (s_k - s_a)/(s_b - s_a) (p_b - p_a) - p_k| <= tolerance_m``, likewise for the rotation vectors. The
    bound is checked on every sample of every chosen chord, so it is never broken; the number of vertices is the
    smallest where a chord that fails stays failing when it is lengthened, and close to it elsewhere.

    Args:
        s: (n,) path parameter (length, time, angle), non-decreasing.
        p: (n, 3) m, positions.
        tolerance_m: Largest allowed position error, > 0, m.
        rotvec: (n, 3) rad, orientation as rotation vectors from a common (nearby) orientation; none when left out.
        tolerance_rad: Largest allowed orientation error, > 0, rad.
        fixed: (n,) True where a sample must stay a vertex (ends of motions). The first and last always stay.

    Returns:
        (m,) indices of the vertices, rising, from 0 to n-1.

    Raises:
        InputError: Shapes differ, ``s`` falls, or a tolerance is not positive.
    """
    s = as_float("s", s, (None,))
    n = len(s)
    p = as_float("p", p, (n, 3))
    r = np.zeros((n, 3)) if rotvec is None else as_float("rotvec", rotvec, (n, 3))
    tol, tol_r = as_positive("tolerance_m", tolerance_m), as_positive("tolerance_rad", tolerance_rad)
    if n == 0:
        return np.zeros(0, dtype=np.int64)
    if np.any(np.diff(s) < 0.0):
        raise InputError("the path parameter falls", where=f"sample {int(np.argmax(np.diff(s) < 0.0)) + 1}")
    keep = np.zeros(n, dtype=np.bool_)
    if fixed is not None:
        if fixed.shape != (n,):
            raise InputError("fixed has the wrong shape", value=fixed.shape, limit=(n,))
        keep |= fixed
    keep[0] = keep[-1] = True
    _open_window(s, p, r, keep, tol * tol, tol_r * tol_r)
    out: Int = np.flatnonzero(keep)
    return out

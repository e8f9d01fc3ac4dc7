"""Kernels that walk a measured path at even steps and match it to the nominal path, in order.

The nominal path may cross itself, run back along itself and be skipped in part; the measured one may stop, lag and
vibrate. A match that looks for the nearest point anywhere would jump between passes. So the match only moves
forward, within a reach bound by the distance just travelled and the present deviation, and prefers nominal moves that
run the way the tool runs: the end of a cut is not taken for the retract above it. Only where the measured path itself
has a hole, or is lost, all later passes are searched and judged by how well the path ahead follows them.
"""

from __future__ import annotations

import math

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.jit import kernel

_AHEAD_STATIONS = 20  # looked ahead when the place on the path is searched
_TIE = 1e-15  # m2; equal distances go to the earlier pass
_SAME_WAY = 0.2  # least cosine between the tool's travel and a nominal move that it is taken to follow
_ANY_WAY = -2.0
_SETTLE = 0.02  # share per station by which the offset from the hint is corrected
_WIDE = 10.0  # times the window: where a place that is lost is searched


@kernel("Tuple((float64[:, ::1], float64[::1], boolean[::1]))(float64[:, ::1], float64, float64)", entry=True)
def even_stations(p: Float, spacing: float, gap: float) -> tuple[Float, Float, Bool]:
    """Points at even chords along a sampled path (divider walk): blind to speed, stops and small vibration.

    Args:
        p: (n, 3) m, n >= 1, joined by straight lines.
        spacing: Chord between stations, m.
        gap: A step longer than this, and four times longer than the steps before and behind it, is a hole, m.

    Returns:
        Stations (k, 3) m; their place in the samples (k,) as index plus fraction; (k,) True where a hole in the path
        lies before the station (the first one included).
    """
    n = p.shape[0]
    length = 0.0
    step = np.zeros(n + 1)
    for i in range(1, n):
        step[i] = math.sqrt((p[i, 0] - p[i - 1, 0]) ** 2 + (p[i, 1] - p[i - 1, 1]) ** 2 + (p[i, 2] - p[i - 1, 2]) ** 2)
        length += step[i]
    out = np.empty((int(length / spacing) + n + 2, 3))
    place = np.empty(out.shape[0])
    broken = np.zeros(out.shape[0], dtype=np.bool_)
    out[0] = p[0]
    place[0] = 0.0
    broken[0] = True
    k = 1
    for i in range(1, n):
        ux, uy, uz = p[i, 0] - p[i - 1, 0], p[i, 1] - p[i - 1, 1], p[i, 2] - p[i - 1, 2]
        uu = ux * ux + uy * uy + uz * uz
        if step[i] > gap and step[i] > 4.0 * max(step[i - 1], step[i + 1]):
            out[k] = p[i]
            place[k] = float(i)
            broken[k] = True
            k += 1
            continue
        if uu == 0.0:
            continue
        while True:
            ax, ay, az = p[i - 1, 0] - out[k - 1, 0], p[i - 1, 1] - out[k - 1, 1], p[i - 1, 2] - out[k - 1, 2]
            ex, ey, ez = ax + ux, ay + uy, az + uz
            if ex * ex + ey * ey + ez * ez < spacing * spacing:
                break
            b = ax * ux + ay * uy + az * uz
            c = ax * ax + ay * ay + az * az - spacing * spacing
            t = (-b + math.sqrt(max(b * b - uu * c, 0.0))) / uu
            t = min(max(t, 0.0), 1.0)
            out[k, 0] = p[i - 1, 0] + t * ux
            out[k, 1] = p[i - 1, 1] + t * uy
            out[k, 2] = p[i - 1, 2] + t * uz
            place[k] = i - 1 + t
            k += 1
    return out[:k].copy(), place[:k].copy(), broken[:k].copy()


@kernel("float64[:, ::1](float64[:, ::1], boolean[::1])", entry=True)
def travel_directions(q: Float, broken: Bool) -> Float:
    """Direction of travel at every station, (k, 3) unit vectors over four chords; zero where the path is one point."""
    m = q.shape[0]
    out = np.zeros((m, 3))
    for i in range(m):
        a, b = i, i
        while a > 0 and a > i - 2 and not broken[a]:
            a -= 1
        while b < m - 1 and b < i + 2 and not broken[b + 1]:
            b += 1
        x, y, z = q[b, 0] - q[a, 0], q[b, 1] - q[a, 1], q[b, 2] - q[a, 2]
        size = math.sqrt(x * x + y * y + z * z)
        if size > 0.0:
            out[i, 0], out[i, 1], out[i, 2] = x / size, y / size, z / size
    return out


@kernel()
def _nearest(
    p: Float, way: Float, least: float, P: Float, S: Float, j0: int, u0: float, u1: float
) -> tuple[float, int, float]:
    """Nearest nominal point with path length in u0..u1, from segment j0 on: squared distance, segment, length."""
    best, best_j, best_u = math.inf, -1, u0
    j = j0
    while j < P.shape[0] and S[j - 1] <= u1:
        length = S[j] - S[j - 1]
        if length > 0.0 and S[j] >= u0:
            ux, uy, uz = P[j, 0] - P[j - 1, 0], P[j, 1] - P[j - 1, 1], P[j, 2] - P[j - 1, 2]
            if way[0] * ux + way[1] * uy + way[2] * uz >= least * length:
                vx, vy, vz = p[0] - P[j - 1, 0], p[1] - P[j - 1, 1], p[2] - P[j - 1, 2]
                t = (vx * ux + vy * uy + vz * uz) / (length * length)
                t = min(max(t, max(0.0, (u0 - S[j - 1]) / length)), min(1.0, (u1 - S[j - 1]) / length))
                dx, dy, dz = vx - t * ux, vy - t * uy, vz - t * uz
                d2 = dx * dx + dy * dy + dz * dz
                if d2 < best - _TIE:
                    best, best_j, best_u = d2, j, S[j - 1] + t * length
        j += 1
    return best, best_j, best_u


@kernel()
def _step(p: Float, way: Float, P: Float, S: Float, j: int, u: float, reach: float) -> tuple[float, int, float]:
    """One step forward: among moves that run the tool's way, else among all."""
    d2, jn, un = _nearest(p, way, _SAME_WAY, P, S, j, u, u + reach)
    if jn < 0:
        d2, jn, un = _nearest(p, way, _ANY_WAY, P, S, j, u, u + reach)
    return d2, jn, un


@kernel()
def _follow(q: Float, way: Float, i: int, stop: int, P: Float, S: Float, j: int, u: float) -> float:
    """Mean squared distance of the stations ahead when they are followed from segment j, length u."""
    total, count = 0.0, 0
    d2, jn, un = _step(q[i], way[i], P, S, j, u, 0.0)
    d = math.sqrt(d2) if jn >= 0 else 0.0
    last = i
    for k in range(i, stop, 10):
        step = math.sqrt((q[k, 0] - q[last, 0]) ** 2 + (q[k, 1] - q[last, 1]) ** 2 + (q[k, 2] - q[last, 2]) ** 2)
        d2, jn, un = _step(q[k], way[k], P, S, j, u, 1e-4 + 2.0 * step + 2.2 * d)
        if jn < 0:
            return math.inf
        j, u, d = jn, un, math.sqrt(d2)
        last = k
        total += d2
        count += 1
    return total / max(count, 1)


@kernel()
def _search(
    q: Float, way: Float, i: int, stop: int, P: Float, S: Float, j0: int, u0: float, u1: float, capture: float
) -> tuple[float, int, float, float]:
    """Place on the nominal path between u0 and u1 that station i and those ahead follow; the earliest of equals."""
    # Returns squared distance, segment, length, and the rms distance of the stations ahead when they follow it.
    least, least_j, least_u = _step(q[i], way[i], P, S, j0, u0, u1 - u0)
    if least_j < 0:
        return least, least_j, least_u, math.inf
    turn = _SAME_WAY if way[i, 0] ** 2 + way[i, 1] ** 2 + way[i, 2] ** 2 > 0.0 else _ANY_WAY
    if i == 0:
        any_way, any_j, any_u = _nearest(q[i], way[i], _ANY_WAY, P, S, j0, u0, u1)
        if math.sqrt(least) > math.sqrt(any_way) + capture:  # a tool that swings as it sets off runs no way yet
            least, least_j, least_u, turn = any_way, any_j, any_u, _ANY_WAY
    limit = (math.sqrt(least) + capture) ** 2
    candidates = np.empty((256, 3))
    count = 0
    group, group_j, group_u, open_until = math.inf, -1, 0.0, -1.0
    for j in range(j0, P.shape[0]):
        if S[j - 1] > u1:
            break
        if S[j] <= S[j - 1] or S[j] < u0:
            continue
        d2, jn, un = _nearest(q[i], way[i], turn, P, S, j, max(u0, S[j - 1]), min(u1, S[j]))
        if jn != j or d2 > limit:
            continue
        if un > open_until and group_j >= 0 and count < 255:
            candidates[count, 0], candidates[count, 1], candidates[count, 2] = group, group_j, group_u
            count += 1
            group = math.inf
        if d2 < group - _TIE:
            group, group_j, group_u = d2, j, un
        open_until = un + 0.5 * capture
    if group_j < 0:
        return least, least_j, least_u, math.sqrt(_follow(q, way, i, stop, P, S, least_j, least_u))
    candidates[count, 0], candidates[count, 1], candidates[count, 2] = group, group_j, group_u
    count += 1
    score = np.empty(count)
    for c in range(count):
        score[c] = math.sqrt(_follow(q, way, i, stop, P, S, int(candidates[c, 1]), candidates[c, 2]))
    for c in range(count):
        if score[c] <= score.min() + capture:
            return candidates[c, 0], int(candidates[c, 1]), candidates[c, 2], score[c]
    return least, least_j, least_u, math.inf


@kernel(
    "Tuple((float64[::1], int64[::1]))(float64[:, ::1], boolean[::1], boolean[::1], float64[:, ::1], "
    "float64[::1], float64, float64, float64, float64[::1], float64)",
    entry=True,
)
def match(
    q: Float,
    broken: Bool,
    touching: Bool,
    P: Float,
    S: Float,
    spacing: float,
    capture: float,
    lost: float,
    hint: Float,
    window: float,
) -> tuple[Float, Int]:
    """Place of every station on the nominal path, never running backwards.

    In the air a new place is only taken where the path ahead follows it closely; else the last place is held until
    the cutter touches. A link move above a later cut must not be taken for that cut.

    Args:
        q: (k, 3) m stations of the measured path.
        broken: (k,) True where a hole in the measured path lies before the station.
        touching: (k,) True while material is removed.
        P: (n, 3) m nominal points.
        S: (n,) m length along them.
        spacing: Chord between stations, m.
        capture: m. After a hole, passes that the path ahead follows worse than the best by less than this count
            as equal, and the earliest is taken.
        lost: m. Beyond this distance the place is searched anew ahead.
        hint: (k,) m, about where on the nominal path each station is; ignored where not finite.
        window: m. How far ahead of the hint, corrected by its slow offset, the place may be.

    Returns:
        Length along the nominal path (k,) m, and the index of the row that ends the segment (k,).
    """
    m = q.shape[0]
    way = travel_directions(q, broken)
    u_out = np.empty(m)
    j_out = np.empty(m, dtype=np.int64)
    j, u, d = 1, 0.0, 0.0
    wait = 0
    ahead = 0.0  # of the hint: the machined program is a little longer or shorter than the nominal one
    for i in range(m):
        d2 = math.inf
        jn, un = -1, u
        low, high = u, math.inf
        reach = 1e-4 + 2.0 * spacing + 2.2 * d
        known = math.isfinite(hint[i])
        if known:
            centre = hint[i] + ahead
            low, high = max(u, centre - _WIDE * window), max(u, centre + _WIDE * window)
            reach = max(0.0, min(reach, centre + window - u))
        if not broken[i]:
            d2, jn, un = _step(q[i], way[i], P, S, j, u, reach)
        wait -= 1
        if jn < 0 or (d2 > lost * lost and wait <= 0):
            wait = 10
            stop = i + 1
            while stop < m and stop < i + 10 * _AHEAD_STATIONS and not broken[stop]:
                stop += 1
            f2, jf, uf, score = _search(q, way, i, stop, P, S, j, low, high, capture)
            sure = i == 0 or touching[i] or score <= 2.0 * capture
            if jf >= 0 and sure and (jn < 0 or f2 < 0.25 * d2):
                d2, jn, un = f2, jf, uf
        if jn < 0:
            d2, jn, un = _nearest(q[i], way[i], _ANY_WAY, P, S, j, u, u)
        if jn >= 0:
            j, u, d = jn, un, math.sqrt(d2)
        if known:
            ahead += _SETTLE * (u - hint[i] - ahead)
        u_out[i] = u
        j_out[i] = j
    return u_out, j_out


@kernel(
    "UniTuple(float64[:, ::1], 4)(float64[:, ::1], float64[:, ::1], float64[::1], int64[::1], "
    "float64[:, ::1], float64[::1], boolean[::1])",
    entry=True,
)
def split(
    q: Float, axis: Float, u: Float, seg: Int, P: Float, S: Float, feed: Bool
) -> tuple[Float, Float, Float, Float]:
    """Deviation of matched stations and the feed direction it is split by.

    At a corner both adjoining feed directions are tried and the one that leaves more across the feed is taken, so
    that overshooting a corner counts as path error.

    Args:
        q: (k, 3) m stations.
        axis: (n, 3) tool axis at the nominal rows.
        u: (k,) m, see :func:`match`.
        seg: (k,) see :func:`match`.
        P: (n, 3) m.
        S: (n,) m.
        feed: (n,) bool.

    Returns:
        Deviation (k, 3), feed direction (k, 3), left normal (k, 3), nominal points (k, 3).
    """
    m = q.shape[0]
    n = P.shape[0]
    dev = np.zeros((m, 3))
    tangent = np.zeros((m, 3))
    left = np.zeros((m, 3))
    near = np.zeros((m, 3))
    for i in range(m):
        j = seg[i]
        length = S[j] - S[j - 1]
        t = (u[i] - S[j - 1]) / length if length > 0.0 else 0.0
        t = min(max(t, 0.0), 1.0)
        for c in range(3):
            near[i, c] = P[j - 1, c] + t * (P[j, c] - P[j - 1, c])
            dev[i, c] = q[i, c] - near[i, c]
            tangent[i, c] = (P[j, c] - P[j - 1, c]) / length if length > 0.0 else 0.0
        other = 0
        if t >= 1.0 - 1e-12:
            other = j + 1
            while other < n and S[other] <= S[other - 1]:
                other += 1
        elif t <= 1e-12:
            other = j - 1
            while other > 0 and S[other] <= S[other - 1]:
                other -= 1
        if 0 < other < n and feed[other] == feed[j]:
            along, along_other = 0.0, 0.0
            length = S[other] - S[other - 1]
            for c in range(3):
                along += dev[i, c] * tangent[i, c]
                along_other += dev[i, c] * (P[other, c] - P[other - 1, c]) / length
            if abs(along_other) < abs(along):
                for c in range(3):
                    tangent[i, c] = (P[other, c] - P[other - 1, c]) / length
        ax, ay, az = axis[j, 0], axis[j, 1], axis[j, 2]
        tx, ty, tz = tangent[i, 0], tangent[i, 1], tangent[i, 2]
        lx, ly, lz = ay * tz - az * ty, az * tx - ax * tz, ax * ty - ay * tx
        size = math.sqrt(lx * lx + ly * ly + lz * lz)
        if size < 1e-6:  # plunging: any direction normal to the feed
            if abs(tx) < 0.9:
                lx, ly, lz = 0.0, tz, -ty
            else:
                lx, ly, lz = -tz, 0.0, tx
            size = math.sqrt(lx * lx + ly * ly + lz * lz)
        if size > 0.0:
            left[i, 0], left[i, 1], left[i, 2] = lx / size, ly / size, lz / size
    return dev, tangent, left, near

"""Kernels: book removed columns by axial level and immersion angle.

What a removed column cost is booked to the cutter's element that first met it: the circle at height h above the tip,
of radius r(h), meets a column with its front at t = s - sqrt(r(h)^2 - w^2), at the immersion angle
``phi = acos(w / r(h))``. What the end face removes (descending moves, plunges) is booked disjoint.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Float32, Int
from counterflex.core.jit import kernel
from counterflex.cutting.envelope_kernels import NODES, Int32, Real, Whole, height_under, radius_over

BINS: Final = 64
"""Bins of the immersion angle over (0, pi)."""
QUANTUM_M: Final = 2.0**-30
"""Unit of the booked heights, m."""
VOLUME: Final = 0
BOTTOM: Final = 1
AREA: Final = 2
VISITED: Final = 3
"""Columns of the per-segment totals: quanta neither booked nor of the end face, by the end face, cells under it, cells
visited. What a segment removed is the sum of the first two and of its book."""
EVENTS: Final = 2048
"""Removed columns gathered before they are booked together."""
COUNT: Final = 0
BOOK: Final = 1
END_FACE: Final = 2
"""What happens to removed columns: volume only; booked by level and angle; all to the end face (plunge)."""

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_SMALL = np.float32(1.0e-12)
_PI = np.float32(math.pi)
_HALF_PI = np.float32(0.5 * math.pi)
_SCALE = np.float32(2.0**30)
_BINS_PER_RAD = np.float32(BINS / math.pi)
# phi = pi would be bin 64, one behind the last.
_LAST = np.float32(BINS - 0.5)
_COSINES = np.append(np.cos(np.linspace(0.0, math.pi, BINS + 1)[:-1]), -2.0)
"""Cosines of the lower edges of the bins; no ratio is below the last entry."""
_PER_RATIO: Final = 2048.0
"""Steps of the table per unit of ratio: so fine that no step holds two edges."""
_LOWEST_BIN = (np.searchsorted(-_COSINES, 1.0 - np.arange(1, 4098) / _PER_RATIO, "right") - 1).clip(0).astype(np.int8)
"""Bin of the largest ratio of each step."""


@kernel()
def bin_of(q: Real, w: Real) -> Real:
    """Bin of phi = atan2(q, w), q >= 0, to be rounded down; within 1e-5 rad (Abramowitz and Stegun 4.4.47)."""
    aside = abs(w)
    x = min(q, aside) / max(max(q, aside), _SMALL)
    y = x * x
    p = np.float32(0.1801410) + y * (np.float32(-0.0851330) + y * np.float32(0.0208351))
    phi = x * (np.float32(0.9998660) + y * (np.float32(-0.3302995) + y * p))
    phi = phi if q < aside else _HALF_PI - phi
    phi = phi if w >= _ZERO else _PI - phi
    return min(phi * _BINS_PER_RAD, _LAST)


@kernel()
def phi_bin(ratio: Real) -> Whole:
    """Bin of phi = acos(ratio)."""
    x = min(1.0, max(-1.0, ratio))
    j = np.int64(_LOWEST_BIN[np.uint32((1.0 + x) * _PER_RATIO)])
    return j + np.int64(x <= _COSINES[np.uint32(j + 1)])


@kernel(disjoint=True)
def _book_column(
    booked: Int,
    sub: Whole,
    quanta: Whole,
    old: Real,
    new: Real,
    s: Real,
    w: Real,
    length: Real,
    za: Real,
    slope: Real,
    minimiser: Float32,
    shape: Float,
) -> Whole:
    """Split one removed column by level and angle; returns the quanta removed by the end face."""
    # booked (n_sub, n_levels, bins) receives the quanta of the side for the segment `sub`. Of a slice cut by a
    # descending corner the share `sin(phi) tan(kappa) / (sin(phi) tan(kappa) + |m|)` belongs to the horizontal motion,
    # the rest to the end face.
    radius, corner = shape[0], shape[1]
    levels = int(shape[2])
    inner = radius - corner
    aside = abs(w)
    remaining = quanta
    bottom = 0
    if slope > 0.0:
        if corner == radius:
            t_new = s - math.sqrt(max(0.0, radius * radius - w * w)) * slope / math.sqrt(1.0 + slope * slope)
        elif levels > 0:
            x = NODES * (1.0 - math.sqrt(max(1.0 - aside / radius, 1.0e-9)))
            i = int(x)
            t_new = s + minimiser[i] + (x - i) * (minimiser[i + 1] - minimiser[i])
        else:
            t_new = s
    else:
        t_new = s - math.sqrt(max(0.0, inner * inner - w * w))
    tip = za + slope * min(max(t_new, 0.0), length)
    if slope < 0.0:
        front = tip + height_under(max(aside, inner), radius, corner)
        bottom = min(quanta, round(min(max(front - new, 0.0), old - new) * (1.0 / QUANTUM_M)))
        new += bottom * QUANTUM_M
        remaining -= bottom
    if levels == 0:
        booked[sub, 0, phi_bin(w / radius)] += remaining
        return bottom
    h_new = max(0.0, new - tip)
    upper = old
    h_up = 1.0e9
    # the tool was nowhere lower than here; a level that begins above the column at its lowest has no part in it
    lowest = za + min(0.0, slope * length) - 1.0e-12
    for level in range(levels, -1, -1):
        if remaining <= 0:
            break
        h = shape[3 + level]
        if h > h_new and level > 0 and lowest + h >= upper:
            h_up = h
            continue
        lower = new
        if h > h_new and level > 0:
            r = radius_over(h, radius, corner)
            lower = za + slope * min(max(s - math.sqrt(max(0.0, r * r - w * w)), 0.0), length) + h
        else:
            h = h_new
        if lower < upper:
            part = remaining
            if lower > new:
                part = min(remaining, round((upper - lower) * (1.0 / QUANTUM_M)))
            r_mid = max(radius_over(0.5 * (h + min(h_up, h + upper - lower)), radius, corner), 1.0e-12)
            share = part
            if slope < 0.0 and level < levels:
                ratio = min(1.0, aside / r_mid)
                v = max(0.0, r_mid - inner)
                pull = math.sqrt(1.0 - ratio * ratio) * v / math.sqrt(max(1.0e-30, corner * corner - v * v))
                share = round(part * pull / (pull - slope))
                bottom += part - share
            booked[sub, level, phi_bin(w / r_mid)] += share
            remaining -= part
            upper = max(lower, new)
        h_up = h
    return bottom + remaining


@kernel()
def _code_flat(event: Float32, code: Int32, gathered: Whole, radius: Real, per_step: Real, count: Whole) -> None:
    """Segment and bin of each removed column under a flat end mill; event[1] becomes the station t of its cut."""
    s_of, w_of, t_of, place_of, sub_of = (
        event[2, :gathered],
        event[3, :gathered],
        event[1, :gathered],
        code[0, :gathered],
        code[2, :gathered],
    )
    r2 = radius * radius
    if count == 1:
        for i in range(gathered):
            q = math.sqrt(max(r2 - w_of[i] * w_of[i], _ZERO))
            place_of[i] = np.int32(bin_of(q, w_of[i]))
        return
    last = np.float32(count) - _HALF
    for i in range(gathered):
        q = math.sqrt(max(r2 - w_of[i] * w_of[i], _ZERO))
        t = s_of[i] - q
        t_of[i] = t
        place_of[i] = np.int32(bin_of(q, w_of[i]))
        sub_of[i] = np.int32(min(max(t * per_step, _ZERO), last))


@kernel()
def _code_flat_descending(
    event: Float32, code: Int32, gathered: Whole, radius: Real, za: Real, slope: Real, length: Real
) -> None:
    """Bin and side quanta of each column under a descending flat end mill; what is below its edge is the end face's."""
    d_of, new_of, s_of, w_of = event[0, :gathered], event[1, :gathered], event[2, :gathered], event[3, :gathered]
    place_of, side_of = code[0, :gathered], code[3, :gathered]
    r2 = radius * radius
    for i in range(gathered):
        q = math.sqrt(max(r2 - w_of[i] * w_of[i], _ZERO))
        edge = za + slope * min(max(s_of[i] - q, _ZERO), length)
        side = max(d_of[i] - max(edge - new_of[i], _ZERO), _ZERO)
        place_of[i] = np.int32(bin_of(q, w_of[i]))
        side_of[i] = np.int32(side * _SCALE + _HALF)


@kernel()
def _code_ball(
    event: Float32,
    code: Int32,
    gathered: Whole,
    radius: Real,
    za: Real,
    slope: Real,
    length: Real,
    sin_theta: Real,
    cos_theta: Real,
    levels: Whole,
) -> Whole:
    """Place and quanta of each removed column under a ball, twice; returns the quanta that the end face removed.

    Left in the quanta is what so tall columns had that they must be split exactly.
    """
    # The sphere, entered along the feed, meets the middle of the column at t; that gives the height above the tip,
    # hence the level, and with `q = s - t` the angle `phi = atan2(q, w)`. What reaches over the level's border goes to
    # the neighbour. On a descent the part below the ball's lowest line belongs to the end face, and of the rest a
    # share.
    d_of, new_of, s_of, w_of = event[0, :gathered], event[1, :gathered], event[2, :gathered], event[3, :gathered]
    place_of, quanta_of, next_of = code[0, :gathered], code[1, :gathered], code[2, :gathered]
    side_of, over_of, end_of = code[3, :gathered], code[4, :gathered], code[5, :gathered]
    cut_of, h_of, ahead_of = event[4, :gathered], event[5, :gathered], event[6, :gathered]
    r2 = radius * radius
    per = _ONE / radius
    top, bins = np.float32(levels), np.float32(BINS)
    unit = radius / (top * top)
    drop = max(-slope, _ZERO)
    falls = slope < _ZERO
    # Three loops: the chain of dependent operations of one would be longer than what the processor looks ahead.
    for i in range(gathered):
        s, w, new = s_of[i], w_of[i], new_of[i]
        a = max(r2 - w * w, _ZERO)
        q = math.sqrt(a)
        cut = d_of[i]
        line = za + slope * min(max(s, _ZERO), length) + radius - q
        rear = min(max(line - new, _ZERO), cut) if falls else _ZERO
        cut -= rear
        rise = new + rear + _HALF * cut - za - radius
        across = rise * cos_theta - s * sin_theta
        entry = (s * cos_theta + rise * sin_theta - math.sqrt(max(a - across * across, _ZERO))) * cos_theta
        shank = s - q
        # Above the equator the cylinder meets the column, not the sphere.
        entry = shank if rise - slope * shank > _ZERO else entry
        cut_of[i] = cut
        h_of[i] = max(rise + radius - slope * min(max(entry, _ZERO), length), _ZERO)
        ahead_of[i] = max(s - entry, _ZERO)
    for i in range(gathered):
        place_of[i] = np.int32(bin_of(ahead_of[i], w_of[i]))
    for i in range(gathered):
        cut, h, ahead = cut_of[i], h_of[i], ahead_of[i]
        half = _HALF * cut
        level = np.floor(top * math.sqrt(min(h * per, _ONE)))
        border = unit * level * level
        width = unit * (level + level + _ONE)
        above = h + half - border - width if level < top else _ZERO
        below = border - h + half if level > _ZERO else _ZERO
        beyond = max(max(above, below), _ZERO)
        # A column over more than two levels has more than the two places noted here: the exact way books it.
        tall = (beyond > _ZERO) & (cut > width + width)
        other = level + (_ONE if above > below else -_ONE)
        share = ahead / (ahead + drop * max(radius - h, _SMALL) + _SMALL) if falls else _ONE
        spot = np.float32(place_of[i])
        place_of[i] = np.int32(level * bins + spot)
        next_of[i] = np.int32(max(other, _ZERO) * bins + spot)
        # Differences cast back: as 64-bit numbers they would halve the vectors of the whole loop.
        quanta = np.int32(0) if tall else quanta_of[i]
        quanta_of[i] = np.int32(quanta_of[i] - quanta)
        over = min(np.int32(beyond * share * _SCALE + _HALF), quanta)
        side = np.int32(quanta - over)
        side = min(np.int32((cut - beyond) * share * _SCALE + _HALF), side) if falls else side
        over_of[i] = over
        side_of[i] = side
        end_of[i] = np.int32(np.int32(quanta - over) - side)
    bottom = np.int64(0)
    for i in range(gathered if falls else 0):
        bottom += np.int64(end_of[i])
    return bottom


@kernel()
def _book_pairs(code: Int32, gathered: Whole, books: Int) -> None:
    """Add the quanta of both places of each column, from both halves in turn: neighbours often share a place."""
    place_of, next_of, side_of, over_of = code[0], code[2], code[3], code[4]
    half = (gathered + 1) // 2
    # With an odd number the second half reads one entry too many; it adds nothing to place 0.
    place_of[gathered] = next_of[gathered] = side_of[gathered] = over_of[gathered] = np.int32(0)
    for i in range(half):
        one, two = np.uint64(i), np.uint64(i + half)
        books[np.uint32(place_of[one])] += np.int64(side_of[one])
        books[np.uint32(place_of[two])] += np.int64(side_of[two])
        books[np.uint32(next_of[one])] += np.int64(over_of[one])
        books[np.uint32(next_of[two])] += np.int64(over_of[two])


@kernel()
def settle(
    event: Float32,
    code: Int32,
    gathered: Whole,
    booked: Int,
    totals: Int,
    count: Whole,
    stations: Float,
    length: Real,
    za: Real,
    slope: Real,
    descending: bool,
    mode: Whole,
    continued: bool,
    minimiser: Float32,
    shape: Float,
) -> None:
    """Add gathered columns (rows removed, new height, s, w) to the books and totals of their segments."""
    radius, corner, levels = shape[0], shape[1], int(shape[2])
    f_rad, f_za, f_slope, f_len = np.float32(radius), np.float32(za), np.float32(slope), np.float32(length)
    quanta_of, removed = code[1, :gathered], event[0, :gathered]
    for i in range(gathered):
        quanta_of[i] = np.int32(removed[i] * _SCALE + _HALF)
    r2 = radius * radius
    if descending and mode != COUNT:
        s_of, w_of = event[2, :gathered], event[3, :gathered]
        f_r2 = f_rad * f_rad
        area = np.int64(0)
        for i in range(gathered):
            ahead = s_of[i] - f_len
            under = (ahead * ahead + w_of[i] * w_of[i] <= f_r2) & (quanta_of[i] > 0)
            area += np.int64(under)
        totals[count - 1, AREA] += area
    if mode == END_FACE or (mode == COUNT and count == 1):
        volume = np.int64(0)
        for i in range(gathered):
            volume += np.int64(quanta_of[i])
        totals[0, BOTTOM if mode == END_FACE else VOLUME] += volume
        return
    bottom = np.int64(0)
    if not continued:
        # what stood over the start is not cut by the motion: the end face takes it, and nothing is left to book
        for i in range(gathered):
            s, w = float(event[2, i]), float(event[3, i])
            if s * s + w * w <= r2:
                bottom += np.int64(quanta_of[i])
                quanta_of[i] = 0
                removed[i] = _ZERO
    books = booked.reshape(-1)
    ball = corner == radius
    if levels == 0 and slope >= 0.0:
        _code_flat(event, code, gathered, f_rad, np.float32(count / length), count)
        if count == 1:
            for i in range(gathered):
                books[np.uint32(code[0, i])] += np.int64(quanta_of[i])
        else:
            for i in range(gathered):
                sub = code[2, i]
                t = event[1, i]
                # The segment found by division is off by one or more where the segments of a run differ in length.
                while sub > 0 and t < stations[sub]:
                    sub -= 1
                while sub < count - 1 and t >= stations[sub + 1]:
                    sub += 1
                if mode == COUNT:
                    totals[sub, VOLUME] += np.int64(quanta_of[i])
                else:
                    books[np.uint32(sub * BINS + code[0, i])] += np.int64(quanta_of[i])
    elif levels == 0:
        _code_flat_descending(event, code, gathered, f_rad, f_za, f_slope, f_len)
        for i in range(gathered):
            side = min(code[3, i], quanta_of[i])
            books[np.uint32(code[0, i])] += np.int64(side)
            bottom += np.int64(quanta_of[i] - side)
    else:
        if ball:
            cosine = 1.0 / math.sqrt(1.0 + slope * slope)
            bottom += _code_ball(
                event, code, gathered, f_rad, f_za, f_slope, f_len, np.float32(slope * cosine), np.float32(cosine),
                levels,
            )  # fmt: skip
            _book_pairs(code, gathered, books)
        single_of, singles = code[5], np.uint64(0)
        for i in range(gathered):
            single_of[singles] = np.int32(i)
            singles += np.uint64(quanta_of[i] > 0)
        for k in range(np.int64(singles)):
            at = np.uint32(single_of[k])
            quanta, new = np.int64(quanta_of[at]), float(event[1, at])
            bottom += _book_column(
                booked, 0, quanta, new + quanta * QUANTUM_M, new, float(event[2, at]), float(event[3, at]), length, za,
                slope, minimiser, shape,
            )  # fmt: skip
    totals[0, BOTTOM] += bottom

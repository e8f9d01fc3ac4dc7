"""Kernels: book removed columns by axial level and immersion angle.

What a removed column cost is booked to the cutter's element that first met it: the circle at height h above the tip,
of radius r(h), meets a column with its front at t = s - sqrt(r(h)^2 - w^2), at the immersion angle
``phi = acos(w / r(h))``. What the end face removes (descending moves, plunges) is booked apart.
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
"""Columns of the per-segment totals: quanta removed, of these by the end face, cells under it, cells visited."""
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
_SCALE = np.float32(2.0**30)
_BINS_PER_RAD = np.float32(BINS / math.pi)


@kernel()
def phi_bin(ratio: Real) -> Whole:
    """Bin of phi = acos(ratio)."""
    phi = math.acos(min(1.0, max(-1.0, ratio)))
    return min(int(phi * (BINS / math.pi)), BINS - 1)


@kernel()
def _acos(c: Real) -> Real:
    """Arc cosine in float32, within 3e-7 rad: Abramowitz and Stegun 4.4.46."""
    a = min(abs(c), _ONE)
    p = np.float32(0.0066700901) + a * np.float32(-0.0012624911)
    p = np.float32(0.0308918810) + a * (np.float32(-0.0170881256) + a * p)
    p = np.float32(0.0889789874) + a * (np.float32(-0.0501743046) + a * p)
    p = np.float32(1.5707963050) + a * (np.float32(-0.2145988016) + a * p)
    phi = math.sqrt(_ONE - a) * p
    return phi if c >= _ZERO else _PI - phi


@kernel()
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
    """Split one removed column by level and angle; returns the quanta removed by the end face.

    booked (n_sub, n_levels, bins) receives the quanta of the side for the segment ``sub``. Of a slice cut by a
    descending corner the share ``sin(phi) tan(kappa) / (sin(phi) tan(kappa) + |m|)`` belongs to the horizontal
    motion, the rest to the end face.
    """
    radius, corner = shape[0], shape[1]
    levels = int(shape[2])
    inner = radius - corner
    aside = abs(w)
    left = quanta
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
        left -= bottom
    if levels == 0:
        booked[sub, 0, phi_bin(w / radius)] += left
        return bottom
    h_new = max(0.0, new - tip)
    upper = old
    h_up = 1.0e9
    for level in range(levels, -1, -1):
        if left <= 0:
            break
        h = shape[3 + level]
        lower = new
        if h > h_new and level > 0:
            r = radius_over(h, radius, corner)
            lower = za + slope * min(max(s - math.sqrt(max(0.0, r * r - w * w)), 0.0), length) + h
        else:
            h = h_new
        if lower < upper:
            part = left
            if lower > new:
                part = min(left, round((upper - lower) * (1.0 / QUANTUM_M)))
            r_mid = max(radius_over(0.5 * (h + min(h_up, h + upper - lower)), radius, corner), 1.0e-12)
            share = part
            if slope < 0.0 and level < levels:
                ratio = min(1.0, aside / r_mid)
                v = max(0.0, r_mid - inner)
                pull = math.sqrt(1.0 - ratio * ratio) * v / math.sqrt(max(1.0e-30, corner * corner - v * v))
                share = round(part * pull / (pull - slope))
                bottom += part - share
            booked[sub, level, phi_bin(w / r_mid)] += share
            left -= part
            upper = max(lower, new)
        h_up = h
    return bottom + left


@kernel()
def _code_flat(event: Float32, code: Int32, held: Whole, radius: Real) -> None:
    """Bin of each removed column under a flat end mill."""
    w_of, bin_of = event[3, :held], code[0, :held]
    per = _ONE / radius
    last = np.float32(BINS - 0.5)
    for i in range(held):
        bin_of[i] = np.int32(min(_acos(w_of[i] * per) * _BINS_PER_RAD, last))


@kernel()
def _code_ball(
    event: Float32,
    code: Int32,
    held: Whole,
    radius: Real,
    za: Real,
    slope: Real,
    length: Real,
    sin_theta: Real,
    cos_theta: Real,
    levels: Whole,
) -> None:
    """Level and bin of each removed column under a ball, or -1 where it must be split or shared.

    The heights above the tip at which the column's ends met the ball are exact: the lower end by the free minimiser,
    the upper one by the sphere entered along the feed. A column over two levels is divided at the border between them.
    """
    d_of, new_of, s_of, w_of = event[0, :held], event[1, :held], event[2, :held], event[3, :held]
    lower_of, upper_of = code[0, :held], code[2, :held]
    lower_side, upper_side = code[3, :held], code[4, :held]
    r2 = radius * radius
    per = _ONE / radius
    top, bins = np.float32(levels), np.float32(BINS)
    last = np.float32(BINS - 0.5)
    for i in range(held):
        s, w, new = s_of[i], w_of[i], new_of[i]
        a = max(r2 - w * w, _ZERO)
        q = math.sqrt(a)
        old = new + d_of[i]
        t_new = min(max(s - max(sin_theta, _ZERO) * q, _ZERO), length)
        tip = za + slope * t_new
        low_end = max(new, min(tip + radius - q, old)) if slope < _ZERO else new
        h_new = low_end - tip
        rise = old - za - radius
        along = s * cos_theta + rise * sin_theta
        across = rise * cos_theta - s * sin_theta
        entry = (along - math.sqrt(max(a - across * across, _ZERO))) * cos_theta
        over = s - q
        entry = over if rise - slope * over > _ZERO else entry
        h_old = rise + radius - slope * min(max(entry, _ZERO), length)
        low = np.floor(top * math.sqrt(min(max(h_new * per, _ZERO), _ONE)))
        high = np.floor(top * math.sqrt(min(max(h_old * per, _ZERO), _ONE)))
        step = high / top
        border = min(max(radius * step * step, h_new), h_old) if high > low else h_old
        h = min(max(_HALF * (h_new + border), _ZERO), radius)
        r2_mid = max(h * (radius + radius - h), _SMALL)
        ratio = min(max(w / math.sqrt(r2_mid), -_ONE), _ONE)
        lower_bin = np.floor(min(_acos(ratio) * _BINS_PER_RAD, last))
        pull = math.sqrt(max((_ONE - ratio * ratio) * r2_mid, _ZERO))
        lower_share = pull / (pull - min(slope, _ZERO) * max(radius - h, _SMALL) + _SMALL)
        h = min(max(_HALF * (border + h_old), _ZERO), radius)
        r2_mid = max(h * (radius + radius - h), _SMALL)
        ratio = min(max(w / math.sqrt(r2_mid), -_ONE), _ONE)
        upper_bin = np.floor(min(_acos(ratio) * _BINS_PER_RAD, last))
        pull = math.sqrt(max((_ONE - ratio * ratio) * r2_mid, _ZERO))
        upper_share = pull / (pull - min(slope, _ZERO) * max(radius - h, _SMALL) + _SMALL)
        cut = old - low_end
        upper_part = cut * ((h_old - border) / max(h_old - h_new, _SMALL))
        lower_of[i] = np.int32(low * bins + lower_bin if high - low <= _ONE else -_ONE)
        upper_of[i] = np.int32(high * bins + upper_bin)
        lower_side[i] = np.int32((cut - upper_part) * lower_share * _SCALE + _HALF)
        upper_side[i] = np.int32(upper_part * upper_share * _SCALE + _HALF)


@kernel()
def settle(
    event: Float32,
    code: Int32,
    held: Whole,
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
    quanta_of, removed = code[1, :held], event[0, :held]
    for i in range(held):
        quanta_of[i] = np.int32(removed[i] * _SCALE + _HALF)
    r2 = radius * radius
    if descending and mode != COUNT:
        s_of, w_of = event[2, :held], event[3, :held]
        f_r2 = f_rad * f_rad
        area = np.int64(0)
        for i in range(held):
            ahead = s_of[i] - f_len
            under = (ahead * ahead + w_of[i] * w_of[i] <= f_r2) & (quanta_of[i] > 0)
            area += np.int64(under)
        totals[count - 1, AREA] += area
    if mode != BOOK and count == 1:
        volume = np.int64(0)
        for i in range(held):
            volume += np.int64(quanta_of[i])
        totals[0, VOLUME] += volume
        if mode == END_FACE:
            totals[0, BOTTOM] += volume
        return
    quick = levels == 0 and slope >= 0.0
    split = corner == radius
    if levels == 0:
        _code_flat(event, code, held, f_rad)
    elif corner == radius:
        quick = True
        cosine = 1.0 / math.sqrt(1.0 + slope * slope)
        _code_ball(
            event, code, held, f_rad, f_za, f_slope, f_len, np.float32(slope * cosine), np.float32(cosine), levels
        )
    mean_step = length / count
    flat_book = booked.reshape(booked.shape[0], -1)
    volume = np.int64(0)
    bottom = np.int64(0)
    if count == 1 and continued and quick:
        total = booked.reshape(-1)
        for i in range(held):
            quanta = np.int64(quanta_of[i])
            place = code[0, i]
            volume += quanta
            if place >= 0:
                if split:
                    upper = min(np.int64(code[4, i]), quanta)
                    side = min(np.int64(code[3, i]), quanta - upper) if slope < 0.0 else quanta - upper
                    total[code[2, i]] += upper
                    total[place] += side
                    bottom += quanta - upper - side
                else:
                    total[place] += quanta
            elif quanta > 0:
                new = float(event[1, i])
                bottom += _book_column(
                    booked,
                    0,
                    quanta,
                    new + quanta * QUANTUM_M,
                    new,
                    float(event[2, i]),
                    float(event[3, i]),
                    length,
                    za,
                    slope,
                    minimiser,
                    shape,
                )
        totals[0, VOLUME] += volume
        totals[0, BOTTOM] += bottom
        return
    for i in range(held):
        quanta = np.int64(quanta_of[i])
        if quanta <= 0:
            continue
        sub = 0
        if count > 1 or not continued:
            s, w = float(event[2, i]), float(event[3, i])
            if not continued and s * s + w * w <= r2:
                totals[0, VOLUME] += quanta
                totals[0, BOTTOM] += quanta
                continue
            if count > 1:
                t = s - math.sqrt(max(0.0, r2 - w * w))
                sub = min(max(int(t / mean_step), 0), count - 1)
                while sub > 0 and t < stations[sub]:
                    sub -= 1
                while sub < count - 1 and t >= stations[sub + 1]:
                    sub += 1
                totals[sub, VOLUME] += quanta
                volume -= quanta
        volume += quanta
        if mode != BOOK:
            continue
        if quick and not split:
            flat_book[sub, code[0, i]] += quanta
        else:
            new = float(event[1, i])
            bottom += _book_column(
                booked,
                sub,
                quanta,
                new + quanta * QUANTUM_M,
                new,
                float(event[2, i]),
                float(event[3, i]),
                length,
                za,
                slope,
                minimiser,
                shape,
            )
    totals[0, VOLUME] += volume
    totals[0, BOTTOM] += bottom

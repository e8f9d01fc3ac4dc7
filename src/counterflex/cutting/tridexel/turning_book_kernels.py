"""Kernels: book what a tilted or turning tool took out of columns by level and immersion angle.

Every piece taken out of a column is an event: its length and its middle in the tool's frame of :mod:`pose_kernels`. The
point is followed back along its own velocity in that frame to where the cutter first met it: on the shank and on the
ball a quadratic equation, on the end face a linear one, on a rounded disc Newton's method from outside. There the
height gives the level, and the distance to the left of the feed the immersion angle about the tool axis. Of what a
descending motion takes, the share of the end face is that of the axial in the normal speed of the surface.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Float32, Int
from counterflex.core.jit import kernel
from counterflex.cutting.booking_kernels import BOTTOM, VOLUME, bin_of
from counterflex.cutting.envelope_kernels import Int32, Whole
from counterflex.cutting.tridexel.pose_kernels import Sweep

LENGTH: Final = 0
"""Rows of an event: length, then w, e, h of its middle; the fifth and sixth receive height and share of the side."""
EVENT_ROWS: Final = 6
CODE_ROWS: Final = 3
_PER_METRE = np.float32(2.0**30)
_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_SMALL = np.float32(1.0e-20)
_FLOOR = np.float32(1.0e-6)
_NEWTON: Final = 4
_NO_FEED: Final = 1.0e-9
_ON_SHANK = np.float32(1.0e-6)


@kernel()
def _meet(event: Float32, gathered: Whole, m: Sweep) -> None:
    """Share of the motion at which the cutter first meets each event, into its fifth row."""
    w_of, e_of, h_of, s_of = event[1, :gathered], event[2, :gathered], event[3, :gathered], event[4, :gathered]
    radius, corner = m.radius, m.corner
    ball = corner == radius
    for i in range(gathered):
        rw, re, h = w_of[i], e_of[i], h_of[i]
        fw, fe, fh = m.v_w + m.omega * h, m.v_e, m.v_h - m.omega * rw
        square = max(fw * fw + fe * fe, _SMALL)
        cross = rw * fe - re * fw
        along = rw * fw + re * fe
        side = (along - math.sqrt(max(radius * radius * square - cross * cross, _ZERO))) / square
        if ball:
            up = h - radius
            whole = square + fh * fh
            b = along + up * fh
            c = rw * rw + re * re + up * up - radius * radius
            round_ = (b - math.sqrt(max(b * b - whole * c, _ZERO))) / whole
            s_of[i] = side if h - side * fh >= radius else round_
        else:
            face = h / min(fh, -_SMALL)
            s_of[i] = max(side, face) if fh < _ZERO else side
    if ball or corner == _ZERO:
        return
    inner = radius - corner
    # From outside a step towards a convex surface never passes it, so the last one ends outside or on it, not in the
    # tool.
    for _ in range(_NEWTON):
        for i in range(gathered):
            fw, fe, fh = m.v_w + m.omega * h_of[i], m.v_e, m.v_h - m.omega * w_of[i]
            s = s_of[i]
            rw, re, h = w_of[i] - s * fw, e_of[i] - s * fe, h_of[i] - s * fh
            rho = math.sqrt(rw * rw + re * re)
            out, up = max(rho - inner, _ZERO), min(h - corner, _ZERO)
            size = math.sqrt(out * out + up * up)
            falls = (out * (rw * fw + re * fe) / max(rho, _SMALL) + up * fh) / max(size, _SMALL)
            step = max(size - corner, _ZERO) / max(falls, _FLOOR)
            s_of[i] = s + step if (h < corner) & (falls > _ZERO) else s


@kernel()
def _place(event: Float32, code: Int32, gathered: Whole, m: Sweep, begins: bool) -> None:
    """Bin, quanta and height of each event, and the quanta that the side of the cutter took."""
    d_of, w_of, e_of, h_of = event[0, :gathered], event[1, :gathered], event[2, :gathered], event[3, :gathered]
    s_of, height_of = event[4, :gathered], event[5, :gathered]
    bin_of_, all_of, side_of = code[0, :gathered], code[1, :gathered], code[2, :gathered]
    radius, corner = m.radius, m.corner
    inner = radius - corner
    for i in range(gathered):
        fw, fe, fh = m.v_w + m.omega * h_of[i], m.v_e, m.v_h - m.omega * w_of[i]
        before = s_of[i] < -_HALF - _ON_SHANK
        # Before its start a motion has no cutter: what would have been met there is met where it starts.
        s = max(s_of[i], -_HALF)
        rw, re, h = w_of[i] - s * fw, e_of[i] - s * fe, h_of[i] - s * fh
        rho = max(math.sqrt(rw * rw + re * re), _SMALL)
        out, up = max(rho - inner, _ZERO), max(corner - h, _ZERO)
        size = max(math.sqrt(out * out + up * up), _SMALL)
        shank = (h >= corner - _ON_SHANK) & (rho >= radius - _ON_SHANK)
        face = (out <= _ZERO) & (up <= _ZERO)
        radial = _ONE if shank else out / size
        axial = _ZERO if shank else (_ONE if face else up / size)
        side = max(radial * (rw * fw + re * fe) / rho, _ZERO)
        down = max(-fh, _ZERO) * axial
        share = side / max(side + down, _SMALL)
        share = _ZERO if before & begins else share
        quanta = d_of[i] * _PER_METRE + _HALF
        left = (re * m.v_w - rw * m.v_e) / rho
        ahead = abs(rw * m.v_w + re * m.v_e) / rho
        bin_of_[i] = np.int32(bin_of(ahead, left))
        all_of[i] = np.int32(quanta)
        side_of[i] = np.int32(np.float32(all_of[i]) * share + _HALF)
        height_of[i] = h


@kernel()
def settle_turning(
    event: Float32,
    code: Int32,
    gathered: Whole,
    m: Sweep,
    begins: bool,
    book: bool,
    shape: Float,
    booked: Int,
    totals: Int,
) -> None:
    """Add gathered events to the book (levels, bins) and the totals (4,) of their segment.

    Args:
        event: (6, n) float32, see :data:`LENGTH`.
        code: (3, n) scratch.
        gathered: How many events there are.
        begins: No motion leads up to its start: what stands there is taken by the end face.
        book: Book by level and angle; the volume only otherwise.
        shape: ``Cutter.kernel_parameters()``.
        booked: (n_levels, 64) quanta.
        totals: (4,) quanta.
    """
    length_of, all_of = event[LENGTH, :gathered], code[1, :gathered]
    volume = np.int64(0)
    if not book or math.hypot(m.v_w, m.v_e) <= _NO_FEED:
        for i in range(gathered):
            volume += np.int64(length_of[i] * _PER_METRE + _HALF)
        totals[BOTTOM if book else VOLUME] += volume
        return
    _meet(event, gathered, m)
    _place(event, code, gathered, m, begins)
    levels, corner = int(shape[2]), shape[1]
    per = 0.0 if corner == 0.0 else 1.0 / corner
    bottom = np.int64(0)
    for i in range(gathered):
        quanta, side, place = np.int64(all_of[i]), np.int64(code[2, i]), code[0, i]
        # Length and share are rounded apart, in 32 bits: the side may come out one quantum above the whole.
        side = min(side, quanta)
        bottom += quanta - side
        if levels == 0:
            booked[0, place] += side
            continue
        half = 0.5 * float(length_of[i]) * abs(m.d_h)
        low, high = max(float(event[5, i]) - half, 0.0), max(float(event[5, i]) + half, 0.0)
        first = int(levels * math.sqrt(min(low * per, 1.0)))
        last = int(levels * math.sqrt(min(high * per, 1.0)))
        rest = side
        for level in range(first, last):  # a piece may reach over several levels
            border = shape[4 + level]
            # Rounded parts must not book more quanta than the piece has; the last level takes what they leave.
            part = min(rest, np.int64(round(side * (border - max(low, shape[3 + level])) / (high - low))))
            booked[level, place] += part
            rest -= part
        booked[last, place] += rest
    totals[BOTTOM] += bottom

"""Decimal numbers in ASCII, read strictly and written with fixed places, without allocation."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel

Bytes = np.ndarray[tuple[int], np.dtype[np.uint8]]
ByteRows = np.ndarray[tuple[int, int], np.dtype[np.uint8]]
"""One datagram in a row."""

_POWERS: Float = np.array([10.0**k for k in range(23)])


@kernel("Tuple((float64, int64))(uint8[::1], int64, int64)")
def read_decimal(data: Bytes, begin: int, end: int) -> tuple[float, int]:
    """Read ``data[begin:end]`` as ``[+-] digits [. digits] [e [+-] digits]``, all of it.

    Args:
        data: (n,) bytes.
        begin: First.
        end: Behind the last.

    Returns:
        The number, and 1 where it is one, 0 where it is not (empty, a sign alone, other characters, ``inf``, ``nan``,
        more than 18 significant digits, an exponent beyond 22, or beyond 1e15). Up to 15 digits the result is the
        nearest double.
    """
    i = begin
    negative = False
    if i < end and (data[i] == 45 or data[i] == 43):
        negative = data[i] == 45
        i += 1
    mantissa = np.int64(0)
    digits, significant, places = 0, 0, 0
    point = False
    while i < end:
        c = data[i]
        if 48 <= c <= 57:
            if mantissa > 0 or c != 48:
                significant += 1
                if significant > 18:
                    return 0.0, 0
            mantissa = mantissa * 10 + (np.int64(c) - 48)
            digits += 1
            if point:
                places += 1
        elif c == 46 and not point:
            point = True
        else:
            break
        i += 1
    if digits == 0:
        return 0.0, 0
    exponent = 0
    if i < end and (data[i] == 101 or data[i] == 69):
        i += 1
        down = False
        if i < end and (data[i] == 45 or data[i] == 43):
            down = data[i] == 45
            i += 1
        if i >= end:
            return 0.0, 0
        while i < end and 48 <= data[i] <= 57:
            exponent = exponent * 10 + (int(data[i]) - 48)
            if exponent > 22:
                return 0.0, 0
            i += 1
        if down:
            exponent = -exponent
    if i != end:
        return 0.0, 0
    exponent -= places
    value = float(mantissa)
    while exponent < -22:
        value /= _POWERS[22]
        exponent += 22
    if exponent < 0:
        value /= _POWERS[-exponent]
    elif exponent > 0:
        if exponent > 22:
            return 0.0, 0
        value *= _POWERS[exponent]
    if value > 1.0e15:
        return 0.0, 0
    return (-value if negative else value), 1


@kernel("int64(uint8[::1], int64, float64, int64)")
def write_decimal(out: Bytes, begin: int, value: float, places: int) -> int:
    """Write a number with a fixed number of decimal places, rounded half to even in its last place.

    Args:
        out: (n,) buffer.
        begin: Where to start.
        value: Finite, at most 1e15 / 10^places in magnitude.
        places: Decimal places, 0 to 9; with 0 no point is written.

    Returns:
        Behind the last byte written, or -1 where the number cannot be written or the buffer is too short. Minus zero
        is written as zero.
    """
    if not abs(value) * _POWERS[places] <= 1.0e15 or places < 0 or places > 9:
        return -1
    scaled = np.int64(np.rint(abs(value) * _POWERS[places]))
    size, rest = 1, scaled // 10
    while rest > 0:
        size += 1
        rest //= 10
    if size <= places:
        size = places + 1
    negative = value < 0.0 and scaled > 0
    total = size + (1 if places > 0 else 0) + (1 if negative else 0)
    if begin + total > out.shape[0]:
        return -1
    at = begin + total - 1
    for k in range(size):
        if k == places and places > 0:
            out[at] = 46
            at -= 1
        out[at] = np.uint8(48 + scaled % 10)
        scaled //= 10
        at -= 1
    if negative:
        out[begin] = 45
    return begin + total


@kernel("Tuple((int64, int64))(uint8[::1], int64, int64)")
def read_integer(data: Bytes, begin: int, end: int) -> tuple[int, int]:
    """Read ``data[begin:end]`` as an unsigned whole number below 10^18, digits only.

    Returns:
        The number, and 1 where it is one.
    """
    if begin >= end or end - begin > 18:
        return 0, 0
    value = np.int64(0)
    for i in range(begin, end):
        if not 48 <= data[i] <= 57:
            return 0, 0
        value = value * 10 + (np.int64(data[i]) - 48)
    return int(value), 1


@kernel("int64(uint8[::1], int64, int64)")
def write_integer(out: Bytes, begin: int, value: int) -> int:
    """Write an unsigned whole number; returns behind its last digit, or -1 where it is negative or does not fit."""
    if value < 0:
        return -1
    size, rest = 1, value // 10
    while rest > 0:
        size += 1
        rest //= 10
    if begin + size > out.shape[0]:
        return -1
    for k in range(size):
        out[begin + size - 1 - k] = np.uint8(48 + value % 10)
        value //= 10
    return begin + size

"""Array types, the checks that guard public functions, and rows of long arrays: a few at a time, or grouped."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from counterflex.core.errors import InputError

ROWS: Final = 1024
"""Rows worked out at a time where a row needs many numbers in between: they stay in the cache of the processor."""


def batches(count: int, size: int = ROWS) -> Iterator[slice]:
    """Consecutive slices of at most ``size`` of ``count`` rows, for work whose intermediate results must stay small.

    Args:
        count: Rows, >= 0.
        size: Rows at a time, >= 1.

    Yields:
        Slices that together cover every row once, in order.
    """
    for first in range(0, count, size):
        yield slice(first, min(first + size, count))


def rows_of_each(number: Int) -> Iterator[tuple[int, Int]]:
    """The rows that bear each number: one sort, instead of a search of all rows for every number.

    Args:
        number: (n,) of each row, such as the group it belongs to.

    Yields:
        Numbers in rising order, each with the indices of its rows in rising order.
    """
    order = np.argsort(number, kind="stable")
    result, first = np.unique(number[order], return_index=True)
    ends = [*first[1:].tolist(), len(order)]
    for value, begin, end in zip(result.tolist(), first.tolist(), ends[: len(result)], strict=True):
        yield int(value), order[begin:end]


Float = npt.NDArray[np.float64]
Float32 = npt.NDArray[np.float32]
Int = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]
Complex = npt.NDArray[np.complex128]


def as_float(name: str, value: Any, shape: tuple[int | None, ...] | None = None) -> Float:
    """Return ``value`` as a finite, C-ordered float64 array of the given shape.

    Args:
        name: Name of the argument, used in the error.
        shape: Expected shape; ``None`` as an entry allows any length there. ``None`` skips the shape check.

    Returns:
        The array; a view of ``value`` where that already fits.

    Raises:
        InputError: The value is not numeric, has another shape, or holds NaN or infinity.
    """
    try:
        array = np.ascontiguousarray(value, dtype=np.float64)
    except (TypeError, ValueError) as fault:
        raise InputError(f"{name} is not an array of numbers", value=repr(value)[:80]) from fault
    if np.ndim(value) == 0 and shape == ():
        array = array.reshape(())
    if shape is not None and (
        array.ndim != len(shape)
        or any(want is not None and have != want for have, want in zip(array.shape, shape, strict=True))
    ):
        expected = tuple("n" if want is None else want for want in shape)
        raise InputError(f"{name} has the wrong shape", value=array.shape, limit=expected)
    if not np.all(np.isfinite(array)):
        bad = np.argwhere(~np.isfinite(np.atleast_1d(array)))[0]
        raise InputError(f"{name} holds a value that is not finite at index {bad.tolist()}")
    return array


def as_positive(name: str, value: float, *, zero: bool = False) -> float:
    """Return ``value`` as a finite float above zero (or, with ``zero``, at least zero)."""
    number = float(value)
    if not np.isfinite(number) or number < 0.0 or (number == 0.0 and not zero):
        raise InputError(f"{name} is out of range", value=value, limit=">= 0" if zero else "> 0")
    return number


def frozen(array: Float) -> Float:
    """Return a read-only copy, for values held by frozen dataclasses."""
    copy = np.array(array, dtype=np.float64, order="C")
    copy.flags.writeable = False
    return copy

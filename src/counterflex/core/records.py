"""Records: numbers of one thing under their names, in one block of memory that a kernel and Python share.

A record is a structured dtype of 64-bit numbers, of rows of them and of other records. A kernel takes an array of one
record and opens it in its first line; what it calls takes the open record::

    MEMORY = record(speed=float, filtered=(float, 3), cycles=int)

    @kernel("void(Memory[::1], float64)", Memory=MEMORY)
    def follow(memories: Records, speed: float) -> None:
        m = memories[0]
        m.speed = speed
        m.cycles += 1

From Python an array of one record costs a call 0.25 us, as much as a plain array, a bare record 1.1 us; between kernels
a record is a pointer. A row of a record goes to a kernel of plain arrays as a slice: ``m.filtered[:]``.
"""

from __future__ import annotations

import ctypes
import functools
import math
from typing import Any, TypeAlias, cast

import numpy as np

from counterflex.core.arrays import Float, Int

Record: TypeAlias = Any
"""One record, open: its fields are attributes."""
Records: TypeAlias = np.ndarray[tuple[int], np.dtype[np.record]]
"""Array of records."""
Field: TypeAlias = "type | np.dtype[Any] | tuple[type | np.dtype[Any], int | tuple[int, ...]]"


def record(**fields: Field) -> np.dtype[np.record]:
    """Type of a record.

    Args:
        fields: In order: ``float`` (64 bits), ``int`` (64 bits, signed) or another record; with a number or a shape
            behind it that many of them.

    Raises:
        ValueError: A name that every record has already, as ``size`` or ``mean``.
    """
    taken = [name for name in fields if hasattr(np.record, name)]
    if taken:
        raise ValueError(f"names that every record has already: {', '.join(taken)}")
    listed = [(name, *field) if isinstance(field, tuple) else (name, field) for name, field in fields.items()]
    return cast("np.dtype[np.record]", np.dtype((np.record, np.dtype(listed, align=True))))


def records(kind: np.dtype[np.record], count: int = 1) -> Records:
    """(count,) records, every number zero."""
    return np.zeros(count, kind)


def count_of(kind: np.dtype[np.record]) -> int:
    """Numbers that a record of this type holds."""
    return kind.itemsize // 8


def place_of(kind: np.dtype[np.record], name: str) -> int:
    """Return which of the record's numbers is the first of a field."""
    assert kind.fields is not None
    return int(kind.fields[name][1]) // 8


def as_reals(array: np.ndarray[Any, Any]) -> Float:
    """(n,) view of records as float64, field behind field; right only where every field is one."""
    out: Float = array.reshape(-1).view(np.float64)
    return out


def as_words(array: np.ndarray[Any, Any]) -> Int:
    """(n,) view of an array, of records or of plain numbers, as whole numbers of 64 bits: every bit of it."""
    out: Int = array.reshape(-1).view(np.int64)
    return out


def reals_and_words(array: np.ndarray[Any, Any]) -> tuple[Float, Int]:
    """(n,) and (m,) views of one record whose float fields come first: its float64, then its whole numbers."""
    kinds = [kind.base for kind, *_ in (array.dtype.fields or {}).values()]
    count = sum(kind.itemsize for kind, *_ in (array.dtype.fields or {}).values() if kind.base == np.float64) // 8
    if sorted(kinds, key=lambda kind: kind != np.float64) != kinds:
        raise ValueError("a float field behind a whole one")
    return as_reals(array)[:count], as_words(array)[count:]


def attributes(array: np.ndarray[Any, Any]) -> Any:
    """One record for code of Python that runs in every cycle: an attribute takes 40 ns, not 600 ns.

    Whole numbers take Python's own only. The memory is that of the array, which must stay.
    """
    words: Any = as_words(array)
    return _structure(array.dtype).from_buffer(words)


@functools.cache
def _structure(kind: np.dtype[Any]) -> type[ctypes.Structure]:
    fields: list[tuple[str, Any]] = []
    for name, (inner, *_) in (kind.fields or {}).items():
        number: Any = ctypes.c_double if inner.base == np.float64 else ctypes.c_int64
        if inner.base.fields:
            number = _structure(inner.base)
        fields.append((name, number * math.prod(inner.shape) if inner.shape else number))
    return type("Fields", (ctypes.Structure,), {"_fields_": fields})

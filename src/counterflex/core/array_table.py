"""Many arrays handed to a compiled kernel as one table of where they are.

Numba unpacks every argument of a call from Python anew, about 0.1 us for each array; a kernel of the online loop takes
forty of them and computes no longer than that. A table is unpacked once: one row per array with the address of its
first number, and its shape. The arrays must stay where they are, so a table keeps them alive, and they are never
replaced by others.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, Final, TypeVar

import numba
import numpy as np
from numba import carray, types
from numba.extending import intrinsic

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel

COLUMNS: Final = 3
"""Address, rows, columns; 0 columns: one dimension."""
Number = TypeVar("Number", bound=np.generic)


class ArrayTable:
    """A table of arrays.

    Args:
        arrays: In the order in which the kernel counts them: float64 or int64 or uint8, of one or two dimensions, or
            records (:mod:`counterflex.core.records`) of one; C order.

    Attributes:
        rows: (n, COLUMNS) to be given to the kernel.

    Raises:
        InputError: An array of another kind.
    """

    def __init__(self, arrays: Sequence[np.ndarray[Any, Any]]) -> None:
        self._kept = tuple(arrays)
        self.rows: Int = np.zeros((len(self._kept), COLUMNS), dtype=np.int64)
        for k, array in enumerate(self._kept):
            plain = array.dtype.str in ("<f8", "<i8", "|u1") and array.ndim in (1, 2)
            if not (plain or (array.dtype.fields and array.ndim == 1)) or not array.flags.c_contiguous:
                raise InputError(
                    "a kernel's array", where=f"number {k}", value=f"{array.dtype}{array.shape}", limit="C order"
                )
            self.rows[k] = array.ctypes.data, array.shape[0], array.shape[1] if array.ndim == 2 else 0


def _pointer(kind: Any) -> Any:
    @intrinsic  # type: ignore[untyped-decorator]
    def pointer(_context: Any, _address: Any) -> Any:
        """Address as a pointer."""

        def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
            return builder.inttoptr(arguments[0], context.get_value_type(kind))

        return kind(types.int64), generate

    return pointer


if numba.config.DISABLE_JIT:
    _to_float: Any = lambda address: ctypes.cast(int(address), ctypes.POINTER(ctypes.c_double))  # noqa: E731
    _to_int: Any = lambda address: ctypes.cast(int(address), ctypes.POINTER(ctypes.c_int64))  # noqa: E731
    _to_byte: Any = lambda address: ctypes.cast(int(address), ctypes.POINTER(ctypes.c_uint8))  # noqa: E731
    to_pointer: Any = lambda address: ctypes.c_void_p(int(address))  # noqa: E731
else:
    _to_float, _to_int, _to_byte = (
        _pointer(types.CPointer(kind)) for kind in (types.float64, types.int64, types.uint8)
    )
    to_pointer = _pointer(types.voidptr)
"""Address as a pointer to anything: ``carray(to_pointer(table[k, 0]), (table[k, 1],), KIND)`` are the records of array
``k``."""


@kernel("float64[::1](int64[:, ::1], int64)")
def reals(table: Int, k: int) -> Float:
    """Array ``k`` of a table: float64, one dimension."""
    out: Float = carray(_to_float(table[k, 0]), (table[k, 1],))
    return out


@kernel("float64[:, ::1](int64[:, ::1], int64)")
def matrix(table: Int, k: int) -> Float:
    """Array ``k`` of a table: float64, two dimensions."""
    out: Float = carray(_to_float(table[k, 0]), (table[k, 1], table[k, 2]))
    return out


@kernel("int64[::1](int64[:, ::1], int64)")
def wholes(table: Int, k: int) -> Int:
    """Array ``k`` of a table: int64, one dimension."""
    out: Int = carray(_to_int(table[k, 0]), (table[k, 1],))
    return out


@kernel("int64[:, ::1](int64[:, ::1], int64)")
def whole_matrix(table: Int, k: int) -> Int:
    """Array ``k`` of a table: int64, two dimensions."""
    out: Int = carray(_to_int(table[k, 0]), (table[k, 1], table[k, 2]))
    return out


@kernel("uint8[:, ::1](int64[:, ::1], int64)")
def byte_matrix(table: Int, k: int) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
    """Array ``k`` of a table: uint8, two dimensions."""
    out: np.ndarray[tuple[int, int], np.dtype[np.uint8]] = carray(_to_byte(table[k, 0]), (table[k, 1], table[k, 2]))
    return out


@kernel("uint8[::1](int64[:, ::1], int64)")
def raw_bytes(table: Int, k: int) -> np.ndarray[tuple[int], np.dtype[np.uint8]]:
    """Array ``k`` of a table: uint8, one dimension."""
    out: np.ndarray[tuple[int], np.dtype[np.uint8]] = carray(_to_byte(table[k, 0]), (table[k, 1],))
    return out

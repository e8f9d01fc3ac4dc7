"""Many arrays handed to a compiled kernel as one record of where they are, each under its name.

Numba unpacks every argument of a call from Python anew, about 0.1 us for each array; a kernel of the online loop takes
forty of them and computes no longer than that. A table is one record: for each array the address of its first number,
and its shape. The arrays must stay where they are, so a table keeps them alive, and they are never replaced by others::

    ARRAYS = addresses("plan", "frame")

    @kernel("void(Arrays[::1])", Arrays=ARRAYS)
    def work(tables: Records) -> None:
        table = tables[0]
        plan, frame = matrix(table.plan), matrix(table.frame)

    work(ArrayTable(ARRAYS, plan=plan, frame=frame).rows)
"""

from __future__ import annotations

import ctypes
from typing import Any, Final

import numba
import numpy as np
from numba import carray, types
from numba.extending import intrinsic

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records, record, records

ADDRESS: Final = record(place=int, rows=int, columns=int)
"""Where an array lies; 0 columns: one dimension."""


def addresses(*names: str) -> np.dtype[np.record]:
    """Type of a table of arrays with these names."""
    return record(**dict.fromkeys(names, ADDRESS))


class ArrayTable:
    """A table of arrays.

    Args:
        kind: Names of the arrays that the kernel takes, of :func:`addresses`.
        arrays: Those: float64 or int64 or uint8 or bool, of one or two dimensions, or records
            (:mod:`counterflex.core.records`) of one; C order.

    Attributes:
        arrays: As given.

    Raises:
        InputError: An array is missing, or of another name or kind.
    """

    def __init__(self, kind: np.dtype[np.record], **arrays: np.ndarray[Any, Any]) -> None:
        self.arrays = arrays
        self.rows: Records = records(kind)  # (1,) of that type, to be given to the kernel
        if set(arrays) != set(kind.names or ()):
            raise InputError("a kernel takes other arrays", value=", ".join(arrays), limit=", ".join(kind.names or ()))
        for name, array in arrays.items():
            plain = array.dtype.str in ("<f8", "<i8", "|u1", "|b1") and array.ndim in (1, 2)
            if not (plain or (array.dtype.fields and array.ndim == 1)) or not array.flags.c_contiguous:
                raise InputError("a kernel's array", where=name, value=f"{array.dtype}{array.shape}", limit="C order")
            columns = array.shape[1] if array.ndim == 2 else 0
            self.rows[name] = (array.ctypes.data, array.shape[0], columns)


def _pointer(kind: Any) -> Any:
    @intrinsic  # type: ignore[untyped-decorator]
    def pointer(_context: Any, _address: Any) -> Any:
        """Address as a pointer."""
        return kind(types.int64), lambda context, builder, _, arguments: builder.inttoptr(
            arguments[0], context.get_value_type(kind)
        )

    return pointer


if numba.config.DISABLE_JIT:
    _to_float: Any = lambda address: ctypes.cast(int(address), ctypes.POINTER(ctypes.c_double))  # noqa: E731
    to_whole: Any = lambda address: ctypes.cast(int(address), ctypes.POINTER(ctypes.c_int64))  # noqa: E731
    _to_byte: Any = lambda address: ctypes.cast(int(address), ctypes.POINTER(ctypes.c_uint8))  # noqa: E731
    to_pointer: Any = lambda address: ctypes.c_void_p(int(address))  # noqa: E731
else:
    _to_float, to_whole, _to_byte = (
        _pointer(types.CPointer(kind)) for kind in (types.float64, types.int64, types.uint8)
    )
    to_pointer = _pointer(types.voidptr)
"""Address as a pointer to anything: ``carray(to_pointer(a.place), (a.rows,), KIND)`` are the records at ``a``."""


@kernel("float64[::1](Address)", Address=ADDRESS)
def reals(a: Record) -> Float:
    """Array of a table: float64, one dimension."""
    out: Float = carray(_to_float(a.place), (a.rows,))
    return out


@kernel("float64[:, ::1](Address)", Address=ADDRESS)
def matrix(a: Record) -> Float:
    """Array of a table: float64, two dimensions."""
    out: Float = carray(_to_float(a.place), (a.rows, a.columns))
    return out


@kernel("int64[::1](Address)", Address=ADDRESS)
def wholes(a: Record) -> Int:
    """Array of a table: int64, one dimension."""
    out: Int = carray(to_whole(a.place), (a.rows,))
    return out


@kernel("int64[:, ::1](Address)", Address=ADDRESS)
def whole_matrix(a: Record) -> Int:
    """Array of a table: int64, two dimensions."""
    out: Int = carray(to_whole(a.place), (a.rows, a.columns))
    return out


@kernel("uint8[:, ::1](Address)", Address=ADDRESS)
def byte_matrix(a: Record) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
    """Array of a table: uint8, two dimensions."""
    out: np.ndarray[tuple[int, int], np.dtype[np.uint8]] = carray(_to_byte(a.place), (a.rows, a.columns))
    return out


@kernel("uint8[::1](Address)", Address=ADDRESS)
def raw_bytes(a: Record) -> np.ndarray[tuple[int], np.dtype[np.uint8]]:
    """Array of a table: uint8, one dimension."""
    out: np.ndarray[tuple[int], np.dtype[np.uint8]] = carray(_to_byte(a.place), (a.rows,))
    return out


@kernel("boolean[::1](Address)", Address=ADDRESS)
def truths(a: Record) -> Bool:
    """Array of a table: bool, one dimension."""
    out: Bool = carray(to_pointer(a.place), (a.rows,), np.bool_)
    return out

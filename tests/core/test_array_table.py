"""Arrays that a kernel finds by a table are the arrays themselves."""

from __future__ import annotations

import gc
import weakref
from typing import Any

import numpy as np
import pytest
from numba import carray

from counterflex.core.array_table import ADDRESS, ArrayTable, addresses, matrix, reals, to_pointer, whole_matrix, wholes
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records, record, records

FOUR = addresses("a", "b", "c", "d")


@kernel("float64(Four[::1])", Four=FOUR)
def _mark(tables: Records) -> float:
    """Sum of all numbers; then every array is marked in its last place."""
    t = tables[0]
    a, b, c, d = reals(t.a), matrix(t.b), wholes(t.c), whole_matrix(t.d)
    total = float(a.sum() + b.sum() + c.sum() + d.sum())
    a[a.shape[0] - 1], b[b.shape[0] - 1, b.shape[1] - 1] = -1.0, -2.0
    c[c.shape[0] - 1], d[d.shape[0] - 1, d.shape[1] - 1] = -3, -4
    return total


ROW = record(place=(float, 3), count=int)


TWO = addresses("first", "rows")


@kernel("Row[::1](Address)", Row=ROW, Address=ADDRESS)
def _rows(a: Record) -> Records:
    out: Records = carray(to_pointer(a.place), (a.rows,), ROW)
    return out


@kernel("void(Two[::1])", Two=TWO)
def _count_up(tables: Records) -> None:
    rows = _rows(tables[0].rows)
    for k in range(rows.shape[0]):
        rows[k].count += k
        rows[k].place[2] = 0.5


def _four() -> tuple[Float, Float, Int, Int]:
    rng = np.random.default_rng(1)
    return rng.random(5), rng.random((3, 4)), rng.integers(0, 99, 7), rng.integers(0, 99, (2, 6))


def _table(arrays: tuple[np.ndarray[Any, Any], ...]) -> ArrayTable:
    return ArrayTable(FOUR, **dict(zip("abcd", arrays, strict=True)))


def test_a_kernel_reads_and_writes_the_arrays_themselves() -> None:
    arrays = _four()
    table = _table(arrays)
    expected = sum(float(array.sum()) for array in arrays)
    assert _mark(table.rows) == pytest.approx(expected, rel=1e-15)
    assert [array.reshape(-1)[-1] for array in arrays] == [-1.0, -2.0, -3, -4]


def test_a_view_is_found_where_it_lies() -> None:
    whole = np.zeros(10)
    rest = _four()[1:]
    _mark(_table((whole[2:7], *rest)).rows)
    np.testing.assert_array_equal(np.flatnonzero(whole), [6])


def test_records_are_found_as_plain_arrays_are() -> None:
    rows = records(ROW, 4)
    _count_up(ArrayTable(TWO, first=np.zeros(2), rows=rows).rows)
    assert rows["count"].tolist() == [0, 1, 2, 3]
    np.testing.assert_array_equal(rows["place"], [[0.0, 0.0, 0.5]] * 4)
    for bad in (rows.reshape(2, 2), rows[::2]):
        with pytest.raises(InputError, match="kernel's array"):
            ArrayTable(TWO, first=np.zeros(2), rows=bad)


def test_the_table_keeps_its_arrays_alive() -> None:
    arrays = _four()
    seen = [weakref.ref(array) for array in arrays]
    table = _table(arrays)
    del arrays
    gc.collect()
    assert all(reference() is not None for reference in seen)
    assert _mark(table.rows) > 0.0


@pytest.mark.parametrize(
    "bad",
    [np.zeros(4, dtype=np.float32), np.zeros((2, 2, 2)), np.zeros((4, 4))[:, 1:3], np.zeros(8)[::2], np.zeros((), int)],
)
def test_other_arrays_are_refused(bad: np.ndarray[Any, Any]) -> None:
    with pytest.raises(InputError, match="rows"):
        ArrayTable(TWO, first=np.zeros(3), rows=bad)


def test_a_table_with_an_array_too_few_or_of_another_name_is_refused() -> None:
    for names in (("first",), ("first", "row"), ("first", "rows", "more")):
        with pytest.raises(InputError, match="takes other arrays"):
            ArrayTable(TWO, **{name: np.zeros(2) for name in names})

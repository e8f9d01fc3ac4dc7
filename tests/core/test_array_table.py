"""Arrays that a kernel finds by a table are the arrays themselves."""

from __future__ import annotations

import gc
import weakref
from typing import Any

import numpy as np
import pytest
from numba import carray

from counterflex.core.array_table import ArrayTable, matrix, reals, to_pointer, whole_matrix, wholes
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel
from counterflex.core.records import Records, record, records


@kernel("float64(int64[:, ::1])")
def _mark(table: Int) -> float:
    """Sum of all numbers; then every array is marked in its last place."""
    a, b, c, d = reals(table, 0), matrix(table, 1), wholes(table, 2), whole_matrix(table, 3)
    total = float(a.sum() + b.sum() + c.sum() + d.sum())
    a[a.shape[0] - 1], b[b.shape[0] - 1, b.shape[1] - 1] = -1.0, -2.0
    c[c.shape[0] - 1], d[d.shape[0] - 1, d.shape[1] - 1] = -3, -4
    return total


ROW = record(place=(float, 3), count=int)


@kernel("Row[::1](int64[:, ::1], int64)", Row=ROW)
def _rows(table: Int, k: int) -> Records:
    out: Records = carray(to_pointer(table[k, 0]), (table[k, 1],), ROW)
    return out


@kernel("void(int64[:, ::1])")
def _count_up(table: Int) -> None:
    rows = _rows(table, 1)
    for k in range(rows.shape[0]):
        rows[k].count += k
        rows[k].place[2] = 0.5


def _four() -> tuple[Float, Float, Int, Int]:
    rng = np.random.default_rng(1)
    return rng.random(5), rng.random((3, 4)), rng.integers(0, 99, 7), rng.integers(0, 99, (2, 6))


def test_a_kernel_reads_and_writes_the_arrays_themselves() -> None:
    arrays = _four()
    table = ArrayTable(arrays)
    expected = sum(float(array.sum()) for array in arrays)
    assert _mark(table.rows) == pytest.approx(expected, rel=1e-15)
    assert [array.reshape(-1)[-1] for array in arrays] == [-1.0, -2.0, -3, -4]


def test_a_view_is_found_where_it_lies() -> None:
    whole = np.zeros(10)
    rest = _four()[1:]
    _mark(ArrayTable((whole[2:7], *rest)).rows)
    np.testing.assert_array_equal(np.flatnonzero(whole), [6])


def test_records_are_found_as_plain_arrays_are() -> None:
    rows = records(ROW, 4)
    _count_up(ArrayTable((np.zeros(2), rows)).rows)
    assert rows["count"].tolist() == [0, 1, 2, 3]
    np.testing.assert_array_equal(rows["place"], [[0.0, 0.0, 0.5]] * 4)
    for bad in (rows.reshape(2, 2), rows[::2]):
        with pytest.raises(InputError, match="kernel's array"):
            ArrayTable((bad,))


def test_the_table_keeps_its_arrays_alive() -> None:
    arrays = _four()
    seen = [weakref.ref(array) for array in arrays]
    table = ArrayTable(arrays)
    del arrays
    gc.collect()
    assert all(reference() is not None for reference in seen)
    assert _mark(table.rows) > 0.0


@pytest.mark.parametrize(
    "bad",
    [np.zeros(4, dtype=np.float32), np.zeros((2, 2, 2)), np.zeros((4, 4))[:, 1:3], np.zeros(8)[::2], np.zeros((), int)],
)
def test_other_arrays_are_refused(bad: np.ndarray[Any, Any]) -> None:
    with pytest.raises(InputError, match="number 1"):
        ArrayTable((np.zeros(3), bad))

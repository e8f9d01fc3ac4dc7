"""Arrays that a kernel finds by a table are the arrays themselves."""

from __future__ import annotations

import gc
import weakref
from typing import Any

import numpy as np
import pytest

from counterflex.core.array_table import ArrayTable, matrix, reals, whole_matrix, wholes
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel


@kernel("float64(int64[:, ::1])")
def _mark(table: Int) -> float:
    """Sum of all numbers; then every array is marked in its last place."""
    a, b, c, d = reals(table, 0), matrix(table, 1), wholes(table, 2), whole_matrix(table, 3)
    total = float(a.sum() + b.sum() + c.sum() + d.sum())
    a[a.shape[0] - 1], b[b.shape[0] - 1, b.shape[1] - 1] = -1.0, -2.0
    c[c.shape[0] - 1], d[d.shape[0] - 1, d.shape[1] - 1] = -3, -4
    return total


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

"""Rows of long arrays a few at a time: every row once, in order."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.core.arrays import batches, rows_of_each


@given(count=st.integers(0, 200), size=st.integers(1, 70))
def test_every_row_once_and_in_order(count: int, size: int) -> None:
    found = [range(*rows.indices(count)) for rows in batches(count, size)]
    assert [row for rows in found for row in rows] == list(range(count))
    assert all(0 < len(rows) <= size for rows in found)


@pytest.mark.parametrize(("count", "most"), [(1, 1), (1024, 1), (1025, 2)])
def test_a_thousand_rows_are_one_batch(count: int, most: int) -> None:
    assert len(list(batches(count))) == most


@given(st.lists(st.integers(-5, 5), max_size=60))
def test_rows_of_each_number_are_those_of_the_definition(numbers: list[int]) -> None:
    number = np.array(numbers, dtype=np.int64)
    found = [(value, rows.tolist()) for value, rows in rows_of_each(number)]
    assert found == [(value, [k for k, own in enumerate(numbers) if own == value]) for value in sorted(set(numbers))]

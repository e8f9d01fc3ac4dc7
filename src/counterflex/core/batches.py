"""Rows of long arrays: a few at a time, or those that belong together."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from counterflex.core.arrays import Int

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
    found, first = np.unique(number[order], return_index=True)
    ends = [*first[1:].tolist(), len(order)]
    for value, begin, end in zip(found.tolist(), first.tolist(), ends[: len(found)], strict=True):
        yield int(value), order[begin:end]

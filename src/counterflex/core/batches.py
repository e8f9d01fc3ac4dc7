"""Rows of long arrays a few at a time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

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

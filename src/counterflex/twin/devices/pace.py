"""Keeping the pace of an instrument: one sample every period of its clock."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Final

LATEST_S: Final = 0.1
"""How far it may fall behind before it gives up the samples in between, as an instrument that was held up does."""


def keep_pace(
    times_s: Iterable[float],
    tick: Callable[[int, float], bool],
    *,
    now: Callable[[], float] = time.perf_counter,
    wait: Callable[[float], None] = time.sleep,
) -> int:
    """Call ``tick`` at each of the times.

    Args:
        times_s: Of the samples, s since the start, not decreasing; may never end.
        tick: Told the number of the sample and its time; returns whether to go on.
        now: The clock, s.
        wait: Waits for so many seconds.

    Returns:
        Number of samples given up because the pace could not be kept.
    """
    begin = now()
    skipped = 0
    for index, due in enumerate(times_s):
        remaining = begin + due - now()
        if remaining > 0.0:
            wait(remaining)
        elif remaining < -LATEST_S:
            skipped += 1
            continue
        if not tick(index, due):
            break
    return skipped

"""How far a job is and how long it will still take, from what it reports."""

from __future__ import annotations

import bisect
import math
import time
from collections.abc import Callable
from typing import Final

_RECENT: Final = 0.3
"""Share of the time so far that counts as recent."""
_KEPT: Final = 0.0025
"""So far apart are the fractions that are remembered."""
_FIRST: Final = 0.01
"""Below this fraction nothing is said about the time left."""


class Meter:
    """A job's progress with its time left.

    The time left is that of the work left at the mean of two speeds, since the beginning and lately (their geometric
    mean): one alone is wrong by much where a job's parts are weighed wrongly, the other jumps.

    Args:
        what: What is done, until the job says more.
        clock: Seconds, monotonic.

    Attributes:
        fraction: Done, 0..1; never falls.
        what: What is being worked on.
    """

    def __init__(self, what: str, clock: Callable[[], float] = time.monotonic) -> None:
        self.what, self.fraction = what, 0.0
        self._clock = clock
        self._seen: list[tuple[float, float]] = [(clock(), 0.0)]

    def report(self, fraction: float, what: str = "") -> None:
        """Take what a job reports; a fraction that is no number or falls back changes nothing but the words."""
        self.what = what or self.what
        if not self.fraction < fraction <= 1.0:
            return
        self.fraction = fraction
        if fraction - self._seen[-1][1] >= _KEPT:
            self._seen.append((self._clock(), fraction))

    def elapsed_s(self) -> float:
        """Time since the beginning, s."""
        return self._clock() - self._seen[0][0]

    def left_s(self) -> float | None:
        """Time left, s; None while nothing is known yet."""
        now, elapsed = self._clock(), self.elapsed_s()
        if self.fraction < _FIRST or elapsed <= 0.0:
            return None
        since = now - _RECENT * elapsed
        before = self._at(since)
        overall, lately = self.fraction / elapsed, (self.fraction - before) / (now - since)
        speed = math.sqrt(overall * max(lately, 0.1 * overall))
        return (1.0 - self.fraction) / speed

    def line(self) -> str:
        """How far it is, in a line."""
        left = self.left_s()
        rest = "" if left is None else f", about {duration(left)} left"
        return f"{self.what}: {100.0 * self.fraction:.0f} %{rest}"

    def _at(self, time_s: float) -> float:
        """Fraction at an earlier time, between what is kept by a straight line."""
        k = bisect.bisect_right(self._seen, time_s, key=lambda item: item[0])
        (t0, f0), (t1, f1) = self._seen[k - 1], self._seen[k] if k < len(self._seen) else (self._clock(), self.fraction)
        return f0 + (f1 - f0) * (time_s - t0) / (t1 - t0) if t1 > t0 else f1


def duration(seconds: float) -> str:
    """A time for people: ``40 s``, ``3 min``, ``1 h 20 min``."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"

"""Progress of a job and the time it will still take, from what it reports.

The weights of a job's parts say what they cost on the machine and the data that they were measured on. Here they may
cost something else, each by its own factor. What the parts done so far took of time for their weight is therefore
learned: the rest of the present part is told at its own rate, the parts to come at the typical rate of all.
"""

from __future__ import annotations

import bisect
import math
import statistics
import time
from collections.abc import Callable, Sequence
from typing import Final

_RECENT: Final = 0.3  # Share of the time of a part so far that counts as recent
_SPACING: Final = 0.0025  # Least distance between two fractions that are remembered
_FIRST: Final = 0.01  # Below this fraction nothing is said about the time left
_ALONE: Final = 0.1
"""Below this fraction nothing is said after a single report: its time is that of starting, for the most part."""
_SURE: Final = 0.05  # A part of this share of the work counts half as much as a very long one for what is learned
_OWN: Final = 0.1
"""When this share of a part is done, or as much as all others, half of its rest is told by its own rate."""
_ODD: Final = 4.0  # A part is taken to be faster or slower than the typical one by this factor at most
_SKIPPED: Final = 0.1
"""A part faster than this share of the typical rate had nothing to do, and says nothing of the others."""
_STANDS: Final = 1.25
"""How fast the time left of a part grows when nothing is heard of it long after it should have been."""


class Meter:
    """A job's progress with its time left.

    With rates ``r = time / work`` of the parts done and of the present one, the time left is that of the present part's
    rest, at its own rate (the geometric mean of that since its first report and lately) blended with the others' while
    little of it is done, and of the parts to come, at the weighted mean of the logarithms of all rates, those far from
    their median drawn in. A job that does not tell its parts (:func:`~counterflex.core.progress.in_parts`) is one part.

    Args:
        what: What is done, until the job says more.
        clock: Seconds, monotonic.

    Attributes:
        fraction: Done, 0..1; never falls.
        heard: Called when something was reported, or None.
    """

    def __init__(self, what: str, clock: Callable[[], float] = time.monotonic) -> None:
        self.what, self.fraction = what, 0.0
        self.on_change: Callable[[], None] | None = None
        self._clock = clock
        self._seen: list[tuple[float, float]] = [(clock(), 0.0)]
        self._last = self._seen[0]
        self._ends: list[float] = [1.0]
        self._steps = 0

    def __call__(self, fraction: float, what: str = "") -> None:
        """Take what a job reports; a fraction that is no number or falls back changes nothing but the words."""
        self.report(fraction, what)

    def report(self, fraction: float, what: str = "") -> None:
        """Take what a job reports, as calling the meter does."""
        self.what = what or self.what
        if self.fraction < fraction <= 1.0:
            self.fraction = fraction
            self._steps += 1
            self._last = (self._clock(), fraction)
            if fraction - self._seen[-1][1] >= _SPACING or fraction in self._ends:
                self._seen.append(self._last)
        if self.on_change is not None:
            self.on_change()

    def planned(self, fractions: Sequence[float]) -> None:
        """Take the fractions at which parts of the job end, 0..1; parts of parts come on top."""
        self._ends = sorted({*self._ends, *(end for end in fractions if 0.0 < end < 1.0)})

    def elapsed_s(self) -> float:
        """Time since the beginning, s."""
        return self._clock() - self._seen[0][0]

    def remaining_s(self) -> float | None:
        """Time left, s; None while nothing is known yet, 0 when all is done that the job told of."""
        if self.fraction >= 1.0:
            return 0.0
        if self.fraction < (_FIRST if self._steps > 1 else _ALONE) or self.elapsed_s() <= 0.0:
            return None
        at = min(bisect.bisect_right(self._ends, self.fraction), len(self._ends) - 1)
        begin, end = (self._ends[at - 1] if at else 0.0), self._ends[at]
        known = self._rates(self._ends[:at])
        own = self._own_rate(begin)
        done = self.fraction - begin
        everything = known if own is None else [*known, (own, done)]
        least = _SKIPPED * statistics.median_high(rate for rate, _ in everything)
        known = [item for item in known if item[0] >= least]
        typical = _typical([item for item in everything if item[0] >= least])
        if own is None or not known:
            rate = typical if own is None else own
        else:
            share = done / (done + min(_OWN * (end - begin), begin))
            rate = own**share * _typical(known) ** (1.0 - share)
        since = self._clock() - self._last[0]
        return _standing(rate * (end - self.fraction), since) + typical * (1.0 - end)

    def line(self) -> str:
        """Return how far it is, in a line."""
        remaining = self.remaining_s()
        rest = "" if remaining is None or self.fraction >= 1.0 else f", about {duration(remaining)} left"
        percent = 100.0 if self.fraction >= 1.0 else min(99.0, 100.0 * self.fraction)
        return f"{self.what}: {percent:.0f} %{rest}"

    def _rates(self, ends: Sequence[float]) -> list[tuple[float, float]]:
        """(rate, work) of the parts that are done."""
        out, before = [], 0.0
        for end in ends:
            out.append(((self._when(end) - self._when(before)) / (end - before), end - before))
            before = end
        return out

    def _own_rate(self, begin: float) -> float | None:
        """Time for work of the present part, up to the last report; None where nothing of it is done."""
        now, fraction = self._last
        since = self._when(begin)
        first = self._seen[min(bisect.bisect_right(self._seen, begin, key=lambda item: item[1]), len(self._seen) - 1)]
        if fraction - first[1] >= 0.5 * (first[1] - begin) > 0.0:  # starting is no measure of going on
            since, begin = first
        if fraction <= begin or now <= since:
            return None
        overall = (fraction - begin) / (now - since)
        recent = _RECENT * (now - since)
        lately = (fraction - max(begin, self._at(now - recent))) / recent
        return 1.0 / math.sqrt(overall * max(lately, 0.1 * overall))

    def _when(self, fraction: float) -> float:
        """Time at which a fraction was reached, between what is kept by a straight line."""
        k = bisect.bisect_left(self._seen, fraction, key=lambda item: item[1])
        if k == 0:
            return self._seen[0][0]
        (t0, f0), (t1, f1) = self._seen[k - 1], self._seen[k] if k < len(self._seen) else self._last
        return t0 + (t1 - t0) * (fraction - f0) / (f1 - f0) if f1 > f0 else t1

    def _at(self, time_s: float) -> float:
        """Fraction at an earlier time, between what is kept by a straight line."""
        k = bisect.bisect_right(self._seen, time_s, key=lambda item: item[0])
        (t0, f0), (t1, f1) = self._seen[k - 1], self._seen[k] if k < len(self._seen) else self._last
        return f0 + (f1 - f0) * (time_s - t0) / (t1 - t0) if t1 > t0 else f1


def _typical(rates: Sequence[tuple[float, float]]) -> float:
    """Mean of rates (rate, work) by their logarithms, long parts counting more, odd ones drawn in."""
    logs = [math.log(max(rate, 1e-12)) for rate, _ in rates]
    weights = [work / (work + _SURE) for _, work in rates]
    middle, most = statistics.median(logs), math.log(_ODD)
    near = [middle + min(max(value - middle, -most), most) for value in logs]
    return math.exp(sum(w * value for w, value in zip(weights, near, strict=True)) / sum(weights))


def _standing(expected_s: float, since_s: float) -> float:
    """Time left of a part when nothing was heard for a while, from what was left at the last report.

    It falls with the time; where it should long be over, it grows again: what has stood long will stand long.
    """
    late = max(0.0, since_s - 0.5 * expected_s)
    return math.hypot(max(0.0, expected_s - since_s), _STANDS * late)


def duration(seconds: float) -> str:
    """A time for people: ``40 s``, ``3 min``, ``1 h 20 min``."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"

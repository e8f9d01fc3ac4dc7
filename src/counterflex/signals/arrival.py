"""Age of samples that another clock has stamped, from when they arrive."""

from __future__ import annotations

import math
from typing import Any, Final

from counterflex.core.arrays import as_positive
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records, attributes, record, records

_ANEW_S: Final = 2.0
_ANEW_SAMPLES: Final = 5
_FALLEN_SAMPLES: Final = 8
_SILENT_S: Final = 0.1  # Without samples for so long, by both clocks, the source was silent
_STEADY_S: Final = 1.0
"""So long later samples must come behind a silence, none of them sooner than the first ones, to be another time."""
_LATER_S: Final = 2e-3

ARRIVAL: Final = record(
    least=float,  # s, age of a sample that came the shortest way
    rate=float,  # by how much the clocks may run apart
    floor=float,  # s, smallest difference of arrival and stamp; inf before the first sample, as the next two
    new_floor=float,
    later=float,
    last=float,  # s, arrival of the last sample
    stamp=float,  # s, of it; -inf before the first
    steady=float,  # s, since when samples are later
    far=int,  # samples in a row that are far too old
    fallen=int,  # samples since stamps fell
    set_back=int,  # how often the other clock was taken anew
)
"""What is known of another clock."""


@kernel("void(Arrival, float64)", Arrival=ARRIVAL)
def _begin_anew(a: Record, floor: float) -> None:
    a.floor, a.far, a.fallen = floor, 0, 0
    a.later = math.inf
    a.set_back += 1


@kernel("void(Arrival, float64, float64)", Arrival=ARRIVAL)
def _watch_stamp(a: Record, difference_s: float, stamp_s: float) -> None:
    """Stamps that have fallen, and what follows: the new time, or the old one again."""
    if stamp_s < a.stamp:
        a.fallen, a.new_floor = 1, difference_s
    elif a.fallen > 0 and difference_s < 0.5 * (a.floor + a.new_floor):
        a.fallen = 0
    elif a.fallen > 0 and stamp_s > a.stamp:
        a.fallen, a.new_floor = a.fallen + 1, min(a.new_floor, difference_s)
    a.stamp = stamp_s
    if a.fallen >= _FALLEN_SAMPLES:
        _begin_anew(a, a.new_floor)


@kernel("void(Arrival, float64, float64, float64)", Arrival=ARRIVAL)
def _watch_silence(a: Record, now_s: float, difference_s: float, stamp_s: float) -> None:
    """Samples that are all later by the same since the source was silent: its clock was set back meanwhile."""
    silent = min(now_s - a.last, stamp_s - a.stamp)
    if a.floor < math.inf and silent > _SILENT_S and difference_s - a.floor > _LATER_S:
        a.later, a.steady = difference_s, now_s
    elif difference_s < 0.5 * (a.floor + a.later):
        a.later = math.inf
    elif difference_s < a.later - 0.5 * _LATER_S:
        a.later, a.steady = difference_s, now_s
    if a.later < math.inf and now_s - a.steady > _STEADY_S:
        _begin_anew(a, a.later)


@kernel("float64(Arrival[::1], float64, float64)", Arrival=ARRIVAL, exact=True, entry=True)
def age(arrivals: Records, now_s: float, stamp_s: float) -> float:
    """Age of a sample, see :class:`ArrivalClock`."""
    a = arrivals[0]
    difference_s = now_s - stamp_s
    if a.floor < math.inf:
        a.floor += a.rate * max(0.0, now_s - a.last)
    _watch_silence(a, now_s, difference_s, stamp_s)
    a.last = now_s
    repeated = stamp_s == a.stamp
    _watch_stamp(a, difference_s, stamp_s)
    a.far = a.far + int(not repeated) if difference_s - a.floor > _ANEW_S else 0
    if a.far >= _ANEW_SAMPLES:
        _begin_anew(a, difference_s)
    a.floor = min(a.floor, difference_s)
    return float(a.least + difference_s - a.floor)


class ArrivalClock:
    """Tells how old a sample is when it arrives, without setting the two clocks.

    Of all samples the one with the smallest difference of arrival and stamp came the shortest way; its age is what was
    identified for it, and every other sample is older by as much as its difference is larger. The smallest difference
    is let up slowly, so that a clock that runs slower than ours is followed; one that runs faster is at once.

    A clock that was set back is known by time stamps that fall; by how much does not matter. It is taken anew with the
    eighth sample of the new time; until then its samples are older than those before them, and their user sees it. One
    sample with a wrong stamp changes nothing, however often it is repeated: the next one has the old time again. Where
    no stamp falls, since the source was silent meanwhile, it is known after five samples that would be older than 2 s,
    or when for 1 s behind a silence of 0.1 s and more (of the stamps, too: a network that stands still lets them go on)
    every sample is later by the same: a queue that is worked off becomes shorter.

    Args:
        least_s: Age of a sample that came the shortest way.
        rate: By how much the clocks may run apart, 1 (1e-4 is 0.1 ms in a second).

    Attributes:
        records: (1,) :data:`ARRIVAL`.
    """

    def __init__(self, least_s: float, rate: float = 1e-4) -> None:
        self.records = records(ARRIVAL)
        self._now: Any = attributes(self.records)
        self._now.least = as_positive("least_s", least_s, zero=True)
        self._now.rate = as_positive("rate", rate, zero=True)
        self._now.floor = self._now.new_floor = self._now.later = math.inf
        self._now.stamp = -math.inf

    @property
    def set_back(self) -> int:
        """Number of times that the other clock was taken anew."""
        return int(self._now.set_back)

    def age(self, now_s: float, stamp_s: float) -> float:
        """Age of a sample. Returns seconds from its measurement to ``now_s``, at least ``least_s``."""
        return age(self.records, now_s, stamp_s)

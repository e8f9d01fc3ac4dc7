"""Age of samples that another clock has stamped, from when they arrive."""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import as_positive

_ANEW_S: Final = 2.0
_ANEW_SAMPLES: Final = 5
_FALLEN_SAMPLES: Final = 8
_SILENT_S: Final = 0.1  # Without samples for so long, by both clocks, the source was silent
_STEADY_S: Final = 1.0
"""So long later samples must come behind a silence, none of them sooner than the first ones, to be another time."""
_LATER_S: Final = 2e-3


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
        set_back: How often the other clock was taken anew.
    """

    def __init__(self, least_s: float, rate: float = 1e-4) -> None:
        self.least_s = as_positive("least_s", least_s, zero=True)
        self._rate = as_positive("rate", rate, zero=True)
        self._floor = math.inf
        self._last = 0.0
        self._far = self._fallen = 0
        self._stamp = -math.inf
        self._new_floor = math.inf
        self._later_s = math.inf
        self._steady_s = 0.0
        self.set_back = 0

    def age(self, now_s: float, stamp_s: float) -> float:
        """Age of a sample. Returns seconds from its measurement to ``now_s``, at least ``least_s``."""
        difference_s = now_s - stamp_s
        if self._floor < math.inf:
            self._floor += self._rate * max(0.0, now_s - self._last)
        self._watch_silence(now_s, difference_s, stamp_s)
        self._last = now_s
        repeated = stamp_s == self._stamp
        self._watch_stamp(difference_s, stamp_s)
        self._far = self._far + (not repeated) if difference_s - self._floor > _ANEW_S else 0
        if self._far >= _ANEW_SAMPLES:
            self._begin_anew(difference_s)
        self._floor = min(self._floor, difference_s)
        return self.least_s + difference_s - self._floor

    def _watch_stamp(self, difference_s: float, stamp_s: float) -> None:
        """Stamps that have fallen, and what follows: the new time, or the old one again."""
        if stamp_s < self._stamp:
            self._fallen, self._new_floor = 1, difference_s
        elif self._fallen and difference_s < 0.5 * (self._floor + self._new_floor):
            self._fallen = 0
        elif self._fallen and stamp_s > self._stamp:
            self._fallen, self._new_floor = self._fallen + 1, min(self._new_floor, difference_s)
        self._stamp = stamp_s
        if self._fallen >= _FALLEN_SAMPLES:
            self._begin_anew(self._new_floor)

    def _watch_silence(self, now_s: float, difference_s: float, stamp_s: float) -> None:
        """Samples that are all later by the same since the source was silent: its clock was set back meanwhile."""
        silent = min(now_s - self._last, stamp_s - self._stamp)
        if self._floor < math.inf and silent > _SILENT_S and difference_s - self._floor > _LATER_S:
            self._later_s, self._steady_s = difference_s, now_s
        elif difference_s < 0.5 * (self._floor + self._later_s):
            self._later_s = math.inf
        elif difference_s < self._later_s - 0.5 * _LATER_S:
            self._later_s, self._steady_s = difference_s, now_s
        if self._later_s < math.inf and now_s - self._steady_s > _STEADY_S:
            self._begin_anew(self._later_s)

    def _begin_anew(self, floor: float) -> None:
        self._floor, self._far, self._fallen = floor, 0, 0
        self._later_s = math.inf
        self.set_back += 1

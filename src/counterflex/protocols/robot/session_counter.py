"""Tells telegrams of a controller's session from repeated and overtaken ones, and from those of another session."""

from __future__ import annotations

from typing import Final

from counterflex.core.units import MS
from counterflex.protocols.robot.port import Verdict
from counterflex.runtime.step.supervise import SESSION_S

SESSION_MS: Final = round(SESSION_S / MS)
"""How far ahead the counter may jump within one session."""
_FAR_RUN, _NEAR_RUN = 3, 8
"""Telegrams in a row that follow each other but not the last good one, until they are another session's: beyond a
second from it, and within (where they may be a batch that was overtaken)."""
_FOLLOWS: Final = 10
_NEW, _OLD, _ASTRAY = Verdict.NEW, Verdict.OLD, Verdict.ASTRAY


class SessionCounter:
    """The counter of one controller, ms: IPOC of RSI, time stamp of EGM.

    A counter that goes back, stands more than a second ahead or begins again at 0 is not followed at once, because one
    damaged telegram may say so; but after at most 8 telegrams that follow each other it is another session, and never
    are the new ones passed over for ever as old.

    Args:
        cycle_ms: Cycle of the controller.

    Attributes:
        newest: Counter of the newest telegram; -1 before the first.
    """

    def __init__(self, cycle_ms: int) -> None:
        self._cycle_ms = cycle_ms
        self.newest = -1
        self._last = -1
        self._other, self._run = -1, 0
        self._another = False

    def judge(self, counter: int) -> Verdict:
        """Judge a telegram by its counter; a new one is taken as the newest."""
        step = counter - self.newest if self.newest >= 0 else 1
        if 0 < step <= SESSION_MS:
            self._run, self.newest = 0, counter
            return _NEW
        near = -SESSION_MS < step <= 0
        follows = self._run > 0 and 0 < counter - self._other <= _FOLLOWS * self._cycle_ms
        self._run = self._run + 1 if follows else 1
        self._other = counter
        if self._run < (_NEAR_RUN if near else _FAR_RUN):
            return _OLD if near else _ASTRAY
        self._run, self._another, self.newest = 0, True, counter
        return _NEW

    def follows(self, counter: int) -> bool:
        """Return whether a counter lies ahead of the newest one and within its session; nothing is taken from it."""
        return self.newest >= 0 and 0 < counter - self.newest <= SESSION_MS

    def advance(self) -> tuple[int, bool]:
        """Go on to the newest telegram.

        Returns:
            Cycles since the one before, at least 1, and whether it belongs to another session.
        """
        first, another = self._last < 0, self._another
        elapsed = 1 if first or another else max(1, round((self.newest - self._last) / self._cycle_ms))
        self._last, self._another = self.newest, False
        return elapsed, another and not first

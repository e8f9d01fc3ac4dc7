"""The robot program of a played cell: it waits to be corrected, obeys a feed hold, and is started again when stopped.

What a program around RSI does: it stands at its beginning until the sensor program says that it is armed, switches the
correction on and goes along its path. A feed hold lets it stand on the path. Once the controller has been stopped, or
nothing is corrected any more, the program is ended: the tool leaves the part, no correction is in effect, no telegram
is sent for a second. Then another session begins, at the beginning of the path.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final

ARMED: Final = 2
"""State by which the sensor program says that it waits for the program (tag ``State``)."""
ACTIVE: Final = 3
"""It corrects."""
NO_TAG: Final = -1
"""It cannot say, the configuration has no such tag."""


class Phase(IntEnum):
    """Phase of the program."""

    WAITS = 0
    """At the beginning, correction off."""
    RUNS = 1
    """On its path, correction on; also where the feed is held."""
    ENDED = 2
    """Between two sessions: no telegram."""


class PlayedProgram:
    """Cycle by cycle, without any clock.

    Args:
        gate: Cycles for which it stands at the beginning at least.
        again: The same when it is started again.
        pause: Cycles without a session once it was ended.
        unanswered: Cycles in a row without an answer after which it is ended.
        uncorrected: Cycles in a row in which the sensor program says that it is neither correcting nor about to.

    Attributes:
        phase: See :class:`Phase`.
        place: Cycles gone along the path.
        held: Cycles in which the feed was held.
        ends: How often it was ended.
    """

    def __init__(
        self, gate: int = 1500, *, again: int = 250, pause: int = 250, unanswered: int = 125, uncorrected: int = 50
    ) -> None:
        self._gate, self._again, self._pause = gate, again, pause
        self._unanswered, self._uncorrected = unanswered, uncorrected
        self.phase = Phase.WAITS
        self.place = self.held_cycles = self.ends = 0
        self._stood = self._silent = self._without = 0
        self._feed_held = False

    @property
    def enabled(self) -> bool:
        """The program wants to be corrected."""
        return self.phase == Phase.RUNS

    def go_on(self, cycles: int) -> None:
        """Cycles in which nobody looked: a program on its path goes on as it went, or stands where it was held."""
        if self.phase == Phase.RUNS:
            self.held_cycles += cycles if self._feed_held else 0
            self.place += 0 if self._feed_held else cycles

    def cycle(self, reported_state: int, *, answered: bool, feed_hold: bool, stopped: str) -> str:
        """Choose what it does in the next cycle, by what came in the last one.

        Args:
            reported_state: What the sensor program says it is doing; :data:`NO_TAG` where it cannot say.
            answered: An answer was taken.
            feed_hold: The feed is to be held.
            stopped: Why the controller was stopped, or empty.

        Returns:
            Why the program was ended in this cycle, or empty.
        """
        if self.phase == Phase.ENDED:
            self._stood += 1
            if self._stood >= self._pause:
                self.phase, self.place, self._stood = Phase.WAITS, 0, 0
            return ""
        self._silent = 0 if answered else self._silent + 1
        running = self.phase == Phase.RUNS
        self._without = self._without + 1 if running and NO_TAG < reported_state < ARMED else 0
        why = stopped
        if running and self._silent >= self._unanswered:
            why = why or "no answer"
        if self._without >= self._uncorrected:
            why = why or "not corrected"
        if why:
            self.phase, self._gate = Phase.ENDED, self._again
            self.ends += 1
            self._stood = self._silent = self._without = 0
        elif running:
            self._feed_held = feed_hold
            self.go_on(1)
        else:
            self._stood += 1
            if self._stood >= self._gate and reported_state in (ARMED, NO_TAG):
                self.phase = Phase.RUNS
        return why

"""Programs that never end, found while they are executed.

An interpreter is deterministic: where a line is reached again with the same values, offsets, modes and position as
before, everything from there on repeats for ever. That is found by Brent's method: one earlier state is kept, compared
at jumps back, and replaced after 1, 2, 4, 8 ... jumps, so that a cycle of any length is found within three times its
length. A loop whose state changes for ever (a counter that only grows) is found by counting.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Final

MOST_REPEATED: Final = 200_000
"""Lines executed again. A surface milled by two nested loops takes 100 000; this many are read in some seconds."""
MOST_WITHOUT_MOTION: Final = 100_000
"""Lines executed again with no motion in between. Loops that only compute (a search, a table) take some thousand."""
_OFTEN: Final = 1000
_SELDOM: Final = 64  # After so many comparisons in vain only every 64th jump is compared: a state takes 0.2 ms to copy


class LoopWatch:
    """Watch the jumps back of one run of a program.

    Args:
        state: Returns all that decides how the run goes on, as a copy that compares by value.
    """

    def __init__(self, state: Callable[[], Any]) -> None:
        self._state = state
        self._place: object = None
        self._kept: Any = None
        self._jumps, self._next = 0, 1
        self._repeated, self._quiet, self._motions = 0, 0, 0
        self._compared = 0

    def jumped_back(self, place: object, lines: int, motions: int) -> str:
        """Return why the run will not end, or nothing where it may.

        Args:
            place: Where the run goes on; compares by value.
            lines: Lines that will be executed again because of this jump, at least 1.
            motions: Motions made so far.
        """
        self._jumps += 1
        self._repeated += lines
        self._quiet = 0 if motions != self._motions else self._quiet + lines
        self._motions = motions
        if self._place == place and (self._compared < _OFTEN or self._jumps % _SELDOM == 0):
            self._compared += 1
            if self._kept == self._state():
                return "the program never ends: this line is reached again with all values and modes as before"
        if self._jumps == self._next:
            self._place, self._kept, self._next = place, self._state(), 2 * self._next
        if self._quiet > MOST_WITHOUT_MOTION:
            return f"the program does not end: it repeats more than {MOST_WITHOUT_MOTION} lines without a motion"
        if self._repeated > MOST_REPEATED:
            return f"the program does not end, or repeats more than {MOST_REPEATED} lines"
        return ""


def frozen(value: object) -> object:
    """Return a copy of plain data that compares by value; of other objects who they are."""
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, Mapping):
        return {key: frozen(item) for key, item in value.items()}
    if isinstance(value, (tuple, list)):
        return [frozen(item) for item in value]
    if is_dataclass(value) and not isinstance(value, type):
        return [type(value).__name__, *(frozen(getattr(value, item.name)) for item in fields(value))]
    if isinstance(value, (set, frozenset)):
        return frozenset(value)
    return id(value)

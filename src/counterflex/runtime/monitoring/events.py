"""Events that the monitor watches for, and why it lowers the speed."""

from __future__ import annotations

from enum import IntEnum
from typing import Final


class Event(IntEnum):
    """An event of the process monitor; bit ``1 << event`` in its results."""

    MISSING_CUT = 0
    """Material should be cut and there is no force."""
    OVERLOAD = 1
    """More force than the plan explains, or than spindle and tool may take."""
    WEAR = 2
    """The ratio of measured to predicted force rises with the length of cut."""
    BREAKAGE = 3
    """The force drops at once where the plan is steady."""
    CHATTER = 4
    """Vibration that does not turn with the spindle."""
    LOW_CHATTER = 5
    """Vibration at the frequencies of the arm and the correction that does not die away in a steady cut."""


EVENTS: Final = len(Event)


class Slowed(IntEnum):
    """Reason for less than the programmed speed."""

    NOT = 0
    PLAN = 1
    """The correction could not follow within tolerance."""
    LIMITER = 2
    """The correction is held back by its limits of speed and acceleration."""
    REACH = 3
    """The correction comes near its largest value."""
    FORCE = 4
    """The force comes near its limit."""

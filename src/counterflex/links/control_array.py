"""The array that the loop shares with the operator's side and the recorder: requests in, tallies out.

Whole 64-bit numbers, so that none is ever seen half written.
"""

from __future__ import annotations

from enum import IntEnum


class Request(IntEnum):
    """What the operator's side can ask for: places of the control array."""

    ARM = 0
    STOP = 1
    RESET = 2
    END = 3


REQUESTS = len(Request)


class Tally(IntEnum):
    """What the loop counts for whoever watches it: places of the control array after those of :class:`Request`."""

    FOREIGN = 4
    """Telegrams from an address that is not the controller's."""
    MALFORMED = 5
    OUT_OF_LINE = 6
    """Repeated, overtaken, or of another session."""
    DRAINED = 7
    """Passed over because a newer one was there."""
    LOST = 8
    """By the controller's counter."""
    LATE = 9
    """Answers that came too late for the controller, by its own count; -1 where it does not say."""
    CLOCK = 10
    """How often this computer's clock and the controller's counter parted."""
    TARES = 11
    """Zeros of the force sensor refused in a row."""
    IDLE_MN = 12
    """What the sensor showed then, mN."""
    IDLE_MNM = 13
    """Its moment, mN m."""


class Kept(IntEnum):
    """What the recorder says of the log: places of the control array after those of :class:`Tally`."""

    TAKEN = 14
    """Records taken over from the loop."""
    TROUBLE = 15
    """1: they cannot be written."""


CONTROL = REQUESTS + len(Tally) + len(Kept)
"""Length of an array that holds requests, tallies and what the recorder says."""

"""Times of a played cell, cycle by cycle, handed over in blocks of some cycles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int

NOT_REPORTED: Final = -1
"""State where no answer came."""


@dataclass(frozen=True, eq=False)
class Block:
    """Times of a number of cycles; n of them had a telegram."""

    reply_s: Float  # (n,) from sending a telegram to having its answer; not-a-number where none came within the cycle
    echo_s: Float  # (n,) the same of the datagram that is only sent back
    late_s: Float  # (n,) how late this side wanted to send the telegram and could not
    woken_s: Float  # (n,) how late this side woke up at most within the cycle, whatever it waited for
    reported_state: Int  # (n,) what the sensor program said it was doing in its answer; NOT_REPORTED without one
    # cycles that were over before this side woke up: their telegrams were not sent, and nobody answered them
    missed: int
    paused: int  # cycles without a telegram, between two sessions
    held_cycles: int  # cycles in which the robot stood because the feed was held
    ended: tuple[tuple[float, str], ...]  # time since the start, s, and why, each time the robot program was ended
    largest_m: float  # largest correction in force, since the start
    refused: int  # answers that the controller did not take, since the start


class Times:
    """A block that is being filled.

    Attributes:
        missed: As in :class:`Block`.
    """

    def __init__(self, most: int) -> None:
        self._times: Float = np.full((4, most), np.nan)
        self._states: Int = np.full(most, NOT_REPORTED, dtype=np.int64)
        self._count = 0
        self.missed = self.paused = self.held_cycles = 0
        self.ended: list[tuple[float, str]] = []

    def add(self, reply_s: float, echo_s: float, late_s: float, woken_s: float, reported_state: int) -> None:
        """Take a cycle with a telegram; see :class:`Block`."""
        k = self._count
        self._times[:, k] = reply_s, echo_s, late_s, woken_s
        self._states[k] = reported_state
        self._count = k + 1

    def block(self, largest_m: float, refused: int) -> Block:
        """All of it so far.

        Args:
            largest_m: Largest correction in force, since the start.
            refused: Answers not taken, since the start.
        """
        n = self._count
        reply, echo, late, woken = (row[:n].copy() for row in self._times)
        return Block(
            reply_s=reply,
            echo_s=echo,
            late_s=late,
            woken_s=woken,
            reported_state=self._states[:n].copy(),
            missed=self.missed,
            paused=self.paused,
            held_cycles=self.held_cycles,
            ended=tuple(self.ended),
            largest_m=largest_m,
            refused=refused,
        )

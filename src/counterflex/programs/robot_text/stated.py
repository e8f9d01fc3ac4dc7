"""Posture and turns of the arm that a robot program states at the end of a motion, in no language."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

TURNING: Final = (0, 3, 5)
"""Axes that reach more than a full turn."""


@dataclass(frozen=True, slots=True)
class StatedPosture:
    """Posture as far as it is stated; None is not."""

    front: bool | None = None  # The wrist centre lies ahead of axis 1
    # Axis 3 is beyond the angle at which the arm is straight, in the direction of elbow up of a front arm
    bent: bool | None = None
    noflip: bool | None = None  # Axis 5 is positive in the sense of the closed form

    def agrees(self, branch: str) -> bool:
        """Return whether nothing of it contradicts a posture such as ``front up noflip``."""
        arm, elbow, wrist = branch.split()
        front = arm == "front"
        own = (front, (elbow == "up") == front, wrist == "noflip")
        stated = (self.front, self.bent, self.noflip)
        return all(a is None or a == b for a, b in zip(stated, own, strict=True))


Stated = tuple[StatedPosture, str]
"""A posture and the words that state it."""


@dataclass(frozen=True, slots=True)
class StatedTurns:
    """Ranges of axes 1, 4 and 6 as the controller shows them."""

    low_deg: tuple[float, ...]
    high_deg: tuple[float, ...]
    words: str


def turn_ranges(numbers: Sequence[int], size_deg: float, first_deg: float, words: str) -> StatedTurns:
    """Ranges of one size that are counted by whole numbers; 0 begins at ``first_deg``."""
    low = tuple(first_deg + size_deg * number for number in numbers)
    return StatedTurns(low, tuple(value + size_deg for value in low), words)

"""One injected fault: what it is, what is required, how to run it, and what came of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

SENSORS: Final = ("force", "both")
"""What the loop corrects from: a force sensor, or a force sensor and a tracker at once."""


@dataclass(frozen=True)
class Effort:
    """Effort that a scenario may take."""

    quick: bool = False  # a small sample instead of one that is large enough for rare events
    seed: int = 0  # of everything that is random
    sensors: str = "force"  # one of SENSORS

    def pick(self, whole: int, quick: int) -> int:
        """One of two numbers of repetitions."""
        return quick if self.quick else whole


@dataclass(frozen=True)
class Outcome:
    """Outcome of a scenario."""

    passed: bool  # the requirement holds
    happened: str  # in words: states, causes
    # largest change of the correction in force at the robot within one cycle; None: none was looked at
    step_m: float | None = None
    # from the fault until the correction stood still or the robot had stopped; None: nothing had to stop
    safe_s: float | None = None
    figures: dict[str, float] = field(default_factory=dict)  # further numbers by name; a name ends with its unit

    def __post_init__(self) -> None:
        """A comparison of arrays gives a truth value that JSON does not know."""
        object.__setattr__(self, "passed", bool(self.passed))


@dataclass(frozen=True)
class Scenario:
    """One fault to inject."""

    requirement: str  # number of the requirement: ``R3``
    name: str  # short, unique
    injected: str  # what is done, in words
    required: str  # what must hold, in words with numbers
    run: Callable[[Effort], Outcome]  # does it
    realtime: bool = False  # it takes real time and shows this machine, too
    sensors: tuple[str, ...] = SENSORS  # those of SENSORS with which it can be run

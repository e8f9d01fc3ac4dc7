"""One injected fault: what it is, what is required, how to run it, and what came of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

SENSORS: Final = ("force", "both")
"""What the loop corrects from: a force sensor, or a force sensor and a tracker at once."""


@dataclass(frozen=True)
class Effort:
    """How much a scenario may take.

    Attributes:
        quick: A small sample instead of one that is large enough for rare events.
        seed: Of everything that is random.
        sensors: One of :data:`SENSORS`.
    """

    quick: bool = False
    seed: int = 0
    sensors: str = "force"

    def pick(self, whole: int, quick: int) -> int:
        """One of two numbers of repetitions."""
        return quick if self.quick else whole


@dataclass(frozen=True)
class Outcome:
    """What came of it.

    Attributes:
        passed: The requirement holds.
        happened: In words: states, causes.
        step_m: Largest change of the correction in force at the robot within one cycle; None: none was looked at.
        safe_s: From the fault until the correction stood still or the robot had stopped; None: nothing had to stop.
        figures: Further numbers by name; a name ends with its unit.
    """

    passed: bool
    happened: str
    step_m: float | None = None
    safe_s: float | None = None
    figures: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Scenario:
    """One fault to inject.

    Attributes:
        requirement: Number of the requirement: ``R3``.
        name: Short, unique.
        injected: What is done, in words.
        required: What must hold, in words with numbers.
        run: Does it.
        realtime: It takes real time and shows this machine, too.
        sensors: Those of :data:`SENSORS` with which it can be run.
    """

    requirement: str
    name: str
    injected: str
    required: str
    run: Callable[[Effort], Outcome]
    realtime: bool = False
    sensors: tuple[str, ...] = SENSORS

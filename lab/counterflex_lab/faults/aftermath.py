"""Consequences of a fault: how far it was followed, whether the cut went on without correction, what was told."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.runtime.state.supervisor import Cause, State
from counterflex_lab.faults.demonstration import PERIOD_S
from counterflex_lab.faults.rig import Rig
from counterflex_lab.faults.scenario import Outcome

LARGEST_STEP_M: Final = 0.40e-3
"""Largest step that the robot may see."""
MOVING: Final = 130
"""Cycles in the cut after which the correction moves as fast as it may: the moment of most faults."""
STANDING: Final = 250
"""Cycles in the cut until the correction of a force that does not change stands still."""


def steady(time_s: float) -> Float:
    """A force (3,) N on the tool, part axes, that is there from the beginning and does not change."""
    return np.array([0.0, 300.0 * (time_s >= 0.0), 0.0])


def described(path: list[str], most: int = 6) -> str:
    """States in a row, shortened."""
    return ", ".join(path[:most]) + (f", ... ({len(path)} in all)" if len(path) > most else "")


def words(named: Cause | State) -> str:
    """A cause or a state in words."""
    return named.name.lower().replace("_", " ")


class Aftermath:
    """The loop as the controller has seen it since a moment: the present, in which something begins.

    Args:
        rig: That it begins in.

    Attributes:
        begin: Cycle in which it begins.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig, self._seen, self.begin = rig, rig.seen, rig.cycle_count

    @property
    def path(self) -> list[str]:
        """States, each with the cause by which it was reached."""
        return self._seen.path(self.begin)

    @property
    def step_m(self) -> float:
        """Largest step of the correction in force."""
        return float(self._seen.steps()[self.begin - 1 :].max())

    @property
    def corrections_m(self) -> Float:
        """(n, 3) in force, from the cycle before it began on."""
        return np.array(self._seen.correction_m[self.begin - 1 :])

    @property
    def largest_m(self) -> float:
        """Largest correction in force."""
        return float(np.linalg.norm(self.corrections_m, axis=1).max())

    @property
    def followed_m(self) -> float:
        """Largest change of the correction in force, from where it stood, while the robot went on."""
        corrections = self.corrections_m
        moved = np.linalg.norm(corrections[1:] - corrections[0], axis=1)
        return float(moved[self._went].max(initial=0.0))

    @property
    def without(self) -> int:
        """Cycles in which the robot went on without its correction, because it was or is being ramped out."""
        # The robot goes by what it was told at the end of the cycle before.
        received = np.array(self._seen.state[self.begin - 1 : -1])
        return int((self._went & np.isin(received, (State.IDLE, State.READY, State.ARMED, State.RAMP_OUT))).sum())

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Named, in order."""
        return tuple(dict.fromkeys(cause for cause in self._seen.reported[self.begin :] if cause))

    @property
    def hold_s(self) -> float | None:
        """Until the loop held or ended; None: it went on."""
        ended = next((k + 1 for k, state in enumerate(self._seen.state[self.begin :]) if state != State.ACTIVE), None)
        return None if ended is None else ended * PERIOD_S

    @property
    def stopped_s(self) -> float | None:
        """Until the controller had stopped; None: it did not."""
        return self._seen.stopped_s(self.begin)

    @property
    def standing(self) -> int:
        """Cycles until following the target ended for good; a ramp to zero is the slow reaction that follows a hold."""
        return max(
            (k + 1 for k, state in enumerate(self._seen.state[self.begin :]) if state == State.ACTIVE), default=0
        )

    @property
    def again(self) -> int:
        """Number of times that the loop became active once more."""
        return sum(part == "active" for part in self.path) - 1

    @property
    def _went(self) -> Any:
        return np.diff(np.array(self._seen.run_cycles[self.begin - 1 :])) > 0

    def first(self, state: State) -> int | None:
        """Cycles to the end of the one in which a state was first there; None: never."""
        return next((k + 1 for k, reached in enumerate(self._seen.state[self.begin :]) if reached == state), None)

    def first_s(self, state: State) -> float | None:
        """The same in seconds."""
        cycles = self.first(state)
        return None if cycles is None else cycles * PERIOD_S

    def kept(self, first: int) -> bool:
        """Return whether the correction stays what it was, and is one, from a later cycle on."""
        after = np.array(self._seen.correction_m[self.begin + first :])
        return bool(np.all(after == after[0])) and float(np.linalg.norm(after[0])) > 0.0

    def outcome(self, passed: bool, happened: str, *, safe_s: float | None = None, **figures: float) -> Outcome:
        """The outcome; no step may have been larger than the largest."""
        step_m = self.step_m
        return Outcome(passed and step_m <= LARGEST_STEP_M, happened, step_m, safe_s, figures)

    def safe(self, passed: bool, *, said: str = "", from_begin: bool = False) -> Outcome:
        """The outcome where the cut may never go on without its correction, in words.

        Args:
            passed: What else is required.
            said: Put in front.
            from_begin: The loop never was active: it is no matter that the robot goes on without a correction.
        """
        without = 0 if from_begin else self.without
        names = ", ".join(map(words, self.causes))
        happened = (
            f"{said}{described(self.path)}; said: {names or 'nothing'}; followed by {self.followed_m / MM:.3f} mm"
        )
        happened += f"; {without} cycles gone on without the correction" if without else ""
        happened += f"; robot: {self._rig.robot.stopped}" if self._rig.robot.stopped else ""
        passed = passed and self.largest_m <= 2.0 * MM * 1.001 and without == 0
        return self.outcome(passed, happened, safe_s=self.hold_s)


def settled(rig: Rig, cycles: int = MOVING) -> Aftermath:
    """Let the loop become active and correct for some cycles; what begins now is looked at."""
    rig.activate().run(cycles)
    return Aftermath(rig)

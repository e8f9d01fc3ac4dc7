"""The loop as the controller sees it, cycle by cycle."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from counterflex.core.arrays import Float
from counterflex.runtime.state.supervisor import Cause, State
from counterflex_lab.faults.demonstration import PERIOD_S


def named(state: State, cause: Cause) -> str:
    """A state and why it was reached, in words."""
    why = f" ({cause.name.lower().replace('_', ' ')})" if cause and state != State.ACTIVE else ""
    return state.name.lower().replace("_", " ") + why


@dataclass(eq=False)
class Seen:
    """The loop as the controller saw it, a row per cycle."""

    age: list[int] = field(default_factory=list)  # (n,) cycles since an answer was accepted; 0: in this cycle
    correction_m: list[Float] = field(default_factory=list)  # (n, 3) in force, RSI's axes
    state: list[State] = field(default_factory=list)  # (n,) of the loop at the end of the cycle
    cause: list[Cause] = field(default_factory=list)  # (n,) its cause
    session: list[int] = field(default_factory=list)  # (n,) number of the controller's session
    running: list[bool] = field(default_factory=list)  # (n,) the controller had not stopped
    run_cycles: list[int] = field(default_factory=list)  # (n,) cycles in which the robot had gone on
    # (n,) cause that held the loop, kept it from being armed or degraded it, at the end of the cycle
    reported: list[Cause] = field(default_factory=list)

    def steps(self) -> Float:
        """(n - 1,) m: change of the correction in force from cycle to cycle; none from one session to the next."""
        change = np.linalg.norm(np.diff(np.array(self.correction_m), axis=0), axis=1)
        out: Float = np.where(np.diff(self.session) == 0, change, 0.0)
        return out

    def stopped_s(self, first: int) -> float | None:
        """Time from the begin of a cycle until the controller had stopped; None: it did not."""
        running = self.running[first:]
        return None if all(running) else (running.index(False) + 1) * PERIOD_S

    def path(self, first: int = 0) -> list[str]:
        """States from a cycle on, each once, with the cause by which it was reached."""
        out: list[str] = []
        before: tuple[State, Cause] | None = None
        for state, cause in zip(self.state[first:], self.cause[first:], strict=True):
            if before is None or state != before[0]:
                out.append(named(state, cause))
            before = (state, cause)
        return out

"""What a lie or a lapse led to: how far it was followed, whether the cut went on without it, what was told."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.runtime.state.supervisor import Cause, State
from counterflex_lab.faults.demonstration import PERIOD_S
from counterflex_lab.faults.network import LARGEST_STEP_M, described
from counterflex_lab.faults.rig import Rig
from counterflex_lab.faults.scenario import Outcome


def steady(time_s: float) -> Float:
    """A force (3,) N on the tool, part axes, that is there from the beginning and does not change."""
    return np.array([0.0, 300.0 * (time_s >= 0.0), 0.0])


@dataclass(frozen=True)
class Aftermath:
    """What came of it.

    Attributes:
        followed_m: Largest change of the correction in force, from where it stood, while the robot went on.
        without: Cycles in which the robot went on without its correction, because it was or is being ramped out.
        causes: Named, in order.
        path: States, each with the cause by which it was reached.
        step_m: Largest step of the correction in force.
        largest_m: Largest correction in force.
        hold_s: Until the loop held or ended; None: it went on.
        stopped: Why the controller has stopped, or empty.
    """

    followed_m: float
    without: int
    causes: tuple[Cause, ...]
    path: list[str]
    step_m: float
    largest_m: float
    hold_s: float | None
    stopped: str

    @property
    def safe(self) -> bool:
        """No step, no correction beyond its limit, and never the cut without its correction while the robot goes on."""
        return self.step_m <= LARGEST_STEP_M and self.largest_m <= 2.0 * MM * 1.001 and self.without == 0

    def outcome(self, passed: bool) -> Outcome:
        """The outcome, in words."""
        names = ", ".join(cause.name.lower().replace("_", " ") for cause in self.causes)
        happened = f"{described(self.path)}; said: {names or 'nothing'}; followed by {self.followed_m / MM:.3f} mm"
        if self.without:
            happened += f"; {self.without} cycles gone on without the correction"
        if self.stopped:
            happened += f"; robot: {self.stopped}"
        return Outcome(self.safe and passed, happened, self.step_m, self.hold_s)


def aftermath(rig: Rig, begin: int) -> Aftermath:
    """What came of something that began in a cycle.

    Args:
        rig: Behind it.
        begin: Cycle in which it began; the correction stood still then.
    """
    seen = rig.seen
    states = np.array(seen.state[begin:])
    went = np.diff(np.array(seen.run_cycles[begin - 1 :])) > 0
    corrections = np.array(seen.correction_m[begin - 1 :])
    moved = np.linalg.norm(corrections[1:] - corrections[0], axis=1)
    received_state = np.array(
        seen.state[begin - 1 : -1]
    )  # the robot goes by what it was told at the end of the cycle before
    without = went & np.isin(received_state, (State.IDLE, State.READY, State.ARMED, State.RAMP_OUT))
    causes = [cause for cause in seen.reported[begin:] if cause]
    not_active = np.flatnonzero(states != State.ACTIVE)
    return Aftermath(
        float(moved[went].max(initial=0.0)),
        int(without.sum()),
        tuple(dict.fromkeys(causes)),
        seen.path(begin),
        float(seen.steps()[begin - 1 :].max()),
        float(np.linalg.norm(corrections, axis=1).max()),
        None if len(not_active) == 0 else (int(not_active[0]) + 1) * PERIOD_S,
        rig.robot.stopped,
    )

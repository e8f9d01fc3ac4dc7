"""Inputs of a cycle of the online loop: telegram, sensors, operator."""

from __future__ import annotations

from dataclasses import dataclass

from counterflex.core.arrays import Float
from counterflex.runtime.estimator.fusion import Source
from counterflex.runtime.state.supervisor import Cause


@dataclass(frozen=True, kw_only=True, eq=False)
class CycleInputs:
    """Inputs of one cycle; for tests, replays and experiments."""

    T_part_tcp: Float  # (4, 4) commanded pose without correction
    q: Float  # (6,) rad
    w_tcp_part: Float | None = None  # (6,) wrench of the process about the TCP, part axes; None leaves the last one
    T_part_actual: Float | None = None  # (4, 4) measured pose; None where there is none in this cycle
    # (4, 4) pose that the controller itself reports, correction included; None: it does not
    T_part_reported: Float | None = None
    elapsed: int = 1  # cycles since the last telegram; 0 where none came
    force_age: int = 0  # cycles since the last good force
    tracker_age: int = 0  # cycles since the last good tracker sample
    healthy: bool = True  # telegrams, sensors and self-tests are good
    arm: bool = False  # the operator arms
    enable: bool = False  # the robot program wants the correction
    stop: bool = False
    reset: bool = False  # the operator resets a fault
    soft: Cause = Cause.NONE  # cause of a hold found elsewhere
    hard: Cause = Cause.NONE  # cause of a fault found elsewhere
    sources: Source = Source.FORCE | Source.TRACKER  # what the cell has beside the plan, for the estimator
    # time from the measurement of ``T_part_actual`` to now; None is the identified one
    tracker_late_s: float | None = None
    tracker_sigma_m: float = 0.0  # standard deviation that the tracker states; 0 where it does not
    # (6,) N m, torque of the process about the axes from motor currents; None where there are none
    torque: Float | None = None

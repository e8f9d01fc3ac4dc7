"""Inputs of a cycle of the online loop: telegram, sensors, operator."""

from __future__ import annotations

from dataclasses import dataclass

from counterflex.core.arrays import Float
from counterflex.runtime.estimator.fusion import Source
from counterflex.runtime.state.supervisor import Cause


@dataclass(frozen=True, kw_only=True, eq=False)
class CycleInputs:
    """Inputs of one cycle; for tests, replays and experiments.

    Attributes:
        T_part_tcp: (4, 4) commanded pose without correction.
        q: (6,) rad.
        w_tcp_part: (6,) wrench of the process about the TCP, part axes; None leaves the last one.
        T_part_actual: (4, 4) measured pose; None where there is none in this cycle.
        T_part_reported: (4, 4) pose that the controller itself reports, correction included; None: it does not.
        elapsed: Cycles since the last telegram; 0 where none came.
        force_age: Cycles since the last good force.
        tracker_age: Cycles since the last good tracker sample.
        healthy: Telegrams, sensors and self-tests are good.
        arm: The operator arms.
        enable: The robot program wants the correction.
        stop: Stop.
        reset: The operator resets a fault.
        soft: Cause of a hold found elsewhere.
        hard: Cause of a fault found elsewhere.
        sources: What the cell has beside the plan, for the estimator.
        tracker_late_s: Time from the measurement of ``T_part_actual`` to now; None is the identified one.
        tracker_sigma_m: Standard deviation that the tracker states; 0 where it does not.
        torque: (6,) N m, torque of the process about the axes from motor currents; None where there are none.
    """

    T_part_tcp: Float
    q: Float
    w_tcp_part: Float | None = None
    T_part_actual: Float | None = None
    T_part_reported: Float | None = None
    elapsed: int = 1
    force_age: int = 0
    tracker_age: int = 0
    healthy: bool = True
    arm: bool = False
    enable: bool = False
    stop: bool = False
    reset: bool = False
    soft: Cause = Cause.NONE
    hard: Cause = Cause.NONE
    sources: Source = Source.FORCE | Source.TRACKER
    tracker_late_s: float | None = None
    tracker_sigma_m: float = 0.0
    torque: Float | None = None

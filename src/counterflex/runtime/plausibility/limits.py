"""Limits of the tests during operation, checked and packed for :mod:`counterflex.runtime.plausibility.kernel`."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from counterflex.core.arrays import Float, Int, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, MS
from counterflex.runtime.plausibility import kernel as pk

_SIGN_LEAST = 15
"""Samples that must at least mirror the correction."""


@dataclass(frozen=True)
class Plausibility:
    """When something is not believed any more.

    Attributes:
        least_m: Correction or deviation below which nothing is judged.
        answer_share: Share of the correction by which the robot's reported answer may differ from it.
        answer_late_s: How much later than thought the robot may answer a correction.
        follow_late_s: How much later than thought it may follow its path, where that turns.
        answer_s: How long a wrong answer lasts before it is a fault.
        growth: Residual by what it was before the correction acted.
        against: Share of the correction's change by which the residual may grow against it where no force is known.
        residual_s: How long that lasts before it is a fault.
        mirrored: Share of the correction's change by which that of the residual may differ from its mirror image for
            the sign to be judged wrong.
        frame_m: Largest difference of measured and commanded position before arming.
        frame_rad: Likewise of orientation.
        return_m: Largest difference from the prediction when a tracker is back.
        return_s: How long it must hold.
        rejected_share: Share of a tracker's samples that may be rejected before it is not relied on.
        rejected_s: Over which time, about, with a sample in every cycle.
        silent_s: How long it may show nothing that is believed.
        angle_rad: Largest angle between measured and predicted force.
        force_n: Force below which a direction is not judged.
        direction_s: How long a wrong direction lasts before it is a fault.
        step_n: Largest step of the measured less the planned force where plan and speed stay.
        step_plan: Share of a change of the planned force that swings on.
        step_few_s: Over which samples a step is looked for.
        step_long_s: How far apart the means are in which a slower one is looked for.
        step_back_s: How long it must be gone.
        idle_n: Largest force where the plan cuts air.
        idle_nm: Largest moment there.
        idle_s: How long it lasts before the loop holds.
    """

    least_m: float = 0.1 * MM
    answer_share: float = 0.5
    answer_late_s: float = 60.0 * MS
    follow_late_s: float = 150.0 * MS
    answer_s: float = 100.0 * MS
    growth: float = 1.5
    against: float = 0.5
    residual_s: float = 250.0 * MS
    mirrored: float = 0.2
    frame_m: float = 2.0 * MM
    frame_rad: float = 0.2 * DEG
    return_m: float = 0.2 * MM
    return_s: float = 12.0 * MS
    rejected_share: float = 0.3
    rejected_s: float = 240.0 * MS
    silent_s: float = 100.0 * MS
    angle_rad: float = 60.0 * DEG
    force_n: float = 50.0
    direction_s: float = 250.0 * MS
    step_n: float = 40.0
    step_plan: float = 0.4
    step_few_s: float = 12.0 * MS
    step_long_s: float = 600.0 * MS
    step_back_s: float = 100.0 * MS
    idle_n: float = 15.0
    idle_nm: float = 5.0
    idle_s: float = 500.0 * MS

    def __post_init__(self) -> None:
        """Check ranges: zero never means unlimited.

        Raises:
            InputError: A limit that is not above zero, a growth below 1, an angle beyond 180 deg.
        """
        for item in fields(self):
            as_positive(f"plausibility: {item.name}", getattr(self, item.name))
        if self.growth < 1.0:
            raise InputError("plausibility: growth is below 1", value=self.growth, limit=">= 1")
        if self.angle_rad >= math.pi:
            raise InputError(
                "plausibility: angle_rad lets every direction pass", value=self.angle_rad / DEG, limit="< 180 deg"
            )

    def packed(
        self, period_s: float, gain: float = 0.0, mode_hz: float = 8.0, mode_damping: float = 0.1
    ) -> tuple[Float, Int]:
        """(LIMITS,) and (TIMES,) for the kernels, with times in cycles of ``period_s``, at least one each.

        Args:
            period_s: Cycle.
            gain: Of the tracker's integrator, per cycle; 0: none, the mirror image is not judged.
            mode_hz: Lowest mode of the arm, about which it swings when a load comes or goes.
            mode_damping: Its damping ratio.
        """
        limits = np.zeros(pk.LIMITS)
        for place, value in (
            (pk.L_LEAST, self.least_m),
            (pk.L_ANSWER, self.answer_share),
            (pk.L_ANSWER_LATE, self.answer_late_s),
            (pk.L_FOLLOW_LATE, self.follow_late_s),
            (pk.L_GROWTH, self.growth),
            (pk.L_AGAINST, self.against),
            (pk.L_FRAME_M, self.frame_m),
            (pk.L_FRAME_RAD, self.frame_rad),
            (pk.L_RETURN_M, self.return_m),
            (pk.L_COSINE, math.cos(self.angle_rad)),
            (pk.L_FORCE_N, self.force_n),
            (pk.L_IDLE_N, self.idle_n),
            (pk.L_IDLE_NM, self.idle_nm),
            (pk.L_PERIOD, period_s),
            (pk.L_MIRRORED, self.mirrored),
            (pk.L_SHARE, self.rejected_share),
            (pk.L_STEP_N, self.step_n),
            (pk.L_STEP_PLAN, self.step_plan),
            (pk.L_STEP_FADE, math.exp(-mode_damping * 2.0 * math.pi * mode_hz * period_s)),
            (pk.L_STEP_MEMORY, math.exp(-0.5 * mode_hz * period_s)),
        ):
            limits[place] = value
        times = np.zeros(pk.TIMES, dtype=np.int64)
        for place, seconds in (
            (pk.T_ANSWER, self.answer_s),
            (pk.T_RESIDUAL, self.residual_s),
            (pk.T_GAP, 2.0 * period_s),
            (pk.T_RETURN, self.return_s),
            (pk.T_DIRECTION, self.direction_s),
            (pk.T_IDLE, self.idle_s),
            (pk.T_SHARE, self.rejected_s),
            (pk.T_SILENT, self.silent_s),
            (pk.T_STEP_FEW, max(self.step_few_s, 2.0 * period_s)),
            (pk.T_STEP_PERIOD, min(1.0 / mode_hz, pk.STEP_MOST // 3 * period_s)),
            (pk.T_STEP_LONG, min(self.step_long_s, pk.STEP_MOST // 2 * period_s)),
            (pk.T_STEP_BACK, self.step_back_s),
            (pk.T_WINDOW, min(100.0 * MS, pk.WINDOW_MOST * period_s)),
        ):
            times[place] = max(1, round(seconds / period_s))
        times[pk.T_SIGN] = max(_SIGN_LEAST, math.ceil(2.0 * self.mirrored / gain)) if gain > 0.0 else 0
        return limits, times

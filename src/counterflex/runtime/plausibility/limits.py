"""Limits of the tests during operation, checked and packed for :mod:`counterflex.runtime.plausibility.kernel`."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from counterflex.core.arrays import as_positive
from counterflex.core.errors import InputError
from counterflex.core.records import Record
from counterflex.core.units import DEG, MM, MS
from counterflex.runtime.state.doubts import STEP_MOST, WINDOW_MOST


@dataclass(frozen=True)
class AxisTolerance:
    """Largest disagreement of axis angles and pose of a telegram."""

    # between the pose of the telegram and that of the angles, offset of the frames taken off: geometry of the
    # controller against that of the description
    position_m: float = 2.0 * MM
    rotation_rad: float = 0.2 * DEG  # likewise, orientation
    offset_m: float = 20.0 * MM  # largest offset of the frames
    offset_rad: float = 3.0 * DEG  # likewise

    def __post_init__(self) -> None:
        """Check that they are lengths and angles above zero. Raises InputError: one is not."""
        for name in ("position_m", "rotation_rad", "offset_m", "offset_rad"):
            as_positive(f"axis check: {name}", getattr(self, name))


_SIGN_LEAST = 15
"""Samples that must at least mirror the correction."""


@dataclass(frozen=True)
class Plausibility:
    """Limits of the plausibility tests."""

    least_m: float = 0.1 * MM  # correction or deviation below which nothing is judged
    answer_share: float = 0.5  # share of the correction by which the robot's reported answer may differ from it
    answer_late_s: float = 60.0 * MS  # how much later than thought the robot may answer a correction
    follow_late_s: float = 150.0 * MS  # how much later than thought it may follow its path, where that turns
    answer_s: float = 100.0 * MS  # how long a wrong answer lasts before it is a fault
    # part of the correction against which the robot's answer falls short that is a fault after ``early_s``
    early_m: float = 0.12 * MM
    # likewise, share of the correction. A robot that answers 2.5 times as slowly as thought shows more than 0.15 of it
    # where the loop expects the first 0.12 mm, one that does nothing, or something else, less
    early_share: float = 0.85
    early_late_s: float = 8.0 * MS  # how much later than thought it may answer there
    early_s: float = 12.0 * MS  # how long that lasts
    # share of a change of the deflection by which the drives may yield until their controllers have taken the load up;
    # 0.17 in simulated cells whose load goes within a cycle
    load_share: float = 0.3
    # over which drives and arm settle: a mean of what is missing of the correction, and how long the answer is not
    # judged behind a stop of the programmed point
    settle_s: float = 250.0 * MS
    missing_m: float = 0.3 * MM  # largest lasting part of the correction that may be missing at the robot
    plan_m: float = 1.0 * MM  # largest lasting distance of the program from the plan in the cut; half of it is told
    plan_feed: float = 0.3  # largest share by which the speed may lastingly differ from the planned one
    plan_force: float = 0.5  # likewise, the measured from the predicted force
    growth: float = 1.5  # residual by what it was before the correction acted
    # share of the correction's change by which the residual may grow against it where no force is known
    against: float = 0.5
    residual_s: float = 250.0 * MS  # how long that lasts before it is a fault
    # share of the correction's change by which that of the residual may differ from its mirror image for the sign to be
    # judged wrong
    mirrored: float = 0.2
    frame_m: float = 2.0 * MM  # largest difference of measured and commanded position before arming
    frame_rad: float = 0.2 * DEG  # likewise of orientation
    return_m: float = 0.2 * MM  # largest difference from the prediction when a tracker is back
    return_s: float = 12.0 * MS  # how long it must hold
    rejected_share: float = 0.3  # share of a tracker's samples that may be rejected before it is not relied on
    rejected_s: float = 240.0 * MS  # over which time, about, with a sample in every cycle
    silent_s: float = 100.0 * MS  # how long it may show nothing that is believed
    angle_rad: float = 60.0 * DEG  # largest angle between measured and predicted force
    force_n: float = 50.0  # force below which a direction is not judged
    direction_s: float = 250.0 * MS  # how long a wrong direction lasts before it is a fault
    step_n: float = 40.0  # largest step of the measured less the planned force where plan and speed stay
    step_plan: float = 0.4  # share of a change of the planned force that swings on
    step_few_s: float = 12.0 * MS  # over which samples a step is looked for
    step_long_s: float = 600.0 * MS  # how far apart the means are in which a slower one is looked for
    step_back_s: float = 100.0 * MS  # how long it must be gone
    idle_n: float = 15.0  # largest force where the plan cuts air
    idle_nm: float = 5.0  # largest moment there
    idle_s: float = 500.0 * MS  # how long it lasts before the loop holds

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

    def pack(self, out: Record, period_s: float, mode: tuple[float, float] | None, gain: float = 0.0) -> None:
        """Write limits, and times in cycles of ``period_s``, at least one each.

        Args:
            out: :data:`counterflex.runtime.state.doubts.LIMITS`; written.
            mode: Lowest mode of the arm, Hz, and its damping ratio, about which it swings when a load comes or goes;
                None: of a robot that does not swing.
            gain: Of the tracker's integrator, per cycle; 0: none, the mirror image is not judged.
        """
        out.least_m, out.answer_share = self.least_m, self.answer_share
        out.follow_late_s, out.early_m, out.early_share = self.follow_late_s, self.early_m, self.early_share
        out.load_share, out.missing_m = self.load_share, self.missing_m
        out.plan_m, out.plan_feed, out.plan_force = self.plan_m, self.plan_feed, self.plan_force
        out.settle_gain = 1.0 - math.exp(-period_s / self.settle_s)
        out.growth, out.against, out.mirrored = self.growth, self.against, self.mirrored
        out.frame_m, out.frame_rad, out.return_m = self.frame_m, self.frame_rad, self.return_m
        out.cosine, out.force_n = math.cos(self.angle_rad), self.force_n
        out.idle_n, out.idle_nm = self.idle_n, self.idle_nm
        out.period, out.rejected_share = period_s, self.rejected_share
        out.step_n, out.step_plan = self.step_n, self.step_plan
        mode_s, turn = (0.0, math.inf) if mode is None else (1.0 / mode[0], 2.0 * math.pi * mode[0] * period_s)
        out.step_fade = math.exp(-turn * (1.0 if mode is None else mode[1]))
        out.step_memory = math.exp(-turn / (4.0 * math.pi))
        for name, seconds in (
            ("answer_cycles", self.answer_s),
            ("answer_late", self.answer_late_s),
            ("early_cycles", self.early_s),
            ("early_late", self.early_late_s),
            ("settle_cycles", 2.0 * self.settle_s),
            ("residual_cycles", self.residual_s),
            ("gap_cycles", 2.0 * period_s),
            ("return_samples", self.return_s),
            ("direction_cycles", self.direction_s),
            ("idle_cycles", self.idle_s),
            ("share_samples", self.rejected_s),
            ("silent_cycles", self.silent_s),
            ("step_few", max(self.step_few_s, 2.0 * period_s)),
            ("step_period", min(mode_s, STEP_MOST // 3 * period_s)),
            ("step_long", min(self.step_long_s, STEP_MOST // 2 * period_s)),
            ("step_back", self.step_back_s),
            ("window", min(100.0 * MS, WINDOW_MOST * period_s)),
        ):
            out[name] = max(1, round(seconds / period_s))
        out.sign_samples = max(_SIGN_LEAST, math.ceil(2.0 * self.mirrored / gain)) if gain > 0.0 else 0

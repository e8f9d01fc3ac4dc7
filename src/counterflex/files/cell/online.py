"""Table ``[online]`` of a cell file: how the online loop corrects, in shop units."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from pydantic import Field, field_validator

from counterflex.core.units import DEG, MM, MS, PERCENT, UM, URAD
from counterflex.files.schema import Table
from counterflex.runtime.axis_gains import AXES, AxisGains
from counterflex.runtime.design.tracker_plant import TrackerPlant
from counterflex.runtime.estimator.fusion import FusionTuning
from counterflex.runtime.plausibility.limits import AxisTolerance, Plausibility
from counterflex.runtime.settings import (
    Delays,
    ForceMode,
    ForceOffset,
    Lost,
    OnlineSettings,
    Output,
    Pilot,
    TrackerMode,
    TrackerTuning,
    per_direction,
)
from counterflex.runtime.state.supervisor import SupervisorSettings
from counterflex.signals.filters import Smoothing
from counterflex.signals.limiter import MotionLimit

if TYPE_CHECKING:
    from counterflex.runtime.sensing.pair_wrench import PairTuning


Times = tuple[Annotated[float, Field(ge=-1e4, le=1e4)], ...]
"""ms: one number, or one for each axis."""
Late = Annotated[float, Field(ge=0.0, le=1e4)]


class ChannelTimingTable(Table):
    """Dead time and lag of one channel against another, and its clock.

    A channel shows at the stamp t what was ``dead_time_ms`` before, behind a lag. Where another clock stamped it, the
    difference of the clocks and the dead time cannot be told apart; their sum is ``clock_offset_ms``.
    """

    against: str = ""
    dead_time_ms: Times = ()
    dead_time_sigma_ms: Times = ()
    lag_ms: Late = 0.0
    lag_sigma_ms: Late = 0.0
    lag_damping: Annotated[float, Field(ge=0.0, le=100.0)] = 0.0
    clock_offset_ms: float | None = None
    clock_offset_sigma_ms: Late = 0.0
    clock_drift_ppm: float = 0.0
    clock_drift_sigma_ppm: Late = 0.0
    bandwidth_hz: Late = 0.0
    source: str = ""


class TimingTable(Table):
    """Timing of all channels of a cell."""

    link_encoder: ChannelTimingTable = ChannelTimingTable()
    drive: ChannelTimingTable = ChannelTimingTable()
    feedback: ChannelTimingTable = ChannelTimingTable()
    tracker: ChannelTimingTable = ChannelTimingTable()
    force: ChannelTimingTable = ChannelTimingTable()
    correction: ChannelTimingTable = ChannelTimingTable()


Force: TypeAlias = Annotated[float, Field(gt=0.0, le=1e5)]
Age: TypeAlias = Annotated[float, Field(ge=0.0, le=1000.0)]


class PairTable(Table):
    """Settings of the filter of two sensors beside their own tables."""

    sensor_noise_n: Force = 3.0
    sensor_zero_n: Force = 1.0
    sensor_walk_n: Force = 0.1
    sensor_late_ms: Age = 0.0
    holder_late_ms: Age = 0.0
    slew_n: Force = 1000.0
    gate: Annotated[float, Field(ge=2.0, le=20.0)] = 5.0
    differ_n: Force = 30.0
    differ_ms: Annotated[float, Field(gt=0.0, le=10_000.0)] = 100.0

    def tuning(self, holder_walk_n: tuple[float, float, float]) -> PairTuning:
        """In SI.

        Args:
            holder_walk_n: (3,) N over one second, holder axes, of what the zeros of the bridges look like.
        """
        from counterflex.runtime.sensing.pair_wrench import PairTuning  # with the compiler

        return PairTuning(
            noise_n=self.sensor_noise_n,
            zero_n=self.sensor_zero_n,
            walk_n=self.sensor_walk_n,
            holder_walk_n=holder_walk_n,
            slew_n=self.slew_n,
            late_s=(self.sensor_late_ms * MS, self.holder_late_ms * MS),
            gate=self.gate,
            differ_n=self.differ_n,
            differ_s=self.differ_ms * MS,
        )


Gain: TypeAlias = Annotated[float, Field(ge=0.0, le=20.0)]
Rate: TypeAlias = Annotated[float, Field(ge=0.0, le=200.0)]
Time: TypeAlias = Annotated[float, Field(ge=0.0, le=1000.0)]
Angle: TypeAlias = Annotated[float, Field(gt=0.0, le=2e4)]


class AxisPidTable(Table):
    """One number for each axis."""

    proportional: tuple[Gain, Gain, Gain, Gain, Gain, Gain] = (0.0,) * 6
    integral_per_s: tuple[Rate, Rate, Rate, Rate, Rate, Rate] = (0.0,) * 6
    derivative_ms: tuple[Time, Time, Time, Time, Time, Time] = (0.0,) * 6
    filter_ms: tuple[Time, Time, Time, Time, Time, Time] = (0.0,) * 6
    most_urad: tuple[Angle, Angle, Angle, Angle, Angle, Angle] = (1000.0,) * 6

    @property
    def gains(self) -> tuple[AxisGains, ...]:
        """In SI, one per axis."""
        return tuple(
            AxisGains(
                self.proportional[k],
                self.integral_per_s[k],
                self.derivative_ms[k] * MS,
                self.filter_ms[k] * MS,
                self.most_urad[k] * URAD,
            )
            for k in range(AXES)
        )


Above = Annotated[float, Field(gt=0.0, le=1e6)]
Signed = Annotated[float, Field(ge=-1e5, le=1e5)]
Level = Annotated[float, Field(ge=0.0, le=1e6)]
Proportional = Annotated[float, Field(ge=0.0, le=2.0)]
Integral = Annotated[float, Field(ge=0.0, le=10.0)]
Derivative = Annotated[float, Field(ge=0.0, le=1000.0)]
Percent = Annotated[float, Field(gt=0.0, le=100.0)]


class OnlineTable(Table):
    """Signals that correct, their filters and limits."""

    protocol: str | None = None
    link: dict[str, bool | int | float | str] = Field(default_factory=dict)
    force: Literal["none", "measured", "pilot", "scale", "fused"] = "pilot"
    force_from: Literal["sensor", "holder", "both"] = "sensor"
    pair: PairTable = PairTable()
    tracker: Literal["none", "integrator", "observer", "designed"] = "none"
    tracker_lost: Literal["hold", "fallback"] = "hold"
    force_offset: Literal["hold", "plan", "tell"] = "hold"
    output: Literal["cartesian", "axes"] = "cartesian"
    mode: Literal["absolute", "relative"] = "absolute"
    axis_play: bool = False
    axis_pid: AxisPidTable | None = None
    own_play_urad: tuple[Level, Level, Level, Level, Level, Level] = (0.0,) * 6
    period_ms: Literal[4, 12, 24, 48, 72, 96] = 4
    spin_us: Annotated[float, Field(ge=0.0, le=500.0)] = 0.0
    along_feed: bool = False
    orientation: bool = False
    proportional: Proportional | tuple[Proportional, Proportional, Proportional] = 1.0
    integral_per_s: Integral | tuple[Integral, Integral, Integral] = 0.0
    derivative_ms: Derivative | tuple[Derivative, Derivative, Derivative] = 0.0
    corner_hz: Annotated[float, Field(ge=0.0, le=100.0)] = 8.0
    average: Annotated[int, Field(ge=1, le=250)] = 8
    inertia_hz: Annotated[float, Field(ge=0.0, le=100.0)] = 0.0
    threshold_n: Above = 150.0
    blend_ms: Above = 80.0
    lead_ms: Level | None = None
    dead_ms: Level = 12.0
    natural_hz: Above = 5.0
    damping: Above = 0.7
    follow_ms: Level = 0.0
    follow_lag_ms: Level = 0.0
    tracker_age_ms: Level = 4.0
    tracker_gain: Annotated[float, Field(gt=0.0, le=1.0)] = 0.01
    tracker_step_um: Above = 50.0
    phase_margin_deg: Annotated[float, Field(ge=20.0, le=80.0)] = 50.0
    gain_margin_db: Annotated[float, Field(ge=3.0, le=30.0)] = 10.0
    undo_lag: bool = True
    undo_play: bool = True
    undo_lag_mm: Above = 1.5
    drift_um: Above = 200.0
    noise_um: Above = 60.0
    force_error_percent: Percent = 25.0
    model_error_percent: Percent = 15.0
    offset_mm: Above = 0.5
    offset_drift_um: Above = 100.0
    tracker_stale_ms: Above = 500.0
    torque_per_current_nm: tuple[Signed, Signed, Signed, Signed, Signed, Signed] | None = None
    torque_noise_nm: Above | tuple[Above, Above, Above, Above, Above, Above] = (60.0, 60.0, 60.0, 20.0, 20.0, 20.0)
    correction_mm: Above = 2.0
    correction_deg: Above = 0.3
    speed_mm_s: Above = 20.0
    acceleration_mm_s2: Above = 1250.0
    hard_factor: Annotated[float, Field(ge=1.0, le=3.0)] = 1.5
    ramp_mm_s: Above = 2.0
    without_log: Literal["warn", "hold"] = "warn"
    without_panel: Literal["continue", "hold"] = "continue"
    axis_check: bool = True
    axis_mm: Annotated[float, Field(gt=0.0, le=100.0)] = 2.0
    axis_deg: Annotated[float, Field(gt=0.0, le=10.0)] = 0.2
    frame_offset_mm: Annotated[float, Field(gt=0.0, le=1000.0)] = 1.0
    frame_offset_deg: Annotated[float, Field(gt=0.0, le=45.0)] = 0.2
    missing_mm: Annotated[float, Field(gt=0.1, le=10.0)] = 0.3
    plan_mm: Annotated[float, Field(gt=0.0, le=5.0)] = 1.0
    plan_feed_percent: Annotated[float, Field(ge=5.0, le=100.0)] = 30.0
    plan_force_percent: Annotated[float, Field(ge=10.0, le=200.0)] = 50.0

    @field_validator("mode")
    @classmethod
    def _total(cls, value: str) -> str:
        if value == "relative":
            raise ValueError(
                'mode = "relative" is not spoken: the controller adds up increments and does not tell which it took, '
                'so one lost answer stays in the cut; expected "absolute", with RSI_ON(#ABSOLUTE) and HOLDON="1"'
            )
        return value

    def settings(
        self, timing: TimingTable | None, *, compensated: bool, mode: tuple[float, float] | None = None
    ) -> OnlineSettings:
        """The loop's settings; delays that were identified take the place of those of this table.

        Args:
            timing: Identified timing of the cell, or None.
            compensated: The program contains the correction of the predicted deflection.
            mode: Lowest mode of the robot, Hz, and its damping ratio, for the designed tracker controller; None is a
                robot without one.

        Raises:
            InputError: Values that contradict each other.
            ModelError: The designed tracker controller cannot keep its margins.
        """
        period = self.period_ms * MS
        delays = self._delays(timing)
        rotation = self.correction_deg * DEG
        d_feed, d_across, d_axial = per_direction("derivative_ms", self.derivative_ms)
        share = rotation / (self.correction_mm * MM)
        return OnlineSettings(
            period_s=period,
            force=ForceMode[self.force.upper()],
            tracker=TrackerMode[self.tracker.upper()],
            tracker_lost=Lost[self.tracker_lost.upper()],
            force_offset=ForceOffset[self.force_offset.upper()],
            output=Output[self.output.upper()],
            axis_play=self.axis_play,
            own_play_rad=tuple(x * URAD for x in self.own_play_urad),  # type: ignore[arg-type]
            axis_pid=None if self.axis_pid is None else self.axis_pid.gains,
            compensated=compensated,
            normal_only=not self.along_feed,
            orientation=self.orientation,
            proportional=self.proportional,
            integral_per_s=self.integral_per_s,
            derivative_s=(d_feed * MS, d_across * MS, d_axial * MS),
            smoothing=Smoothing(self.corner_hz, self.average, period),
            inertia_hz=self.inertia_hz,
            pilot=Pilot(self.threshold_n, self.blend_ms * MS, None if self.lead_ms is None else self.lead_ms * MS),
            delays=delays,
            tuning=self._tuning(delays, period, mode),
            fusion=FusionTuning(
                factor=self.force_error_percent * PERCENT,
                model=self.model_error_percent * PERCENT,
                offset_m=self.offset_mm * MM,
                offset_drift_m=self.offset_drift_um * UM,
                tracker_stale_s=self.tracker_stale_ms * MS,
                torque_nm=self._torque_nm,
                mode=mode,
            ),
            translation=MotionLimit(self.correction_mm * MM, self.speed_mm_s * MM, self.acceleration_mm_s2 * MM),
            rotation=MotionLimit(rotation, self.speed_mm_s * MM * share, self.acceleration_mm_s2 * MM * share),
            hard_factor=self.hard_factor,
            ramp_m_s=self.ramp_mm_s * MM,
            supervisor=_supervisor(self.period_ms),
            plausibility=Plausibility(
                missing_m=self.missing_mm * MM,
                plan_m=self.plan_mm * MM,
                plan_feed=self.plan_feed_percent * PERCENT,
                plan_force=self.plan_force_percent * PERCENT,
            ),
        )

    @property
    def axis_tolerance(self) -> AxisTolerance | None:
        """Return how far axis angles and pose of a telegram may disagree; None: they are not compared."""
        if not self.axis_check:
            return None
        return AxisTolerance(
            self.axis_mm * MM, self.axis_deg * DEG, self.frame_offset_mm * MM, self.frame_offset_deg * DEG
        )

    @property
    def _torque_nm(self) -> tuple[float, float, float, float, float, float]:
        torques = self.torque_noise_nm
        return torques if isinstance(torques, tuple) else (torques, torques, torques, torques, torques, torques)

    def _tuning(self, delays: Delays, period_s: float, mode: tuple[float, float] | None) -> TrackerTuning:
        gain, proportional, notch = self.tracker_gain, 0.0, (1.0, 0.0, 0.0, 0.0, 0.0)
        ahead: tuple[float, ...] = (0.0,) * 8
        if self.tracker == "designed":
            from counterflex.runtime.design.tracker import DesignGoals, design, lag_filter

            ahead = tuple(float(b) for b in lag_filter(delays, period_s, mode))
            goals = DesignGoals(self.phase_margin_deg * DEG, 10.0 ** (self.gain_margin_db / 20.0))
            result = design(tracker_plant(delays, period_s, mode), goals)
            gain, proportional, notch = result.integral, result.proportional, result.notch
        return TrackerTuning(
            gain=gain,
            saturation_m=self.tracker_step_um * UM,
            drift_m=self.drift_um * UM,
            noise_m=self.noise_um * UM,
            proportional=proportional,
            notch=notch,
            lag_filter=ahead,
            undo_lag=self.undo_lag,
            undo_play=self.undo_play,
            lag_most_m=self.undo_lag_mm * MM,
        )

    def _delays(self, timing: TimingTable | None) -> Delays:
        dead, natural, damping = self.dead_ms * MS, 2.0 * math.pi * self.natural_hz, self.damping
        follow, lag, age = self.follow_ms * MS, self.follow_lag_ms * MS, self.tracker_age_ms * MS
        if timing is not None:
            correction = timing.correction
            if correction.dead_time_ms:
                dead = max(0.0, sum(correction.dead_time_ms) / len(correction.dead_time_ms)) * MS
            if correction.lag_ms > 0.0:
                damping = correction.lag_damping or damping
                natural = 2.0 * damping / (correction.lag_ms * MS)
            if timing.tracker.dead_time_ms:
                age = max(0.0, timing.tracker.dead_time_ms[0]) * MS
            if timing.drive.lag_ms > 0.0:
                ahead = max(0.0, sum(timing.drive.dead_time_ms) / max(1, len(timing.drive.dead_time_ms))) * MS
                lag = timing.drive.lag_ms * MS
                follow = lag + ahead
        return Delays(dead, natural, damping, follow, age, min(lag, follow))


def tracker_plant(delays: Delays, period_s: float, mode: tuple[float, float] | None) -> TrackerPlant:
    """Return what the tracker sees of a correction, from identified delays.

    Args:
        mode: Lowest mode, Hz, and its damping ratio; None is a robot without one.
    """
    hz, damping = mode if mode is not None else (0.0, 0.1)
    delay = delays.dead_s + delays.tracker_s
    return TrackerPlant(period_s, delay, delays.natural_per_s, delays.damping, 2.0 * math.pi * hz, damping)


def _supervisor(period_ms: int) -> SupervisorSettings:
    """Times of the supervisor as cycles: those of 4 ms, at least one cycle each."""
    usual = SupervisorSettings()
    times = (usual.hold, usual.good, usual.rise, usual.stop, usual.calm)
    hold, good, rise, stop, calm = (max(1, round(count * 4 / period_ms)) for count in times)
    return SupervisorSettings(hold, good, rise, stop, usual.returns, calm)

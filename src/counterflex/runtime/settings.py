"""Settings of the online loop, checked, and packed for the step."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from counterflex.core.arrays import Float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, MS, UM
from counterflex.runtime.axis_gains import AxisGains, require_usable
from counterflex.runtime.estimator.fusion import FusionTuning
from counterflex.runtime.plausibility.limits import Plausibility
from counterflex.runtime.state.supervisor import SupervisorSettings
from counterflex.signals.filters import Smoothing
from counterflex.signals.limiter import MotionLimit

Gain = float | tuple[float, float, float]


class ForceMode(IntEnum):
    """Force from which the correction is computed."""

    NONE = 0
    MEASURED = 1
    PILOT = 2
    SCALE = 3
    FUSED = 4
    """One estimator for plan, force, tracker and motor currents (:mod:`.estimator.fusion_kernel`)."""


class TrackerMode(IntEnum):
    """Use of a tracker."""

    NONE = 0
    INTEGRATOR = 1
    """As published (Mandiola2023): ``c += sat(K e)``."""
    OBSERVER = 2
    """Estimates what force and plan do not explain, knowing the delay of the correction."""
    DESIGNED = 3
    """PI with a filter, gains from delay, lag and mode with stated margins; lag and play are undone ahead."""


class Lost(IntEnum):
    """Reaction to a tracker that is silent, repeats itself or is rejected while there is a force beside it."""

    FALLBACK = 0
    """Its part of the correction stands still, force and plan go on; it is said."""
    HOLD = 1


class ForceOffset(IntEnum):
    """Reaction to a step of the measured force that neither the plan nor the program's speed explains."""

    TELL = 0
    """It is said; the force is used as before."""
    PLAN = 1
    """The force is left out: the plan, or what else the estimator has, goes on. A measured force alone holds."""
    HOLD = 2
    """The feed is held; the estimator of all sources goes on without the force where it has another."""


class Output(IntEnum):
    """Form in which the correction is sent."""

    CARTESIAN = 0
    AXES = 1


@dataclass(frozen=True)
class Pilot:
    """Pilot control (Haehn2020 section 2.8)."""

    threshold_n: float = 150.0  # difference of forces above which the prediction is blended in
    blend_s: float = 80.0 * MS  # time of a whole blend
    # how much ahead of the robot the plan is read as it is; None shapes it for the delays instead
    lead_s: float | None = 40.0 * MS


@dataclass(frozen=True)
class Delays:
    """Delays, from identification."""

    dead_s: float = 12.0 * MS  # from sending a correction until the robot begins to move
    # natural frequency of the robot's answer to a correction (second order), rad/s
    natural_per_s: float = 2.0 * np.pi * 5.0
    damping: float = 0.7  # its damping ratio
    follow_s: float = 0.0  # how late the robot follows its programmed path
    tracker_s: float = 4.0 * MS  # age of a tracker sample when the loop sees it
    follow_lag_s: float = 0.0  # how much of that is a first-order lag; the rest is dead time

    @property
    def lag_gains(self) -> tuple[float, float]:
        """``f1`` (s) and ``g1 f1 - f2`` (s2) of :mod:`counterflex.runtime.design.tracker`."""
        lag, dead = self.follow_lag_s, self.follow_s - self.follow_lag_s
        second = lag * lag + lag * dead + 0.5 * dead * dead
        return self.follow_s, self.correction_s * self.follow_s - second

    @property
    def correction_s(self) -> float:
        """Delay of slow corrections: dead time plus ``2 zeta / w0``."""
        return self.dead_s + 2.0 * self.damping / self.natural_per_s


@dataclass(frozen=True)
class TrackerTuning:
    """Gains of the tracker loop."""

    gain: float = 0.01  # K of the integrator, per cycle; Ki of the designed controller
    saturation_m: float = 50.0 * UM  # largest step of the integrator, per axis and cycle
    saturation_rad: float = 0.005 * DEG  # likewise for orientation
    drift_m: float = 200.0 * UM  # standard deviation that the unexplained deviation gains per root second (observer)
    noise_m: float = 60.0 * UM  # standard deviation of a sample, timing of the robot included
    drift_rad: float = 0.02 * DEG  # as ``drift_m``, orientation
    noise_rad: float = 0.02 * DEG  # as ``noise_m``, orientation
    largest_jump_m: float = 2.0 * MM  # a sample farther than this from what is expected is not believed
    proportional: float = 0.0  # Kp of the designed controller
    notch: tuple[float, float, float, float, float] = (1.0, 0.0, 0.0, 0.0, 0.0)  # its filter, ``b0 b1 b2 a1 a2``
    lag_filter: tuple[float, ...] = (0.0,) * 8  # filter of tracker on speed and acceleration of the program
    undo_lag: bool = False  # it undoes the lag behind the program ahead of any measurement
    undo_play: bool = False  # likewise the play that the plan predicts, where the program does not contain it
    # largest translation given for the lag; a faster program is not corrected along its path
    lag_most_m: float = 1.5 * MM


@dataclass(frozen=True)
class OnlineSettings:
    """Everything the loop can be told."""

    period_s: float = 4.0 * MS  # cycle of the robot controller
    force: ForceMode = ForceMode.PILOT
    tracker: TrackerMode = TrackerMode.NONE
    # see Lost; a cell file says hold where it says nothing. A tracker alone always holds
    tracker_lost: Lost = Lost.FALLBACK
    force_offset: ForceOffset = ForceOffset.TELL  # see ForceOffset; a cell file says hold where it says nothing
    output: Output = Output.CARTESIAN
    axis_play: bool = False  # with output in axes, undo the play of the gears along program and correction together
    # (6,) half the play that the controller itself adds in the direction of the programmed motion
    own_play_rad: tuple[float, float, float, float, float, float] = (0.0,) * 6
    # with output in axes, a controller per axis on the angle in effect; None: what is wanted is sent
    axis_pid: tuple[AxisGains, ...] | None = None
    # the program already contains the correction of the predicted deflection: only the rest is sent
    compensated: bool = False
    normal_only: bool = True  # leave out the component along the feed (Haehn2020 eq. 10-11)
    orientation: bool = False  # correct the orientation too
    # gains of the deflection under force along the feed, across it and along the tool; 1 undoes it. A single number
    # holds for all three, here and in the next two
    proportional: Gain = 1.0
    integral_per_s: Gain = 0.0
    derivative_s: Gain = 0.0
    smoothing: Smoothing = field(default_factory=lambda: Smoothing(8.0, 8, 4.0 * MS))  # filters of the force
    # corner of the low-pass with which the inertia of what hangs behind the sensor is taken out of its force
    # (spindle_inertia); 0 leaves it in
    inertia_hz: float = 0.0
    pilot: Pilot = field(default_factory=Pilot)
    delays: Delays = field(default_factory=Delays)
    tuning: TrackerTuning = field(default_factory=TrackerTuning)
    fusion: FusionTuning = field(default_factory=FusionTuning)
    force_noise_n: float = 8.0  # standard deviation of a filtered force, for the scale's filter
    timing_s: float = 10.0 * MS  # uncertainty of the timing between plan and force, likewise
    # how long an error of force or timing lasts: filters, and the arm's swing, which the sensor feels. That many cycles
    # tell as much as one
    correlation_s: float = 120.0 * MS
    scale_drift: float = 0.02  # standard deviation that a factor gains per root second
    # limits of the correction
    translation: MotionLimit = field(default_factory=lambda: MotionLimit(2.0 * MM, 20.0 * MM, 1.25))
    rotation: MotionLimit = field(default_factory=lambda: MotionLimit(0.3 * DEG, 3.0 * DEG, 190.0 * DEG))  # likewise
    hard_factor: float = 1.5  # a correction wanted beyond the limit times this is a fault
    ramp_m_s: float = 2.0 * MM  # speed of ramping out
    supervisor: SupervisorSettings = field(default_factory=SupervisorSettings)
    stale_cycles: int = 3  # age of a force at which the loop holds, or goes on by the plan alone where the mode has one
    bridge_s: float = 80.0 * MS  # how long it may go on so before it holds
    lost_cycles: int = 3  # telegrams lost in a row at which it holds; ten are a fault
    # distance of the commanded point from the planned path at which the plan is not believed
    off_path_m: float = 5.0 * MM
    plausibility: Plausibility = field(default_factory=Plausibility)  # limits of the tests during operation

    @property
    def blending_s(self) -> float:
        """Mean delay of blending into the prediction: half its time with pilot control, else nothing."""
        return 0.5 * self.pilot.blend_s if self.force == ForceMode.PILOT else 0.0

    @property
    def lead_s(self) -> float:
        """Lead at which the plan is read: as set, else the delay of a correction and half the blending."""
        return self.delays.correction_s + self.blending_s if self.pilot.lead_s is None else self.pilot.lead_s

    def __post_init__(self) -> None:
        """Check that the numbers can belong together.

        Raises:
            InputError: Something is out of range or contradicts another setting.
        """
        tuning = ("gain", "saturation_m", "saturation_rad", "drift_m", "noise_m", "drift_rad", "noise_rad")
        for holder, zero, names in (
            (self, False, ("period_s", "hard_factor", "ramp_m_s", "off_path_m", "force_noise_n", "scale_drift")),
            (self, True, ("timing_s", "correlation_s", "inertia_hz", "bridge_s")),
            (self.pilot, False, ("threshold_n", "blend_s")),
            (self.delays, False, ("natural_per_s", "damping")),
            (self.delays, True, ("dead_s", "tracker_s", "follow_s", "follow_lag_s")),
            (self.tuning, False, (*tuning, "lag_most_m")),
            (self, True, ("lead_s",)),
        ):
            for name in names:
                as_positive(f"online: {name}", getattr(holder, name), zero=zero)
        for name in ("proportional", "integral_per_s", "derivative_s"):
            for gain in per_direction(name, getattr(self, name)):
                as_positive(f"online: {name}", gain, zero=True)
        as_positive("online: proportional gain of the tracker", self.tuning.proportional, zero=True)
        for wrong, what, value, limit, hint in self._contradictions():
            if wrong:
                raise InputError(what, value=value, limit=limit, hint=hint)
        if self.axis_pid is not None:
            require_usable(self.axis_pid, self.output.name, self.tracker.name, axis_play=self.axis_play)

    def _contradictions(self) -> tuple[tuple[bool, str, object, object, str | None], ...]:
        """Settings that cannot belong together: whether it is so, what is wrong, value, limit, what to do."""
        delays, speed, period = self.delays, self.translation.speed, self.smoothing.period_s
        least_cycles = min(self.stale_cycles, self.lost_cycles)
        in_axes, no_tracker = self.output == Output.AXES, self.tracker == TrackerMode.NONE
        return (
            (
                delays.follow_lag_s > delays.follow_s,
                "the lag behind the path is longer than the whole delay",
                delays.follow_lag_s,
                delays.follow_s,
                None,
            ),
            (abs(period - self.period_s) > 1e-9, "the force filter has another period", period, self.period_s, None),
            (self.hard_factor < 1.0, "hard_factor is below 1", self.hard_factor, ">= 1", None),
            (self.ramp_m_s > speed, "ramping out is faster than the limit of speed", self.ramp_m_s, speed, None),
            (least_cycles < 1, "cycles without data", least_cycles, ">= 1", None),
            (
                self.axis_play and not in_axes,
                "the play of the axes is undone in axis-specific output",
                f'output = "{self.output.name.lower()}"',
                None,
                'In Cartesian output the controller does it; set output = "axes", or leave axis_play out',
            ),
            (
                self.force == ForceMode.FUSED and not no_tracker,
                "the estimator takes the tracker itself",
                f"tracker = {self.tracker.name.lower()}",
                None,
                'With force = "fused" leave tracker = "none"; a tracker that is there is used',
            ),
            (
                self.force == ForceMode.NONE and no_tracker,
                "nothing to correct from",
                "neither force nor tracker",
                None,
                "Choose one of them",
            ),
        )


def require_for_held_part(settings: OnlineSettings) -> None:
    """Check what is chosen for a robot that holds the part against a spindle that stands.

    Axis corrections mean the same whatever the robot holds. What a controller's Cartesian correction is about, and in
    which axes, while its tool stands, no document says.

    Raises:
        InputError: A Cartesian correction, a tracker, the estimator, or inertia taken out of the force.
    """
    chosen = (
        ("output", settings.output.name, Output.AXES.name, settings.output != Output.AXES),
        ("force", settings.force.name, "MEASURED, PILOT or SCALE", settings.force in (ForceMode.FUSED, ForceMode.NONE)),
        ("tracker", settings.tracker.name, TrackerMode.NONE.name, settings.tracker != TrackerMode.NONE),
        ("inertia_hz", f"{settings.inertia_hz:g}", "0", settings.inertia_hz > 0.0),
        ("axis_pid", "a table", "none", settings.axis_pid is not None),
    )
    for key, value, limit, wrong in chosen:
        if wrong:
            raise InputError(
                'the loop cannot do this where the robot holds the part (part_on = "flange")',
                where=f"[online] {key}",
                value=value.lower(),
                limit=limit.lower(),
            )


def inertia_smoothing(settings: OnlineSettings) -> Smoothing:
    """The low-pass that the force passes while the inertia is taken out of it; with a corner of 0 it does nothing."""
    return Smoothing(settings.inertia_hz, 1, settings.period_s)


def force_delay(settings: OnlineSettings) -> float:
    """Delay of the filtered force, s."""
    return settings.smoothing.delay_s + inertia_smoothing(settings).delay_s


def per_direction(name: str, gain: Gain) -> tuple[float, float, float]:
    """Gains along the feed, across it and along the tool of one number or three. Raises InputError: neither."""
    if isinstance(gain, int | float):
        return (float(gain),) * 3
    if len(gain) != 3:
        raise InputError(f"online: {name} per direction", value=len(gain), limit="3: feed, across, along the tool")
    return gain


def robot_answer(settings: OnlineSettings) -> tuple[int, Float]:
    """Response of the robot to a correction, sampled: whole cycles of dead time and ``b0 b1 b2 a1 a2``.

    Second order, ``w0^2 / (s^2 + 2 zeta w0 s + w0^2)``, bilinear transform; the part of the dead time that is no whole
    cycle is left out.
    """
    delays, T = settings.delays, settings.period_s
    k = delays.natural_per_s * T / 2.0
    norm = 1.0 + 2.0 * delays.damping * k + k * k
    b = k * k / norm
    a1, a2 = 2.0 * (k * k - 1.0) / norm, (1.0 - 2.0 * delays.damping * k + k * k) / norm
    return round(delays.dead_s / T), np.array([b, 2.0 * b, b, a1, a2])

"""Constants, modes and limits of the online step, written into its record from settings and plan."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.records import Record
from counterflex.runtime import settings as options
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.state.chosen import SUPERVISION
from counterflex.runtime.state.memory import PAST_ROWS
from counterflex.runtime.step.axis_pid import AxisPid

SCALE_VARIANCE: Final = 0.25**2
"""Variance of a learnt factor of the force before anything is learnt."""
_WINDOW = 200
_SETTLED_S = 0.2
TORQUE_MEMORY_S: Final = 0.5
"""Over which the friction in a motor current stays the same, so that its samples are no new information."""


def pack_settings(
    out: Record,
    settings: options.OnlineSettings,
    T_base_part: Float,
    plan: LoopPlan | None,
    T_base_tcp: Float | None = None,
) -> None:
    """Write constants, modes and delays in whole cycles of the step.

    Args:
        out: :data:`counterflex.runtime.state.chosen.SETTINGS`; written.
        T_base_part: (4, 4) part frame.
        plan: Of the program, or None.
        T_base_tcp: (4, 4) tool frame of a spindle that stands, where the robot holds the part; else None.

    Raises:
        InputError: A delay is longer than the loop remembers.
    """
    _pack_constants(out, settings, plan)
    _pack_tracker(out, settings)
    _pack_modes(out, settings, plan)
    _pack_delays(out, settings, plan)
    out.R_base_part[:] = T_base_part[:3, :3].reshape(-1)
    out.holds_part = T_base_tcp is not None
    out.R_base_tcp[:] = (np.eye(4) if T_base_tcp is None else T_base_tcp)[:3, :3].reshape(-1)
    supervision = settings.supervisor.packed()
    for name, value in zip(SUPERVISION.names or (), supervision, strict=True):
        out.supervisor[name] = value


def _pack_constants(out: Record, settings: options.OnlineSettings, plan: LoopPlan | None) -> None:
    T, fused = settings.period_s, settings.force == options.ForceMode.FUSED
    out.period, out.lead = T, _lead(settings, plan)
    out.preview = settings.delays.correction_s if _shaped(settings, plan) else settings.lead_s
    out.threshold, out.blend = settings.pilot.threshold_n, T / settings.pilot.blend_s
    for k, (name, factor) in enumerate((("proportional", 1.0), ("integral_per_s", T), ("derivative_s", 1.0 / T))):
        gains = options.per_direction(name, getattr(settings, name))
        out.gains[3 * k : 3 * k + 3] = [factor * gain for gain in gains]
    out.contained = float(settings.compensated)
    out.reference_late = options.force_delay(settings) if plan is None else 0.0
    out.follow = settings.delays.follow_s if fused else 0.0
    out.fusion[:] = settings.fusion.packed(T)
    out.torque_variance[:] = np.square(settings.fusion.torque_nm) * TORQUE_MEMORY_S / T
    out.translation[:] = settings.translation.packed()
    out.rotation[:] = settings.rotation.packed()
    share = settings.ramp_m_s / settings.translation.speed
    out.ramp[:] = settings.translation.packed() * [1.0, share, 1.0]
    out.ramp_rotation[:] = settings.rotation.packed() * [1.0, share, 1.0]
    out.hard_factor, out.off_path = settings.hard_factor, settings.off_path_m
    drift = settings.scale_drift**2 * T
    alike = 1.0 if fused else math.sqrt(max(1.0, settings.correlation_s / T))  # the estimator knows of the swing
    out.scale[:] = alike * settings.force_noise_n, alike * settings.timing_s / T, drift, SCALE_VARIANCE
    out.answer[:] = options.robot_answer(settings)[1]
    out.swing[:] = settings.fusion.swing(T)
    out.inertia[:] = options.inertia_smoothing(settings).coefficients()


def _pack_tracker(out: Record, settings: options.OnlineSettings) -> None:
    T, tuning = settings.period_s, settings.tuning
    out.tracker_late = settings.delays.tracker_s
    out.gain, out.proportional = tuning.gain, tuning.proportional
    out.saturation[:] = tuning.saturation_m, tuning.saturation_rad
    out.drift[:] = tuning.drift_m**2 * T, tuning.drift_rad**2 * T
    out.noise[:] = tuning.noise_m**2, tuning.noise_rad**2
    out.largest_jump = tuning.largest_jump_m
    out.notch[:] = tuning.notch
    out.lag[:] = tuning.lag_filter
    out.lag_most = tuning.lag_most_m


def _pack_modes(out: Record, settings: options.OnlineSettings, plan: LoopPlan | None) -> None:
    out.force, out.tracker = settings.force, settings.tracker
    out.compensated, out.normal_only = settings.compensated, settings.normal_only
    out.orientation, out.has_plan = settings.orientation, plan is not None
    out.tracker_lost_holds = settings.tracker_lost == options.Lost.HOLD or settings.force == options.ForceMode.NONE
    out.force_offset = settings.force_offset
    out.reads_ahead = _shaped(settings, plan)
    designed = settings.tracker == options.TrackerMode.DESIGNED
    out.undo_lag = designed and settings.tuning.undo_lag
    out.undo_play = designed and settings.tuning.undo_play and plan is not None and not settings.compensated


def _pack_delays(out: Record, settings: options.OnlineSettings, plan: LoopPlan | None) -> None:
    T, delays = settings.period_s, settings.delays
    tracker = round(delays.tracker_s / T)
    dead, _ = options.robot_answer(settings)
    ahead = settings.lead_s if settings.force == options.ForceMode.SCALE else -options.force_delay(settings)
    if settings.force in (options.ForceMode.PILOT, options.ForceMode.SCALE) and _shaped(settings, plan):
        ahead = delays.correction_s
    out.nominal_back = round((delays.follow_s + delays.tracker_s) / T)
    out.correction_back = dead + (0 if settings.force == options.ForceMode.FUSED else tracker)
    out.deflection_back = max(0, round((ahead + delays.tracker_s) / T))
    out.reported_back = round(delays.follow_s / T)
    back = max(out.nominal_back, out.correction_back, out.deflection_back, out.reported_back)
    if back >= PAST_ROWS:
        raise InputError(
            "the delays are longer than the loop remembers", value=f"{back} cycles", limit=f"< {PAST_ROWS}"
        )
    out.stale, out.lost = settings.stale_cycles, settings.lost_cycles
    out.window = _WINDOW
    bridged = plan is not None and settings.force in (options.ForceMode.PILOT, options.ForceMode.SCALE)
    out.bridge = settings.stale_cycles + (round(settings.bridge_s / T) if bridged else 0)
    out.tracker_stale = max(1, round(settings.fusion.tracker_stale_s / T))
    out.disbelieved = settings.fusion.disbelieved


def pack_limits(out: Record, settings: options.OnlineSettings) -> None:
    """Write the limits of the plausibility tests.

    Args:
        out: :data:`counterflex.runtime.state.doubts.LIMITS`; written.
    """
    integrates = settings.tracker in (options.TrackerMode.INTEGRATOR, options.TrackerMode.DESIGNED)
    gain = settings.tuning.gain if integrates else 0.0
    fusion, period_s = settings.fusion, settings.period_s
    settings.plausibility.pack(out, period_s, fusion.mode, gain)
    out.step_torque = period_s / TORQUE_MEMORY_S
    out.tracker_late = settings.delays.tracker_s
    if settings.force == options.ForceMode.FUSED:  # which takes slow trackers, too
        out.silent_cycles = max(1, round(fusion.tracker_stale_s / period_s))
    out.settled = round((_SETTLED_S + 2.0 * settings.smoothing.delay_s) / period_s)


def _shaped(settings: options.OnlineSettings, plan: LoopPlan | None) -> bool:
    """Return whether the plan says itself what to command ahead of time."""
    return plan is not None and plan.w_ahead_part is not None and settings.pilot.lead_s is None


def _lead(settings: options.OnlineSettings, plan: LoopPlan | None) -> float:
    """Lead at which the plan is read, s; a plan that is shaped for the delays is read in place."""
    return 0.0 if _shaped(settings, plan) else settings.lead_s


def axis_pid(settings: options.OnlineSettings) -> AxisPid | None:
    """Controllers of the axes, where there are any; a plan is read ahead by the answer, a measured force is not."""
    if settings.axis_pid is None:
        return None
    expected = settings.force != options.ForceMode.MEASURED
    return AxisPid(settings.axis_pid, settings.period_s, settings.delays.dead_s, expected=expected)

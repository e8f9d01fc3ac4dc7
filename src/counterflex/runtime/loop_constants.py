"""The constants and choices of the online step, packed from settings and plan in the places of the layout."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.primitives.localize import PLAN_A, PLAN_W
from counterflex.runtime.settings import (
    ForceMode,
    Lost,
    OnlineSettings,
    TrackerMode,
    force_delay,
    inertia_smoothing,
    per_direction,
    robot_answer,
)
from counterflex.runtime.state import layout as at

SCALE_VARIANCE: Final = 0.25**2
"""Variance of a learnt factor of the force before anything is learnt."""
_WINDOW = 200
TORQUE_MEMORY_S: Final = 0.5
"""Over which the friction in a motor current stays the same, so that its samples are no new information."""


def pack_constants(settings: OnlineSettings, T_base_part: Float, plan: LoopPlan | None) -> Float:
    """Constants of the step.

    Args:
        settings: Of the loop.
        T_base_part: (4, 4) part frame.
        plan: Of the program, or None.

    Returns:
        (at.CONSTANTS,) in the places ``C_...`` of :mod:`counterflex.runtime.state.layout`, SI.
    """
    T, tuning = settings.period_s, settings.tuning
    out = np.zeros(at.CONSTANTS)

    def put(place: int, values: Sequence[float] | Float) -> None:
        out[place : place + len(values)] = values

    lead = _lead(settings, plan)
    out[at.C_SOON] = settings.delays.correction_s if _shaped(settings, plan) else settings.lead_s
    put(at.C_PERIOD, [T, lead, settings.pilot.threshold_n, T / settings.pilot.blend_s])
    fused = settings.force == ForceMode.FUSED
    for place, name, factor in (
        (at.C_KP, "proportional", 1.0),
        (at.C_KI, "integral_per_s", T),
        (at.C_KD, "derivative_s", 1.0 / T),
    ):
        put(place, [factor * gain for gain in per_direction(name, getattr(settings, name))])
    put(at.C_WITHOUT, [float(settings.compensated), force_delay(settings) if plan is None else 0.0])
    out[at.C_FOLLOW] = settings.delays.follow_s if fused else 0.0
    put(at.C_FUSION, settings.fusion.packed(T))
    out[at.C_TRACKER_LATE] = settings.delays.tracker_s
    put(at.C_TORQUE, np.square(settings.fusion.torque_nm) * TORQUE_MEMORY_S / T)
    put(at.C_TRANSLATION, settings.translation.packed())
    put(at.C_ROTATION, settings.rotation.packed())
    share = settings.ramp_m_s / settings.translation.speed
    put(at.C_RAMP, settings.translation.packed() * [1.0, share, 1.0])
    put(at.C_RAMP_ROTATION, settings.rotation.packed() * [1.0, share, 1.0])
    out[at.C_HARD] = settings.hard_factor
    drift = settings.scale_drift**2 * T
    alike = 1.0 if fused else math.sqrt(max(1.0, settings.correlation_s / T))  # the estimator knows of the swing
    put(at.C_SCALE, [alike * settings.force_noise_n, alike * settings.timing_s / T, drift, SCALE_VARIANCE])
    put(at.C_GAIN, [tuning.gain, tuning.saturation_m, tuning.saturation_rad])
    put(at.C_DRIFT, [tuning.drift_m**2 * T, tuning.drift_rad**2 * T])
    put(at.C_NOISE, [tuning.noise_m**2, tuning.noise_rad**2])
    put(at.C_JUMP, [tuning.largest_jump_m, settings.off_path_m])
    put(at.C_ANSWER, robot_answer(settings)[1])
    put(at.C_SWING, settings.fusion.swing(T))
    put(at.C_INERTIA, inertia_smoothing(settings).coefficients())
    put(at.C_R_BASE_PART, T_base_part[:3, :3].reshape(-1))
    out[at.C_PROPORTIONAL] = tuning.proportional
    put(at.C_NOTCH, tuning.notch)
    put(at.C_LAG, [*tuning.lag_filter, tuning.lag_most_m])
    return out


def pack_choices(settings: OnlineSettings, plan: LoopPlan | None) -> Int:
    """Choices of the step: modes, switches, and delays in whole cycles.

    Args:
        settings: Of the loop.
        plan: Of the program, or None.

    Returns:
        (at.CHOICES,) in the places ``W_...`` of :mod:`counterflex.runtime.state.layout`.

    Raises:
        InputError: A delay is longer than the loop remembers.
    """
    T, delays = settings.period_s, settings.delays
    tracker = round(delays.tracker_s / T)
    dead, _ = robot_answer(settings)
    ahead = settings.lead_s if settings.force == ForceMode.SCALE else -force_delay(settings)
    if settings.force in (ForceMode.PILOT, ForceMode.SCALE) and _shaped(settings, plan):
        ahead = delays.correction_s
    back = {
        at.W_NOMINAL_BACK: round((delays.follow_s + delays.tracker_s) / T),
        at.W_CORRECTION_BACK: dead + (0 if settings.force == ForceMode.FUSED else tracker),
        at.W_DEFLECTION_BACK: max(0, round((ahead + delays.tracker_s) / T)),
        at.W_REPORTED_BACK: round(delays.follow_s / T),
    }
    if max(back.values()) >= at.RING_ROWS:
        raise InputError(
            "the delays are longer than the loop remembers",
            value=f"{max(back.values())} cycles",
            limit=f"< {at.RING_ROWS}",
        )
    out = np.zeros(at.CHOICES, dtype=np.int64)
    out[at.W_FORCE], out[at.W_TRACKER] = settings.force, settings.tracker
    out[at.W_COMPENSATED], out[at.W_NORMAL] = settings.compensated, settings.normal_only
    out[at.W_ORIENTATION], out[at.W_PLAN] = settings.orientation, plan is not None
    out[at.W_TRACKER_LOST] = settings.tracker_lost == Lost.HOLD or settings.force == ForceMode.NONE
    out[at.W_FORCE_OFFSET] = settings.force_offset
    out[at.W_STALE], out[at.W_LOST] = settings.stale_cycles, settings.lost_cycles
    out[at.W_WINDOW] = _WINDOW
    bridged = plan is not None and settings.force in (ForceMode.PILOT, ForceMode.SCALE)
    out[at.W_BRIDGE] = settings.stale_cycles + (round(settings.bridge_s / T) if bridged else 0)
    out[at.W_AHEAD] = PLAN_A if _shaped(settings, plan) else PLAN_W
    out[at.W_TRACKER_STALE] = max(1, round(settings.fusion.tracker_stale_s / T))
    out[at.W_DISBELIEVED] = settings.fusion.disbelieved
    designed = settings.tracker == TrackerMode.DESIGNED
    out[at.W_LAG] = designed and settings.tuning.undo_lag
    out[at.W_PLAY] = designed and settings.tuning.undo_play and plan is not None and not settings.compensated
    for place, value in back.items():
        out[place] = value
    return out


def _shaped(settings: OnlineSettings, plan: LoopPlan | None) -> bool:
    """Whether the plan says itself what to command ahead of time."""
    return plan is not None and plan.w_ahead_part is not None and settings.pilot.lead_s is None


def _lead(settings: OnlineSettings, plan: LoopPlan | None) -> float:
    """How much ahead the plan is read, s; what says itself what to command ahead of time is read in place."""
    return 0.0 if _shaped(settings, plan) else settings.lead_s

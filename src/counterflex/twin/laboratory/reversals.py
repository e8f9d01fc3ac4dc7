"""Slow reversals of single axes at the simulated cell, seen by a tracker on the tool or by encoders on the links.

The axis runs straight pieces with rounded corners at a low speed on the moving robot: drives with their errors, play,
dry friction of motor and link, the arm's own oscillation. The tracker's readings are averaged over each interval and
late; the motor's torque is recorded with noise and an error of scale.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MS, URAD
from counterflex.twin.laboratory.instrument_clocks import InstrumentClocks
from counterflex.twin.laboratory.laboratory import Measured, Measurement, Order
from counterflex.twin.plant.plant import STEP_S, Plant

INTERVAL_S: Final = 20.0 * MS
READINGS: Final = 20
"""Readings of the tracker within an interval, 1 kHz."""
ENCODER_RAD: Final = 0.5 * URAD
LINK_RAD: Final = 1.0 * URAD
TORQUE_SHARE: Final = 0.03
"""Error of scale of the motor's torque (torque constant, temperature)."""
TORQUE_NM: Final = 3.0
TURNS: Final = (0.0, -1.0, 1.0, -1.0, 0.25, -0.25, 0.0)
"""Where the axis reverses, in amplitudes from the pose."""
_ROUND_S = 0.2
_SETTLE_S = 0.5
_SEEN = ("tracker", "link")


@Measurement
def measure(order: Order) -> Measured:
    """Run reversal motions.

    ``order``: Request: ``q1_rad`` ... ``q6_rad`` poses, ``axis`` 1..6, ``amplitude_rad``, ``speed_rad_s``, each (n,).
    Settings: ``seen_by``: ``tracker`` (default) or ``link`` (encoders behind the gears).

    Returns:
        ``time_s``, ``q_motor``, ``tau_motor`` and ``p_tracker_target`` or ``q_link``; a group for each motion.

    Raises:
        InputError: A column is missing, an axis or speed out of range, or an unknown setting.
    """
    truth, laboratory, _request, settings, progress = order
    q = order.q
    axes, speeds, sizes = order.columns("axis", "speed_rad_s", "amplitude_rad").T
    seen_by = str(settings.get("seen_by", _SEEN[0]))
    if seen_by not in _SEEN:
        raise InputError("seen_by", value=seen_by, limit=", ".join(_SEEN))
    if np.any((axes < 1) | (axes > 6) | (axes != np.round(axes))) or np.any(speeds <= 0.0) or np.any(sizes <= 0.0):
        raise InputError("axis or speed of a reversal", value=f"{axes.tolist()}, {speeds.tolist()}")
    noise = laboratory.noise(f"reversals.{seen_by}")
    scale = 1.0 + TORQUE_SHARE * laboratory.standing("reversals.torque").standard_normal(6)
    times = InstrumentClocks.of(laboratory)
    late = times.link_dead_time_s if seen_by == "link" else times.tracker.dead_time_s + times.tracker.lag_s
    plant = Plant(truth)
    parts: list[dict[str, Float]] = []
    group = []
    for k in range(len(q)):
        part = _run(plant, q[k], int(axes[k]) - 1, float(sizes[k]), float(speeds[k]), late, seen_by)
        parts.append(part)
        group.append(np.full(len(part["time_s"]), k, dtype=np.int64))
        progress((k + 1) / len(q), f"reversals, motion {k + 1} of {len(q)}")
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    joined["q_motor"] = joined["q_motor"] + ENCODER_RAD * noise.standard_normal(joined["q_motor"].shape)
    joined["tau_motor"] = joined["tau_motor"] * scale + TORQUE_NM * noise.standard_normal(joined["tau_motor"].shape)
    sigma: dict[str, float | Float] = {"q_motor": ENCODER_RAD, "tau_motor": TORQUE_NM}
    if seen_by == "link":
        joined["q_link"] = joined["q_link"] + LINK_RAD * noise.standard_normal(joined["q_link"].shape)
        sigma["q_link"] = LINK_RAD
    else:
        T = laboratory.T_base_tracker
        p = (joined.pop("p_base") - T[:3, 3]) @ T[:3, :3]
        each = laboratory.tracker_m / np.sqrt(READINGS)
        joined["p_tracker_target"] = p + each * noise.standard_normal(p.shape)
        sigma["p_tracker_target"] = each
    return Measured(joined, sigma, np.concatenate(group), {})


def _run(plant: Plant, q: Float, axis: int, size: float, speed: float, late_s: float, seen_by: str) -> dict[str, Float]:
    """One motion: means over the intervals; what sees the link shows what was ``late_s`` before."""
    corners = np.array(TURNS) * size
    at = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(corners)) / speed)])
    at[1:] += _SETTLE_S
    count = round((at[-1] + _SETTLE_S) / STEP_S)
    t = STEP_S * np.arange(count + 1)
    straight = np.interp(t, np.concatenate([[0.0, _SETTLE_S], at[1:]]), np.concatenate([corners[:1], corners]))
    width = round(_ROUND_S / STEP_S)
    window = np.hanning(width + 2)[1:-1]
    padded = np.concatenate([np.full(width // 2, straight[0]), straight, np.full(width, straight[-1])])
    moved = np.convolve(padded, window / window.sum(), mode="valid")[: count + 1]
    q_ref = np.repeat(q[None], count + 1, axis=0)
    q_ref[:, axis] += moved
    qd_ref = np.zeros((count + 1, 6))
    qd_ref[:, axis] = np.gradient(moved, STEP_S)
    plant.reset(q)
    free = np.zeros(6)
    motor, link, torque, p = (np.empty((count, k)) for k in (6, 6, 6, 3))
    for k in range(count):
        motor[k], link[k], p[k] = plant.q_motor(), plant.q_link(), plant.p_base_tcp
        plant.step(q_ref[k], qd_ref[k], free)
        torque[k] = plant.drive_torque
    plant.check()
    name, seen = ("q_link", link) if seen_by == "link" else ("p_base", p)
    shown = {"time_s": t[:count, None], "q_motor": motor, "tau_motor": torque, name: _delayed(seen, late_s)}
    return {channel: _mean(values) for channel, values in shown.items()}


def _mean(values: Float) -> Float:
    """(rows, k) means over the intervals of (n, k) steps."""
    per = round(INTERVAL_S / STEP_S)
    rows = len(values) // per
    out: Float = values[: rows * per].reshape(rows, per, -1).mean(axis=1)
    return out


def _delayed(values: Float, late_s: float) -> Float:
    """(n, k) values ``late_s`` before each step, linear between steps."""
    last = len(values) - 1
    index = np.clip(np.arange(len(values)) - late_s / STEP_S, 0, last)
    low = np.floor(index).astype(np.int64)
    weight = (index - low)[:, None]
    out: Float = values[low] * (1.0 - weight) + values[np.minimum(low + 1, last)] * weight
    return out

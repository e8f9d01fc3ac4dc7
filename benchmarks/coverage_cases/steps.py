"""Loop gains from load steps: the planner's own loop, and friction, a lagging torque and gains that change."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from counterflex.app.identification.cell_model import model_of
from counterflex.core.arrays import Float
from counterflex.core.units import MS, URAD
from counterflex.files.cell.cell import read_cell
from counterflex.identify.data.dataset import of_arrays
from counterflex.identify.servo import recipe as servo
from counterflex.identify.servo.residuals import together
from counterflex.robot.elasticity.servo import servo_error
from counterflex.robot.model.description import Servo
from coverage_cases.counted import Counted, counted

CELL = Path(__file__).resolve().parents[2] / "examples" / "cells" / "kr300_d16_flat.toml"
STEP_S = 4.0 * MS
STEPS = 8
NOMINAL = (1.5e5, 1.8e5, 1.0e5, 1.0e4, 1.1e4, 5e3)
SWING = (800.0, 800.0, 600.0, 100.0, 100.0, 60.0)
TORQUE = 0.03
"""Scale of the torque that the drives show, one standard deviation per axis."""
POSTURE = 0.03
"""By how much the gain of an axis differs from step to step (posture, friction of the motor)."""
STUCK_RAD = 1.0 * URAD
"""Angle that motor friction leaves an axis beside its command, one standard deviation per step."""


def released(t: Float, size: Float, rng: np.random.Generator) -> Float:
    """(n, 6) N m: the load goes within 4 ms and the arm rings."""
    after = np.clip(t - 0.2, 0.0, None)
    hz = rng.uniform(7.0, 10.0)
    ring = np.where(t > 0.2, np.exp(-4.0 * after) * np.cos(2.0 * np.pi * hz * after), 0.0)
    drop = 1.0 - np.clip(after / 0.004, 0.0, 1.0)
    return np.asarray(size * (drop + 0.3 * ring)[:, None])


def gains_of_steps(seed: int, *, errors: bool, known: bool = False) -> list[Counted]:
    """Load steps of six axes, identified.

    Args:
        seed: Of the truth.
        errors: With what the model lacks.
        known: Whether the cell file has gains, within a tenth of the true ones. If not, nothing says which of Kv and
            1/Ti is the larger, and as many truths have the one as the other.
    """
    rng = np.random.default_rng([51, seed])
    t = STEP_S * np.arange(300, dtype=np.float64)
    cell = model_of(read_cell(CELL))
    base = [Servo(k, 22.0, 0.07) for k in NOMINAL]
    if known:
        cell = replace(cell, robot=replace(cell.robot, servo=tuple(base)))
    spread = np.exp(np.array([0.1, 0.05, 0.05]) * rng.standard_normal((6, 3)))
    true = [
        Servo(b.speed_gain_nm_s * k, b.position_gain_per_s * v, b.integral_time_s * i)
        for b, (k, v, i) in zip(base, spread, strict=True)
    ]
    if not known:
        other = np.random.default_rng([52, seed]).random(6) < 0.5
        true = [
            replace(s, position_gain_per_s=1.0 / s.integral_time_s, integral_time_s=1.0 / s.position_gain_per_s)
            if o
            else s
            for s, o in zip(true, other, strict=True)
        ]
    scale = 1.0 + TORQUE * rng.standard_normal(6) * errors
    rows: dict[str, list[Float]] = {k: [] for k in ("time_s", "q_command", "q_motor", "tau_motor", "f_tcp_base")}
    for _ in range(STEPS):
        q = np.repeat(rng.uniform(-1.0, 1.0, 6)[None], len(t), axis=0)
        tau = 300.0 + released(t, rng.uniform(-1.0, 1.0, 6) * SWING, rng)
        now = np.exp(POSTURE * rng.standard_normal(6)) if errors else np.ones(6)
        loops = tuple(
            Servo(s.speed_gain_nm_s * f, s.position_gain_per_s, s.integral_time_s)
            for s, f in zip(true, now, strict=True)
        )
        error = servo_error(loops, q, -tau, t)
        if errors:
            stuck = STUCK_RAD * rng.standard_normal(6)
            error = error + stuck * np.clip((t - 0.2) / 0.1, 0.0, 1.0)[:, None]
        rows["time_s"].append(t)
        rows["q_command"].append(q)
        rows["q_motor"].append(q + error + 0.5 * URAD * rng.standard_normal(q.shape))
        rows["tau_motor"].append(tau * scale + 2.0 * rng.standard_normal(q.shape))
        rows["f_tcp_base"].append(np.where(t[:, None] <= 0.2, 500.0, 0.0) * np.array([0.6, 0.0, -0.8]))
    arrays = {key: np.concatenate(value) for key, value in rows.items()}
    sigma = {"q_motor": 0.5 * URAD, "tau_motor": 2.0}
    data = of_arrays("steps", "servo_steps", arrays, sigma, group=np.repeat(np.arange(STEPS), len(t)))
    found = servo.RECIPE.identify(cell, [data], [], {"as_stated": True, "torque_share": TORQUE * errors})
    out: list[Counted] = []
    for axis, s in enumerate(true):
        name = f"axis{axis + 1}"
        values = {"speed_gain": s.speed_gain_nm_s, "position_gain": s.position_gain_per_s}
        values["integral_time"] = s.integral_time_s
        truth = {f"{name}.{key}": value for key, value in values.items()}
        fit = found.fits.get(f"axis {axis + 1}")
        if fit is None:
            continue
        out += counted(fit, truth)
        both = together(fit, axis)
        rate = 1.0 / s.integral_time_s
        pair = {"sum": s.position_gain_per_s + rate, "product": s.position_gain_per_s * rate}
        for i, (key, value) in enumerate(pair.items()):
            ends = [float(v[i]) for v in (both.value, both.sigma, both.lower, both.upper)]
            out.append(Counted(f"{name}.{key}", value, *ends))
    return out

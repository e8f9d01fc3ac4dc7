"""Readings of the flange sensor in many orientations, without a process: kind ``sensor_poses``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from counterflex.core.arrays import Float
from counterflex.twin.laboratory.laboratory import Laboratory, Measured, Measurement, Order
from counterflex.twin.plant.force_sensor import ForceSensor, force_sensor
from counterflex.twin.plant.plant import Plant
from counterflex.twin.truth.truth import Truth

ROW_S = 20.0
"""From one reading to the next."""
SAMPLES = 25
"""Samples whose mean is a reading."""
START_C, WARM_C, WARM_S, WOBBLE_C = 20.5, 4.0, 2400.0, 0.4


def sensor_from(truth: Truth, laboratory: Laboratory, settings: Mapping[str, Any]) -> ForceSensor:
    """The laboratory's sensor in the body that the setting ``sensor_segment`` names."""
    return force_sensor(
        truth, laboratory.seed, settings.get("sensor_segment"), hose_share=float(settings.get("hose_share", 1.0))
    )


def air_c(time_s: Float | float, phase: float) -> Float:
    """Temperature of the sensor: warming up, with the hall's slow wobble."""
    t = np.asarray(time_s, dtype=np.float64)
    out: Float = START_C + WARM_C * (1.0 - np.exp(-t / WARM_S)) + WOBBLE_C * np.sin(t / 300.0 + phase)
    return out


@Measurement
def measure(order: Order) -> Measured:
    """Drive to each orientation, wait, and average the sensor.

    ``order``: Request: ``q1_rad`` ... ``q6_rad``. Settings: ``sensor_segment``, ``hose_share`` (1; 0 is none). Returns
    channels ``q``, ``w_sensor``, ``temperature_c``, ``time_s``.
    """
    truth, laboratory, _request, settings, progress = order
    q = order.q
    sensor = sensor_from(truth, laboratory, settings)
    plant = Plant(truth)
    noise = laboratory.noise("sensor_poses")
    phase = float(noise.uniform(0.0, 2.0 * np.pi))
    sigma = np.r_[np.full(3, laboratory.force_n), np.full(3, laboratory.moment_nm)] / np.sqrt(SAMPLES)
    time_s = ROW_S * np.arange(len(q)) + noise.uniform(0.0, 0.3 * ROW_S, len(q))
    warm = air_c(time_s, phase)
    shown, w = np.empty((len(q), 6)), np.empty((len(q), 6))
    for k in range(len(q)):
        plant.reset(q[k])
        shown[k] = plant.q_motor()
        w[k] = sensor.reading(sensor.true_wrench(plant, truth.gravity_base), float(time_s[k]), float(warm[k]))
        progress((k + 1) / len(q), f"orientation {k + 1} of {len(q)}")
    w += sigma * noise.standard_normal(w.shape)
    return Measured(
        channels={
            "q": shown,
            "w_sensor": w,
            "temperature_c": (warm + 0.05 * noise.standard_normal(len(q)))[:, None],
            "time_s": time_s[:, None],
        },
        sigma={"w_sensor": sigma, "q": 1e-5, "temperature_c": 0.05},
        group=np.arange(len(q), dtype=np.int64),
    )

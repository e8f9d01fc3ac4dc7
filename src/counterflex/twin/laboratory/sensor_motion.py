"""Readings of the flange sensor while the arm swings without a process: kind ``sensor_motion``."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG
from counterflex.twin.laboratory.laboratory import Measured, Measurement, Order
from counterflex.twin.laboratory.sensor_poses import air_c, sensor_from
from counterflex.twin.plant.plant import Plant

RATES_HZ = (0.0, 0.31, 0.43, 0.83, 0.67, 1.03)
"""Swing of each axis."""
SWING_RAD = 5.0 * DEG
RECORD_S, SAMPLE_S, RAMP_S = 6.0, 0.004, 1.0


@Measurement
def measure(order: Order) -> Measured:
    """Swing axes 2 to 6 about each requested posture, at rates of their own, and record.

    ``order``: Request: ``q1_rad`` ... ``q6_rad``, one row for each swing. Settings: As for ``sensor_poses``.

    Returns:
        Channels ``q``, ``w_sensor``, ``temperature_c``, ``time_s``, rising over all swings.
    """
    truth, laboratory, _request, settings, progress = order
    middle = order.q
    sensor = sensor_from(truth, laboratory, settings)
    plant = Plant(truth)
    noise = laboratory.noise("sensor_motion")
    every = round(SAMPLE_S / plant.step_s)
    count = round(RECORD_S / plant.step_s)
    t = plant.step_s * np.arange(count)[:, None]
    grown = 0.5 * (1.0 - np.cos(np.pi * np.minimum(t / RAMP_S, 1.0)))
    omega = 2.0 * np.pi * np.asarray(RATES_HZ)
    swing = SWING_RAD * grown * np.sin(omega * t)
    speed = np.gradient(swing, plant.step_s, axis=0)
    free = np.zeros(6)
    shown, read, times = [], [], []
    for k, q in enumerate(middle):
        plant.reset(q)
        place: Float = q + swing
        for i in range(count):
            plant.step(place[i], speed[i], free)
            if i % every == 0:
                now = RECORD_S * k + float(t[i, 0])
                warm = float(air_c(now, 0.0))
                shown.append(plant.q_motor())
                read.append(sensor.reading(sensor.true_wrench(plant, truth.gravity_base), now, warm))
                times.append(now)
        plant.check()
        progress((k + 1) / len(middle), f"swing {k + 1} of {len(middle)}")
    sigma = np.r_[np.full(3, laboratory.force_n), np.full(3, laboratory.moment_nm)]
    time_s = np.array(times)
    return Measured(
        channels={
            "q": np.array(shown),
            "w_sensor": np.array(read) + sigma * noise.standard_normal((len(time_s), 6)),
            "temperature_c": np.asarray(air_c(time_s, 0.0))[:, None],
            "time_s": time_s[:, None],
        },
        sigma={"w_sensor": sigma, "q": 1e-5, "temperature_c": 0.05},
        group=np.zeros(len(time_s), dtype=np.int64),
    )

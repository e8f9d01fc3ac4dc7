"""Loads cut off at the simulated cell: the trace of the drives and a tracker on the tool, while the arm rings down."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.errors import InputError
from counterflex.core.units import MS, URAD
from counterflex.twin.laboratory.laboratory import Measured, Measurement, Order
from counterflex.twin.plant.plant import STEP_S, Plant

CYCLE_S: Final = 4.0 * MS
BEFORE_S: Final = 0.2
AFTER_S: Final = 1.2
CUT_S: Final = 4.0 * MS
"""Time in which the cut cable loses its force."""
ENCODER_RAD: Final = 0.5 * URAD
TORQUE_SHARE: Final = 0.03
TORQUE_NM: Final = 3.0
FORCE_SHARE: Final = 0.002


@Measurement
def measure(order: Order) -> Measured:
    """Cut loads off.

    ``order``: Request: ``q1_rad`` ... ``q6_rad``, ``fx_n fy_n fz_n`` on the tool in base axes, each (n,).

    Returns:
        ``time_s``, ``q_command``, ``q_motor``, ``tau_motor``, ``f_tcp_base``, ``p_tracker_target``; a group for each
        load step. The motors' torque has an error of scale of 3 %.

    Raises:
        InputError: A column is missing.
        SimulationError: The load is beyond what the robot carries.
    """
    truth, laboratory, _request, settings, progress = order
    q, force = order.q, order.force
    if settings:
        raise InputError("load steps have no settings", value=", ".join(settings))
    noise = laboratory.noise("servo_steps")
    scale = 1.0 + TORQUE_SHARE * laboratory.standing("reversals.torque").standard_normal(6)
    plant = Plant(truth)
    per = round(CYCLE_S / STEP_S)
    before, count = round(BEFORE_S / CYCLE_S), round((BEFORE_S + AFTER_S) / CYCLE_S)
    n = len(q) * count
    motor, torque, tip, load = (np.empty((n, k)) for k in (6, 6, 3, 3))
    still = np.zeros(6)
    row = 0
    for k in range(len(q)):
        w = np.zeros(6)
        w[:3] = force[k]
        plant.reset(q[k], w)
        for cycle in range(count):
            motor[row], tip[row], torque[row] = plant.q_motor(), plant.p_base_tcp, plant.drive_torque
            load[row] = force[k] if cycle <= before else 0.0
            row += 1
            for i in range(per):
                remaining = 1.0 - np.clip(((cycle - before) * CYCLE_S + i * STEP_S) / CUT_S, 0.0, 1.0)
                plant.step(q[k], still, w * remaining)
        plant.check()
        progress((k + 1) / len(q), f"load step {k + 1} of {len(q)}")
    T = laboratory.T_base_tracker
    seen = (tip - T[:3, 3]) @ T[:3, :3] + laboratory.tracker_m * noise.standard_normal(tip.shape)
    weighed = np.repeat(1.0 + FORCE_SHARE * noise.standard_normal(len(q)), count)[:, None]
    return Measured(
        channels={
            "time_s": np.tile(CYCLE_S * np.arange(count), len(q))[:, None],
            "q_command": np.repeat(q, count, axis=0),
            "q_motor": motor + ENCODER_RAD * noise.standard_normal(motor.shape),
            "tau_motor": torque * scale + TORQUE_NM * noise.standard_normal(torque.shape),
            "f_tcp_base": load * weighed,
            "p_tracker_target": seen,
        },
        sigma={
            "q_command": 0.01 * URAD,
            "q_motor": ENCODER_RAD,
            "tau_motor": TORQUE_NM,
            "f_tcp_base": 1.0,
            "p_tracker_target": laboratory.tracker_m,
        },
        group=np.repeat(np.arange(len(q), dtype=np.int64), count),
        settings={},
    )

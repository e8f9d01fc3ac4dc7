"""Force sensor at the flange by closed formulas of whole arrays, against the kernels that read it cycle by cycle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.geometry import pose
from counterflex.sensing.flange_sensor import DOWN, FlangeSensor, orientation_basis, tensor


@dataclass(frozen=True, eq=False)
class SensorMotion:
    """Motion of the sensor frame, in its own axes; from an accelerometer or from the commanded path."""

    acceleration_m_s2: Float  # (..., 3) of the sensor's origin, without gravity
    omega_rad_s: Float  # (..., 3)
    alpha_rad_s2: Float  # (..., 3) angular acceleration


def idle_wrench(
    sensor: FlangeSensor,
    R_base_sensor: Float,
    *,
    temperature_c: Float | float | None = None,
    time_s: Float | float = 0.0,
    motion: SensorMotion | None = None,
    gravity_base: Float = DOWN,
    R_hose_sensor: Float | None = None,
) -> Float:
    """Reading of the sensor without a process.

    Force ``m (g - a) - m (alpha x c + omega x (omega x c))``, moment ``c x force - I alpha - omega x I omega``, plus
    bias, drift, temperature and the offset of the orientation.

    Args:
        R_base_sensor: (..., 3, 3), bent arm included (:mod:`counterflex.sensing.carrier`).
        temperature_c: (...) deg C; None is the reference temperature.
        time_s: (...) s since the sensor was set to zero or identified.
        motion: Motion of the sensor; None is at rest.
        gravity_base: (3,) m/s2 in base axes.
        R_hose_sensor: (..., 3, 3) of `counterflex.sensing.carrier.hose_rotation`; needed where the offset is one
            of that rotation.

    Returns:
        (..., 6) N, N m about the sensor's origin in its axes.

    Raises:
        InputError: The rotation in the body that the hose pack comes from is needed and not given.
    """
    R = np.asarray(R_base_sensor, dtype=np.float64)
    g = np.swapaxes(R, -1, -2) @ np.asarray(gravity_base, dtype=np.float64)
    c = sensor.p_sensor_com
    force = sensor.mass_kg * g
    moment_c = np.zeros(3)
    if motion is not None:
        omega, alpha = np.asarray(motion.omega_rad_s), np.asarray(motion.alpha_rad_s2)
        at_com = motion.acceleration_m_s2 + np.cross(alpha, c) + np.cross(omega, np.cross(omega, c))
        force = force - sensor.mass_kg * at_com
        inertia = tensor(sensor.inertia_kg_m2)
        moment_c = -(alpha @ inertia) - np.cross(omega, omega @ inertia)
    out = np.concatenate([force, np.cross(c, force) + moment_c], axis=-1) + sensor.w_bias
    out = out + np.asarray(time_s, dtype=np.float64)[..., None] * sensor.w_drift_per_s
    if temperature_c is not None:
        warmer = np.asarray(temperature_c, dtype=np.float64) - sensor.reference_c
        out = out + warmer[..., None] * sensor.w_kelvin
    if sensor.degree:
        out = out + orientation_basis(_rest_rotation(sensor, R, R_hose_sensor), sensor.degree) @ sensor.w_offset
    result: Float = out
    return result


def _rest_rotation(sensor: FlangeSensor, R_base_sensor: Float, R_hose_sensor: Float | None) -> Float:
    if not sensor.hose_from:
        return R_base_sensor
    if R_hose_sensor is None:
        raise InputError(
            "the offset of the sensor goes by its rotation in a body of the arm, which is not given",
            value=sensor.hose_from,
            limit="R_hose_sensor",
        )
    return np.asarray(R_hose_sensor, dtype=np.float64)


def process_wrench(
    sensor: FlangeSensor,
    w_sensor: Float,
    R_base_sensor: Float,
    *,
    temperature_c: Float | float | None = None,
    time_s: Float | float = 0.0,
    motion: SensorMotion | None = None,
    gravity_base: Float = DOWN,
    R_hose_sensor: Float | None = None,
) -> Float:
    """Wrench of the process about the sensor's origin in its axes: reading minus :func:`idle_wrench`.

    Args:
        w_sensor: (..., 6) N, N m: the reading.
        R_base_sensor: See :func:`idle_wrench`, as all that follows.
        gravity_base: (3,) m/s2.
        R_hose_sensor: Likewise.

    Returns:
        (..., 6) N, N m (Haehn2020 eq. 18, moments likewise).
    """
    idle = idle_wrench(
        sensor,
        R_base_sensor,
        temperature_c=temperature_c,
        time_s=time_s,
        motion=motion,
        gravity_base=gravity_base,
        R_hose_sensor=R_hose_sensor,
    )
    out: Float = np.asarray(w_sensor, dtype=np.float64) - idle
    return out


def tcp_wrench(
    sensor: FlangeSensor,
    w_sensor: Float,
    R_base_sensor: Float,
    T_seg_tcp: Float,
    *,
    temperature_c: Float | float | None = None,
    time_s: Float | float = 0.0,
    motion: SensorMotion | None = None,
    gravity_base: Float = DOWN,
    R_hose_sensor: Float | None = None,
) -> Float:
    """Process wrench on the tool about the TCP in base axes (Haehn2020 eq. 18-20, with moments).

    ``f_base = R_base_sensor f``, ``m_base = R_base_sensor (m - p_sensor_tcp x f)``.

    Args:
        w_sensor: (..., 6) N, N m: the reading.
        R_base_sensor: (..., 3, 3), bent arm included.
        T_seg_tcp: (4, 4) TCP in the body that carries the sensor
            (`counterflex.sensing.carrier.carrier_to_tcp`).
        temperature_c: See :func:`idle_wrench`.
        time_s: Likewise.
        R_hose_sensor: Likewise.

    Returns:
        (..., 6) N, N m ``w_tcp_base``.
    """
    w = process_wrench(
        sensor,
        w_sensor,
        R_base_sensor,
        temperature_c=temperature_c,
        time_s=time_s,
        motion=motion,
        gravity_base=gravity_base,
        R_hose_sensor=R_hose_sensor,
    )
    p_sensor_tcp = (pose.inverse(sensor.T_seg_sensor) @ np.asarray(T_seg_tcp, dtype=np.float64))[:3, 3]
    return pose.rotate_wrench(np.asarray(R_base_sensor, dtype=np.float64), pose.shift_wrench(w, -p_sensor_tcp))

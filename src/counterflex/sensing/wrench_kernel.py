"""The flange sensor's reading as process wrench at the TCP, compiled for the online loop: one sample, no allocation.

Constants are those of :meth:`counterflex.sensing.flange_sensor.FlangeSensor.record`.
"""

from __future__ import annotations

import math

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Records
from counterflex.sensing.flange_sensor import IDLE

_H = math.sqrt(0.5)
_T = 1.0 / math.sqrt(6.0)
_SYMMETRIC: Float = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, _H, 0.0, _H, 0.0],
        [0.0, 0.0, _H, 0.0, 0.0, 0.0, _H, 0.0, 0.0],
        [0.0, _H, 0.0, _H, 0.0, 0.0, 0.0, 0.0, 0.0],
        [_H, 0.0, 0.0, 0.0, -_H, 0.0, 0.0, 0.0, 0.0],
        [-_T, 0.0, 0.0, 0.0, -_T, 0.0, 0.0, 0.0, 2.0 * _T],
    ]
)


@kernel("float64(float64[::1], int64, int64)")
def _second(R: Float, a: int, b: int) -> float:
    """``<S_a, R S_b R^T>`` of the orientation functions of degree 2."""
    total = 0.0
    for i in range(3):
        for j in range(3):
            s = _SYMMETRIC[a, 3 * i + j]
            if s == 0.0:
                continue
            m = 0.0
            for k in range(3):
                for n in range(3):
                    t = _SYMMETRIC[b, 3 * k + n]
                    if t != 0.0:
                        m += R[3 * i + k] * t * R[3 * j + n]
            total += s * m
    return total


@kernel("void(Idle[::1], float64[::1], float64[::1], float64[::1], float64, float64, float64[::1])", Idle=IDLE)
def idle(
    sensors: Records, R: Float, R_rest: Float, gravity: Float, time_s: float, temperature_c: float, out: Float
) -> None:
    """Reading of the sensor at rest without a process.

    Args:
        sensors: (1,) IDLE.
        R: (9,) R_base_sensor by rows, of the bent arm.
        R_rest: (9,) rotation that the offset goes by: R_base_sensor, or R_hose_sensor where a body is named.
        gravity: (3,) m/s2, base axes.
        time_s: Since the sensor's zero.
        temperature_c: NaN is the reference temperature.
        out: (6,) N, N m about the sensor's origin in its axes; written.
    """
    s = sensors[0]
    warm = temperature_c - s.reference_c if math.isfinite(temperature_c) else 0.0
    m = s.mass
    fx = m * (R[0] * gravity[0] + R[3] * gravity[1] + R[6] * gravity[2])
    fy = m * (R[1] * gravity[0] + R[4] * gravity[1] + R[7] * gravity[2])
    fz = m * (R[2] * gravity[0] + R[5] * gravity[1] + R[8] * gravity[2])
    cx, cy, cz = s.com[0], s.com[1], s.com[2]
    out[0], out[1], out[2] = fx, fy, fz
    out[3], out[4], out[5] = cy * fz - cz * fy, cz * fx - cx * fz, cx * fy - cy * fx
    for k in range(6):
        out[k] += s.bias[k] + time_s * s.drift[k] + warm * s.kelvin[k]
    for i in range(s.functions):
        value = math.sqrt(3.0) * R_rest[i] if i < 9 else math.sqrt(5.0) * _second(R_rest, (i - 9) // 5, (i - 9) % 5)
        row = s.offset[i]
        for k in range(6):
            out[k] += value * row[k]


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1])")
def to_tcp(w_sensor: Float, w_idle: Float, R: Float, p_sensor_tcp: Float, R_base_part: Float, out: Float) -> None:
    """Reading to process wrench on the tool about the TCP in part axes (Haehn2020 eq. 18-20, with moments).

    Args:
        w_sensor: (6,) reading.
        w_idle: (6,) of :func:`idle`.
        R: (9,) R_base_sensor by rows.
        p_sensor_tcp: (3,) m, TCP in the sensor's frame.
        R_base_part: (9,) by rows.
        out: (6,) N, N m; written.
    """
    fx, fy, fz = w_sensor[0] - w_idle[0], w_sensor[1] - w_idle[1], w_sensor[2] - w_idle[2]
    px, py, pz = p_sensor_tcp[0], p_sensor_tcp[1], p_sensor_tcp[2]
    mx = w_sensor[3] - w_idle[3] - (py * fz - pz * fy)
    my = w_sensor[4] - w_idle[4] - (pz * fx - px * fz)
    mz = w_sensor[5] - w_idle[5] - (px * fy - py * fx)
    for part in range(2):
        x, y, z = (fx, fy, fz) if part == 0 else (mx, my, mz)
        bx = R[0] * x + R[1] * y + R[2] * z
        by = R[3] * x + R[4] * y + R[5] * z
        bz = R[6] * x + R[7] * y + R[8] * z
        for k in range(3):
            out[3 * part + k] = R_base_part[k] * bx + R_base_part[3 + k] * by + R_base_part[6 + k] * bz

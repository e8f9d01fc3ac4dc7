"""The compiled reading of the flange sensor against the array form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from counterflex.geometry import pose, rotation
from counterflex.sensing.flange_sensor import FlangeSensor
from counterflex.sensing.wrench_kernel import idle, to_tcp
from flange_wrench import idle_wrench, tcp_wrench

DOWN = np.array([0.0, 0.0, -9.80665])


def sensor(rng: np.random.Generator, functions: int) -> FlangeSensor:
    return FlangeSensor(
        segment="sensor",
        T_seg_sensor=pose.make(rotation.exp(rng.normal(size=3)), rng.normal(size=3)),
        mass_kg=75.0,
        p_sensor_com=rng.normal(size=3),
        w_bias=rng.normal(size=6),
        w_drift_per_s=rng.normal(size=6),
        w_kelvin=rng.normal(size=6),
        w_offset=rng.normal(size=(functions, 6)),
    )


@pytest.mark.parametrize("functions", [0, 9, 34])
@pytest.mark.parametrize("seed", [1, 2])
def test_agrees_with_the_array_form(functions: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    one = sensor(rng, functions)
    R_base_sensor = rotation.exp(rng.normal(size=3))
    w_idle, out = np.zeros(6), np.zeros(6)
    flat = np.ascontiguousarray(R_base_sensor.reshape(-1))
    idle(one.record(), flat, flat, DOWN, 100.0, 25.0, w_idle)
    expected = idle_wrench(one, R_base_sensor, temperature_c=25.0, time_s=100.0)
    np.testing.assert_allclose(w_idle, expected, rtol=1e-12, atol=1e-9)
    R_hose_sensor = rotation.exp(rng.normal(size=3))
    idle(one.record(), flat, np.ascontiguousarray(R_hose_sensor.reshape(-1)), DOWN, 100.0, 25.0, w_idle)
    one = replace(one, hose_from="axis4")
    expected = idle_wrench(one, R_base_sensor, temperature_c=25.0, time_s=100.0, R_hose_sensor=R_hose_sensor)
    np.testing.assert_allclose(w_idle, expected, rtol=1e-12, atol=1e-9)
    T_seg_tcp = pose.make(rotation.exp(rng.normal(size=3)), rng.normal(size=3))
    R_base_part = rotation.exp(rng.normal(size=3))
    w_sensor = 100.0 * rng.normal(size=6)
    p_sensor_tcp = np.ascontiguousarray((pose.inverse(one.T_seg_sensor) @ T_seg_tcp)[:3, 3])
    to_tcp(w_sensor, w_idle, flat, p_sensor_tcp, np.ascontiguousarray(R_base_part.reshape(-1)), out)
    w_base = tcp_wrench(
        one, w_sensor, R_base_sensor, T_seg_tcp, temperature_c=25.0, time_s=100.0, R_hose_sensor=R_hose_sensor
    )
    np.testing.assert_allclose(out, pose.rotate_wrench(R_base_part.T, w_base), rtol=1e-11, atol=1e-9)


def test_without_a_temperature_it_is_the_reference() -> None:
    one, out = sensor(np.random.default_rng(3), 0), np.zeros(6)
    idle(one.record(), np.eye(3).reshape(-1).copy(), np.eye(3).reshape(-1).copy(), DOWN, 0.0, float("nan"), out)
    np.testing.assert_allclose(out, idle_wrench(one, np.eye(3)), rtol=1e-12)

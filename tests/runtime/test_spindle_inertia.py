"""Inertia taken out of the force: rigid motions against the sensor's equation, lost telegrams, delay."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import counterflex
from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation
from counterflex.runtime.sensing.spindle_inertia import SpindleInertia
from counterflex.sensing.carrier import carrier_to_tcp
from counterflex.sensing.flange_sensor import FlangeSensor
from counterflex.signals.filters import Smoother
from flange_wrench import SensorMotion, idle_wrench

CELL: Cell = read_cell(Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml")
T = 4e-3
RIGID = np.zeros((6, 6))
SENSOR = FlangeSensor(
    segment="sensor",
    T_seg_sensor=pose.make(rotation.about_z(0.3)),
    mass_kg=75.0,
    p_sensor_com=np.array([0.12, 0.03, 0.2]),
    inertia_kg_m2=np.array([2.0, 3.0, 1.5, 0.1, 0.0, -0.2]),
)


def packed(pose_: Float) -> Float:
    return np.concatenate([pose_[:3, :3].reshape(-1), pose_[:3, 3]])


def test_a_rigid_motion_leaves_nothing() -> None:
    """Tool swinging about all axes at 4 Hz: the sensor's own equation gives the reading, its process part is zero."""
    inertia = SpindleInertia(CELL.chain, SENSOR, CELL.T_base_part, 60.0, T)
    R_base_part = CELL.T_base_part[:3, :3]
    T_sensor_tcp = pose.inverse(SENSOR.T_seg_sensor) @ carrier_to_tcp(CELL.chain, "sensor")
    w0, start = 2.0 * np.pi * 4.0, rotation.about_x(np.pi)
    swing = np.array([2.0, -1.0, 0.5]) * MM
    turn = np.array([0.4, -0.3, 0.6]) * MM  # rad
    largest_in = largest_out = 0.0
    for k in range(400):
        t = k * T
        s, c = np.sin(w0 * t), np.cos(w0 * t)
        R_part_tcp = rotation.exp(turn * s) @ start
        p_tcp = swing * s
        # Sensor: rigidly joined. Second order in the angle is left out by both sides of the comparison below 1e-6.
        R_part_sensor = R_part_tcp @ T_sensor_tcp[:3, :3].T
        lever = -R_part_sensor @ T_sensor_tcp[:3, 3]
        alpha, omega = -w0 * w0 * s * turn, w0 * c * turn
        a_tcp = -w0 * w0 * s * swing
        a_sensor = a_tcp + np.cross(alpha, lever) + np.cross(omega, np.cross(omega, lever))
        motion = SensorMotion(R_part_sensor.T @ a_sensor, R_part_sensor.T @ omega, R_part_sensor.T @ alpha)
        still = idle_wrench(SENSOR, R_base_part @ R_part_sensor)
        shown = idle_wrench(SENSOR, R_base_part @ R_part_sensor, motion=motion) - still
        w_tcp = pose.rotate_wrench(R_part_sensor, pose.shift_wrench(shown, -T_sensor_tcp[:3, 3]))
        found = inertia(packed(pose.make(R_part_tcp, p_tcp)), w_tcp, RIGID, 1)
        if k > 100:
            largest_in, largest_out = max(largest_in, np.abs(w_tcp).max()), max(largest_out, np.abs(found).max())
    assert largest_in > 60.0
    assert largest_out < 0.015 * largest_in


def test_the_arm_that_bends_under_the_reading_moves_the_spindle() -> None:
    """A load that swings at 5 Hz on a spring moves the mass by C w: what comes out is w + m C w''."""
    C = np.zeros((6, 6))
    C[:3, :3] = CELL.T_base_part[:3, :3] @ np.diag([2e-6, 3e-6, 1e-6]) @ CELL.T_base_part[:3, :3].T
    inertia = SpindleInertia(CELL.chain, SENSOR, CELL.T_base_part, 60.0, T)
    w0, still = 2.0 * np.pi * 5.0, packed(pose.make(rotation.about_x(np.pi)))
    peak = np.zeros(3)
    for k in range(500):
        w = np.zeros(6)
        w[:3] = np.array([100.0, -200.0, 50.0]) * np.sin(w0 * k * T)
        found = inertia(still, w, C, 1)
        if k > 250:
            peak = np.maximum(peak, np.abs(found[:3]))
    expected = np.array([100.0, 200.0, 50.0]) * (1.0 - w0 * w0 * 75.0 * np.array([2e-6, 3e-6, 1e-6]))
    np.testing.assert_allclose(peak, expected, rtol=0.02)


@pytest.mark.parametrize("lost", [1, 2, 4, 9])
def test_lost_telegrams_of_a_moving_robot_are_no_force(lost: int) -> None:
    """25 mm/s with gaps: a difference over the wrong time would be hundreds of newtons."""
    inertia = SpindleInertia(CELL.chain, SENSOR, CELL.T_base_part, 25.0, T)
    x, worst = 0.0, 0.0
    for k in range(600):
        elapsed = lost if k % 50 == 49 else 1
        x += 0.025 * T * elapsed
        where = packed(pose.make(rotation.about_x(np.pi), np.array([x, 0.0, 0.0])))
        found = inertia(where, np.full(6, 10.0), RIGID, elapsed)
        if k > 100:
            worst = max(worst, float(np.abs(found - 10.0).max()))
    assert worst < 1e-6


def test_the_force_itself_passes_the_stated_low_pass() -> None:
    inertia = SpindleInertia(CELL.chain, SENSOR, CELL.T_base_part, 25.0, T)
    low = Smoother(SpindleInertia.smoothing(25.0, T), 6)
    low.reset(np.zeros(6))
    still, out = packed(np.eye(4)), np.zeros(6)
    rng = np.random.default_rng(0)
    inertia(still, np.zeros(6), RIGID, 1)
    for _ in range(100):
        w = rng.standard_normal(6)
        low(w, out)
        np.testing.assert_allclose(inertia(still, w, RIGID, 1), out, atol=1e-12)

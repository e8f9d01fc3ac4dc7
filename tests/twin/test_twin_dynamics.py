"""Modes, servo, friction and play of the twin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

from counterflex.core.arrays import Float
from counterflex.core.errors import SimulationError
from counterflex.robot.model import catalog
from counterflex.robot.model.description import EndEffector, Segment
from counterflex.twin.plant.drives import first_order_lag, gains
from counterflex.twin.plant.plant import Plant
from counterflex.twin.truth.nominal import nominal_truth
from counterflex.twin.truth.truth import CuttingTruth, Truth


def locked_modes_hz(truth: Truth, q: Float) -> Float:
    """Frequencies with the motors locked: ``K x = w^2 M x`` over the elastic coordinates."""
    plant = Plant(truth, friction=False)
    plant.reset(q)
    elastic = np.ix_(plant.coordinates.kind >= 0, plant.coordinates.kind >= 0)
    w2 = scipy.linalg.eigh(
        np.diag(plant.coordinates.stiffness)[elastic], plant.mass_matrix()[elastic], eigvals_only=True
    )
    out: Float = np.sqrt(w2) / (2.0 * np.pi)
    return out


def servo_modes(truth: Truth, q: Float) -> tuple[Float, Float]:
    """Frequencies in Hz and damping ratios with springs, dampers and PID drives, from the linear equations."""
    plant = Plant(truth, friction=False)
    plant.reset(q)
    c, M = plant.coordinates, plant.mass_matrix()
    n = len(c.kind)
    K, D, integral = np.diag(c.stiffness), np.zeros((n, n)), np.zeros((n, n))
    beta = np.array([truth.bodies[b].damping_s for b in c.body])
    D += np.diag(beta * c.stiffness)
    for axis, (kp, kv, ki) in enumerate(gains(truth.drives)):
        m = c.motor[axis]
        K[m, m], D[m, m], integral[m, m] = kp, kv, ki
    inverse = np.linalg.inv(M)
    A = np.zeros((3 * n, 3 * n))
    A[:n, n : 2 * n] = np.eye(n)
    A[n : 2 * n, :n], A[n : 2 * n, n : 2 * n], A[n : 2 * n, 2 * n :] = -inverse @ K, -inverse @ D, -inverse @ integral
    A[2 * n :, :n] = np.eye(n)
    s = np.linalg.eigvals(A)
    assert np.all(s.real < 1e-6)
    s = s[s.imag > 2.0 * np.pi * 3.0]
    order = np.argsort(np.abs(s))
    return np.abs(s[order]) / (2.0 * np.pi), -s.real[order] / np.abs(s[order])


def test_first_modes_with_locked_motors(weightless: Truth, poses_rad: Float) -> None:
    """Published twin of this robot: 6.31 and 6.36 Hz stretched, 9.1 and 9.3 Hz at a working pose."""
    np.testing.assert_allclose(locked_modes_hz(weightless, poses_rad[0])[:2], [6.31, 6.36], rtol=0.03)
    np.testing.assert_allclose(locked_modes_hz(weightless, poses_rad[1])[:2], [9.1, 9.3], rtol=0.05)


def test_first_modes_with_servo(weightless: Truth, poses_rad: Float) -> None:
    """Published: 5.1 Hz / 0.13 and 5.4 Hz / 0.12 stretched, 8.3 Hz / 0.17 and 8.9 Hz / 0.11 working."""
    for q, expected in ((poses_rad[0], (5.1, 5.4)), (poses_rad[1], (8.3, 8.9))):
        hz, zeta = servo_modes(weightless, q)
        structure = (hz > 4.0) & (hz < 12.0) & (zeta < 0.3)
        np.testing.assert_allclose(np.sort(hz[structure])[:2], expected, rtol=0.08)
        assert np.all((zeta[structure][:2] > 0.05) & (zeta[structure][:2] < 0.25))


def test_ring_down_shows_the_first_mode(weightless: Truth, poses_rad: Float) -> None:
    q, rest = poses_rad[0], np.zeros(6)
    plant = Plant(weightless, friction=False)
    plant.reset(q, np.array([0.0, 300.0, 0, 0, 0, 0]))
    y = np.empty(2400)
    for k in range(len(y)):
        y[k] = plant.p_base_tcp[1]
        plant.step(q, rest, rest)
    hz, zeta = servo_modes(weightless, q)
    lateral = y[200:] - y[-1]
    crossings = np.flatnonzero(np.diff(np.sign(lateral)) != 0)[:6]
    period = 2.0 * np.mean(np.diff(crossings)) * plant.step_s
    first = hz[(hz > 4.0) & (zeta < 0.3)][:2]
    assert 0.93 * first.min() < 1.0 / period < 1.07 * first.max()


def test_nothing_moves_after_the_start(truth: Truth, poses_rad: Float) -> None:
    plant = Plant(truth)
    rest = np.zeros(6)
    for q in poses_rad[1:]:
        start = plant.equilibrium(q)[:3, 3]
        for _ in range(600):
            plant.step(q, rest, rest)
        assert np.linalg.norm(plant.tcp_pose()[:3, 3] - start) < 1e-9


def test_energy_is_not_created(weightless: Truth, poses_rad: Float) -> None:
    """Released from a load with stiff drives, every later swing is smaller than the one before."""
    q, rest = poses_rad[1], np.zeros(6)
    plant = Plant(weightless, friction=False)
    plant.reset(q, np.array([0.0, 0, 750.0, 0, 0, 0]))
    z = np.empty(4000)
    for k in range(len(z)):
        z[k] = plant.p_base_tcp[2]
        plant.step(q, rest, rest)
    swing = np.abs(z - z[-1]).reshape(8, 500).max(axis=1)
    assert np.all(np.diff(swing[:6]) < 0.0)
    assert swing[-2] < 0.02 * swing[0]


def lost_motion(truth: Truth) -> float:
    """Axis 1: load +2000 N m, release, -2000 N m, release; difference of the torsions at rest, rad."""
    plant = Plant(truth)
    q, rest, moment = np.radians([0.0, -90, 90, 0, 0, 0]), np.zeros(6), np.zeros(6)
    plant.reset(q)
    held = []
    for begin, end in ((0.0, 2000.0), (2000.0, 0.0), (0.0, -2000.0), (-2000.0, 0.0)):
        for k in range(1500):
            moment[5] = begin + (end - begin) * 0.5 * (1.0 - np.cos(np.pi * k / 1499))
            plant.step(q, rest, moment)
        held.append(float(plant.q_link()[0] - plant.q_motor()[0]))
    return abs(held[1] - held[3])


@pytest.mark.parametrize(("play", "dry"), [(25e-6, 0.0), (0.0, 1.0), (25e-6, 1.0)])
def test_lost_motion(truth: Truth, play: float, dry: float) -> None:
    """``2 b + 2 Fc / k``: 50, 80 and 130 urad for b = 25 urad, Fc = 300 N m, k = 7.5e6 N m/rad.

    The other axes are left free of friction and play, motor friction is off, and the drive is stiff without integral
    part, so that the torsion of axis 1 alone is seen.
    """
    drives = [
        replace(d, dead_band_rad=0.0, motor_friction_nm=0.0, link_friction_nm=(0.0, 0.0, 0.0)) for d in truth.drives
    ]
    shares = (75.0, 105.0, 120.0)
    drives[0] = replace(
        drives[0],
        dead_band_rad=play,
        link_friction_nm=tuple(dry * f for f in shares),
        position_gain_per_s=500.0,
        integral_time_s=1e3,
    )
    found = lost_motion(replace(truth, drives=tuple(drives)))
    expected = 2.0 * play + 2.0 * dry * 300.0 / 7.5e6
    if dry == 0.0:
        assert found <= expected * 1.02  # nothing holds the link inside its play
    else:
        assert found == pytest.approx(expected, rel=0.03)


def test_stiction_holds_without_creep(truth: Truth) -> None:
    drives = tuple(replace(d, position_gain_per_s=100.0, integral_time_s=1e3) for d in truth.drives)
    plant = Plant(replace(truth, drives=drives))
    q, rest = np.radians([0.0, -90, 90, 0, 0, 0]), np.zeros(6)
    plant.reset(q)
    load, held = np.zeros(6), []
    for k in range(5000):
        load[5] = 25.0 * (1.0 - np.cos(np.pi * min(k / 2000, 1.0)))
        plant.step(q, rest, load)
        if k in (2999, 4999):
            held.append(plant.q_link()[0])
    assert held[0] < -1e-6
    assert abs(held[1] - held[0]) < 2e-8


def test_servo_follows_a_ramp_without_lag(truth: Truth) -> None:
    """Full speed feed-forward: no following error at steady speed (friction is learnt by the integrator)."""
    plant = Plant(truth)
    q = np.radians([0.0, -90, 90, 0, 20, 0])
    speed = np.array([0.05, 0, 0, 0, 0, 0])
    plant.reset(q, None, speed)
    for k in range(2000):
        plant.step(q + speed * k * plant.step_s, speed, np.zeros(6))
    error = q + speed * 1999 * plant.step_s + speed * plant.step_s - plant.q_motor()
    assert np.max(np.abs(error)) < 20e-6


def test_following_error_is_speed_over_gain() -> None:
    q = np.outer(np.arange(2000) * 4e-3, np.full(6, 0.3))
    lagged = first_order_lag(q, 4e-3, 11.0)
    np.testing.assert_allclose((q - lagged)[-1], 0.3 / 11.0, rtol=1e-9)


def test_not_a_number_is_an_error(truth: Truth) -> None:
    plant = Plant(truth)
    q = np.zeros(6)
    plant.step(q, q, np.array([np.nan, 0, 0, 0, 0, 0]))
    plant.step(q, q, q)
    with pytest.raises(SimulationError, match="unstable"):
        plant.check()


def test_instability_is_an_error(truth: Truth) -> None:
    wild = tuple(replace(d, speed_bandwidth_per_s=1e5) for d in truth.drives)
    with pytest.raises(SimulationError, match="too stiff for its inertia"):
        Plant(replace(truth, drives=wild))
    plant = Plant(replace(truth, drives=wild), parts=1)
    q, rest = np.radians([0.0, -90, 90, 0, 0, 0]), np.zeros(6)
    plant.reset(q)
    with pytest.raises(SimulationError, match="unstable"):
        for _ in range(2000):
            plant.step(q + 1e-4, rest, rest)
            plant.check()


def test_same_start_same_motion(truth: Truth) -> None:
    q, rest, ends = np.radians([10.0, -80, 100, 5, 30, 0]), np.zeros(6), []
    for _ in range(2):
        plant = Plant(truth)
        plant.reset(q)
        for k in range(300):
            plant.step(q, rest, np.array([0.0, 300.0 * np.sin(0.1 * k), 0, 0, 0, 0]))
        ends.append(np.concatenate(plant.state()))
    np.testing.assert_array_equal(ends[0], ends[1])


def test_every_robot_of_the_catalogue_holds_still_under_a_load() -> None:
    """Masses and friction filled in where a description has none must not make any of them unstable."""
    tip = np.array([[0.0, 0, 1, 0.15], [0, 1, 0, 0], [-1, 0, 0, 0.10], [0, 0, 0, 1]])
    rest = np.zeros(6)
    for name in catalog.names():
        robot, payload = catalog.load(name), catalog.entry(name).payload_kg or 3.0
        load = np.array([0.0, 2.0 * payload, 0.0, 0.0, 0.0, 0.0])
        spindle = Segment(
            "spindle", np.eye(4), compliance=np.array([0, 0, 0, 5e-6, 5e-6, 5e-6]), mass_kg=0.3 * payload,
            p_seg_com=np.array([0.05, 0.0, 0.10]),
        )  # fmt: skip
        plant = Plant(nominal_truth(robot, EndEffector((spindle,), tip), CuttingTruth((1.0, 1, 1), (0, 0, 0))))
        q = 0.3 * robot.joint_limits_rad.mean(axis=1)
        start = plant.equilibrium(q)[:3, 3]
        for _ in range(100):
            plant.step(q, rest, load)
        plant.check()
        assert np.linalg.norm(plant.p_base_tcp - start) < 5e-3, name

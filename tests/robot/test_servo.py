"""Motors that yield: closed form of a step and a ramp, no steady error, superposition, sampling."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ModelError
from counterflex.core.units import URAD
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.servo import servo_error
from counterflex.robot.model import catalog
from counterflex.robot.model.description import Servo

AXIS = Servo(speed_gain_nm_s=155550.0, position_gain_per_s=20.0, integral_time_s=0.06)


def one(load: Float, time: Float, servo: Servo = AXIS, q: Float | None = None) -> Float:
    angles = np.zeros((len(time), 1)) if q is None else q[:, None]
    return servo_error((servo,), angles, np.asarray(load, dtype=np.float64)[:, None], time)[:, 0]


def test_ramp_settles_at_ramp_over_integral_gain() -> None:
    """A torque r t: e -> r / ki with ki = K Kv / Ti."""
    time = np.linspace(0.0, 2.0, 201)
    assert one(3000.0 * time, time)[-1] == pytest.approx(3000.0 * 0.06 / (155550.0 * 20.0), rel=1e-9)


def test_step_is_the_closed_form() -> None:
    """e(t) = tau / (K (a - b)) (exp(-b t) - exp(-a t)), and nothing is left in the end."""
    rise = 1e-9
    time = np.concatenate([[0.0, rise], np.linspace(0.005, 3.0, 600)])
    load = np.where(time > 0.0, 500.0, 0.0)
    a, b = 20.0, 1.0 / 0.06
    expected = 500.0 / (155550.0 * (a - b)) * (np.exp(-b * time) - np.exp(-a * time))
    assert one(load, time) == pytest.approx(expected, abs=1e-10)
    assert expected.max() > 30 * URAD
    assert abs(one(load, time)[-1]) < 1e-15


def test_equals_the_loop_integrated_in_time() -> None:
    """Independent truth: K (de/dt + (Kv + 1/Ti) e + Kv/Ti int e) = tau, solved by a stiff integrator."""
    time = np.sort(np.random.default_rng(3).uniform(0.0, 1.5, 60))
    time[0] = 0.0
    load = np.random.default_rng(4).normal(0.0, 400.0, 60)
    load[0] = 0.0

    def slope(t: float, y: Float) -> list[float]:
        drive = float(np.interp(t, time, load)) / AXIS.speed_gain_nm_s
        return [drive - (20.0 + 1 / 0.06) * y[0] - 20.0 / 0.06 * y[1], y[0]]

    found = solve_ivp(slope, (0.0, time[-1]), [0.0, 0.0], t_eval=time, rtol=1e-9, atol=1e-13, max_step=2e-3)
    assert one(load, time) == pytest.approx(found.y[0], abs=1e-9)


def test_equal_poles_are_no_singularity() -> None:
    time = np.linspace(0.0, 1.0, 101)
    load = 400.0 * np.sin(5.0 * time)
    equal = one(load, time, replace(AXIS, position_gain_per_s=1 / 0.06))
    near = one(load, time, replace(AXIS, position_gain_per_s=1.001 / 0.06))
    assert equal == pytest.approx(near, abs=2e-3 * float(np.abs(near).max()))


def test_sampling_does_not_matter_for_a_load_that_is_linear_between_points() -> None:
    coarse = np.linspace(0.0, 1.0, 11)
    load = np.array([0, 100, 300, 250, 250, -100, 0, 500, 500, 200, 0.0])
    fine = np.linspace(0.0, 1.0, 101)
    assert one(np.interp(fine, coarse, load), fine)[::10] == pytest.approx(one(load, coarse), abs=1e-15)


def test_friction_at_the_motor_shows_at_a_reversal_only() -> None:
    dry = replace(AXIS, friction_nm=60.0, slip_rad=25 * URAD)
    time = np.linspace(0.0, 4.0, 2001)
    q = 0.01 * np.abs(time - 2.0)
    error = one(np.zeros(2001), time, dry, q)
    assert abs(error[990]) < 0.02 * np.abs(error).max()  # long after it has slid into the direction of motion
    bump = error[1001:1200]
    assert bump[np.argmax(np.abs(bump))] < 0.0  # held back as the axis turns to rising angles
    assert np.abs(bump).max() > 1.8 * np.abs(error[:1000]).max()


def test_steady_load_and_axes_without_gains_do_not_move() -> None:
    time = np.linspace(0.0, 1.0, 50)
    assert np.all(one(np.full(50, 2000.0), time) == 0.0)
    out = servo_error((AXIS, None), np.zeros((50, 2)), np.tile(1e3 * time[:, None], (1, 2)), time)
    assert np.any(out[:, 0] != 0.0)
    assert np.all(out[:, 1] == 0.0)


def test_wrong_numbers_are_refused() -> None:
    with pytest.raises(InputError, match="backwards"):
        one(np.zeros(3), np.array([0.0, 1.0, 0.5]))
    robot = catalog.load("kuka_kr300_r2500_ultra")
    with pytest.raises(ModelError, match="axis 2"):
        ElasticChain.build(replace(robot, servo=(AXIS, replace(AXIS, integral_time_s=0.0), None, None, None, None)))
    with pytest.raises(ModelError, match="one entry per driven axis"):
        ElasticChain.build(replace(robot, servo=(AXIS,)))

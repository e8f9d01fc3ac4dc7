"""Class prior of drives, friction and play: its laws, and its median against what it comes from."""

from __future__ import annotations

import math

import numpy as np
import pytest

from counterflex.robot.elasticity.servo import servo_error
from counterflex.robot.model import class_prior
from counterflex.robot.model.class_prior import DrivePrior

REFERENCE = DrivePrior(300.0, 2.496, 60.0, 2e6)
SPREAD = math.exp(0.5 * REFERENCE.yield_log_sigma**2)


def test_friction_grows_with_payload_times_reach_and_angles_do_not() -> None:
    larger = DrivePrior(600.0, 3.0, 60.0, 2e6)
    ratio = 600.0 * 3.0 / (300.0 * 2.496)
    for axis in range(6):
        own, other = REFERENCE.servo(axis), larger.servo(axis)
        assert other.friction_nm == pytest.approx(ratio * own.friction_nm)
        assert larger.play(axis).friction_nm[0] == pytest.approx(ratio * REFERENCE.play(axis).friction_nm[0])
        assert larger.play(axis).half_band_rad == REFERENCE.play(axis).half_band_rad


@pytest.mark.parametrize("omega", [20.0, 200.0])
def test_drives_of_each_size_yield_the_same_share_of_the_deflection(omega: float) -> None:
    """A mass on the spring of axis 1 alone: a step of torque turns the motor by 14 % of the twist of the spring."""
    k = 3e6
    prior = DrivePrior(300.0, 2.496, omega, k / class_prior.SPEED_GAIN_SHARE[0])
    assert k / (2.0 * omega * prior.servo(0).speed_gain_nm_s) == pytest.approx(SPREAD * class_prior.DAMPING_RATIO)
    time = np.linspace(0.0, 20.0 / omega, 4000)
    load = np.where(time > 0.0, 100.0, 0.0)[:, None]
    gains = (prior.servo(0),)
    assert np.max(servo_error(gains, np.zeros_like(load), load, time)) / (100.0 / k) == pytest.approx(0.14, abs=0.005)


def test_friction_of_both_sides_is_what_is_published_of_the_reference() -> None:
    both = [REFERENCE.servo(axis).friction_nm + sum(REFERENCE.play(axis).friction_nm) for axis in range(6)]
    np.testing.assert_allclose(both, class_prior.FRICTION_NM)


def test_the_gear_alone_holds_the_share_of_its_compliance() -> None:
    whole, share = REFERENCE.play(1), REFERENCE.play(1, 0.4)
    assert share.friction_nm[0] == pytest.approx(0.4 * whole.friction_nm[0])
    assert share.half_band_rad == whole.half_band_rad


def test_the_plan_takes_the_mean_of_what_gains_of_the_class_yield() -> None:
    z = np.random.default_rng(1).standard_normal((400_000, 2)) / 1.6448536
    gains = z * np.log([class_prior.SPEED_GAIN_FACTOR, class_prior.POSITION_GAIN_FACTOR])
    yields = -gains.sum(axis=1)
    assert REFERENCE.yield_log_sigma == pytest.approx(np.std(yields), rel=0.01)
    assert pytest.approx(np.mean(np.exp(yields)), rel=0.02) == SPREAD


def test_play_is_drawn_about_what_the_plan_takes_and_friction_on_either_side_of_the_gear() -> None:
    band, friction = class_prior.drawn_play(20_000, 1)
    low, high = np.quantile(band / REFERENCE.play(0).half_band_rad, [0.05, 0.95])
    assert (low, high) == pytest.approx((1.0 / class_prior.PLAY_FACTOR, class_prior.PLAY_FACTOR), rel=0.03)
    assert np.mean(2.0 * band > math.radians(1.0 / 60.0)) == pytest.approx(0.01, abs=0.003)  # catalogues: 1 arcmin
    sigma = math.log(class_prior.FRICTION_FACTOR) / 1.6448536
    assert np.mean(friction) == pytest.approx(math.exp(0.5 * sigma**2), rel=0.01)
    assert np.mean(friction**2) == pytest.approx(4.0 / 3.0 * math.exp(2.0 * sigma**2), rel=0.02)  # evenly 0 to 2 times

"""Class prior of drives, friction and play: its laws, and its median against what it comes from."""

from __future__ import annotations

import math

import numpy as np
import pytest

from counterflex.robot.model import drive_prior
from counterflex.robot.model.drive_prior import DrivePrior

REFERENCE = DrivePrior(300.0, 2.496)


def test_torques_grow_with_payload_times_reach_and_angles_and_times_do_not() -> None:
    larger = DrivePrior(600.0, 3.0)
    ratio = 600.0 * 3.0 / (300.0 * 2.496)
    for axis in range(6):
        own, other = REFERENCE.servo(axis), larger.servo(axis)
        assert other.speed_gain_nm_s == pytest.approx(ratio * own.speed_gain_nm_s)
        assert other.friction_nm == pytest.approx(ratio * own.friction_nm)
        assert (other.position_gain_per_s, other.integral_time_s) == (own.position_gain_per_s, own.integral_time_s)
        assert larger.play(axis).friction_nm[0] == pytest.approx(ratio * REFERENCE.play(axis).friction_nm[0])
        assert larger.play(axis).half_band_rad == REFERENCE.play(axis).half_band_rad


def test_friction_of_both_sides_is_what_is_published_of_the_reference() -> None:
    both = [REFERENCE.servo(axis).friction_nm + sum(REFERENCE.play(axis).friction_nm) for axis in range(6)]
    np.testing.assert_allclose(both, drive_prior.FRICTION_NM)


def test_the_gear_alone_holds_the_share_of_its_compliance() -> None:
    whole, share = REFERENCE.play(1), REFERENCE.play(1, 0.4)
    assert share.friction_nm[0] == pytest.approx(0.4 * whole.friction_nm[0])
    assert share.half_band_rad == whole.half_band_rad


def test_the_spread_of_the_yield_is_that_of_both_gains_drawn_together() -> None:
    z = np.random.default_rng(1).standard_normal((200_000, 2)) / 1.6448536
    gains = z * np.log([drive_prior.SPEED_GAIN_FACTOR, drive_prior.POSITION_GAIN_FACTOR])
    assert REFERENCE.yield_log_sigma == pytest.approx(np.std(-gains.sum(axis=1)), rel=0.01)


def test_gains_lie_between_the_rule_and_what_the_source_states() -> None:
    """The least is a cascade at four times its own position gain on rotor and arm, the most ``K_vel u^2``."""
    gears, stated = np.array([1798 / 7, 1872 / 7, 757 / 3]), 20.0
    least = np.array(drive_prior.ROTOR_KG_M2) * 2.5 * 4.0 * 10.0
    most = stated * gears**2
    gains = REFERENCE.speed_gain_nm_s[:3]
    assert np.all(least < gains)
    assert np.all(gains < most)
    assert math.log(drive_prior.SPEED_GAIN_FACTOR) > 0.7 * np.max(np.abs(np.log(gains / np.sqrt(least * most))))

"""The simulated equipment: drawn by seed, standing still between sessions, with noise that is new in each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, MRAD, MS
from counterflex.geometry import pose
from counterflex.twin.laboratory.instrument_clocks import InstrumentClocks
from counterflex.twin.laboratory.laboratory import NOMINAL_T_BASE_TRACKER, NOMINAL_T_TCP_TARGET, laboratory
from counterflex.twin.laboratory.measurements import measurement
from counterflex.twin.truth.truth import Truth


def test_a_seed_is_a_laboratory() -> None:
    one, again, other = laboratory(1), laboratory(1), laboratory(2)
    np.testing.assert_array_equal(one.T_base_tracker, again.T_base_tracker)
    assert not np.allclose(one.T_base_tracker, other.T_base_tracker)
    for seed in range(20):
        here = laboratory(seed)
        gap = pose.difference(NOMINAL_T_BASE_TRACKER, here.T_base_tracker)
        assert 0.0 < np.linalg.norm(gap[:3]) < 100.0 * MM
        assert 0.0 < np.linalg.norm(gap[3:]) < 10.0 * DEG
        assert np.linalg.norm(pose.difference(NOMINAL_T_TCP_TARGET, here.T_tcp_target)[:3]) < 10.0 * MM


def test_noise_is_new_in_each_session_and_the_equipment_is_not() -> None:
    base = laboratory(3)
    days = [replace(base, session=name) for name in ("", "monday", "tuesday")]
    noise = [day.noise("a").standard_normal(1000) for day in days]
    for i in range(3):
        np.testing.assert_array_equal(noise[i], days[i].noise("a").standard_normal(1000))
        assert abs(np.corrcoef(noise[i], noise[(i + 1) % 3])[0, 1]) < 0.15
        assert abs(np.corrcoef(noise[i], days[i].noise("b").standard_normal(1000))[0, 1]) < 0.15
        np.testing.assert_array_equal(days[i].standing("a").standard_normal(5), base.standing("a").standard_normal(5))
    times = [InstrumentClocks.of(day) for day in days]
    assert times[0].tracker_clock == times[1].tracker_clock == times[2].tracker_clock
    assert 1.0 * MS < times[0].tracker.dead_time_s < 20.0 * MS


@pytest.fixture
def request_of(poses_rad: Float) -> dict[str, Float]:
    return {f"q{i + 1}_rad": poses_rad[:, i] for i in range(6)}


def test_readings_of_two_sessions_differ_by_their_stated_noise(truth: Truth, request_of: dict[str, Float]) -> None:
    readings = []
    for name in ("monday", "tuesday"):
        at_rest = measurement("tracker_poses")(truth, replace(laboratory(1), session=name), request_of, {}, _quiet)
        readings.append(at_rest)
    p = [r.channels["p_tracker_target"] for r in readings]
    sigma = np.broadcast_to(readings[0].sigma["p_tracker_target"], p[0].shape)
    gap = np.abs(p[1] - p[0]) / sigma
    assert 0.1 < gap.mean() < 3.0
    assert gap.max() < 6.0
    np.testing.assert_array_equal(readings[0].channels["q"], readings[1].channels["q"])
    assert 0.0 < float(np.max(readings[0].sigma["R_tracker_target"])) < MRAD


def _quiet(fraction: float, what: str = "") -> None:
    pass

"""Test cuts over time: contact, zero, settled stretches, means and their standard deviations."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.identify.cutting.record import contact, mean_with_sigma, settled, split_ramp, zero


def trapezium(n: int = 400, rise: int = 40, begin: int = 80, end: int = 320) -> Float:
    shape = np.interp(np.arange(n), [begin, begin + rise, end - rise, end], [0.0, 1.0, 1.0, 0.0])
    out: Float = shape[:, None] * np.array([-80.0, 200.0, -30.0])
    return out


def test_contact_by_depth_where_the_record_says_what_is_air() -> None:
    depth = np.r_[np.zeros(5), np.full(7, 2e-3), np.zeros(3)]
    assert np.flatnonzero(contact(np.zeros((15, 3)), depth)).tolist() == list(range(5, 12))


def test_contact_by_force_where_it_does_not() -> None:
    touching = contact(trapezium() + np.array([700.0, -20.0, 5.0]), np.full(400, 2e-3))
    rows = np.flatnonzero(touching)
    assert 80 <= rows[0] <= 90
    assert 310 <= rows[-1] <= 320
    assert len(rows) == rows[-1] - rows[0] + 1


def test_zero_is_a_line_in_time_between_both_sides_and_a_swing_does_not_count() -> None:
    rng = np.random.default_rng(1)
    time: Float = np.linspace(0.0, 7.98, 400)
    drift = np.array([12.0, -7.0, -800.0]) + time[:, None] * np.array([0.5, 0.0, -0.3])
    shown = trapezium() + drift + 0.3 * rng.standard_normal((400, 3))
    shown[:15, 2] += 90.0  # the machine had just stopped
    base = zero(shown, time, contact(np.zeros((400, 3)), (np.abs(trapezium()[:, 1]) > 0).astype(float)))
    assert base.sides == 2
    np.testing.assert_allclose(base.value[80:320], drift[80:320], atol=0.5)
    np.testing.assert_allclose(base.drift, (time[360] - time[40]) * np.array([0.5, 0.0, -0.3]), atol=0.7)
    assert np.all(base.sigma < 0.2)


def test_zero_of_one_side_is_constant_and_of_none_is_nothing() -> None:
    shown, time = np.ones((20, 3)), np.arange(20.0)
    late = np.arange(20) >= 8
    assert zero(shown, time, late).sides == 1
    np.testing.assert_allclose(zero(shown, time, late).value, 1.0)
    none = zero(shown, time, np.ones(20, dtype=np.bool_))
    assert none.sides == 0
    np.testing.assert_allclose(none.value, 0.0)


def test_settled_stretches_keep_away_from_ends_and_steps() -> None:
    n = 300
    travel: Float = np.linspace(0.0, 0.5e-3 * (n - 1), n)
    touching = (np.arange(n) >= 20) & (np.arange(n) < 280)
    feed = np.where(np.arange(n) < 150, 0.01, 0.02)[:, None]
    found = settled(touching, travel, np.where(touching, 3e-3, 0.0), feed, np.full(n, 10e-3))
    assert [(int(r[0]), int(r[-1])) for r in found] == [(40, 129), (170, 259)]


def test_a_ramp_is_one_stretch_and_a_step_of_depth_two() -> None:
    n = 200
    travel: Float = np.arange(float(n)) * 1e-3
    touching, same = np.ones(n, dtype=np.bool_), np.ones((n, 1))
    ramp = settled(touching, travel, 0.05 * travel + 1e-3, same, np.full(n, 5e-3))
    assert len(ramp) == 1
    depth: Float = np.where(np.arange(n) < 90, 1e-3, 3e-3)
    step = settled(touching, travel, depth, same, np.full(n, 5e-3))
    assert [len(r) for r in step] == pytest.approx([80, 100], abs=1)


def test_a_ramp_is_split_by_its_depth_and_a_level_cut_is_not() -> None:
    depth = np.linspace(1e-3, 3e-3, 100)
    parts = split_ramp(np.arange(100), depth, 0.5e-3)
    assert len(parts) == 4
    assert all(np.ptp(depth[p]) <= 0.5e-3 for p in parts)
    assert len(split_ramp(np.arange(100), np.full(100, 2e-3), 0.5e-3)) == 1
    with pytest.raises(InputError, match="change of depth"):
        split_ramp(np.arange(3), depth, 0.0)


@pytest.mark.parametrize("memory", [0.0, 0.7])
def test_standard_deviation_of_a_mean_holds_for_correlated_samples(memory: float) -> None:
    rng = np.random.default_rng(5)
    means, sigmas = [], []
    for _ in range(300):
        noise = rng.standard_normal((240, 1))
        for i in range(1, 240):
            noise[i] += memory * noise[i - 1]
        mean, sigma = mean_with_sigma(noise, None)
        means.append(mean[0])
        sigmas.append(sigma[0])
    assert float(np.sqrt(np.mean(np.square(sigmas)))) == pytest.approx(float(np.std(means)), rel=0.2)


def test_standard_deviation_is_never_below_what_the_sensor_promises() -> None:
    _, sigma = mean_with_sigma(np.ones((100, 2)), np.full((100, 2), 2.0))
    np.testing.assert_allclose(sigma, 0.2)

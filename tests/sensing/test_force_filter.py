"""Causal force filters: optimal in steady state, with the delay they state."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.sensing.force_filter import DELAY_HZ, kalman_observer

RNG = np.random.default_rng(0)
K = 1e-7 * RNG.standard_normal((6, 3))
NOISE = np.diag(np.full(6, (0.2e-6) ** 2))
STEP_S = 1e-3


def walk(count: int, size: float) -> Float:
    return np.cumsum(size * np.sqrt(STEP_S) * RNG.standard_normal((count, 3)), axis=0)


def test_scalar_gain_is_that_of_the_closed_form() -> None:
    """One force by three alike bridges: P solves P^2 - Q P - Q R = 0 with R the noise of their mean."""
    alike = 1e-7 * np.vstack([np.eye(3)] * 2)
    f = kalman_observer(alike, NOISE, step_s=STEP_S, slew_n=300.0)
    Q, R = 300.0**2 * STEP_S, (0.2e-6 / 1e-7) ** 2 / 2.0
    P = 0.5 * (Q + np.sqrt(Q**2 + 4.0 * Q * R))
    np.testing.assert_allclose(f.sigma_n, np.sqrt(P * R / (P + R)), rtol=1e-9)


def test_stated_deviation_is_met() -> None:
    f = walk(20_000, 200.0)
    s = f @ K.T + 0.2e-6 * RNG.standard_normal((len(f), 6))
    observer = kalman_observer(K, NOISE, step_s=STEP_S, slew_n=200.0)
    error = (observer.run(s) - f)[200:]
    np.testing.assert_allclose(error.std(axis=0), observer.sigma_n, rtol=0.08)
    for slew in (50.0, 1000.0):  # any other gain is worse
        other = (kalman_observer(K, NOISE, step_s=STEP_S, slew_n=slew).run(s) - f)[200:]
        assert np.mean(other**2) > np.mean(error**2)


def test_delay_is_what_a_slow_wave_shows() -> None:
    g = kalman_observer(K, NOISE, step_s=STEP_S, slew_n=40.0, wander=np.full(6, 1e-9))
    t = STEP_S * np.arange(6000)
    for axis in range(3):
        f = np.zeros((len(t), 3))
        f[:, axis] = 100.0 * np.sin(2.0 * np.pi * DELAY_HZ * t)
        shown = g.run(f @ K.T)[2000:, axis]
        tail = t[2000:]
        c, s = (shown @ fn(2.0 * np.pi * DELAY_HZ * tail) for fn in (np.cos, np.sin))
        late = -np.arctan2(c, s) / (2.0 * np.pi * DELAY_HZ)
        assert late == pytest.approx(g.delay_s[axis], abs=0.2e-3)
        assert g.delay_s[axis] > 0.5e-3


def test_faster_forces_cost_noise_and_win_delay() -> None:
    slow, fast = (kalman_observer(K, NOISE, step_s=STEP_S, slew_n=v) for v in (30.0, 3000.0))
    assert np.all(slow.delay_s > fast.delay_s)
    assert np.all(slow.sigma_n < fast.sigma_n)


def test_filters_are_causal() -> None:
    g = kalman_observer(K, NOISE, step_s=STEP_S, slew_n=100.0)
    s = 1e-6 * RNG.standard_normal((50, 6))
    changed = s.copy()
    changed[30:] += 1e-5
    np.testing.assert_array_equal(g.run(s)[:30], g.run(changed)[:30])


def test_wandering_zeros_do_not_pass_for_force_where_bridges_disagree() -> None:
    count = 8000
    zero = np.cumsum(1e-6 * np.sqrt(STEP_S) * RNG.standard_normal((count, 6)), axis=0)
    s = zero + 0.2e-6 * RNG.standard_normal((count, 6))
    plain = kalman_observer(K, NOISE, step_s=STEP_S, slew_n=20.0)
    aware = kalman_observer(K, NOISE, step_s=STEP_S, slew_n=20.0, wander=np.full(6, 1e-6))
    assert np.mean(aware.run(s) ** 2) < 0.9 * np.mean(plain.run(s) ** 2)


def test_bad_settings_are_named() -> None:
    with pytest.raises(InputError, match="step_s"):
        kalman_observer(K, NOISE, step_s=0.0, slew_n=1.0)
    with pytest.raises(InputError, match="wander"):
        kalman_observer(K, NOISE, step_s=STEP_S, slew_n=1.0, wander=np.zeros(6))

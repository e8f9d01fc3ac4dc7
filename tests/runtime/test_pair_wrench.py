"""Two force sensors: the fused variance against a Riccati equation, loss without a jump, disagreement an alarm."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

from counterflex.core.arrays import Float
from counterflex.core.records import Record, records
from counterflex.geometry import rotation
from counterflex.runtime.sensing.pair_kernel import FIRST, PAIR, PAIRED, SECOND, pair_step

T = 4e-3
NOISE: Float = np.array([4.0, 4.0, 4.0, 2.0, 3.0, 20.0])
R_FIRST: Float = rotation.exp(np.array([0.3, -0.5, 0.9]))
R_SECOND: Float = rotation.exp(np.array([-1.1, 0.2, 0.4]))
BOTH = FIRST | SECOND


def pair(
    slew: float = 300.0, walk: float = 0.1, zero: float = 1.0, late: tuple[float, float] = (0.0, 0.0), **more: float
) -> tuple[Record, Record]:
    c, p = records(PAIR)[0], records(PAIRED)[0]
    c.slew, c.walk, c.late, c.gate, c.floor_n, c.patience = slew**2, walk**2, late, 5.0, 10.0, 25
    for name, value in more.items():
        setattr(c, name, value)
    p.axes[:3], p.axes[3:] = R_FIRST.T, R_SECOND.T
    p.noise = NOISE**2
    np.fill_diagonal(p.covariance, [slew**2] * 3 + [zero**2] * 6)
    return c, p


def shown(p: Record, f: Float, rng: np.random.Generator, off: Float | float = 0.0) -> None:
    p.reading = p.axes @ f + off + NOISE * rng.standard_normal(6)


def test_steady_variance_is_that_of_the_riccati_equation() -> None:
    """Zeros known: the force alone, two sensors turned against each other."""
    c, p = pair(walk=1e-9, zero=1e-6)
    p.reading = 0.0
    for _ in range(400):
        assert pair_step(c, p, T, BOTH)
    H, R, Q = np.asarray(p.axes), np.diag(NOISE**2), c.slew * T * np.eye(3)
    before = scipy.linalg.solve_discrete_are(np.eye(3), H.T, Q, R)
    after = np.linalg.inv(np.linalg.inv(before) + H.T @ np.linalg.inv(R) @ H)
    np.testing.assert_allclose(p.covariance[:3, :3], after, rtol=1e-6, atol=1e-6)


def test_without_memory_it_is_the_mean_weighted_by_inverse_variances() -> None:
    """A force that may be anything in the next cycle."""
    c, p = pair(slew=1e5, walk=1e-9, zero=1e-6)
    y = np.array([30.0, -60.0, 90.0, 40.0, 10.0, 70.0])
    p.reading = y
    c.floor_n = 1e9
    pair_step(c, p, T, BOTH)
    H, W = np.asarray(p.axes), np.diag(NOISE**-2.0)
    np.testing.assert_allclose(p.x[:3], np.linalg.solve(H.T @ W @ H, H.T @ W @ y), rtol=1e-6)


def test_the_spread_of_the_error_is_what_the_filter_states() -> None:
    """A force and zeros that walk as the filter thinks, rates that differ: normalised error about one."""
    rng = np.random.default_rng(7)
    c, p = pair()
    f, z, squares = np.zeros(3), rng.standard_normal(6), []
    for k in range(6000):
        f = f + 300.0 * np.sqrt(T) * rng.standard_normal(3)
        z = z + 0.1 * np.sqrt(T) * rng.standard_normal(6)
        shown(p, f, rng, z)
        pair_step(c, p, T, BOTH if k % 3 == 0 else SECOND if k % 3 == 1 else FIRST)
        error = p.x[:3] - f
        squares.append(error @ np.linalg.solve(p.covariance[:3, :3], error) / 3.0)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.1)


def test_two_are_better_than_either_alone() -> None:
    """Same force, same noise."""
    rms = {}
    for fresh in (FIRST, SECOND, BOTH):
        rng = np.random.default_rng(11)
        (c, p), f, errors = pair(), np.zeros(3), []
        for _ in range(4000):
            f = f + 300.0 * np.sqrt(T) * rng.standard_normal(3)
            shown(p, f, rng)
            pair_step(c, p, T, fresh)
            errors.append(p.x[:3] - f)
        rms[fresh] = float(np.sqrt(np.mean(np.square(errors))))
    assert rms[BOTH] < 0.9 * min(rms[FIRST], rms[SECOND])


@pytest.mark.parametrize("left", [FIRST, SECOND])
def test_one_falls_away_without_a_jump(left: int) -> None:
    """Zeros 6 N apart that the filter has learnt: the force goes on within the noise of the one that is left."""
    rng = np.random.default_rng(3)
    c, p = pair(walk=0.5, zero=5.0)
    off = np.array([3.0, 3.0, -3.0, -3.0, -3.0, 3.0])
    f = np.array([80.0, -150.0, 40.0])
    seen = []
    for k in range(4000):
        shown(p, f, rng, off)
        pair_step(c, p, T, BOTH if k < 3000 else left)
        seen.append(np.array(p.x[:3]))
    before, after = np.mean(seen[2500:3000], axis=0), np.mean(seen[3000:3500], axis=0)
    sigma = np.sqrt(np.diag(p.covariance[:3, :3]))
    assert np.all(np.abs(after - before) < 0.5 * sigma + 0.5)


def test_a_sensor_that_jumps_is_an_alarm_and_nothing_is_taken_meanwhile() -> None:
    """After 0.1 s, gone again once both have agreed for as long; the force stands still, the jump does not enter."""
    rng = np.random.default_rng(5)
    c, p = pair()
    f, alarms, seen = np.array([50.0, 20.0, -10.0]), [], []
    for k in range(600):
        shown(p, f, rng, np.r_[np.zeros(3), 120.0, 0.0, 0.0] if 200 <= k < 300 else 0.0)
        pair_step(c, p, T, BOTH)
        alarms.append(int(p.alarm))
        seen.append(np.array(p.x[:3]))
    assert not any(alarms[:224])
    assert all(alarms[224:300])
    assert not any(alarms[330:])
    assert np.ptp(np.array(seen)[200:300], axis=0).max() == 0.0
    assert p.gap_n < 60.0


def test_delays_that_differ_are_no_disagreement() -> None:
    """The second shows the force 12 ms later while it rises by 200 N in 60 ms."""
    rng = np.random.default_rng(9)
    c, p = pair(slew=1000.0, late=(0.0, 12e-3))
    force = np.clip((np.arange(300) - 150) / 15.0, 0.0, 1.0)[:, None] * np.array([200.0, 0.0, 0.0])
    for k in range(3, 300):
        p.reading[:3] = p.axes[:3] @ force[k] + NOISE[:3] * rng.standard_normal(3)
        p.reading[3:] = p.axes[3:] @ force[k - 3] + NOISE[3:] * rng.standard_normal(3)
        pair_step(c, p, T, BOTH)
        assert p.alarm == 0
        assert p.differing == 0

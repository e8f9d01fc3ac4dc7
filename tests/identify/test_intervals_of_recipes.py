"""Intervals of single recipes hold the truth although the model lacks what real records show."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.core.arrays import Bool, Float, Int
from counterflex.files.cell.cell import read_cell
from counterflex.files.dataset.reader import read_dataset
from counterflex.geometry import rotation
from counterflex.identify.payload.residuals import Knowledge, SensorEffects, SensorReadings, parameters
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.jackknife import parts_of_groups, stretches, widened, with_correlation, with_jackknife
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.identify.solver.solve import Stop, solve
from counterflex.identify.timing.delay import Delay, find_delay
from counterflex.identify.timing.pairs import pairs
from counterflex.sensing.flange_sensor import FlangeSensor

ROOT = Path(__file__).parents[2]
DRAWN = 40


@pytest.fixture(scope="module")
def kuka() -> Delay:
    """The link encoders of the KR 300 after its motor encoders."""
    cell = model_of(read_cell(ROOT / "examples/cells/kr300_d16_flat.toml"))
    data = read_dataset(ROOT / "examples/data/kuka_kr300_r2500_trajectories/timing.toml")
    (pair,) = pairs(cell, data, "link_encoder")
    return find_delay(pair)


@pytest.mark.long
def test_intervals_hold_with_what_the_model_of_the_kr300_lacks(kuka: Delay) -> None:
    """The record is made anew from the values found, with its own residuals put at another time and sign.

    What is left of the real record is no noise: it has a memory of a second. The long-run covariance, which is cut off
    sooner, holds delay and torsion in about half of the cases.
    """
    truth, block = kuka.fit.values, kuka.block
    ideal, left = block.predict(truth), block.measured - block.predict(truth)
    rng, n = np.random.default_rng(0), len(left)
    wanted = [i for i, name in enumerate(kuka.parameters.names) if "delay" in name or "compliance" in name]
    inside: dict[str, list[Bool]] = {"before": [], "now": []}
    for _ in range(DRAWN):
        shifted = [np.roll(left[:, c], rng.integers(n)) * rng.choice([-1.0, 1.0]) for c in range(left.shape[1])]
        drawn = replace(block, measured=ideal + np.stack(shifted, axis=1))
        fit = solve(kuka.parameters, [drawn], robust=False, start=truth, stop=Stop(tolerance=1e-7, evaluations=5))
        before = with_correlation(fit, [drawn])
        now = widened(before, np.diag(with_jackknife(fit, [drawn], stretches([drawn])).covariance))
        for name, one in (("before", before), ("now", now)):
            inside[name].append(np.abs(one.values - truth)[wanted] < 1.96 * one.sigma[wanted])
    assert np.mean(inside["before"]) < 0.7
    assert np.mean(inside["now"]) > 0.88


@pytest.mark.long
def test_thirds_of_the_kr300_record_agree_within_their_intervals(kuka: Delay) -> None:
    cell = model_of(read_cell(ROOT / "examples/cells/kr300_d16_flat.toml"))
    data = read_dataset(ROOT / "examples/data/kuka_kr300_r2500_trajectories/timing.toml")
    n = np.arange(len(data))
    thirds = []
    for k in range(3):
        (pair,) = pairs(cell, data.rows(n * 3 // len(n) == k), "link_encoder")
        thirds.append(find_delay(pair))
    names = [name for name in kuka.parameters.names if "compliance" in name]
    beyond = sum(
        abs(a.fit.value(name) - b.fit.value(name)) > 1.96 * np.hypot(a.fit.sigma_of(name), b.fit.sigma_of(name))
        for name in names
        for a, b in ((thirds[0], thirds[1]), (thirds[0], thirds[2]), (thirds[1], thirds[2]))
    )
    assert beyond <= 1


SENSOR = FlangeSensor("sensor", np.eye(4), 80.0, np.array([0.01, -0.02, 0.25]))


def oriented(rng: np.random.Generator, count: int, sigma: Float, error: Float) -> SensorReadings:
    """Readings of a sensor in random orientations: stated standard deviations (6,), drawn errors (count, 6)."""
    R = rotation.from_quat_wxyz(rng.standard_normal((count, 4)))
    gamma = R.swapaxes(1, 2) @ np.array([0.0, 0.0, -9.80665])
    still = np.zeros((count, 3))
    block = SensorReadings(
        name="sensor",
        group=np.arange(count, dtype=np.int64),
        sigma=np.broadcast_to(sigma, (count, 6)).copy(),
        w_sensor=np.zeros((count, 6)),
        R_base_sensor=R,
        R_rest=R,
        gamma=gamma,
        omega=still,
        alpha=still,
        time_s=np.zeros(count),
        warmer_k=np.zeros(count),
    )
    known = parameters(SENSOR, Knowledge(), SensorEffects())
    return replace(block, w_sensor=-block.evaluate(known.nominal) * block.sigma + error)


@pytest.mark.long
@pytest.mark.parametrize("count", [12, 30])
def test_intervals_of_the_payload_hold_where_single_components_are_worse_than_stated(count: int) -> None:
    """Two components of the force are four times as noisy as stated: one factor for all six promises too much."""
    sigma = np.array([0.5, 0.5, 0.5, 0.1, 0.1, 0.1])
    free = parameters(SENSOR, Knowledge(), SensorEffects())
    before: list[list[bool]] = []
    now: list[list[bool]] = []
    for seed in range(DRAWN):
        rng = np.random.default_rng(seed)
        noise = sigma * np.array([4.0, 4.0, 1.0, 1.0, 1.0, 1.0]) * rng.standard_normal((count, 6))
        block = oriented(rng, count, sigma, noise)
        fit = solve(free, [block])
        wide = with_jackknife(fit, [block], parts_of_groups([block]))
        for one, into in ((fit, before), (wide, now)):
            off = np.abs(one.values - free.nominal)
            into.append([bool(off[i] < 1.96 * one.sigma[i]) for i in (0, 1, 6)])
    assert np.mean(before) < 0.9
    assert 0.92 < np.mean(now) < 0.99


class Line:
    """``y = a + b t`` with unit standard deviation."""

    name, components = "line", ("y m",)

    def __init__(self, t: Float, y: Float, group: Int) -> None:
        self.t, self.y, self.group = t, y, group
        self.sigma = np.ones((len(t), 1))

    def evaluate(self, x: Float) -> Float:
        out: Float = (self.y - x[0] - x[1] * self.t)[:, None]
        return out

    def jacobian(self, x: Float) -> Float:
        out: Float = -np.stack([np.ones_like(self.t), self.t], axis=1).reshape(-1, 1, len(x))
        return out

    def subset(self, rows: Bool) -> Line:
        return Line(self.t[rows], self.y[rows], self.group[rows])


def line(rng: np.random.Generator, noise: Float) -> tuple[Parameters, Line, Fit]:
    t = np.sort(rng.uniform(-1.0, 1.0, len(noise)))
    p = Parameters.of([Parameter("a", "m", 0.0, np.inf, scale=1.0), Parameter("b", "m", 0.0, np.inf, scale=1.0)])
    block = Line(t, 0.3 + 2.0 * t + noise, np.arange(len(t)))
    return p, block, solve(p, [block], robust=False)


@pytest.mark.long
def test_one_step_is_the_fit_without_the_part() -> None:
    rng = np.random.default_rng(1)
    p, block, fit = line(rng, 5.0 * rng.standard_normal(60))
    parts = stretches([block])
    left_out = np.array([solve(p, [block.subset(parts[0] != k)], robust=False).values for k in range(10)])
    plain = np.sqrt(9.0 / 10.0 * np.sum((left_out - left_out.mean(axis=0)) ** 2, axis=0))
    fitted = with_jackknife(fit, [block], parts)
    np.testing.assert_allclose(np.maximum(fit.sigma, plain * np.sqrt(9.0 / 7.0)), fitted.sigma, rtol=0.05)


@pytest.mark.long
def test_white_noise_is_widened_little_and_never_narrowed() -> None:
    rng = np.random.default_rng(2)
    grown = []
    for _ in range(60):
        _, block, fit = line(rng, rng.standard_normal(80))
        wide = with_jackknife(fit, [block], parts_of_groups([block]))
        assert np.all(wide.sigma >= fit.sigma)
        np.testing.assert_array_equal(wide.values, fit.values)
        grown.append(wide.sigma / fit.sigma)
    assert np.mean(grown) < 1.15


@pytest.mark.long
def test_too_few_parts_say_nothing() -> None:
    rng = np.random.default_rng(3)
    _, block, fit = line(rng, rng.standard_normal(4))
    assert with_jackknife(fit, [block], parts_of_groups([block])) is fit

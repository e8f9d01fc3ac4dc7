"""Readings of one orientation are one measurement in the payload's intervals, however often they are read or copied."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.app.identification.cell_model import model_of
from counterflex.core.arrays import Float, as_float
from counterflex.core.progress import silent
from counterflex.core.units import DEG
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import rotation
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.payload.data import ALIKE_RAD, count_of, distinct, groups_of, orientations
from counterflex.identify.payload.recipe import RECIPE
from counterflex.identify.payload.residuals import Knowledge, SensorEffects, SensorReadings, parameters
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.jackknife import parts_of_groups, with_groups_once, with_jackknife
from counterflex.identify.solver.solve import solve
from counterflex.robot.elasticity.chain import flange
from counterflex.sensing.flange_sensor import FlangeSensor

SENSOR = FlangeSensor("sensor", np.eye(4), 80.0, np.array([0.01, -0.02, 0.25]))
SIGMA = np.array([0.5, 0.5, 0.5, 0.1, 0.1, 0.1])
LACK = 4.0
"""What the model lacks in one orientation, in standard deviations of a reading."""


def readings(R: Float, error: Float) -> SensorReadings:
    n = len(R)
    still = np.zeros((n, 3))
    gamma = R.swapaxes(1, 2) @ np.array([0.0, 0.0, -9.80665])
    block = SensorReadings(
        name="sensor",
        group=np.arange(n, dtype=np.int64),
        sigma=np.broadcast_to(SIGMA, (n, 6)).copy(),
        w_sensor=np.zeros((n, 6)),
        R_base_sensor=R,
        R_rest=R,
        gamma=gamma,
        omega=still,
        alpha=still,
        time_s=np.zeros(n),
        warmer_k=np.zeros(n),
    )
    known = parameters(SENSOR, Knowledge(), SensorEffects())
    return replace(block, w_sensor=-block.evaluate(known.nominal) * block.sigma + error)


def near_copies(rng: np.random.Generator, count: int, copies: int, jitter_rad: float) -> SensorReadings:
    """Each orientation read several times, a little turned, with noise of its own and one lack in common."""
    R = np.repeat(rotation.from_quat_wxyz(rng.standard_normal((count, 4))), copies, axis=0)
    R = R @ rotation.exp(jitter_rad * rng.uniform(-1.0, 1.0, (len(R), 3)))
    lack = np.repeat(LACK * SIGMA * rng.standard_normal((count, 6)), copies, axis=0)
    return readings(R, lack + SIGMA * rng.standard_normal((len(R), 6)))


def judged(block: SensorReadings) -> Fit:
    (group,) = groups_of([block], [True])
    block = replace(block, group=group)
    fit = solve(parameters(SENSOR, Knowledge(), SensorEffects()), [block])
    return with_jackknife(with_groups_once(fit, [block]), [block], parts_of_groups([block]))


@pytest.mark.long
@pytest.mark.parametrize(("count", "copies"), [(4, 8), (8, 5), (12, 4)])
def test_intervals_of_mass_hold_where_orientations_are_copied_or_nearly_so(count: int, copies: int) -> None:
    before: list[float] = []
    now: list[float] = []
    for seed in range(30):
        block = near_copies(np.random.default_rng(seed), count, copies, 0.3 * DEG)
        plain = solve(parameters(SENSOR, Knowledge(), SensorEffects()), [block])
        row_by_row = with_jackknife(plain, [block], parts_of_groups([block]))
        for fit, into in ((row_by_row, before), (judged(block), now)):
            into.append((fit.value("mass") - SENSOR.mass_kg) / fit.sigma_of("mass"))
    assert np.sqrt(np.mean(np.square(before))) > 1.7
    assert np.sqrt(np.mean(np.square(now))) < 1.25
    assert np.mean(np.abs(now) < 1.96) >= 0.9


@pytest.mark.parametrize("count", [4, 9])
def test_exact_copies_say_nothing_new(count: int) -> None:
    rng = np.random.default_rng(count)
    R = rotation.from_quat_wxyz(rng.standard_normal((count, 4)))
    error = LACK * SIGMA * rng.standard_normal((count, 6))
    once = judged(readings(R, error))
    copied = judged(readings(np.repeat(R, 8, axis=0), np.repeat(error, 8, axis=0)))
    assert copied.sigma_of("mass") > 0.6 * once.sigma_of("mass")


def test_readings_once_each_keep_their_intervals() -> None:
    block = near_copies(np.random.default_rng(1), 4, 1, 0.0)
    fit = solve(parameters(SENSOR, Knowledge(), SensorEffects()), [block])
    assert with_groups_once(fit, [block]) is fit


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 12), st.integers(1, 5), st.integers(0, 10_000))
def test_turns_about_the_vertical_and_small_ones_are_one_orientation(count: int, copies: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    tilt = as_float("tilt", rng.permutation(40)[:count] * 4.0 * DEG)
    R = np.repeat(rotation.about_x(tilt), copies, axis=0)
    R = rotation.about_z(rng.uniform(-3.0, 3.0, len(R))) @ R
    R = R @ rotation.exp(0.2 * ALIKE_RAD * rng.uniform(-1.0, 1.0, (len(R), 3)))
    order = rng.permutation(len(R))
    found = orientations(R[order])
    which = np.repeat(np.arange(count), copies)[order]
    assert len(np.unique(found)) == count == len({(a, b) for a, b in zip(found, which, strict=True)})
    assert distinct(readings(R, np.zeros((len(R), 6)))) == count


def test_files_share_orientations_motions_keep_their_own_and_named_groups_stay_whole() -> None:
    R = rotation.about_x(np.radians([0.0, 30.0, 60.0, 90.0]))
    zero = np.zeros((4, 6))
    first, second = readings(R, zero), readings(R[::-1], zero)
    named = replace(first, group=np.array([7, 7, 8, 9]))
    motion = replace(readings(R, zero), group=np.array([0, 0, 1, 1]))
    a, b, c = groups_of([named, replace(second, group=np.array([20, 21, 22, 23])), motion], [True, True, False])
    assert a[0] == a[1] != a[2] != a[3]
    assert b.tolist() == a[::-1].tolist()
    assert not set(c) & set(a)
    assert len(set(c)) == 2
    assert count_of([replace(first, group=a), replace(motion, group=c)]) == 5


def test_the_recipe_counts_orientations_and_says_so() -> None:
    """Twenty readings in seven orientations, some nearly copied: no hose pack is looked for, seven are said."""
    model = model_of(read_cell("examples/cells/kr300_d16_small.toml"))
    columns = RECIPE.propose(model, 7, {"seed": 3}).columns
    q = np.stack([columns[f"q{i}_rad"] for i in range(1, 7)], axis=1)
    rng = np.random.default_rng(2)
    q = np.concatenate([q, q, q[:6]]) + 0.4 * DEG * rng.uniform(-1.0, 1.0, (20, 6))
    R = flange(model.chain, q)[:, :3, :3]
    gamma = (R.swapaxes(1, 2) @ np.array([0.0, 0.0, -9.80665])) * 80.0
    moment = np.cross(np.array([0.0, 0.0, 0.2]), gamma)
    w = np.hstack([gamma, moment]) + SIGMA * rng.standard_normal((20, 6))
    data: Dataset = of_arrays("poses", "sensor_poses", {"q": q, "w_sensor": w}, {"w_sensor": SIGMA})
    found = RECIPE.identify(model, [data], [], {"as_stated": True}, silent)
    said = " ".join(found.remarks)
    assert "20 readings in 7 different orientations" in said
    assert "18 or more different orientations; the data have 7" in said

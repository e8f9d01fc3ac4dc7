"""Priors of an arm that its data contradict: zeros off by far more than stated, an exact arm seen with noise."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.identification.cell_model import model_of
from counterflex.core.arrays import Float
from counterflex.core.units import MM, MRAD, UM
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import pose, rotation
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.design.pose_candidates import measurable
from counterflex.identify.geometry.arm_geometry import displaced_arm
from counterflex.identify.geometry.arm_parameters import ArmPriors
from counterflex.identify.kinematics.setup import CalibrationSetup, set_up
from counterflex.identify.kinematics.stages import Widened, model_of_data, widened
from counterflex.identify.solver.solve import solve

CELL = model_of(read_cell(Path(__file__).resolve().parents[3] / "examples" / "cells" / "kr300_d10_ball.toml"))
SIGMA_M, SIGMA_RAD = 50.0 * UM, 0.1 * MRAD
Z = pose.make(rotation.exp(np.array([0.1, -0.2, 2.0])), np.array([4.0, 1.0, -0.5]))
X = pose.make(rotation.exp(np.array([0.3, 0.1, -0.4])), np.array([0.05, 0.03, 0.08]))
FAR = (10.0, 20.0, -35.0, 30.0, -15.0)
NEAR = (0.3, -0.4, 0.5, 0.2, -0.3)


@cache
def _q(count: int, seed: int) -> Float:
    return measurable(CELL, count, np.random.default_rng(seed))


def poses(zeros_mrad: tuple[float, ...], count: int, seed: int) -> Dataset:
    """Poses of an arm whose lengths and tilts are off by 0.3 mm and 0.3 mrad, its zeros as given."""
    rng, arm = np.random.default_rng(seed), np.random.default_rng(77)
    driven = [CELL.nominal_chain.names[i] for i in np.flatnonzero(CELL.nominal_chain.joint >= 0)]
    moves = {
        name: np.concatenate([arm.normal(0.0, 0.3 * MM, 3), arm.normal(0.0, 0.3 * MRAD, 2), [zero * MRAD]])
        for name, zero in zip(driven, zeros_mrad, strict=False)
    }
    q = _q(count, seed)
    B = pose.inverse(Z) @ displaced_arm(CELL.nominal_chain, q, moves).poses(np.zeros(0)) @ X
    return of_arrays(
        f"poses {seed}",
        "tracker_poses",
        {
            "q": q,
            "p_tracker_target": B[:, :3, 3] + SIGMA_M * rng.standard_normal((count, 3)),
            "R_tracker_target": B[:, :3, :3] @ rotation.exp(SIGMA_RAD * rng.standard_normal((count, 3))),
        },
        {"p_tracker_target": SIGMA_M, "R_tracker_target": SIGMA_RAD},
    )


def calibrated(zeros_mrad: tuple[float, ...], option: str = "evidence") -> tuple[Widened, float, float]:
    """Return what evidence makes of the priors, and the mean position error of other poses: with it and as stated."""
    data, unseen = [poses(zeros_mrad, 45, 1)], [poses(zeros_mrad, 20, 2)]

    def made(priors: ArmPriors) -> CalibrationSetup:
        return set_up(CELL, model_of_data(CELL, [*data, *unseen], priors, "cell", tied=False), data, unseen)

    setup = made(ArmPriors())
    fit = solve(setup.parameters, setup.blocks)
    found = widened(ArmPriors(), setup, fit, made, option)

    def error(s: CalibrationSetup, x: Float) -> float:
        (block,) = s.unseen
        return float(np.mean(np.linalg.norm((block.evaluate(x) * block.sigma)[:, :3], axis=1)))

    return found, error(found.setup, found.fit.values), error(setup, fit.values)


def test_zeros_far_off_are_found_and_the_prior_that_binds_is_named() -> None:
    found, after, before = calibrated(FAR)
    assert before > 5.0 * MM
    assert after < 2.5 * SIGMA_M  # noise alone: sqrt(8 / pi) of one component
    assert found.priors.length_m < 1.0 * MM
    assert 10.0 * MRAD < found.priors.of_zero < 34.0 * MRAD
    (said,) = found.remarks
    assert "contradict the priors" in said
    assert "zeros of the axes from 0.5 to" in said
    assert max(found.fit.sigma_factors) < 1.3


def test_an_arm_within_its_priors_keeps_them() -> None:
    found, after, before = calibrated(NEAR)
    assert found.priors == ArmPriors()
    assert found.remarks == ()
    assert after == before


def test_stated_priors_stay_on_request_and_are_named_where_they_bind() -> None:
    found, after, before = calibrated(FAR, "stated")
    assert after == before
    assert "The stated priors bind" in found.remarks[0]


@pytest.mark.parametrize("name", ["length_m", "angle_rad", "zero_rad"])
def test_the_prior_of_zeros_is_that_of_the_angles_unless_it_is_stated(name: str) -> None:
    priors = ArmPriors(**{name: 1e-2})
    assert priors.of_zero == (1e-2 if name != "length_m" else 0.5 * MRAD)

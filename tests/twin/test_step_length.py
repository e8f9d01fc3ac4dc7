"""The plant divides its step where a spring is too stiff for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float
from counterflex.core.errors import SimulationError
from counterflex.files.cell.cell import read_cell
from counterflex.twin.plant.mjcf import parts_of_step, step_is_stable
from counterflex.twin.plant.plant import Plant
from counterflex.twin.truth.family import FAMILIES
from counterflex.twin.truth.truth import Truth

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
H = 0.5e-3
POSTURE = np.radians([0.0, -90.0, 100.0, 40.0, -60.0, 10.0])


def radius(M: Float, K: Float, implicit: Float, explicit: Float, h: float) -> float:
    """Spectral radius of one step, from its matrix."""
    late = np.linalg.inv(M + h * implicit)
    speed, place = late @ (M - h * explicit), -h * late @ K
    n = len(M)
    return float(np.abs(np.linalg.eigvals(np.block([[speed, place], [h * speed, np.eye(n) + h * place]]))).max())


def matrix(rng: np.random.Generator, n: int, scale: float) -> Float:
    """Symmetric and positive."""
    a = rng.standard_normal((n, n))
    out: Float = scale * (a @ a.T + 0.1 * np.eye(n))
    return out


@given(st.integers(0, 2**32 - 1), st.integers(1, 6), st.floats(4.0, 8.0), st.floats(0.0, 2e3), st.floats(0.0, 2e3))
def test_a_step_that_is_called_stable_lets_nothing_grow(
    seed: int, n: int, exponent: float, late: float, early: float
) -> None:
    rng = np.random.default_rng(seed)
    M, K = matrix(rng, n, 1.0), matrix(rng, n, 10.0**exponent)
    implicit, explicit = matrix(rng, n, late), matrix(rng, n, early)
    if step_is_stable(M, K, implicit, explicit, H):
        assert radius(M, K, implicit, explicit, H) <= 1.0 + 1e-9


@pytest.mark.parametrize(("late", "early"), [(0.0, 0.0), (300.0, 0.0), (0.0, 300.0)])
def test_the_limit_of_one_mass_is_exact(late: float, early: float) -> None:
    """``h^2 k = 4 m + 2 h (d - d_e)``: a hair below it is stable, a hair above it is not."""
    one = np.eye(1)
    limit = (4.0 + 2.0 * H * (late - early)) / H**2
    for share, stable in ((1.0 - 1e-6, True), (1.0 + 1e-6, False)):
        case = one, share * limit * one, late * one, early * one
        assert step_is_stable(*case, H) is stable
        assert (radius(*case, H) <= 1.0) is stable


def test_twice_the_frequency_takes_half_the_step() -> None:
    one, none = np.eye(1), np.zeros((1, 1))
    inertia = lambda _: one  # noqa: E731
    soft = 1.0 / H**2
    assert [parts_of_step(inertia, k * soft * one, none, none, H) for k in (1.0, 4.0, 16.0, 64.0)] == [1, 2, 4, 8]
    with pytest.raises(SimulationError, match="too stiff for its inertia"):
        parts_of_step(inertia, 1e5 * soft * one, none, none, H)


@pytest.fixture(scope="module")
def stiff() -> Truth:
    """A cell whose wrist friction is too stiff for half a millisecond."""
    return truth_of(read_cell(EXAMPLES / "cells" / "kr300_d16_small.toml"), 2, FAMILIES["mild"])


def ringing_n(plant: Plant) -> float:
    """Range of the force in front of the last body from 0.3 to 0.5 s after a knock of 50 N on the standing robot."""
    plant.reset(POSTURE)
    name, still, knock = plant.truth.bodies[-1].name, np.zeros(6), np.array([30.0, 40.0, 0.0, 0.0, 0.0, 0.0])
    forces = []
    for k in range(1000):
        plant.step(POSTURE, still, knock if k < 20 else still)
        if k >= 600:
            forces.append(plant.section_wrench(name)[:3])
    return float(np.ptp(forces, axis=0).max())


def test_a_knock_leaves_the_swing_of_the_arm_and_nothing_of_the_steps(stiff: Truth) -> None:
    """Divided as the plant does, the force is that of steps four times as short; undivided, the friction adds to it."""
    divided, shorter, whole = (ringing_n(Plant(stiff, parts=parts)) for parts in (None, 8, 1))
    assert divided == pytest.approx(shorter, rel=0.01)
    assert whole > 2.0 * shorter


def test_a_divided_step_is_the_motion_of_shorter_steps(truth: Truth, poses_rad: Float) -> None:
    """Two halves of a step end where two steps of half the length do."""
    q, qd, load = poses_rad[1], np.array([0.1, -0.2, 0.1, 0.3, 0.0, 0.2]), np.array([100.0, -50.0, 30.0, 0.0, 0.0, 0.0])
    halves, short = Plant(truth, parts=2), Plant(truth, step_s=0.25e-3, parts=1)
    for plant in (halves, short):
        plant.reset(q, None, qd)
    for k in range(200):
        reference = q + k * halves.step_s * qd
        halves.step(reference, qd, load)
        for part in (0.0, 0.5):
            short.step(reference + part * halves.step_s * qd, qd, load)
    np.testing.assert_allclose(halves.tcp_pose(), short.tcp_pose(), atol=1e-12)
    assert halves.time_s == pytest.approx(short.time_s)

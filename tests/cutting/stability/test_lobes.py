"""Zeroth-order lobes: closed form of turning, the characteristic equation, published minima, another method."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from counterflex.core.errors import InputError
from counterflex.cutting.stability import lobes, semi_discretisation
from counterflex.cutting.stability.modes import TipModes, modes_along
from counterflex.cutting.stability.process import Process, process_of_arc

STIFFNESS = 0.03993 * (2.0 * np.pi * 922.0) ** 2
ROUND = modes_along(
    np.full(2, 922.0), np.full(2, 0.011), np.full(2, STIFFNESS), np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
)
"""Benchmark of Insperger and Ding: 922 Hz, damping 0.011, modal mass 0.03993 kg in x and y."""
SLOT = process_of_arc(0.0, np.pi, 6e8, 2e8, 2)
HALF_UP = process_of_arc(0.0, 0.5 * np.pi, 6e8, 2e8, 2)


@pytest.mark.parametrize(
    ("k", "zeta", "kf"), [(2.26e8, 0.012, 1e9), (2e7, 0.05, 2e9), (4e5, 0.1, 1.5e9)], ids=["survey", "tool", "robot"]
)
def test_turning_on_one_mode(k: float, zeta: float, kf: float) -> None:
    """``a_min = 2 k zeta (1 + zeta) / Kf``; for the first, 5.489088 mm."""
    mode = modes_along(np.array([150.0]), np.array([zeta]), np.array([k]), np.array([[1.0, 0.0, 0.0]]))
    A = np.diag([kf, 0.0, 0.0])
    omega = lobes.frequencies_for(mode)
    factor, _ = lobes.curves(A, mode.response(omega))
    assert factor.min() == pytest.approx(2.0 * k * zeta * (1.0 + zeta) / kf, rel=1e-3)
    periods = np.linspace(0.002, 0.05, 400)
    limits, _ = lobes.limits(A, mode.response(omega), omega, periods)
    assert limits.min() >= factor.min() * (1.0 - 1e-9)


@pytest.mark.parametrize(("process", "least_mm"), [(SLOT, 0.0479), (HALF_UP, 0.1267)], ids=["slot", "half immersion"])
def test_least_limits_of_the_benchmark(process: Process, least_mm: float) -> None:
    factor, _ = lobes.curves(process.mean, ROUND.response(lobes.frequencies_for(ROUND)))
    assert factor.min() * 1e3 == pytest.approx(least_mm, rel=2e-3)


@pytest.mark.parametrize("rank", [3, 2, 1])
def test_limits_meet_the_characteristic_equation(rank: int) -> None:
    """det(I + s (1 - exp(-i omega T)) A G) = 0, three directions, a matrix without symmetry, of any rank."""
    random = np.random.default_rng(3)
    modes = TipModes(
        2.0 * np.pi * np.array([30.0, 47.0, 90.0]), np.array([0.05, 0.03, 0.04]), 0.1 * random.normal(size=(3, 3))
    )
    left, size, right = np.linalg.svd(1e7 * random.normal(size=(3, 3)))
    A = (left[:, :rank] * size[:rank]) @ right[:rank]
    omega = lobes.frequencies_for(modes)
    periods = np.linspace(0.002, 0.02, 12)
    factors, chatter = lobes.limits(A, modes.response(omega), omega, periods)
    known = np.isfinite(factors)
    assert known.sum() >= 8
    G = modes.response(chatter[known])
    rest = []
    for s, w, T, g in zip(factors[known], chatter[known], periods[known], G, strict=True):
        loop = s * (1.0 - np.exp(-1j * w * T)) * A @ g
        rest.append(np.abs(np.linalg.eigvals(loop) + 1.0).min())
    assert max(rest) < 5e-3


@settings(max_examples=30)
@given(
    hz=st.tuples(*[st.floats(20.0, 200.0)] * 3),
    stiffness=st.tuples(*[st.floats(1e6, 1e8)] * 3),
    A=st.tuples(*[st.floats(1e6, 1e9)] * 3),
)
@example(hz=(40.0, 70.0, 110.0), stiffness=(3e7, 2e6, 5e7), A=(2e8, 2e8, 2e8))
@example(hz=(40.0, 70.0, 110.0), stiffness=(3e7, 5e7, 2e6), A=(2e8, 2e8, 2e8))
def test_directions_that_do_not_couple_have_the_least_of_their_own_limits(
    hz: tuple[float, ...], stiffness: tuple[float, ...], A: tuple[float, ...]
) -> None:
    """Whichever direction is the weakest at a speed."""
    f, damping, k = np.array(hz), np.full(3, 0.03), np.array(stiffness)
    modes = modes_along(f, damping, k, np.eye(3))
    omega, periods = lobes.frequencies_for(modes), np.linspace(0.002, 0.02, 12)
    whole, _ = lobes.limits(np.diag(A), modes.response(omega), omega, periods)
    alone = []
    for i in range(3):
        one = modes_along(f[i : i + 1], damping[:1], k[i : i + 1], np.eye(3)[:1])
        alone.append(lobes.limits(np.diag([A[i], 0.0, 0.0]), one.response(omega), omega, periods)[0])
    np.testing.assert_allclose(whole, np.min(alone, axis=0), rtol=1e-9)


def test_lobes_are_semi_discretisation_of_the_mean_coefficients() -> None:
    """Another method with nothing in common: the delay equation with constant coefficients, in the time domain."""

    class Constant(Process):
        def means(self, phi: np.ndarray) -> np.ndarray:
            return np.broadcast_to(self.mean, (len(phi) - 1, 3, 3))

    period = 60.0 / 9000.0 / 2.0
    omega = lobes.frequencies_for(ROUND)
    factors, _ = lobes.limits(SLOT.mean, ROUND.response(omega), omega, np.array([period]))
    constant = Constant(SLOT.arcs, SLOT.slopes_pa, SLOT.teeth)
    other = semi_discretisation.limit(
        ROUND, constant, period, most=4e-4, least=2e-4, intervals=160, tolerance=1e-4
    )  # fmt: skip
    assert factors[0] == pytest.approx(other, rel=2e-3)


def test_eigenvalues_stay_on_their_curve() -> None:
    """Two planes that do not couple: each has the limits that it has alone."""
    two = modes_along(
        np.array([900.0, 930.0]), np.full(2, 0.02), np.array([2e7, 3e7]), np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    )
    A = np.diag([1e9, 8e8, 0.0])
    omega, periods = lobes.frequencies_for(two), np.linspace(0.002, 0.006, 80)
    both, _ = lobes.limits(A, two.response(omega), omega, periods)
    alone = [
        lobes.limits(A, two.only(np.array([i])).response(omega), omega, periods)[0] for i in range(2)
    ]  # fmt: skip
    np.testing.assert_allclose(both, np.minimum(*alone), rtol=1e-6)


@pytest.mark.parametrize(
    ("omega", "periods"), [(np.array([2.0, 1.0]), np.array([0.01])), (np.array([1.0, 2.0]), np.array([0.0]))]
)
def test_bad_input(omega: np.ndarray, periods: np.ndarray) -> None:
    with pytest.raises(InputError):
        lobes.limits(np.eye(3), np.zeros((2, 3, 3), dtype=np.complex128), omega, periods)

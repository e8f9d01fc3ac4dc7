"""The low-frequency criterion: closed form of one mode, semi-discretisation, signs in up- and down-milling."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.cutting.stability import low_frequency, semi_discretisation
from counterflex.cutting.stability.delayed import least_damping
from counterflex.cutting.stability.modes import TipModes, modes_along
from counterflex.cutting.stability.process import Process, process_of_arc

TURN = 2.0 * np.pi
X, Y = np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])


def _one(direction: np.ndarray, zeta: float = 0.03) -> TipModes:
    """A robot: 390 N/mm, 10 Hz."""
    return modes_along(np.array([10.0]), np.array([zeta]), np.array([3.9e5]), direction)


UP = process_of_arc(0.0, 0.5 * np.pi, 8e8, 3e8, 3)
DOWN = process_of_arc(0.5 * np.pi, np.pi, 8e8, 3e8, 3)


def test_closed_form_of_one_mode() -> None:
    """``w < 2 zeta k / (omega T |u'Au|)``."""
    T = 60.0 / 13000.0 / 3.0
    u = Y[0]
    expected = 2.0 * 0.03 * 3.9e5 / (TURN * 10.0 * T * abs(u @ UP.mean @ u))
    assert _separate_limits(_one(Y), UP.mean, T)[0] == pytest.approx(expected, rel=1e-12)
    assert low_frequency.limit(_one(Y), UP.mean, T)[0] == pytest.approx(expected, rel=1e-6)
    assert low_frequency.limit(_one(Y), UP.mean, T)[1] == pytest.approx(TURN * 10.0, rel=0.01)


@pytest.mark.parametrize(
    ("process", "feeds", "damps"), [(UP, Y, X), (DOWN, X, Y)], ids=["up: the normal", "down: the feed"]
)
def test_direction_that_half_immersion_destabilises(process: Process, feeds: np.ndarray, damps: np.ndarray) -> None:
    assert np.isfinite(low_frequency.limit(_one(feeds), process.mean, 1e-3)[0])
    assert low_frequency.limit(_one(damps), process.mean, 1e-3)[0] == np.inf


def test_half_immersion_turns_at_a_ratio_of_two_over_pi() -> None:
    for ratio, stable in ((0.62, False), (0.65, True)):
        process = process_of_arc(0.0, 0.5 * np.pi, 8e8, ratio * 8e8, 3)
        assert np.isinf(_separate_limits(_one(Y), process.mean, 1e-3)[0]) == stable


def test_a_slot_damps_every_direction() -> None:
    process = process_of_arc(0.0, np.pi, 8e8, 3e8, 3)
    for angle in np.linspace(0.0, np.pi, 7):
        u = np.array([[np.cos(angle), np.sin(angle), 0.0]])
        assert low_frequency.limit(_one(u), process.mean, 1e-3)[0] == np.inf


def _cases(count: int) -> list[tuple[TipModes, Process, float]]:
    """Robots with two modes, one to four teeth, any engagement, omega T of the faster mode from 0.02 to 0.1."""
    random = np.random.default_rng(1)
    out: list[tuple[TipModes, Process, float]] = []
    while len(out) < count:
        f, ratio = random.uniform(5.0, 36.0), random.uniform(0.01, 0.08)
        T = random.uniform(0.02, 0.1) / (TURN * f)
        phi = np.arccos(1.0 - 2.0 * random.uniform(0.1, 0.9))
        arc = (0.0, phi) if random.random() < 0.5 else (np.pi - phi, np.pi)
        entry, leave = arc
        process = process_of_arc(entry, leave, 8e8, random.uniform(0.2, 0.6) * 8e8, int(random.integers(1, 5)))
        u = random.normal(size=(2, 3))
        u[:, 2] = 0.0
        frequencies = np.array([f, f * random.uniform(0.4, 1.0)])
        modes = modes_along(frequencies, np.full(2, ratio), np.array([3.9e5, 6e5]), u)
        if np.isfinite(low_frequency.limit(modes, process.mean, T)[0]):
            out.append((modes, process, T))
    return out


@pytest.mark.parametrize("case", _cases(10), ids=[f"robot {i}" for i in range(10)])
def test_within_one_percent_of_semi_discretisation(case: tuple[TipModes, Process, float]) -> None:
    modes, process, T = case
    assert modes.omega_rad_s.max() * T <= 0.1
    factor, _ = low_frequency.limit(modes, process.mean, T)
    other = semi_discretisation.limit(modes, process, T, most=1.1 * factor, least=0.95 * factor, tolerance=5e-4)
    assert factor == pytest.approx(other, rel=0.01)


def test_what_is_stable_is_stable_by_semi_discretisation_up_to_the_valid_depth() -> None:
    process = process_of_arc(0.0, np.pi, 8e8, 3e8, 3)
    modes = modes_along(np.array([10.0, 17.0]), np.full(2, 0.03), np.array([4e5, 6e5]), np.eye(3)[:2])
    assert low_frequency.limit(modes, process.mean, 1e-3)[0] == np.inf
    deepest = low_frequency.valid_factor(modes, process.mean, 1e-3)
    for share in (0.1, 0.5, 1.0):
        assert semi_discretisation.largest_multiplier(modes, process, 1e-3, share * deepest) < 1.0


def test_error_grows_as_the_docstring_says() -> None:
    """(omega T)^2 / 6: 1.5 % at 0.3."""
    T = 0.3 / (TURN * 10.0)
    low, _ = low_frequency.limit(_one(Y), UP.mean, T)
    other = semi_discretisation.limit(_one(Y), UP, T, most=1.2 * low, least=0.9 * low, tolerance=2e-4)
    assert low / other - 1.0 == pytest.approx(-(0.3**2) / 6.0, abs=0.006)


def test_least_damping_of_one_mode_is_its_own_and_that_of_the_cut() -> None:
    modes, process = _one(Y), process_of_arc(0.0, 0.5 * np.pi, 700e6, 210e6, 3, 1e-4)
    T, omega = 1e-4, float(modes.omega_rad_s[0])
    fed = float(modes.shape[:, 0] @ process.mean @ modes.shape[:, 0])
    expected = 0.03 + T * fed / (2.0 * omega)
    assert least_damping(modes, process.mean, T) == pytest.approx(expected, rel=1e-3)


def test_least_damping_of_a_slow_mode_alone_is_zero_at_its_separate_limit() -> None:
    """What the separate limit leaves out is of the order of ``(omega T)^2 / 6``."""
    for modes, process, T in _cases(12):
        for k, factor in enumerate(_separate_limits(modes, process.mean, T)):
            if np.isfinite(factor):
                left = least_damping(modes.only(np.array([k])), factor * process.mean, T)
                assert left == pytest.approx(0.0, abs=0.1 * float(modes.damping_ratio[k]))


def _separate_limits(modes: TipModes, A: Float, period_s: float) -> Float:
    """Limit of each mode by itself, ``2 zeta omega / (T |u'Au|)`` with mass-normalised u; inf where u'Au >= 0."""
    along = np.einsum("in,ij,jn->n", modes.shape, A, modes.shape)
    feeding = along < 0.0
    damping = 2.0 * modes.damping_ratio * modes.omega_rad_s
    out: Float = np.where(feeding, damping / (period_s * np.where(feeding, -along, 1.0)), np.inf)
    return out

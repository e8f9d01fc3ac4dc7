"""Semi-discretisation against the published benchmark and against the delay equation integrated in time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, strategies as st
from scipy.integrate import solve_ivp

import milling_collocation
from counterflex.core.errors import InputError
from counterflex.cutting.stability.modes import TipModes, modes_along
from counterflex.cutting.stability.process import Process, process_of_arc
from counterflex.cutting.stability.semi_discretisation import intervals_for, largest_multiplier, limit

STIFFNESS = 0.03993 * (2.0 * np.pi * 922.0) ** 2
X = np.array([[1.0, 0.0, 0.0]])
ONE = modes_along(np.array([922.0]), np.array([0.011]), np.array([STIFFNESS]), X)
ROUND = modes_along(np.full(2, 922.0), np.full(2, 0.011), np.full(2, STIFFNESS), np.eye(3)[:2])
SLOT = process_of_arc(0.0, np.pi, 6e8, 2e8, 2)
HALF = process_of_arc(0.0, 0.5 * np.pi, 6e8, 2e8, 2)
SHALLOW_DOWN = process_of_arc(np.pi - np.arccos(0.9), np.pi, 6e8, 2e8, 2)
"""a_e = 0.05 D."""


@pytest.mark.parametrize(("depth_mm", "mu"), [(0.2, 0.8197), (0.5, 1.0740), (0.7, 1.2216), (1.0, 1.4065)])
def test_multipliers_of_the_benchmark(depth_mm: float, mu: float) -> None:
    """Slot, two teeth, 5000 rpm, one mode in x; the error falls with the square of the intervals (Richardson)."""
    coarse, fine = (largest_multiplier(ONE, SLOT, 0.006, depth_mm * 1e-3, k) for k in (100, 200))
    assert fine + (fine - coarse) / 3.0 == pytest.approx(mu, abs=2e-4)
    assert largest_multiplier(ONE, SLOT, 0.006, depth_mm * 1e-3) == pytest.approx(mu, rel=0.01)


def test_the_delayed_wave_is_linear_between_its_ends() -> None:
    """Then it is too small by ``(omega T / k)^2 / 12``, and the multiplier by less; as a constant, by twice that."""
    period, k, mu = 0.006, 100, 1.40647
    wave = (2.0 * np.pi * 922.0 * period / k) ** 2 / 12.0
    assert 0.5 * wave < 1.0 - largest_multiplier(ONE, SLOT, period, 1e-3, k) / mu < wave


@pytest.mark.parametrize(
    ("process", "rpm", "limit_mm"),
    [
        (SLOT, 9000, 0.345),
        (SLOT, 12000, 0.0852),
        (SLOT, 15000, 0.1145),
        (SLOT, 18000, 0.0480),
        (SLOT, 22000, 0.1202),
        (HALF, 9000, 0.948),
        (HALF, 12000, 0.2423),
        (HALF, 15000, 0.2821),
        (HALF, 18000, 0.1307),
        (HALF, 22000, 0.3565),
        (SHALLOW_DOWN, 12000, 8.06),
        (SHALLOW_DOWN, 15000, 1.668),
        (SHALLOW_DOWN, 18000, 3.706),
        (SHALLOW_DOWN, 22000, 10.59),
    ],
)
def test_limits_of_two_directions(process: Process, rpm: float, limit_mm: float) -> None:
    """Reference values at 50 intervals of a tooth period. At 6000 rpm those have not converged, see below."""
    value = limit(
        ROUND, process, 30.0 / rpm, most=1.2e-3 * limit_mm, least=0.85e-3 * limit_mm, intervals=50, tolerance=5e-4
    )
    assert value * 1e3 == pytest.approx(limit_mm, rel=0.01)


def _growth_in_time(modes: TipModes, process: Process, period: float, factor: float, periods: int) -> float:
    """Growth per tooth period of the delay equation, integrated by scipy period after period."""
    n = len(modes)
    speed = 2.0 * np.pi / (process.teeth * period)
    begin = 2.0 * np.pi * np.arange(process.teeth) / process.teeth
    step = 1e-6

    def coefficients(t: float) -> np.ndarray:
        phi = begin + speed * t
        out: np.ndarray = (process.up_to(phi + step) - process.up_to(phi - step)).sum(axis=0) / (2.0 * step)
        return out

    table = np.array([coefficients(t) for t in np.linspace(0.0, period, 201)])
    sizes, state, before = [], np.concatenate([np.zeros(n), np.ones(n)]), None
    for _ in range(periods):

        def slope(t: float, x: np.ndarray, delayed=before) -> np.ndarray:  # type: ignore[no-untyped-def]
            place = min(t / period * 200.0, 199.999)
            at = int(place)
            a = table[at] + (place - at) * (table[at + 1] - table[at])
            past = np.zeros(n) if delayed is None else delayed(t)[:n]
            force = -factor * a @ (modes.shape @ (x[:n] - past))
            damping = 2.0 * modes.damping_ratio * modes.omega_rad_s * x[n:]
            return np.concatenate([x[n:], modes.shape.T @ force - damping - modes.omega_rad_s**2 * x[:n]])

        run = solve_ivp(slope, (0.0, period), state, rtol=1e-5, atol=1e-9, max_step=period / 20.0, dense_output=True)
        before, state = run.sol, run.y[:, -1]
        sizes.append(float(np.abs(run.y[n:]).max()))
    late = np.log(sizes[periods // 3 :])
    return float(np.exp(np.polyfit(np.arange(len(late)), late, 1)[0]))


@pytest.mark.parametrize(
    ("process", "modes", "rpm", "depth_mm"),
    [(SLOT, ONE, 5000, 1.0), (HALF, ROUND, 12000, 0.4)],
    ids=["slot", "half immersion"],
)
def test_multiplier_is_the_growth_of_the_delay_equation(
    process: Process, modes: TipModes, rpm: float, depth_mm: float
) -> None:
    period = 30.0 / rpm
    expected = _growth_in_time(modes, process, period, depth_mm * 1e-3, 24)
    assert largest_multiplier(modes, process, period, depth_mm * 1e-3, 150) == pytest.approx(expected, rel=0.01)


def test_the_slowest_speed_of_the_reference_has_not_converged() -> None:
    """5 % down-milling at 6000 rpm: 1.654 mm is printed for 50 intervals. Integrated in time, 1.62 mm chatters."""
    assert _growth_in_time(ROUND, SHALLOW_DOWN, 0.005, 1.62e-3, 24) > 1.005
    assert limit(ROUND, SHALLOW_DOWN, 0.005, most=1.8e-3, least=1.3e-3, intervals=200) == pytest.approx(
        1.54e-3, rel=5e-3
    )


def test_a_cut_of_no_depth_is_the_free_swing() -> None:
    mu = largest_multiplier(ONE, SLOT, 0.006, 0.0)
    assert mu == pytest.approx(np.exp(-0.011 * 2.0 * np.pi * 922.0 * 0.006), rel=1e-6)


def test_intervals_follow_the_fastest_mode() -> None:
    assert len(intervals_for(ONE, SLOT, 1e-4)) == 41
    wanted = 2.0 * np.pi * 922.0 * 0.006 / 0.3
    assert len(intervals_for(ONE, SLOT, 0.006)) == pytest.approx(wanted + 1.0, abs=1.0)


def test_free_motion_is_one_interval() -> None:
    """5 % immersion cuts for a seventh of the pitch: the intervals lie there, before it one long one."""
    edges = intervals_for(ROUND, SHALLOW_DOWN, 0.005)
    assert len(edges) == 42
    assert edges[1] == pytest.approx(np.pi - np.arccos(0.9), rel=1e-12)
    assert edges[-1] == np.pi


@given(
    first=st.floats(0.0, 3.0), length=st.floats(0.05, 3.0), second=st.floats(0.0, 3.0), teeth=st.integers(1, 6)
)  # fmt: skip
@example(first=0.0, length=2.0, second=1.5707963267341256, teeth=4)  # the end of an arc just before that of the pitch
def test_intervals_hold_all_that_is_cut(first: float, length: float, second: float, teeth: int) -> None:
    """Outside the engaged stretches nothing feeds back, and the means over the intervals keep the whole."""
    arcs = np.array([[begin, min(begin + length, np.pi), 1e-3, 0.5 * np.pi] for begin in sorted({first, second})])
    process = Process(arcs, np.array([6e8, 2e8, 0.0]), teeth)
    edges = intervals_for(ONE, process, 0.005)
    a = process.means(edges)
    np.testing.assert_allclose(np.diff(edges) @ a.reshape(len(a), 9), process.up_to(np.array(np.pi)).ravel(), rtol=1e-9)
    spans, middles = process.engaged(), 0.5 * (edges[1:] + edges[:-1])
    free = ~np.any((middles[:, None] > spans[:, 0]) & (middles[:, None] < spans[:, 1]), axis=1)
    assert np.all(np.abs(a[free]) < 1e-3)
    assert free.sum() <= len(spans) + 1


@pytest.mark.parametrize(
    ("entry", "leave", "rpm", "near_mm"),
    [
        (0.0, np.pi, 6000, 0.0484),
        (0.0, 0.5 * np.pi, 6000, 0.127),
        (np.pi - np.arccos(0.9), np.pi, 6000, 1.54),
        (np.pi - np.arccos(0.9), np.pi, 9000, 11.3),
        (np.pi - np.arccos(0.9), np.pi, 22000, 10.4),
        (np.pi - np.arccos(0.98), np.pi, 6000, 6.0),
    ],
)
def test_default_intervals_against_collocation(entry: float, leave: float, rpm: float, near_mm: float) -> None:
    """Another method, which converges spectrally: 0.5 % at any immersion and as slow as the benchmark goes."""
    cut = milling_collocation.Cut(2.0 * np.pi * 922.0, 0.011, STIFFNESS, entry, leave, (6e8, 2e8), 2)
    expected = milling_collocation.limit(cut, 30.0 / rpm, (0.5e-3 * near_mm, 1.3e-3 * near_mm))
    process = process_of_arc(entry, leave, 6e8, 2e8, 2)
    value = limit(ROUND, process, 30.0 / rpm, most=1.2 * expected, least=0.9 * expected, tolerance=2e-4)
    assert value == pytest.approx(expected, rel=5e-3)


def test_large_and_small_matrices_give_the_same() -> None:
    """Above 250 rows only the largest multipliers are computed."""
    small, large = (largest_multiplier(ONE, SLOT, 0.006, 0.5e-3, k) for k in (246, 254))
    assert large == pytest.approx(small, rel=1e-4)


@pytest.mark.parametrize("arguments", [(0.0, 1.0, None), (0.006, -1.0, None), (0.006, 1.0, 1)])
def test_bad_input(arguments: tuple[float, float, int | None]) -> None:
    with pytest.raises(InputError):
        largest_multiplier(ONE, SLOT, *arguments)

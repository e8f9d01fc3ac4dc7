"""ISO 230-4 figures and the error budget against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.evaluate.error_budget import REMAINDER, error_budget
from counterflex.evaluate.iso230.circular_test import Circularity

ANGLE: Float = np.linspace(0.0, 2 * np.pi, 721)


def circle(radius: Float | float, centre: tuple[float, float] = (0.0, 0.0)) -> Float:
    out: Float = np.stack([centre[0] + radius * np.cos(ANGLE), centre[1] + radius * np.sin(ANGLE)], axis=1)
    return out


def test_shifted_circle_is_round_but_not_in_place() -> None:
    found = Circularity.of(circle(0.15, (3e-4, -4e-4)), np.zeros(2), 0.15)
    assert found.g_m == pytest.approx(0.0, abs=1e-10)
    assert found.centre_offset_m == pytest.approx((3e-4, -4e-4), abs=1e-9)
    assert found.f_max_m == pytest.approx(5e-4, rel=1e-3)
    assert found.f_min_m == pytest.approx(-5e-4, rel=1e-3)


def test_oval_has_twice_its_amplitude() -> None:
    found = Circularity.of(circle(0.15 + 1e-4 * np.cos(2 * ANGLE), (1e-3, 0.0)), np.zeros(2), 0.15)
    assert found.g_m == pytest.approx(2e-4, rel=1e-4)
    assert found.radius_m == pytest.approx(0.15, abs=1e-8)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.floats(-1e-4, 1e-4), min_size=24, max_size=24), st.floats(-1e-3, 1e-3))
def test_minimum_zone_is_never_wider_than_about_any_other_centre(ripple: list[float], shift: float) -> None:
    radius = 0.1 + np.interp(ANGLE, np.linspace(0, 2 * np.pi, 25), [*ripple, ripple[0]])
    points = circle(radius)
    found = Circularity.of(points, np.array([shift, 0.0]), 0.1)
    about = np.linalg.norm(points, axis=1)
    assert found.g_m <= about.max() - about.min() + 1e-9
    assert found.f_max_m - found.f_min_m >= found.g_m - 1e-12


def test_hopeless_circles_are_refused() -> None:
    with pytest.raises(InputError, match="four points"):
        Circularity.of(circle(0.1)[:3], np.zeros(2), 0.1)
    with pytest.raises(InputError, match="too short"):
        Circularity.of(circle(0.1)[:100], np.zeros(2), 0.1)
    with pytest.raises(InputError, match="near the centre"):
        Circularity.of(circle(0.1), np.array([0.1, 0.0]), 0.1)


def test_shares_and_means_add_up() -> None:
    rng = np.random.default_rng(1)
    met = rng.normal(size=(500, 3)) * 1e-3
    budget = error_budget(met, {"axis 2": 0.6 * met, "gravity": -0.1 * met, "noise": rng.normal(size=(500, 3)) * 1e-4})
    shares = {line.name: line.share for line in budget}
    assert shares["axis 2"] == pytest.approx(0.6)
    assert shares["gravity"] == pytest.approx(-0.1)
    assert sum(shares.values()) == pytest.approx(1.0)
    assert sum(line.mean_m for line in budget) == pytest.approx(np.linalg.norm(met, axis=1).mean())
    assert budget[-1].name == REMAINDER
    assert budget[0].max_m == pytest.approx(0.6 * np.linalg.norm(met, axis=1).max())


def test_budget_refuses_what_it_cannot_split() -> None:
    with pytest.raises(InputError, match="no deviation"):
        error_budget(np.zeros((3, 3)), {})
    with pytest.raises(InputError, match="name of the remainder"):
        error_budget(np.ones((3, 3)), {REMAINDER: np.ones((3, 3))})
    with pytest.raises(InputError, match="wrong shape"):
        error_budget(np.ones((3, 3)), {"a": np.ones((2, 3))})

"""True edge path: brute force on sampled trochoids, published deviations of the circle, runout, bad input."""

from __future__ import annotations

import math

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ModelError
from counterflex.core.units import MM, UM
from counterflex.cutting.chip import circle_thickness, edge_radii, trochoid_thickness

PHI = np.linspace(0.02, math.pi - 0.02, 181)


def brute_force(phi: float, feed: float, radii: Float, tooth: int) -> float:
    """Sample each earlier path finely, pick by linear interpolation where it crosses the ray."""
    teeth = radii.size
    pitch = 2 * math.pi / teeth
    ray = np.array([math.sin(phi), math.cos(phi)])
    normal = np.array([ray[1], -ray[0]])
    reach = -math.inf
    for k in range(1, teeth + 1):
        back = k * pitch + np.linspace(-0.2, 0.2, 200_001)  # rotation since then
        angle = phi + k * pitch - back
        radius = radii[(tooth - k) % teeth]
        points = radius * np.stack([np.sin(angle), np.cos(angle)], axis=1)
        points[:, 0] -= feed / pitch * back
        side = points @ normal
        crossing = int(np.flatnonzero(np.diff(np.sign(side)) != 0)[0])
        share = side[crossing] / (side[crossing] - side[crossing + 1])
        point = points[crossing] * (1 - share) + points[crossing + 1] * share
        reach = max(reach, float(point @ ray))
    return float(radii[tooth] - reach)


@pytest.mark.parametrize(("radius", "feed", "flutes"), [(8.0, 0.0385, 3), (3.0, 0.1, 2), (0.25, 0.02, 2)])
@pytest.mark.parametrize("runout", [0.0, 0.004])
def test_newton_against_brute_force(radius: float, feed: float, flutes: int, runout: float) -> None:
    radii = edge_radii(radius, flutes, runout, 0.7)
    for phi in (0.05, 0.8, math.pi / 2, 2.2, 3.0):
        found = trochoid_thickness(phi, feed, radii, 1)[0]
        assert found == pytest.approx(brute_force(phi, feed, radii, 1), abs=2e-8)


@pytest.mark.parametrize(
    ("radius", "feed", "flutes", "percent"),
    [(8.0, 0.0385, 3, 0.29), (3.0, 0.03, 4, 0.66), (3.0, 0.1, 2, 1.9), (0.25, 0.02, 2, 4.6)],
)
def test_deviation_of_the_circle(radius: float, feed: float, flutes: int, percent: float) -> None:
    phi = np.linspace(0.0, math.pi, 2001)
    true = trochoid_thickness(phi, feed * MM, np.full(flutes, radius * MM))
    deviation = np.abs(circle_thickness(phi, feed * MM) - true).max() / (feed * MM)
    assert 100 * deviation == pytest.approx(percent, rel=0.03)


def test_second_order_formula_errs_by_the_third_order() -> None:
    errors = []
    for feed in (0.02, 0.04, 0.08):
        true = trochoid_thickness(PHI, feed, np.full(3, 3.0))
        errors.append(np.abs(_second_order_thickness(PHI, feed, 3.0, 3) - true).max())
    assert errors[1] / errors[0] == pytest.approx(8.0, rel=0.1)
    assert errors[2] / errors[1] == pytest.approx(8.0, rel=0.1)


def test_teeth_share_the_chip_whatever_the_runout() -> None:
    """Over a revolution all teeth together cut N f_z in the feed direction, as long as every tooth cuts."""
    for runout in (0.0, 3 * UM):
        radii = edge_radii(3 * MM, 4, runout, 0.4)
        parts = [trochoid_thickness(math.pi / 2, 0.03 * MM, radii, j)[0] for j in range(4)]
        assert sum(parts) == pytest.approx(4 * 0.03 * MM, rel=1e-9)


def test_a_tooth_that_runs_low_cuts_nothing_and_leaves_it_to_the_next() -> None:
    radii = np.array([3.0, 2.9, 3.0]) * MM
    cut = [trochoid_thickness(math.pi / 2, 0.03 * MM, radii, j)[0] for j in range(3)]
    assert cut[1] < 0.0
    assert cut[2] == pytest.approx(0.06 * MM, rel=1e-9)


def test_edge_radii() -> None:
    radii = edge_radii(8 * MM, 2, 5 * UM, 0.0)
    np.testing.assert_allclose(radii - 8 * MM, [5 * UM, -5 * UM], rtol=1e-9)
    lagged = edge_radii(8 * MM, 2, 5 * UM, 0.0, lag_rad=math.pi)
    np.testing.assert_allclose(lagged, radii[::-1])


def test_bad_input() -> None:
    with pytest.raises(InputError):
        trochoid_thickness(1.0, 0.0, np.full(2, 1.0))
    with pytest.raises(InputError):
        trochoid_thickness(1.0, 0.1, np.full(2, 1.0), 2)
    with pytest.raises(InputError):
        trochoid_thickness(1.0, 0.1, np.array([1.0, -1.0]))
    with pytest.raises(ModelError):
        trochoid_thickness(1.0, 5.0, np.full(2, 1.0))


def _second_order_thickness(phi: Float, feed_m: float, radius_m: float, flutes: int) -> Float:
    """The trochoid's thickness to second order in f_z / R: path of Martellotti, and curvature of the earlier path."""
    sin, cos = np.sin(phi), np.cos(phi)
    ratio = feed_m / radius_m
    result: Float = feed_m * (sin - flutes / (2.0 * math.pi) * ratio * sin * cos + 0.5 * ratio * cos * cos)
    return result

"""Directional coefficients: closed forms, the derivative of the mean force, time average."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.cutting.coefficients import LinearEdgeLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.force import engagement_of_arc
from counterflex.cutting.mean_force import mean_force_weights, mean_wrenches
from counterflex.cutting.stability.process import (
    Process,
    arcs_of_engagement,
    mean_chip_of_arcs,
    process_of_arc,
    process_of_arcs,
    slopes_of,
)

LAW = LinearEdgeLaw(
    ktc_pa=8e8, krc_pa=3e8, kac_pa=2e8, kte_n_m=2e4, kre_n_m=2e4, kae_n_m=1e3, h_min_m=0.0, h_max_m=1e-3, source="test",
    status="test",
)  # fmt: skip
FLAT = Cutter(0.016, flutes=3, flute_length_m=0.03)
BALL = Cutter(0.016, corner_radius_m=0.008, flutes=2, flute_length_m=0.03)


def _booked(depth: Float, cutter: Cutter, feed_m: float) -> Process:
    return process_of_arcs(arcs_of_engagement(depth, cutter), LAW, feed_m, cutter.flutes)


def test_matrix_of_a_slot() -> None:
    """``N/2pi w pi/2 [[Kr, Kt], [-Kt, Kr]]``."""
    A = process_of_arc(0.0, np.pi, 8e8, 3e8, 3, depth_m=0.002).mean
    expected = 3.0 / (2.0 * np.pi) * 0.002 * 0.5 * np.pi * np.array([[3e8, 8e8], [-8e8, 3e8]])
    np.testing.assert_allclose(A[:2, :2], expected, rtol=1e-12)
    np.testing.assert_allclose(A[:, 2], 0.0)


@pytest.mark.parametrize("cutter", [FLAT, BALL], ids=["flat", "ball"])
@pytest.mark.parametrize("arc", [(0.0, 1.1), (0.7, np.pi)])
def test_first_column_is_the_slope_of_the_mean_force_over_the_feed(cutter: Cutter, arc: tuple[float, float]) -> None:
    """A tool that leads the surface by delta along the feed cuts as with delta more feed per tooth."""
    depth = engagement_of_arc(cutter, 0.003, *arc)
    feed, delta = 5e-5, 1e-6
    A = _booked(depth, cutter, feed).mean
    weights = mean_force_weights(cutter, LAW)
    more, less = (mean_wrenches(weights, depth, feed + sign * delta)[:3] for sign in (1.0, -1.0))
    size = np.abs(A[:, 0]).max()
    np.testing.assert_allclose(-A[:, 0], (more - less) / (2.0 * delta), atol=0.02 * size)


def test_teeth_average_to_the_mean() -> None:
    process = _booked(engagement_of_arc(BALL, 0.003, 0.2, 2.0), BALL, 5e-5)
    np.testing.assert_allclose(
        process.means(np.linspace(0.0, 2.0 * np.pi / process.teeth, 38)).mean(axis=0),
        process.mean,
        rtol=1e-12,
        atol=1e-6,
    )


def test_means_follow_the_teeth() -> None:
    """Four teeth in a narrow cut: most of the tooth period nothing is engaged."""
    means = process_of_arc(0.1, 0.3, 8e8, 3e8, 4).means(np.linspace(0.0, 0.5 * np.pi, 101))
    assert np.count_nonzero(np.any(means != 0.0, axis=(1, 2))) == pytest.approx(100 * 0.2 / (0.5 * np.pi), abs=2)


def test_slopes_of_laws() -> None:
    """A linear law has its cutting coefficients, whatever the chip; a power law (1 - m) k h^-m."""
    np.testing.assert_allclose(slopes_of(LAW, 3e-5), [8e8, 3e8, 2e8])
    with pytest.raises(InputError):
        slopes_of(LAW, 0.0)


def test_mean_chip_of_a_slot() -> None:
    depth = engagement_of_arc(FLAT, 0.002, 0.0, np.pi)
    assert mean_chip_of_arcs(arcs_of_engagement(depth, FLAT), 1e-4) == pytest.approx(1e-4 * 2.0 / np.pi, rel=1e-9)
    assert mean_chip_of_arcs(arcs_of_engagement(0.0 * depth, FLAT), 1e-4) == 0.0


@pytest.mark.parametrize("arc", [(1.0, 0.5), (-0.1, 1.0), (0.5, 3.3)])
def test_bad_arcs(arc: tuple[float, float]) -> None:
    with pytest.raises(InputError):
        process_of_arc(*arc, 8e8, 3e8, 2)

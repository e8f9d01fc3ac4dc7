"""Booked engagement against the closed forms of straight and curved cuts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.engagement import accumulate, figures, stretches
from counterflex.cutting.removal import RemovalResult, bin_edges_rad, remove_path
from counterflex.cutting.stock import HeightMap

FLAT = Cutter(0.016)
BALL = Cutter(0.010, 0.005)
DEPTH = 0.003
R = FLAT.radius_m


def _rotate(points: Float, angle: float) -> Float:
    c, s = math.cos(angle), math.sin(angle)
    return np.stack([c * points[:, 0] - s * points[:, 1], s * points[:, 0] + c * points[:, 1], points[:, 2]], axis=1)


def _line(offset: float, side: float, n: int = 91) -> Float:
    x = np.linspace(-0.0225, 0.0225, n)
    return np.stack([x, np.full(n, side * offset), np.full(n, -DEPTH)], axis=1)


def _straight(width: float, side: float = 1.0, angle: float = math.radians(30.0), cell: float = 1e-4) -> RemovalResult:
    """A cut of the given width beside a wider clearing; side +1 has the material on the left of the feed."""
    stock = HeightMap.from_box((-0.035, -0.035, -0.008), (0.035, 0.035, 0.0), cell)
    if width < 2.0 * R:
        for shift in (0.0, 2.0 * R):
            clear = _rotate(_line(-shift, side), angle)[::90] * [1.8, 1.8, 1.0]
            foot = _rotate(np.array([[0.0, -side * shift, -DEPTH]]), angle)[0]
            clear[:, :2] += foot[:2] - clear[:, :2].mean(axis=0)
            remove_path(stock, clear, np.ones(1, dtype=np.int64), FLAT)
    path = _rotate(_line(width if width < 2.0 * R else 0.0, side), angle)
    return remove_path(stock, path, np.ones(90, dtype=np.int64), FLAT)


def _moments(depth: Float) -> Float:
    """Integrals of depth times sin^2, sin cos, sin over phi, with the bins integrated exactly."""
    a, b = bin_edges_rad()[:-1], bin_edges_rad()[1:]
    sine2 = 0.5 * (b - a) - 0.25 * (np.sin(2 * b) - np.sin(2 * a))
    mixed = 0.5 * (np.sin(b) ** 2 - np.sin(a) ** 2)
    sine = np.cos(a) - np.cos(b)
    return np.array([depth @ sine2, depth @ mixed, depth @ sine])


def _exact_moments(entry: float, leave: float) -> Float:
    return DEPTH * np.array(
        [
            0.5 * (leave - entry) - 0.25 * (math.sin(2 * leave) - math.sin(2 * entry)),
            0.5 * (math.sin(leave) ** 2 - math.sin(entry) ** 2),
            math.cos(entry) - math.cos(leave),
        ]
    )


@pytest.mark.parametrize("share", [1.0, 0.5, 0.3, 0.1])
def test_mean_force_of_straight_cuts(share: float) -> None:
    """Bias of the force integrals below 0.1 % of their size; width known to some um."""
    width = share * 2.0 * R
    result = _straight(width)
    assert result.engagement is not None
    middle = accumulate(result.engagement, result.length_m, 20, 80)[0]
    leave = math.pi if share == 1.0 else math.acos(1.0 - 2.0 * share)
    exact = _exact_moments(0.0, leave)
    # rolled on the height map, the previous wall lies within some um of its place: allow that width, and no more
    slack = 4e-6 / width
    error = np.abs(_moments(middle) - exact) / np.linalg.norm(exact[:2])
    assert np.all(error < 1e-3 + slack)
    found = figures(result.engagement, result.length_m, FLAT)
    inner = slice(10, 38)
    assert np.mean(found.chip_area_m2[inner]) / DEPTH == pytest.approx(width, abs=6e-6)
    assert np.mean(found.radial_width_m[inner]) == pytest.approx(width, abs=2e-5)
    assert np.mean(found.axial_depth_m[inner]) == pytest.approx(DEPTH, rel=3e-3)
    if share < 1.0:
        assert np.degrees(np.abs(found.exit_rad[inner] - leave)).mean() < 0.5
    assert np.all(found.entry_rad[inner] < math.radians(8.0))


def test_material_on_the_left_is_cut_below_ninety_degrees() -> None:
    """The angle counts clockwise from the left normal: material on the left is phi < 90, on the right phi > 90 deg.

    With a clockwise spindle an edge moves from left over ahead to right, so the chip starts thin on the left:
    material on the left is up-milling (h grows from 0), on the right down-milling (h falls to 0).
    """
    left, right = _straight(0.004, 1.0), _straight(0.004, -1.0)
    assert left.engagement is not None
    assert right.engagement is not None
    a = accumulate(left.engagement, left.length_m, 20, 80)[0]
    b = accumulate(right.engagement, right.length_m, 20, 80)[0]
    assert a[32:].sum() == 0.0
    assert b[:32].sum() == 0.0
    assert a.sum() > 0.0


@settings(max_examples=6, deadline=None)
@given(st.floats(-3.1, 3.1), st.floats(0.003, 0.012))
def test_mirrored_feed_mirrors_phi(angle: float, width: float) -> None:
    left, right = _straight(width, 1.0, angle, 2e-4), _straight(width, -1.0, -angle, 2e-4)
    assert left.engagement is not None
    assert right.engagement is not None
    a = accumulate(left.engagement, left.length_m, 20, 80)[0]
    b = accumulate(right.engagement, right.length_m, 20, 80)[0][::-1]
    assert np.abs(_moments(a) - _moments(b)).max() < 4e-3 * np.abs(_moments(a)).max()


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_arc_engagement_is_that_of_the_curved_cut(turn: float) -> None:
    """A hole of radius 20 opened to 24 mm: 71.79 deg, where the straight formula says 60.00 deg."""
    stock = HeightMap.from_box((-0.026, -0.026, -0.006), (0.026, 0.026, 0.0), 1e-4)
    x, y = np.meshgrid(stock.x_m(), stock.y_m())
    stock.z[np.hypot(x, y) < 0.020] = -DEPTH
    stock.refresh()
    phase = turn * np.linspace(0.0, 1.7 * math.pi, 171)
    path = np.stack([0.016 * np.cos(phase), 0.016 * np.sin(phase), np.full(171, -DEPTH)], axis=1)
    result = remove_path(stock, path, np.ones(170, dtype=np.int64), FLAT)
    arc = math.acos((0.020**2 - 0.016**2 - R**2) / (2.0 * 0.016 * R))
    assert math.degrees(arc) == pytest.approx(71.79, abs=0.005)
    assert result.engagement is not None
    found = figures(result.engagement, result.length_m, FLAT)
    inner = slice(10, -2)
    if turn > 0.0:
        engaged = math.pi - found.entry_rad[inner]
        assert np.all(found.exit_rad[inner] > math.radians(172.0))
    else:
        engaged = found.exit_rad[inner]
        assert np.all(found.entry_rad[inner] < math.radians(8.0))
    assert np.degrees(engaged.mean()) == pytest.approx(71.79, abs=0.4)
    middle = accumulate(result.engagement, result.length_m, 20, 165)[0]
    middle = middle[::-1] if turn > 0.0 else middle
    exact = _exact_moments(0.0, arc)
    # the chords of the path (0.5 mm on radius 16) leave the arc by 2 um
    assert np.all(np.abs(_moments(middle) - exact) < 2e-3 * np.linalg.norm(exact))


def test_ball_slot_engages_each_level_fully() -> None:
    stock = HeightMap.from_box((-0.01, -0.01, -0.008), (0.03, 0.01, 0.0), 1e-4)
    n = 51
    path = np.stack([np.linspace(0.0, 0.02, n), np.full(n, 2e-5), np.full(n, -DEPTH)], axis=1)
    result = remove_path(stock, path, np.ones(n - 1, dtype=np.int64), BALL)
    assert result.engagement is not None
    depth = accumulate(result.engagement, result.length_m, 15, 45)
    levels = BALL.levels()
    heights = np.clip(DEPTH, levels[:-1], levels[1:]) - levels[:-1]
    a, b = bin_edges_rad()[:-1], bin_edges_rad()[1:]
    mean = depth @ (np.cos(a) - np.cos(b)) / 2.0
    assert np.allclose(mean[1:], heights[1:], atol=0.012 * DEPTH)
    assert mean.sum() == pytest.approx(DEPTH, rel=3e-3)
    assert result.bottom_volume_m3[15:45].sum() == 0.0


def test_ramping_flat_mill_splits_side_and_end_face() -> None:
    """Descending at slope s, the end face removes s pi R^2 per length; the side the rest."""
    stock = HeightMap.from_box((-0.012, -0.01, -0.01), (0.05, 0.01, 0.0), 1e-4)
    n, slope = 81, 0.05
    x = np.linspace(0.0, 0.04, n)
    path = np.stack([x, np.full(n, 1e-5), -slope * x], axis=1)
    result = remove_path(stock, path, np.ones(n - 1, dtype=np.int64), FLAT)
    per_length = result.bottom_volume_m3[30:75] / result.length_m[30:75]
    assert per_length.mean() == pytest.approx(slope * math.pi * R**2, rel=2e-3)
    assert result.bottom_area_m2[30:75].mean() == pytest.approx(math.pi * R**2, rel=5e-3)
    side = (result.volume_m3 - result.bottom_volume_m3)[60:70].sum() / result.length_m[60:70].sum()
    # the side meets a wall of the height that the tip has below the top
    assert side == pytest.approx(2.0 * R * slope * x[60:71].mean(), rel=5e-3)


def test_stretches_cover_the_path_once() -> None:
    first, last = stretches(np.array([4e-4, 4e-4, 4e-4, 2e-3, 0.0, 5e-4]), 1e-3)
    assert first.tolist() == [0, 3, 4]
    assert last.tolist() == [3, 4, 6]
    with pytest.raises(InputError):
        stretches(np.array([1.0]), -1.0)


def test_air_has_no_angles() -> None:
    stock = HeightMap.from_box((-0.01, -0.01, -0.01), (0.01, 0.01, 0.0), 5e-4)
    path = np.array([[0.0, 0.0, 0.01], [0.005, 0.0, 0.01], [0.006, 0.0, 0.01]])
    result = remove_path(stock, path, np.ones(2, dtype=np.int64), FLAT)
    assert result.engagement is not None
    found = figures(result.engagement, result.length_m, FLAT)
    assert np.all(np.isnan(found.entry_rad))
    assert found.chip_area_m2.tolist() == [0.0, 0.0]
    with pytest.raises(InputError):
        figures(result.engagement, result.length_m, BALL)

"""Surface deviation: signs, sub-cell walls and sloped floors against exact shapes."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.removal import remove_path
from counterflex.cutting.stock import HeightMap
from counterflex.evaluate.surface import SurfaceDeviation, nominal_surface
from counterflex.evaluate.swept_section import swept_section
from counterflex.path import FEED

CUTTER = Cutter(diameter_m=16e-3)
CELL = 0.2e-3
TOP = 0.0


def blank() -> HeightMap:
    return HeightMap.from_box((0.0, 0.0, -0.02), (0.08, 0.05, TOP), CELL)


def milled(moves: Float, cutter: Cutter = CUTTER) -> HeightMap:
    """Removal by brute force: lowest flat tool over every cell, moves sampled densely."""
    out = blank()
    x, y = np.meshgrid(out.x_m(), out.y_m())
    z = out.z.astype(float)
    for a, b in itertools.pairwise(moves):
        d = b[:2] - a[:2]
        length = float(np.hypot(*d))
        if length == 0.0:
            t0, t1 = np.zeros_like(x), np.zeros_like(x)
            inside = np.hypot(x - a[0], y - a[1]) <= cutter.radius_m
        else:
            s = ((x - a[0]) * d[0] + (y - a[1]) * d[1]) / length
            w2 = (x - a[0]) ** 2 + (y - a[1]) ** 2 - s * s
            q = np.sqrt(np.maximum(cutter.radius_m**2 - w2, 0.0))
            t0, t1 = np.clip(s - q, 0, length) / length, np.clip(s + q, 0, length) / length
            inside = (w2 <= cutter.radius_m**2) & (s + q >= 0) & (s - q <= length)
        low = np.minimum(a[2] + t0 * (b[2] - a[2]), a[2] + t1 * (b[2] - a[2]))
        z = np.where(inside, np.minimum(z, low), z)
    out.z = np.maximum(z, out.bottom_m).astype(np.float32)
    out.refresh()
    return out


GROOVE = np.array([[-0.012, 0.025, -0.004], [0.092, 0.025, -0.004]])


@pytest.mark.parametrize("shift", [1.23e-4, -3.77e-4, 1.4e-3])
def test_wall_shift_is_recovered_below_the_cell(shift: float) -> None:
    surface = nominal_surface(blank(), milled(GROOVE), GROOVE, CUTTER)
    moved = GROOVE + np.array([0.0, shift, 0.0])
    found = SurfaceDeviation.of(surface, milled(moved), moved)
    left = surface.wall_normal[:, 1] > 0.5
    np.testing.assert_allclose(found.wall_m[left], -shift, atol=1e-9)  # shifted into the left wall: too much removed
    np.testing.assert_allclose(found.wall_m[~left], shift, atol=1e-9)
    np.testing.assert_allclose(surface.wall_point[left][:, 1], 0.033, atol=1e-12)
    assert found.wall.max_m == pytest.approx(abs(shift), abs=1e-9)
    assert found.floor.max_m < 1e-8  # nothing of the wall is booked as floor
    assert found.wall_lost_m2 == 0.0
    assert surface.wall_area_m2.sum() == pytest.approx(2 * 0.08 * 0.004, rel=0.01)


def test_wall_shift_below_a_face_of_the_blank_that_lies_lower_than_nominal() -> None:
    surface = nominal_surface(blank(), milled(GROOVE), GROOVE, CUTTER)
    moved = GROOVE + np.array([0.0, 1.4e-3, 0.0])
    actual = milled(moved)
    actual.z = np.minimum(actual.z, TOP - 40e-6).astype(np.float32)  # touched off a little too high
    actual.refresh()
    found = SurfaceDeviation.of(surface, actual, moved)
    right = surface.wall_normal[:, 1] < -0.5
    np.testing.assert_allclose(found.wall_m[right], 1.4e-3, atol=1e-9)  # not the 0.36 mm up to the untouched face


@pytest.mark.parametrize("dz", [2.5e-4, -1.5e-4])
def test_floor_shift_is_exact_and_positive_where_material_is_left(dz: float) -> None:
    surface = nominal_surface(blank(), milled(GROOVE), GROOVE, CUTTER)
    moved = GROOVE + np.array([0.0, 0.0, dz])
    found = SurfaceDeviation.of(surface, milled(moved), moved)
    values = found.floor_m[~np.isnan(found.floor_m)]
    np.testing.assert_allclose(values, dz, atol=1e-9)
    assert len(values) * CELL**2 == pytest.approx(0.08 * (0.016 - 2 * CELL), rel=0.01)
    assert found.surface.max_m == pytest.approx(abs(dz), abs=1e-9)


def test_sloped_floor_is_measured_along_its_normal() -> None:
    slope = 0.1
    ramp = np.array([[-0.02, 0.025, -0.001], [0.1, 0.025, -0.001 - slope * 0.12]])
    surface = nominal_surface(blank(), milled(ramp), ramp, CUTTER)
    moved = ramp + np.array([0.0, 0.0, 2e-4])
    found = SurfaceDeviation.of(surface, milled(moved), moved)
    centre = found.floor_m[found.floor_m.shape[0] // 2, 150:250]
    np.testing.assert_allclose(centre, 2e-4 / np.sqrt(1 + slope**2), rtol=2e-4)


def test_circular_wall_grown_by_a_radius() -> None:
    angle = np.linspace(0.0, 2 * np.pi, 721)
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    centre = np.array([0.04, 0.025, -0.003])
    nominal, actual = centre + 0.010 * circle, centre + 0.01015 * circle
    surface = nominal_surface(blank(), milled(nominal[::8]), nominal, CUTTER)
    outer = np.linalg.norm(surface.wall_point[:, :2] - centre[:2], axis=1) > 0.017
    found = SurfaceDeviation.of(surface, milled(actual[::8]), actual)
    np.testing.assert_allclose(found.wall_m[outer], -0.15e-3, atol=1e-6)
    np.testing.assert_allclose(found.wall_m[~outer], -0.0 + 0.15e-3, atol=1e-6)  # the island grew with it


@settings(max_examples=20, deadline=None)
@given(
    st.floats(0.0, 2 * np.pi), st.floats(0.0, 2 * np.pi), st.floats(1e-3, 0.03), st.floats(0.0, 7e-3),
    st.floats(0.0, 1.0),
)  # fmt: skip
def test_ray_leaves_one_stadium_where_the_closed_form_says(
    heading: float, ray_angle: float, length: float, offset: float, fraction: float
) -> None:
    a = np.zeros(3)
    u = np.array([np.cos(heading), np.sin(heading), 0.0])
    b = length * u
    point = fraction * b + offset * np.array([-u[1], u[0], 0.0]) + np.array([0, 0, 1e-3])
    ray = np.array([[np.cos(ray_angle), np.sin(ray_angle)]])
    exit_m, normal = swept_section(np.stack([a, b]), CUTTER, 0.1).wall_exit(point[None], ray, 0.0)
    end = point[:2] + exit_m[0] * ray[0]
    s = np.clip(end @ u[:2], 0.0, length)
    away = end - s * u[:2]
    assert np.hypot(*away) == pytest.approx(CUTTER.radius_m, abs=1e-9)
    np.testing.assert_allclose(normal[0], away / np.hypot(*away), atol=1e-6)


def test_ball_end_section_is_narrower_near_the_tip() -> None:
    ball = Cutter(diameter_m=10e-3, corner_radius_m=5e-3)
    path = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0]])
    heights = np.array([0.5e-3, 2e-3, 5e-3, 8e-3])
    points = np.column_stack([np.full(4, 0.025), np.zeros(4), heights])
    found, _ = swept_section(path, ball, 0.01).wall_exit(points, np.tile([0.0, 1.0], (4, 1)), 0.0)
    np.testing.assert_allclose(found, [ball.radius_at(h) for h in heights], atol=1e-12)


def test_what_no_path_reached_is_not_a_number() -> None:
    section = swept_section(np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0]]), CUTTER, 0.003)
    points = np.array([[0.02, 0.02, 0.001], [0.02, 0.0, -0.001], [0.3, 0.3, 0.0]])
    found, _ = section.wall_exit(points, np.tile([0.0, 1.0], (3, 1)), 0.0)
    assert np.all(np.isnan(found))


def test_holes_in_the_path_cut_nothing() -> None:
    path = np.array([[0.0, 0, 0], [0.01, 0, 0], [0.05, 0, 0], [0.06, 0.0, 0.0]])
    point, ray = np.array([[0.03, 0.0, 0.001]]), np.array([[0.0, 1.0]])
    whole, _ = swept_section(path, CUTTER, 0.003).wall_exit(point, ray, 0.0)
    cut, _ = swept_section(path, CUTTER, 0.003, np.array([True, True, False, True])).wall_exit(point, ray, 0.0)
    assert np.isinf(whole[0])  # 8 mm is beyond the reach of 3 mm
    assert np.isnan(cut[0])


def test_other_grids_are_refused() -> None:
    other = HeightMap.from_box((0.0, 0.0, -0.02), (0.08, 0.05, TOP), 0.25e-3)
    with pytest.raises(InputError, match="different grids"):
        nominal_surface(blank(), other, GROOVE, CUTTER)


def test_shallow_ramp_left_too_high_counts_its_height_not_the_distance_to_the_wall() -> None:
    """A slot of slope 1:30 cut 0.05 mm too high: at its shallow end no wall is there, yet only 0.05 mm is left."""
    cutter = Cutter(diameter_m=6e-3, flutes=2)
    path = np.array([[-5e-3, 0.0, 5e-4], [25e-3, 0.0, -5e-4]])
    high = path + np.array([0.0, 0.0, 5e-5])
    maps = []
    for run in (path, high):
        stock = HeightMap.from_box((-10e-3, -8e-3, -5e-3), (30e-3, 8e-3, 0.0), 1e-4)
        remove_path(stock, run, np.array([FEED]), cutter)
        maps.append(stock)
    blank = HeightMap.from_box((-10e-3, -8e-3, -5e-3), (30e-3, 8e-3, 0.0), 1e-4)
    dense = np.linspace(high[0], high[1], 3001)
    found = SurfaceDeviation.of(nominal_surface(blank, maps[0], path, cutter), maps[1], dense)
    assert found.wall.max_m < 3e-4
    assert found.floor.max_m == pytest.approx(5e-5, rel=0.05)

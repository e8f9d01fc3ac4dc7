"""A point of a scan counts for the nearest nominal surface that looks its way."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.evaluate.inspection.nominal_part import NominalPart, nominal_part
from counterflex.evaluate.inspection.part_deviations import FREE, WALL
from counterflex.evaluate.surface import nominal_surface

CUTTER = Cutter(diameter_m=16e-3)
MIDDLE, HALF, FLOOR = 0.025, 8e-3, -4e-3


class Groove:
    """An endless groove along x, by its closed form."""

    def distance(self, points_part: Float) -> Float:
        """(n,) m, positive in the material."""
        q = np.stack([np.abs(points_part[:, 1] - MIDDLE) - HALF, FLOOR - points_part[:, 2]])
        out: Float = np.hypot(*np.maximum(q, 0.0)) + np.minimum(q.max(axis=0), 0.0)
        return out


def part() -> NominalPart:
    """A groove through a blank of 80 x 50 x 20 mm."""
    stock = HeightMap.from_box((0.0, 0.0, -0.02), (0.08, 0.05, 0.0), 0.2e-3)
    made = stock.copy()
    made.z[np.abs(made.y_m() - MIDDLE) <= HALF] = FLOOR
    made.refresh()
    path = np.array([[-0.012, MIDDLE, FLOOR], [0.092, MIDDLE, FLOOR]])
    return nominal_part(nominal_surface(stock, made, path, CUTTER), Groove())


def test_a_shifted_wall_is_measured_up_to_the_face_that_it_runs_out_of() -> None:
    x = np.array([0.4, 0.6, 0.8, 1.2, 5.0]) * 1e-3
    wall = np.column_stack([x, np.full(5, MIDDLE + HALF + 0.9e-3), np.full(5, -1.5e-3)])
    looks = np.tile([0.0, 1.0, 0.0], (5, 1))
    nearest = part().nearest(wall, looks)
    np.testing.assert_allclose(nearest.deviation_m, -0.9e-3, atol=1e-9)  # too much was cut
    assert np.all(nearest.face == WALL)
    assert np.all(nearest.near)


def test_points_of_the_face_beside_a_shifted_wall_stay_with_the_face() -> None:
    face = np.column_stack([np.full(3, 0.02e-3), [0.005, 0.010, 0.045], np.full(3, -1.5e-3)])
    nearest = part().nearest(face, np.tile([-1.0, 0.0, 0.0], (3, 1)))
    np.testing.assert_allclose(nearest.deviation_m, -0.02e-3, atol=1e-9)
    assert np.all(nearest.face == FREE)


def test_points_that_look_no_way_are_near_but_count_for_nothing() -> None:
    points = np.array([[0.04, MIDDLE, FLOOR + 0.1e-3], [0.04, MIDDLE, FLOOR + 0.1e-3], [0.04, MIDDLE, 0.05]])
    looks = np.array([[0.6, 0.0, 0.8], [np.nan, np.nan, np.nan], [0.0, 0.0, 1.0]])
    nearest = part().nearest(points, looks)
    assert np.all(np.isnan(nearest.deviation_m))
    assert nearest.near.tolist() == [True, True, False]

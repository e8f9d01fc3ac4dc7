"""The end face of a descending cutter: its forces cancel where all of it cuts, and push aside where half of it does."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.units import MM
from counterflex.cutting.removal import grid_of
from counterflex.cutting.stock import HeightMap
from counterflex.plan.cut_kernel import _end_face_lean

RADIUS, CELL = 8 * MM, 0.1 * MM


def lean(x: float) -> tuple[float, float]:
    """Of a face whose centre is at x, over a block that ends at x = 0, 0.01 mm deep in it."""
    stock = HeightMap.from_box((-40 * MM, -20 * MM, 0.0), (0.0, 20 * MM, 10 * MM), CELL)
    return _end_face_lean(grid_of(stock), x, 0.0, 10 * MM - 1e-5, 1e-5, RADIUS)


def test_a_face_all_in_the_material_leans_nowhere() -> None:
    assert lean(-20 * MM) == pytest.approx((0.0, 0.0), abs=1e-12)


def test_a_face_half_over_the_edge_leans_to_the_material_by_a_diameter() -> None:
    """The integral of r_hat over rho and phi of a half disc is 2 R."""
    x, y = lean(0.0)
    assert x == pytest.approx(-2.0 * RADIUS, rel=0.03)  # 24 angles, 6 rings
    assert y == pytest.approx(0.0, abs=1e-12)


def test_a_face_beside_the_material_leans_nowhere() -> None:
    assert lean(9 * MM) == (0.0, 0.0)
    assert np.hypot(*lean(4 * MM)) < 2.0 * RADIUS

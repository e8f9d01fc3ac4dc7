"""A box seen along a tilted tool."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from counterflex.cutting.stock import HeightMap
from counterflex.cutting.tilted_stock import box_along_tool, working_plane
from counterflex.path.toolpath import tool_orientation

LOW, HIGH, CELL = np.array([0.0, -0.01, 0.0]), np.array([0.06, 0.05, 0.04]), 0.5e-3


def test_straight_down_it_is_the_box() -> None:
    seen = box_along_tool(LOW, HIGH, CELL, np.eye(3))
    box = HeightMap.from_box(tuple(LOW.tolist()), tuple(HIGH.tolist()), CELL)
    np.testing.assert_allclose(seen.z, box.z, atol=1e-9)
    assert (seen.x0_m, seen.y0_m, seen.bottom_m) == pytest.approx((box.x0_m, box.y0_m, box.bottom_m))


@pytest.mark.parametrize("seed", range(4))
def test_tops_lie_on_the_box_and_its_shadow_is_right(seed: int) -> None:
    """Just below a top is inside, just above is not; the area seen is that of the faces turned to the tool."""
    axis = Rotation.random(random_state=seed).as_matrix()[:, 2]
    axis[2] = abs(axis[2]) + 0.3
    axis /= np.linalg.norm(axis)
    R = working_plane(axis)
    seen = box_along_tool(LOW, HIGH, CELL, R)
    x, y = np.meshgrid(seen.x_m(), seen.y_m())
    solid = seen.z > seen.bottom_m + 1e-6
    for off, inside in ((-2e-6, True), (2e-6, False)):
        p = np.stack([x, y, seen.z + off], axis=-1)[solid] @ R.T
        found = np.all((p > LOW) & (p < HIGH), axis=1)
        assert np.mean(found == inside) > 0.999  # a ray through an edge is in and out at once
    side = HIGH - LOW
    area = abs(axis[0]) * side[1] * side[2] + abs(axis[1]) * side[0] * side[2] + abs(axis[2]) * side[0] * side[1]
    around = 4.0 * float(side.sum()) * CELL  # half a cell along the outline
    assert solid.sum() * CELL**2 == pytest.approx(float(area), abs=around)


@pytest.mark.parametrize("axis", [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.95, 0.1, 0.2], [0.1, -0.9, 0.3]])
def test_the_plane_holds_the_tool_as_the_part_does(axis: list[float]) -> None:
    """The free angle about the tool means the same in the plane as in the part."""
    a = np.array([axis]) / np.linalg.norm(axis)
    R = working_plane(a[0])
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(R @ tool_orientation(a @ R, 0.7)[0], tool_orientation(a, 0.7)[0], atol=1e-12)

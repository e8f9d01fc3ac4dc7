"""Which stretch made which place: against the removal of the displaced path, and exact for a tool off everywhere."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from tests.evaluate.path_error.conftest import LENGTH_M, straight_path

from counterflex.core.units import MM, UM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.removal import remove_tool_path
from counterflex.cutting.stock import HeightMap
from counterflex.evaluate.path_error.contacts import UNREST, contacts_of, nodes_of
from counterflex.evaluate.surface import SurfaceDeviation, nominal_surface
from counterflex.path.toolpath import ToolPath


def displaced(path: ToolPath, error: np.ndarray) -> ToolPath:
    return ToolPath(path.p_part_tcp + error, *(getattr(path, f) for f in list(path.__dataclass_fields__)[1:]))


def test_law_agrees_with_the_removal_of_the_displaced_path(mill: Cutter) -> None:
    path = straight_path()
    x = path.p_part_tcp[:, 0]
    error = np.column_stack([0.0 * x, 80 * UM * np.sin(x / (9.0 * MM)), 60 * UM * np.cos(x / (7.0 * MM))])
    error[:2, 2] += 1.0 * MM  # clear of the part: the rapid cuts nothing
    blank = HeightMap.from_box((-12 * MM, -12 * MM, -10 * MM), (LENGTH_M + 12 * MM, 12 * MM, 6 * MM), 0.2 * MM)
    nominal, actual = blank.copy(), blank.copy()
    remove_tool_path(nominal, path, mill, engagement=False)
    moved = displaced(path, error)
    remove_tool_path(actual, moved, mill, engagement=False)
    surface = nominal_surface(blank, nominal, path.p_part_tcp, mill)
    judged = SurfaceDeviation.of(surface, actual, moved.p_part_tcp)
    j, i = np.nonzero(np.isfinite(judged.floor_m))
    at = np.column_stack([nominal.x0_m + i * nominal.cell_m, nominal.y0_m + j * nominal.cell_m, nominal.z[j, i]])
    # a floor nearer to a wall was passed by so few stretches that the tool's error across decides which
    some = (at[:, 0] > 10 * MM) & (at[:, 0] < LENGTH_M - 10 * MM) & (np.abs(at[:, 1]) < 7 * MM)
    wall = surface.wall_point
    inner = (wall[:, 0] > 10 * MM) & (wall[:, 0] < LENGTH_M - 10 * MM)
    nodes = nodes_of(path)
    up = np.tile([0.0, 0.0, 1.0], (int(some.sum()), 1))
    out = np.pad(-surface.wall_normal[inner], ((0, 0), (0, 1)))
    for points, normals, true in (
        (at[some], up, judged.floor_m[j, i][some]),
        (wall[inner], out, judged.wall_m[inner]),
    ):
        contacts = contacts_of(path, nodes, lambda _: mill, points, normals, 1.0 * MM)
        assert contacts.made.all()
        # stretches of 0.5 mm at slopes up to 9 um/mm, and the second order d^2/R
        np.testing.assert_allclose(contacts.left_on(error[nodes.row]), true, atol=6.0 * UM)


@given(
    st.tuples(*(st.floats(-200.0, 200.0) for _ in range(3))), st.just(0.0) | st.floats(0.5, 8.0), st.integers(0, 1000)
)
@settings(max_examples=12)
def test_tool_off_by_the_same_everywhere_leaves_its_component_along_the_normal(
    off_um: tuple[float, float, float], corner_mm: float, seed: int
) -> None:
    cutter = Cutter(diameter_m=16.0 * MM, corner_radius_m=corner_mm * MM, flutes=2)
    path = straight_path(step_m=0.5 * MM)
    nodes = nodes_of(path)
    rng = np.random.default_rng(seed)
    x = rng.uniform(12 * MM, LENGTH_M - 12 * MM, 40)
    angle = rng.uniform(0.0, 0.5 * np.pi, 40) * np.sign(rng.normal(size=40))  # on the rounded corner, from its foot up
    r = corner_mm * MM
    y = np.sign(angle) * (8.0 * MM - r) + r * np.sin(angle)
    points = np.column_stack([x, y, r - r * np.cos(angle)])
    normal = np.column_stack([0.0 * x, -np.sin(angle), np.cos(angle)])
    if corner_mm == 0.0:  # the floor
        points[:, 1:], normal = np.array([3.0 * MM, 0.0]), np.tile([0.0, 0.0, 1.0], (40, 1))
    contacts = contacts_of(path, nodes, lambda _: cutter, points, normal, 1.0 * MM)
    assert contacts.made.all()
    d = np.array(off_um) * UM
    # along the feed the tool of another stretch does the same; across, curvature adds d^2 / 2r at most
    bound = 3.0 * UM + float(d @ d) / (2.0 * max(r, 0.5 * MM))
    assert np.all(np.abs(contacts.left_on(np.tile(d, (len(nodes), 1))) - normal @ d) < bound)


def test_places_that_the_program_did_not_make_are_left_out(mill: Cutter) -> None:
    path = straight_path()
    points = np.array([[0.03, 0.0, 0.0], [0.03, 0.0, -0.2 * MM], [0.03, 0.012, 0.006]])
    up = np.tile([0.0, 0.0, 1.0], (3, 1))
    contacts = contacts_of(path, nodes_of(path), lambda _: mill, points, up, 1.0 * MM)
    assert contacts.made.tolist() == [True, False, False]


def test_narrow_errors_are_larger_where_the_force_changes_whatever_its_size() -> None:
    """1 where it is even, 1 + UNREST within UNREST_M of where it comes or goes whole, half of that for half of it."""
    path = straight_path()
    x = path.p_part_tcp[:, 0]
    bend = np.column_stack([0.0 * x, np.where(x > 30.0 * MM, 40.0 * UM, 20.0 * UM), 0.0 * x])
    bend[x > 50.0 * MM] = 0.0
    nodes = nodes_of(path, bend)
    at = x[nodes.row]
    for low, high, factor in ((11, 21, 1.0), (23, 37, 1.0 + 0.5 * UNREST), (39, 41, 1.0), (43, 57, 1.0 + UNREST)):
        np.testing.assert_allclose(nodes.unrest[(at > low * MM) & (at < high * MM)], factor)
    np.testing.assert_allclose(nodes_of(path, 1e3 * bend).unrest, nodes.unrest)
    for even in (nodes_of(path), nodes_of(path, 0.0 * bend), nodes_of(path, 0.0 * bend + 1.0)):
        np.testing.assert_array_equal(even.unrest, 1.0)


def test_nodes_end_every_motion_and_begin_every_run() -> None:
    path = straight_path()
    nodes = nodes_of(path)
    assert nodes.row[0] == 1
    assert nodes.row[-1] == len(path) - 1
    assert np.max(np.diff(nodes.station_m)) == pytest.approx(0.5 * MM)

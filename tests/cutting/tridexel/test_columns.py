"""Columns against the height map, brute force in space, and the height map seen along a tilted tool."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError, ModelError
from counterflex.core.units import DEG
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.removal import remove_path, unit_widths
from counterflex.cutting.stock import HeightMap
from counterflex.cutting.tilted_stock import box_along_tool, working_plane
from counterflex.cutting.tridexel.column_kernels import STRETCHES
from counterflex.cutting.tridexel.columns import ColumnStock, motions_of, remove_turning
from counterflex.path import FEED, RAPID

FLAT, BALL, BULL = Cutter(0.016), Cutter(0.010, 0.005), Cutter(0.016, 0.003)
KINDS = pytest.mark.parametrize("cutter", [FLAT, BALL, BULL], ids=["flat", "ball", "bull"])
TOP_M = 0.05


def _feeds(points: Float) -> Int:
    return np.full(len(points) - 1, FEED, dtype=np.int64)


def _upright(points: Float) -> Float:
    return np.tile([0.0, 0.0, 1.0], (len(points), 1))


def _wander(seed: int, n: int, reach: float = 0.02, depth: float = 0.006) -> Float:
    rng = np.random.default_rng(seed)
    p = np.cumsum(rng.normal(size=(n, 3)) * [1.5e-3, 1.5e-3, 3e-4], axis=0)
    p[:, :2] = reach * np.sin(p[:, :2] / reach)
    p[:, 2] = -depth * np.abs(np.sin(1.0 + p[:, 2] / depth))
    return p


def _box(cell: float) -> HeightMap:
    return HeightMap.from_box((-0.03, -0.03, -0.03), (0.03, 0.03, 0.0), cell)


@KINDS
def test_an_upright_tool_leaves_what_the_height_map_leaves(cutter: Cutter) -> None:
    stock, path = _box(5e-4), _wander(3, 60)
    columns = ColumnStock.of(stock)
    ours = remove_turning(columns, path, _upright(path), _feeds(path), cutter, top_m=TOP_M)
    mapped = remove_path(stock, path, _feeds(path), cutter)
    assert columns.count.max() == 1
    np.testing.assert_allclose(
        columns.high[0], stock.z, atol=2e-7
    )  # the map finds a bull nose to 0.15 um, brute force says
    assert ours.volume_m3.sum() == pytest.approx(mapped.volume_m3.sum(), rel=1e-5)
    np.testing.assert_allclose(ours.length_m, mapped.length_m, rtol=1e-12)


def test_an_upright_flat_mill_is_engaged_as_on_the_height_map() -> None:
    stock = _box(2.5e-4)
    path = _wander(3, 40)
    path[:, 2] = -0.004
    columns = ColumnStock.of(stock)
    ours = remove_turning(columns, path, _upright(path), _feeds(path), FLAT, top_m=TOP_M).engagement
    mapped = remove_path(stock, path, _feeds(path), FLAT).engagement
    assert ours is not None
    assert mapped is not None
    one, two = ours.dense(1, len(ours)), mapped.dense(1, len(mapped))  # the first stands in material as it begins
    assert np.abs(one.sum((1, 2)) - two.sum((1, 2))).max() <= 0.02 * two.sum((1, 2)).max()
    assert np.abs(one.sum((0, 1)) - two.sum((0, 1))).sum() <= 0.01 * two.sum()


@pytest.mark.parametrize("cutter", [FLAT, BULL], ids=["flat", "bull"])
def test_a_tilted_groove_is_engaged_as_on_a_height_map_along_the_tool(cutter: Cutter) -> None:
    tilt = 25.0 * DEG
    axis = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    path = np.array([[0.003, y, -0.004] for y in np.linspace(-0.015, 0.015, 13)])
    axes = np.tile(axis, (len(path), 1))
    block = (np.array([-0.03, -0.03, -0.03]), np.array([0.03, 0.03, 0.0]))
    R = working_plane(axis)
    columns = ColumnStock.of(_box(2.5e-4))
    ours = remove_turning(columns, path, axes, _feeds(path), cutter, top_m=TOP_M)
    mapped = remove_path(box_along_tool(*block, 2.5e-4, R), path @ R, _feeds(path), cutter)
    row = 2.5e-4 / 0.016  # a row of cells more or less of the groove's width
    assert ours.volume_m3[2:].sum() == pytest.approx(mapped.volume_m3[2:].sum(), rel=row)
    if cutter is FLAT:  # the groove is a trapezium: width times depth on the axis, over cos(tilt)
        assert ours.volume_m3[2:].sum() == pytest.approx(0.025 * 0.016 * 0.004 / np.cos(tilt), rel=2e-4)
    books = [found.engagement for found in (ours, mapped) if found.engagement is not None]
    # by width of the bins, as the force weighs them: those at the sides are narrower than a cell
    one, two = (book.dense(2, 12).mean(axis=0) * unit_widths() for book in books)
    assert one.sum() == pytest.approx(two.sum(), rel=row)
    halves = [np.array([book[:, :32].sum(), book[:, 32:].sum()]) for book in (one, two)]  # up and down milling side
    np.testing.assert_allclose(halves[0], halves[1], rtol=2.0 * row)


def _brute_force(path: Float, axis: Float, radius: float, x: Float, y: Float, z: Float) -> Bool:
    """Nodes (ny, nx, nz) in no cylinder of two hundred poses per segment: the axis turns at a constant rate."""
    held = np.ones((len(y), len(x), len(z)), dtype=bool)
    points = np.stack(np.meshgrid(x, y, z), axis=-1)
    for k in range(len(path) - 1):
        angle = np.arccos(np.clip(axis[k] @ axis[k + 1], -1.0, 1.0))
        for s in np.linspace(0.0, 1.0, 201):
            u = (np.sin((1 - s) * angle) * axis[k] + np.sin(s * angle) * axis[k + 1]) / np.sin(angle)
            r = points - (path[k] + s * (path[k + 1] - path[k]))
            h = r @ u
            held &= (np.sum(r * r, axis=-1) - h * h > radius**2) | (h < 0.0) | (h > TOP_M)
    return held


def test_a_tool_that_turns_while_it_cuts_leaves_what_hundreds_of_poses_leave() -> None:
    path = np.array([[-0.012, 0.001, -0.004], [0.0, -0.001, -0.006], [0.011, 0.002, -0.003]])
    lean = np.array([-15.0, 3.0, 20.0]) * DEG
    axis = np.stack([np.sin(lean), 0.2 * np.sin(lean), np.cos(lean)], axis=1)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    columns = ColumnStock.of(HeightMap.from_box((-0.025, -0.012, -0.012), (0.025, 0.012, 0.0), 1e-3))
    remove_turning(columns, path, axis, _feeds(path), Cutter(0.010), top_m=TOP_M)
    ny, nx = columns.count.shape
    x = np.linspace(columns.x0_m, columns.x0_m + 1e-3 * (nx - 1), nx)
    y = np.linspace(columns.y0_m, columns.y0_m + 1e-3 * (ny - 1), ny)
    z = np.linspace(-0.0119, -0.0001, 119)
    truth = _brute_force(path, axis, 0.005, x, y, z)
    ours = np.moveaxis(columns.holds(z), 0, 2)
    assert np.count_nonzero(~truth) > 5000
    assert np.count_nonzero(ours != truth) <= 2e-3 * np.count_nonzero(~truth)


def test_a_hole_from_the_side_leaves_material_above_and_below() -> None:
    columns = ColumnStock.of(_box(5e-4))
    path = np.array([[-0.05, 0.0, -0.015], [0.02, 0.0, -0.015]])
    axis = np.tile([-1.0, 0.0, 0.0], (2, 1))
    before = columns.volume_m3
    removed = remove_turning(columns, path, axis, _feeds(path), FLAT, top_m=0.1)
    hole = np.pi * 0.008**2 * 0.05
    assert removed.volume_m3.sum() == pytest.approx(hole, rel=2e-3)
    assert removed.bottom_volume_m3.sum() == pytest.approx(hole, rel=2e-3)  # a drill cuts with its end face
    assert before - columns.volume_m3 == pytest.approx(removed.volume_m3.sum(), rel=1e-4)
    j, i = columns.count.shape[0] // 2, columns.count.shape[1] // 2
    assert columns.count[j, i] == 2
    np.testing.assert_allclose(columns.high[0, j, i], -0.023, atol=1e-5)
    np.testing.assert_allclose(columns.low[1, j, i], -0.007, atol=1e-5)


def test_columns_full_of_stretches_are_refused() -> None:
    stock = HeightMap.from_box((-0.01, -0.01, -0.1), (0.01, 0.01, 0.0), 1e-3)
    rows = []
    for k in range(STRETCHES + 1):
        rows += [[-0.02, 0.0, -0.005 - 0.01 * k], [0.02, 0.0, -0.005 - 0.01 * k], [-0.02, 0.0, -0.005 - 0.01 * k]]
    path = np.array(rows)
    axis = np.tile([-1.0, 0.0, 0.0], (len(path), 1))
    with pytest.raises(ModelError, match="too many stretches") as told:
        remove_turning(ColumnStock.of(stock), path, axis, _feeds(path), Cutter(0.004), top_m=0.1)
    assert "segment" in str(told.value)


def test_a_rapid_into_material_is_named() -> None:
    path = np.array([[-0.02, 0.0, -0.005], [0.0, 0.0, -0.005], [0.02, 0.0, -0.005]])
    kinds = np.array([RAPID, FEED])
    found = remove_turning(ColumnStock.of(_box(1e-3)), path, _upright(path), kinds, FLAT, top_m=TOP_M)
    np.testing.assert_array_equal(found.collisions, [0])


def test_a_segment_that_turns_is_divided_by_its_angle() -> None:
    path = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0]])
    axis = np.array([[0.0, 0.0, 1.0], [np.sin(0.0099), 0.0, np.cos(0.0099)]])
    motions, owner = motions_of(path, axis, engaged_m=0.02)
    assert len(motions) == 50  # 20 mm x 0.0099 rad / (2 x 2 um) = 49.5
    assert not owner.any()
    np.testing.assert_allclose(motions[:, 3:6].sum(axis=0), path[1] - path[0])
    np.testing.assert_allclose(np.linalg.norm(motions[:, 6:], axis=1), 1.0)
    axis[1] = [1.0, 0.0, 0.0]
    with pytest.raises(InputError, match="turns too far in one segment"):
        motions_of(path, axis, engaged_m=0.02)

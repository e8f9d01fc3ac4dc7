"""Columns against the height map, brute force in space, and the height map seen along a tilted tool."""

from __future__ import annotations

import itertools

import manifold3d
import numpy as np
import pytest

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError, ModelError
from counterflex.core.units import DEG
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.removal import remove_path, unit_widths
from counterflex.cutting.stock import HeightMap
from counterflex.cutting.tilted_stock import box_along_tool, working_plane
from counterflex.cutting.tridexel.column_block_kernels import MOST_STRETCHES, STRETCHES
from counterflex.cutting.tridexel.columns import ColumnStock, motions_of, remove_turning
from counterflex.cutting.tridexel.cut_log import CutLog
from counterflex.path import FEED, RAPID

FLAT, BALL, BULL = Cutter(0.016), Cutter(0.010, 0.005), Cutter(0.016, 0.003)
KINDS = pytest.mark.parametrize("cutter", [FLAT, BALL, BULL], ids=["flat", "ball", "bull"])
TOP_M = 0.05
OFF_M = 2e-6
"""What the sweep of a turning tool may be off."""


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


@pytest.mark.long
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


def _bores(count: int) -> tuple[Float, Float]:
    """Tips and axes of bores of 4 mm from the side, 10 mm one below the other, each bored and left."""
    rows = []
    for k in range(count):
        z = -0.005 - 0.01 * k
        rows += [[-0.02, 0.0, z], [0.02, 0.0, z], [-0.02, 0.0, z]]
    return np.array(rows), np.tile([-1.0, 0.0, 0.0], (len(rows), 1))


@pytest.mark.parametrize("count", [STRETCHES - 1, STRETCHES, 5 * STRETCHES])
def test_columns_grow_with_the_stretches_that_they_hold(count: int) -> None:
    tips, axes = _bores(count)
    columns = ColumnStock.of(HeightMap.from_box((-0.01, -0.01, -0.01 * count - 0.005), (0.01, 0.01, 0.0), 1e-3))
    before = columns.volume_m3
    removed = remove_turning(columns, tips, axes, _feeds(tips), Cutter(0.004), top_m=0.1).volume_m3
    assert columns.count.max() == count + 1
    each = removed.reshape(-1)[0::3]
    np.testing.assert_allclose(each, each[0], rtol=1e-4)  # the last bore takes what the first takes
    assert before - columns.volume_m3 == pytest.approx(removed.sum(), rel=1e-5)


def test_more_stretches_than_the_kernels_can_work_on_are_refused() -> None:
    tips, axes = _bores(MOST_STRETCHES)
    stock = HeightMap.from_box((-0.01, -0.01, -0.01 * MOST_STRETCHES), (0.01, 0.01, 0.0), 1e-3)
    with pytest.raises(ModelError, match=r"segment \d+: a column of the stock holds too many stretches") as told:
        remove_turning(ColumnStock.of(stock), tips, axes, _feeds(tips), Cutter(0.004), top_m=0.1)
    assert told.value.hint


def test_ridges_thinner_than_the_sweep_is_exact_fall_before_columns_grow() -> None:
    count = 3 * STRETCHES
    rows = []
    for k in range(count):  # a mill lying along y: of 1 mm, so that 0.5 um of material stay between two slots
        z = -0.001 - 0.0010005 * k
        rows += [[0.0, -0.02, z], [0.0, 0.02, z], [0.0, -0.02, z]]
    tips, axes = np.array(rows), np.tile([0.0, -1.0, 0.0], (len(rows), 1))
    columns = ColumnStock.of(HeightMap.from_box((-0.0105, -0.01, -0.1), (0.0105, 0.01, 0.0), 1e-3))
    remove_turning(columns, tips, axes, _feeds(tips), Cutter(0.001), top_m=0.1)
    assert len(columns.low) == STRETCHES
    assert columns.count.max() < STRETCHES


def test_a_rapid_into_material_is_named() -> None:
    path = np.array([[-0.02, 0.0, -0.005], [0.0, 0.0, -0.005], [0.02, 0.0, -0.005]])
    kinds = np.array([RAPID, FEED])
    found = remove_turning(ColumnStock.of(_box(1e-3)), path, _upright(path), kinds, FLAT, top_m=TOP_M)
    np.testing.assert_array_equal(found.collisions, [0])


def test_a_segment_that_turns_is_divided_until_it_is_straight_within_2_um() -> None:
    path = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0]])
    axis = np.array([[0.0, 0.0, 1.0], [np.sin(0.0999), 0.0, np.cos(0.0999)]])
    motions, owner = motions_of(path, axis, engaged_m=0.02)
    assert len(motions) == 5  # 40 mm x (0.0999 rad / n)^2 / 8 <= 2 um: n >= 4.99
    assert not owner.any()
    np.testing.assert_allclose(motions[:, 3:6].sum(axis=0), path[1] - path[0])
    ends = [motions[:, 6:9] + sign * 0.5 * motions[:, 9:] for sign in (-1.0, 1.0)]
    one, two = (end / np.linalg.norm(end, axis=1, keepdims=True) for end in ends)
    np.testing.assert_allclose(one[0], axis[0], atol=1e-15)
    np.testing.assert_allclose(two[-1], axis[1], atol=1e-15)
    np.testing.assert_allclose(one[1:], two[:-1], atol=1e-15)
    axis[1] = [1.0, 0.0, -0.01]
    with pytest.raises(InputError, match="turns too far in one segment"):
        motions_of(path, axis, engaged_m=0.02)


@KINDS
def test_columns_hold_what_the_distance_to_the_cutter_along_its_motion_says(cutter: Cutter) -> None:
    rng = np.random.default_rng(11)
    for _ in range(8):
        path = np.array([[0.0, 0.0, -0.012], [0.004, 0.001, -0.0125]]) + rng.normal(scale=5e-4, size=(2, 3))
        lean = np.linspace(0.0, 1.0, 2)[:, None] * rng.normal(scale=0.015, size=2) + rng.uniform(-0.4, 0.4, 2)
        axis = np.concatenate([lean, np.ones((2, 1))], axis=1)
        axis /= np.linalg.norm(axis, axis=1, keepdims=True)
        columns = ColumnStock.of(_box(5e-4))
        remove_turning(columns, path, axis, _feeds(path), cutter, top_m=TOP_M)
        log = CutLog.of(path, axis, cutter, top_m=TOP_M)
        ny, nx = columns.count.shape
        y, x = np.meshgrid(columns.y0_m + 5e-4 * np.arange(ny), columns.x0_m + 5e-4 * np.arange(nx), indexing="ij")
        for z in (-0.001, -0.006, -0.0105, -0.0122, -0.014):
            off = log.distance(np.stack([x.ravel(), y.ravel(), np.full(x.size, z)], axis=1)).reshape(x.shape)
            held = columns.holds(np.array([z]))[0]
            assert np.nanmin(off[held], initial=0.0) > -OFF_M  # no material in the sweep
            assert np.nanmax(off[~held], initial=0.0) < OFF_M  # nothing gone beyond it
        cut = (columns.count == 1) & (columns.high[0] < 0.0)
        ends = np.stack([x[cut], y[cut], columns.high[0][cut]], axis=1)
        assert len(ends) > 100
        assert np.abs(log.distance(ends)).max() < OFF_M


def _channel(blades: int, passes: int, points: int) -> tuple[Float, Float]:
    """Channels of a hub, the tool leaning outwards and twisting as it goes out and down; tips and axes."""
    tips, axes = [], []
    share = np.linspace(0.0, 1.0, points)
    for blade in range(blades):
        for level in range(passes):
            around = 2.0 * np.pi * blade / blades + 0.9 * share
            radius, height = 0.012 + 0.018 * share, -0.004 * (level + 1) - 0.006 * share**1.5
            lean, twist = 0.15 + 0.35 * share, 0.25 * np.sin(np.pi * share)
            outward = np.stack([np.cos(around), np.sin(around), np.zeros(points)], axis=1)
            along = np.stack([-np.sin(around), np.cos(around), np.zeros(points)], axis=1)
            axis = np.tan(lean)[:, None] * outward + np.tan(twist)[:, None] * along + [0.0, 0.0, 1.0]
            axis /= np.linalg.norm(axis, axis=1, keepdims=True)
            tip = radius[:, None] * outward + height[:, None] * [0.0, 0.0, 1.0]
            over = np.array([0.0, 0.0, 0.03])
            tips.append(np.concatenate([tip[:1] + over, tip, tip[-1:] + over]))
            axes.append(np.concatenate([axis[:1], axis, axis[-1:]]))
    return np.concatenate(tips), np.concatenate(axes)


def _posed(cutter: Cutter, tip: Float, axis: Float, around: int = 40) -> Float:
    """Vertices of the cutter as a polyhedron of its volume at a pose, mm."""
    r = cutter.radius_m if cutter.is_ball else cutter.corner_radius_m
    psi = np.linspace(0.0, np.pi / 2.0, 12) if r > 0.0 else np.zeros(1)
    rho, h = cutter.radius_m - r + r * np.sin(psi), r - r * np.cos(psi)
    rho, h = np.append(rho if r > 0.0 else cutter.radius_m, cutter.radius_m), np.append(h, TOP_M)
    side = 2.0 * np.pi / around
    angle = side * np.arange(around)
    rho *= np.sqrt(side / np.sin(side))
    e = np.cross(axis, [1.0, 0.0, 0.0])
    e /= np.linalg.norm(e)
    ring = np.cos(angle)[:, None] * e + np.sin(angle)[:, None] * np.cross(axis, e)
    return np.concatenate([tip + b * axis + a * ring for a, b in zip(rho, h, strict=True)]) * 1e3


@pytest.mark.long
@pytest.mark.parametrize("cutter", [Cutter(0.008), Cutter(0.008, 0.004)], ids=["flat", "ball"])
def test_an_impeller_has_the_volume_that_a_solid_modeller_gives_it(cutter: Cutter) -> None:
    tips, axes = _channel(1, 2, 72)
    columns = ColumnStock.of(HeightMap.from_box((-0.036, -0.036, -0.024), (0.036, 0.036, 0.0), 2.5e-4))
    before = columns.volume_m3
    removed = float(remove_turning(columns, tips, axes, _feeds(tips), cutter, top_m=TOP_M).volume_m3.sum())
    assert columns.count.max() > 1  # undercut
    assert before - columns.volume_m3 == pytest.approx(removed, rel=1e-5)
    poses = [_posed(cutter, tip, axis) for tip, axis in zip(tips, axes, strict=True)]
    swept = [manifold3d.Manifold.hull_points(np.concatenate(pair)) for pair in itertools.pairwise(poses)]
    block = manifold3d.Manifold.cube((72.0, 72.0, 24.0)).translate((-36.0, -36.0, -24.0))
    left = block - manifold3d.Manifold.batch_boolean(swept, manifold3d.OpType.Add)
    # a hull is larger than what a turning flat mill sweeps: 0.8 % at steps of 1.5 mm, 0.1 % at 0.2 mm
    assert removed == pytest.approx((block.volume() - left.volume()) * 1e-9, rel=4e-3)

"""The surface of a part against closed forms: walls, cylinders, corners, balls; the mesh against its volume."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.removal import remove_path
from counterflex.cutting.stock import HeightMap
from counterflex.cutting.tridexel.columns import ColumnStock, remove_turning
from counterflex.cutting.tridexel.cut_log import CutLog
from counterflex.cutting.tridexel.surface import Surface, surface
from counterflex.path import FEED

FLAT, BALL, BULL = Cutter(0.016), Cutter(0.010, 0.005), Cutter(0.016, 0.003)
KINDS = pytest.mark.parametrize("cutter", [FLAT, BALL, BULL], ids=["flat", "ball", "bull"])
TOP_M = 0.05
EXACT_M = 1e-6
SLOT = np.array([[-0.02, 0.02, 0.022], [0.08, 0.035, 0.022]])
"""From side to side through a block, 8 mm deep, at 8.5 degrees."""


def _upright(points: Float) -> Float:
    return np.tile([0.0, 0.0, 1.0], (len(points), 1))


def _milled(path: Float, cutter: Cutter, cell: float = 5e-4) -> tuple[Surface, ColumnStock, CutLog]:
    stock = HeightMap.from_box((0.0, 0.0, 0.0), (0.06, 0.06, 0.03), cell)
    remove_path(stock, path, np.full(len(path) - 1, FEED), cutter)
    columns, log = ColumnStock.of(stock), CutLog.of(path, _upright(path), cutter, top_m=TOP_M)
    return surface(columns, log), columns, log


def _off_slot(points: Float, path: Float, cutter: Cutter) -> Float:
    """Signed distance to the section of a straight slot, m."""
    along = (path[1] - path[0]) / np.linalg.norm(path[1] - path[0])
    rest = points - path[0]
    side = np.abs(rest @ np.array([-along[1], along[0], 0.0])) - (cutter.radius_m - cutter.corner_radius_m)
    below = cutter.corner_radius_m - rest[:, 2]
    inner = np.minimum(np.maximum(side, below), 0.0)
    out: Float = inner + np.hypot(np.maximum(side, 0.0), np.maximum(below, 0.0)) - cutter.corner_radius_m
    return out


@KINDS
def test_points_of_an_oblique_slot_lie_on_its_section(cutter: Cutter) -> None:
    found, _, log = _milled(SLOT, cutter)
    walls = found.cut & (found.along < 2)
    assert walls.sum() > 500
    assert np.abs(_off_slot(found.points[found.cut], SLOT, cutter)).max() < EXACT_M
    assert np.nanmax(np.abs(log.distance(found.points[found.cut]))) < EXACT_M


def test_the_wall_of_a_circular_pocket_is_a_cylinder() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 721)
    path = np.stack([0.03 + 0.012 * np.cos(angle), 0.03 + 0.012 * np.sin(angle), np.full(721, 0.02)], axis=1)
    found, _, _ = _milled(path, FLAT)
    walls = found.points[found.cut & (found.along < 2)]
    radius = np.hypot(walls[:, 0] - 0.03, walls[:, 1] - 0.03)
    outer = radius > 0.012
    chord = 0.012 * (1.0 - np.cos(np.pi / 720))  # a circle of chords
    assert np.count_nonzero(outer) > 1000
    assert np.all(np.abs(radius[outer] - 0.02) < EXACT_M + chord)
    assert np.all(np.abs(radius[~outer] - 0.004) < EXACT_M + 2.0 * chord)


@KINDS
def test_the_mesh_is_closed_and_holds_the_volume(cutter: Cutter) -> None:
    found, columns, _ = _milled(SLOT, cutter)
    mesh = trimesh.Trimesh(found.vertices, found.triangles, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(columns.volume_m3, rel=2e-3)


def test_a_hole_from_the_side_is_round_in_the_mesh() -> None:
    columns = ColumnStock.of(HeightMap.from_box((0.0, 0.0, 0.0), (0.06, 0.06, 0.03), 5e-4))
    path, axis = np.array([[-0.02, 0.03, 0.015], [0.04, 0.03, 0.015]]), np.tile([-1.0, 0.0, 0.0], (2, 1))
    remove_turning(columns, path, axis, np.array([FEED]), FLAT, top_m=0.1)
    found = surface(columns, CutLog.of(path, axis, FLAT, top_m=0.1))
    inside = found.points[found.cut & (found.along > 0) & (found.points[:, 0] < 0.039)]
    assert np.abs(np.hypot(inside[:, 1] - 0.03, inside[:, 2] - 0.015) - 0.008).max() < EXACT_M
    ends = found.points[found.cut & (found.along == 0)]
    assert np.abs(ends[:, 0] - 0.04).max() < EXACT_M
    mesh = trimesh.Trimesh(found.vertices, found.triangles, process=False)
    assert mesh.is_watertight
    assert mesh.body_count == 1


def _flanked(tips: Float, axes: Float, cutter: Cutter, side: float, cell: float) -> Float:
    """Points (n, 3) m of walls that the flank of a turning tool has left in a block of 10 mm about the origin."""
    columns = ColumnStock.of(HeightMap.from_box((-side, -side, -0.01), (side, side, 0.0), cell))
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    remove_turning(columns, tips, axes, np.full(len(tips) - 1, FEED), cutter, top_m=TOP_M)
    found = surface(columns, CutLog.of(tips, axes, cutter, top_m=TOP_M))
    mesh = trimesh.Trimesh(found.vertices, found.triangles, process=False)
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(columns.volume_m3, rel=5e-3)
    return found.points[found.cut & (found.along < 2)]


def test_the_flank_of_a_tool_that_leans_outwards_on_a_circle_leaves_two_cones() -> None:
    angle, lean, ring, depth = np.linspace(0.0, 2.0 * np.pi, 361), 0.2, 0.012, 0.006
    around = np.stack([np.cos(angle), np.sin(angle), np.zeros(361)], axis=1)
    tips, axes = ring * around - [0.0, 0.0, depth], np.sin(lean) * around + [0.0, 0.0, np.cos(lean)]
    walls = _flanked(tips, axes, Cutter(0.006), 0.02, 5e-4)
    # distance from the cone that the axis sweeps: radius ring + (z + depth) tan(lean)
    off = (np.hypot(walls[:, 0], walls[:, 1]) - ring) * np.cos(lean) - (walls[:, 2] + depth) * np.sin(lean)
    flank = walls[:, 2] > -depth + 0.003 * np.sin(lean) + 1e-4  # above the rim of the end face
    assert np.count_nonzero(flank & (off > 0.0)) > 500
    assert np.count_nonzero(flank & (off < 0.0)) > 500
    chord = (ring + 0.006) * (1.0 - np.cos(np.pi / 360))
    assert np.abs(np.abs(off[flank]) - 0.003).max() < EXACT_M + chord


def test_the_flank_of_a_tool_that_turns_as_it_goes_leaves_the_offset_of_a_ruled_surface() -> None:
    x, rate, depth, radius = np.linspace(-0.03, 0.03, 61), 8.0, 0.006, 0.003
    tips = np.stack([x, np.zeros(61), np.full(61, -depth)], axis=1)
    axes = np.stack([np.zeros(61), rate * x, np.ones(61)], axis=1)  # its lines: y = rate x (z + depth)
    walls = _flanked(tips, axes, Cutter(2.0 * radius), 0.02, 5e-4)
    walls = walls[walls[:, 2] > -depth + 1e-3]
    x, z = walls[:, 0].copy(), walls[:, 2] + depth
    h = z.copy()
    for _ in range(60):  # the foot (x, h) on the surface, one coordinate after the other
        x = (walls[:, 0] + rate * h * walls[:, 1]) / (1.0 + (rate * h) ** 2)
        h = (z + rate * x * walls[:, 1]) / (1.0 + (rate * x) ** 2)
    off = np.sqrt((walls[:, 0] - x) ** 2 + (walls[:, 1] - rate * x * h) ** 2 + (z - h) ** 2)
    assert np.count_nonzero(h > 3e-4) > 1500
    assert np.abs(off - radius)[h > 3e-4].max() < EXACT_M


def test_a_wall_milled_too_deep_is_off_by_what_it_was_moved() -> None:
    found, _, _ = _milled(SLOT + np.array([0.0, 0.0003, 0.0]), FLAT)
    nominal = CutLog.of(SLOT, _upright(SLOT), FLAT, top_m=TOP_M)
    walls = found.points[
        found.cut & (found.along < 2) & (found.points[:, 2] > 0.0225)
    ]  # nearer to the wall than to the floor
    off = nominal.distance(walls)
    square = 0.0003 * np.cos(np.arctan2(0.015, 0.1))
    np.testing.assert_allclose(np.abs(off), square, atol=EXACT_M)
    assert np.all((off > 0.0) == (walls[:, 1] > np.interp(walls[:, 0], SLOT[:, 0], SLOT[:, 1])))


def test_a_tool_that_stands_still_at_a_corner_does_not_cut_it() -> None:
    path = np.array([[0.01, 0.01, 0.0], [0.02, 0.01, 0.0], [0.02, 0.01, 0.0], [0.02, 0.03, 0.0], [0.02, 0.04, 0.0]])
    log = CutLog.of(path, _upright(path), FLAT, top_m=TOP_M)
    np.testing.assert_allclose(log.motions[:, 3:6], [[0.01, 0.0, 0.0], [0.0, 0.03, 0.0]], atol=1e-15)
    still = CutLog.of(np.tile(path[:1], (3, 1)), _upright(path[:3]), FLAT, top_m=TOP_M)
    assert len(still.motions) == 1
    assert still.distance(np.array([[0.01, 0.01, 0.004]]))[0] == pytest.approx(-0.004, abs=1e-12)


def test_meshes_are_written_in_mm(tmp_path: Path) -> None:
    found, _, log = _milled(SLOT, FLAT, 1e-3)
    found.save(tmp_path / "part.stl")
    found.save(tmp_path / "part.ply", log.distance(found.vertices))
    for name in ("part.stl", "part.ply"):
        mesh = trimesh.load_mesh(tmp_path / name)
        np.testing.assert_allclose(mesh.extents, [60.0, 60.0, 30.0], atol=1e-3)
    assert mesh.visual.kind == "vertex"
    with pytest.raises(InputError, match=r"\.stl or \.ply"):
        found.save(tmp_path / "part.step")
    with pytest.raises(InputError, match="range of the colours"):
        found.save(tmp_path / "part.ply", range_m=0.0)


def test_nothing_left_and_too_fine_a_lattice_are_refused() -> None:
    stock = HeightMap.from_box((0.0, 0.0, 0.0), (0.02, 0.02, 0.01), 1e-3)
    path = np.array([[-0.05, 0.01, -0.001], [0.07, 0.01, -0.001]])
    log = CutLog.of(path, _upright(path), Cutter(0.05), top_m=TOP_M)
    with pytest.raises(InputError, match="too many points"):
        surface(ColumnStock.of(stock), log, pitch_m=1e-8)
    remove_path(stock, path, np.array([FEED]), Cutter(0.05))
    with pytest.raises(InputError, match="nothing is left"):
        surface(ColumnStock.of(stock), log)

"""Height maps: from a box, a mesh, a file; what they refuse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import FileFormatError, InputError, ModelError
from counterflex.cutting.stock import BLOCK_COLUMNS, BLOCK_ROWS, HeightMap, block_tops, require_vertical


def to_mesh(stock: HeightMap, step: int = 1) -> tuple[Float, Int]:
    """Closed triangle mesh of the part: the top through the cell centres, vertical sides, and the bottom.

    Args:
        stock: The height map.
        step: Use every ``step``-th cell each way.

    Returns:
        Vertices (n, 3) in m, part frame, and faces (m, 3), counter-clockwise seen from outside. Its volume is that of
        the map less half a cell along the rim.

    Raises:
        InputError: The step leaves fewer than 2 cells a side.
    """
    if step < 1 or min(stock.z.shape) <= step:
        raise InputError("mesh step is out of range", value=step, limit=f"1 to {min(stock.z.shape) - 1}")
    z = stock.z[::step, ::step].astype(np.float64)
    x, y = stock.x_m()[::step], stock.y_m()[::step]
    ny, nx = z.shape
    plan_x, plan_y = np.meshgrid(x, y)
    top = np.stack([plan_x, plan_y, np.maximum(z, stock.bottom_m)], axis=-1).reshape(-1, 3)
    base = top.copy()
    base[:, 2] = stock.bottom_m
    index = np.arange(ny * nx).reshape(ny, nx)
    a, b, c, d = index[:-1, :-1].ravel(), index[:-1, 1:].ravel(), index[1:, 1:].ravel(), index[1:, :-1].ravel()
    up = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    rim = np.concatenate([index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]])
    after = np.roll(rim, -1)
    n = ny * nx
    sides = np.concatenate([np.stack([rim, rim + n, after + n], 1), np.stack([rim, after + n, after], 1)])
    faces: Int = np.concatenate([up, up[:, ::-1] + n, sides]).astype(np.int64)
    vertices: Float = np.concatenate([top, base])
    return vertices, faces


def test_box_has_its_volume_and_cells() -> None:
    stock = HeightMap.from_box((0.0, -0.01, -0.02), (0.03, 0.01, 0.0), 1e-4)
    assert stock.z.shape == (200, 300)
    assert stock.volume_m3 == pytest.approx(0.03 * 0.02 * 0.02, rel=1e-7)
    assert stock.x_m()[0] == pytest.approx(0.5e-4)
    assert stock.y_m()[-1] == pytest.approx(0.01 - 0.5e-4)


def test_block_maxima_match_a_direct_search() -> None:
    rng = np.random.default_rng(3)
    z = rng.normal(size=(21, 53)).astype(np.float32)
    tops = block_tops(z)
    for b in range(tops.shape[0]):
        for k in range(tops.shape[1]):
            i = min(k * BLOCK_COLUMNS, 53 - BLOCK_COLUMNS)
            assert tops[b, k] == z[b * BLOCK_ROWS : (b + 1) * BLOCK_ROWS, i : i + BLOCK_COLUMNS].max()


def test_previous_result_is_new_stock(tmp_path: Path) -> None:
    stock = HeightMap.from_box((0.0, 0.0, -0.01), (0.02, 0.02, 0.0), 5e-4)
    stock.z[3:9, 5:11] -= np.float32(0.004)
    stock.refresh()
    stock.save(tmp_path / "a" / "result.npz")
    again = HeightMap.load(tmp_path / "a" / "result.npz")
    assert np.array_equal(again.z, stock.z)
    assert np.array_equal(again.tops, stock.tops)
    assert (again.x0_m, again.y0_m, again.cell_m, again.bottom_m) == (
        stock.x0_m,
        stock.y0_m,
        stock.cell_m,
        stock.bottom_m,
    )


def test_copy_is_independent() -> None:
    stock = HeightMap.from_box((0.0, 0.0, -0.01), (0.02, 0.02, 0.0), 5e-4)
    other = stock.copy()
    other.z[:] = -0.005
    assert float(stock.z.max()) == 0.0


def test_stl_block_with_a_dome(tmp_path: Path) -> None:
    block = trimesh.creation.box(extents=(30.0, 20.0, 10.0))
    dome = trimesh.creation.icosphere(subdivisions=4, radius=8.0)
    dome.apply_translation((0.0, 0.0, 5.0))
    body = trimesh.boolean.union([block, dome], engine="manifold")
    body.export(tmp_path / "stock.stl")
    stock = HeightMap.from_stl(tmp_path / "stock.stl", 1e-4)
    assert stock.z.shape == (200, 300)
    assert stock.bottom_m == pytest.approx(-0.005)
    assert stock.volume_m3 == pytest.approx(body.volume * 1e-9, rel=2e-5)
    x, y = np.meshgrid(stock.x_m(), stock.y_m())
    rest = 0.008**2 - x**2 - y**2
    expected = np.where(rest > 0.0, 0.005 + np.sqrt(np.maximum(rest, 0.0)), 0.005)
    inside = np.hypot(x, y) < 0.0075
    assert np.abs(stock.z - expected)[inside].max() < 3e-5


def test_part_as_mesh_is_closed_and_has_the_volume() -> None:
    stock = HeightMap.from_box((0.0, 0.0, -0.01), (0.02, 0.03, 0.0), 5e-4)
    stock.z[10:20, 10:30] = -0.004
    vertices, faces = to_mesh(stock)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    inner = 39 * 59 * 5e-4**2 * 0.01 - 10 * 20 * 5e-4**2 * 0.004
    assert mesh.volume == pytest.approx(inner, rel=1e-6)


def test_open_mesh_is_refused(tmp_path: Path) -> None:
    box = trimesh.creation.box(extents=(30.0, 20.0, 10.0))
    trimesh.Trimesh(box.vertices, box.faces[1:]).export(tmp_path / "open.stl")
    with pytest.raises(FileFormatError, match="watertight"):
        HeightMap.from_stl(tmp_path / "open.stl", 1e-4)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_wrong_unit_is_noticed(tmp_path: Path, scale: float) -> None:
    trimesh.creation.box(extents=(30.0 * scale, 20.0 * scale, 10.0 * scale)).export(tmp_path / "unit.stl")
    with pytest.raises(InputError, match="implausibly"):
        HeightMap.from_stl(tmp_path / "unit.stl", 1e-4)


def test_what_is_no_stl_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.stl").write_text("hello")
    with pytest.raises(FileFormatError):
        HeightMap.from_stl(tmp_path / "x.stl", 1e-4)
    with pytest.raises(FileFormatError, match="no such file"):
        HeightMap.from_stl(tmp_path / "missing.stl", 1e-4)


def test_damaged_and_newer_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(b"not a zip")
    np.savez(tmp_path / "b.npz", z=np.zeros(3))
    np.savez(tmp_path / "c.npz", format=np.array("counterflex-stock"), version=np.array(99))
    np.savez(tmp_path / "d.npz", format=np.array("counterflex-stock"), version=np.array(1))
    for name in "abcd":
        with pytest.raises(FileFormatError):
            HeightMap.load(tmp_path / f"{name}.npz")
    with pytest.raises(FileFormatError):
        HeightMap.load(tmp_path / "missing.npz")


@pytest.mark.parametrize(
    ("low", "high", "cell"),
    [
        ((0.0, 0.0, 0.0), (0.02, 0.02, 0.0), 1e-4),
        ((0.0, 0.0, 0.0), (-0.02, 0.02, 0.01), 1e-4),
        ((0.0, 0.0, 0.0), (0.02, 0.02, 0.01), 0.0),
        ((0.0, 0.0, 0.0), (0.02, 0.02, 0.01), float("nan")),
        ((0.0, 0.0, 0.0), (0.02, 0.02, 0.01), 5e-3),
        ((0.0, 0.0, 0.0), (200.0, 200.0, 40.0), 0.1),
        ((0.0, 0.0, 0.0), (2.0, 2.0, 0.01), 1e-5),
        ((0.0, 0.0, 0.0), (0.02, 0.02, 3.0), 1e-4),
        ((0.0, 0.0, float("inf")), (0.02, 0.02, 3.0), 1e-4),
    ],
)
def test_impossible_boxes_are_refused(
    low: tuple[float, float, float], high: tuple[float, float, float], cell: float
) -> None:
    with pytest.raises(InputError):
        HeightMap.from_box(low, high, cell)


def test_heights_must_be_finite_and_above_the_bottom() -> None:
    z = np.zeros((20, 20), np.float32)
    with pytest.raises(InputError, match="below its bottom"):
        HeightMap(0.0, 0.0, 1e-3, z, 0.01)
    z[3, 3] = np.nan
    with pytest.raises(InputError, match="not finite"):
        HeightMap(0.0, 0.0, 1e-3, z, -0.01)


def test_tilted_axis_is_a_model_error() -> None:
    axis = np.tile([0.0, 0.0, 1.0], (5, 1))
    require_vertical(axis)
    axis[3] = [np.sin(0.01), 0.0, np.cos(0.01)]
    with pytest.raises(ModelError, match="point 3"):
        require_vertical(axis)
    with pytest.raises(ModelError):
        require_vertical(np.array([[0.0, 0.0, -1.0]]))

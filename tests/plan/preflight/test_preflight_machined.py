"""Distance of bodies to the machined stock, against MuJoCo on boxes that stand for it; meshes as bodies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.core.units import MM
from counterflex.cutting.stock import HeightMap
from counterflex.files.cell.bodies import MOST_PIECES, convex_pieces
from counterflex.geometry import pose, rotation
from counterflex.plan.preflight.bodies import CollisionBody, along, box, holder, hull
from counterflex.plan.preflight.collision import Scene
from counterflex.plan.preflight.column_distance_kernel import stock_distance
from counterflex.plan.preflight.machined_stock import SHAPES, coarse

FAR_M = 0.5
X, Z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
CORNERS = np.array([[x, y, z] for x in (-0.01, 0.01) for y in (-0.02, 0.02) for z in (0.0, 0.03)])
BODIES = {
    "box": CollisionBody("b", "base", "box", np.eye(4), (0.01, 0.02, 0.03)),
    "capsule": along("c", "base", -0.02 * Z, 0.02 * Z, 0.01),
    "cylinder": along("c", "base", -0.02 * Z, 0.02 * Z, 0.015, "cylinder"),
    "mesh": hull("m", "base", np.eye(4), CORNERS, surrounds=True),
}


def stepped() -> HeightMap:
    """A block of 40 x 40 x 20 mm whose half beyond x = 20 mm is 8 mm high."""
    stock = HeightMap.from_box((0.0, 0.0, 0.0), (0.04, 0.04, 0.02), 0.5 * MM)
    stock.z[:, 40:] = 8.0 * MM
    stock.refresh()
    return stock


def to_stock(body: CollisionBody, T: Float, stock: HeightMap) -> float:
    grid = np.array([stock.x0_m, stock.y0_m, stock.cell_m, stock.bottom_m])
    planes = np.zeros((0, 4)) if body.faces is None else body.faces
    size = np.array([*body.size_m, 0.0, 0.0][:3])
    return stock_distance(SHAPES[body.shape], size, planes, T, stock.z, stock.tops, grid, np.zeros(3), FAR_M)


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(["box", "capsule", "cylinder"]),
    st.tuples(*(st.floats(-0.06, 0.1) for _ in range(3))),
    st.tuples(*(st.floats(-3.0, 3.0) for _ in range(3))),
)
def test_distance_is_that_of_two_boxes(shape: str, at: tuple[float, ...], turn: tuple[float, ...]) -> None:
    """The stepped block as two boxes, by MuJoCo; columns stand for their middles, half a cell inside."""
    body = BODIES[shape]
    T = pose.make(rotation.exp(np.array(turn)), np.array(at))
    high = box("high", "base", np.zeros(3), np.array([0.02, 0.04, 0.02]))
    low = box("low", "base", np.array([0.02, 0.0, 0.0]), np.array([0.04, 0.04, 0.008]))
    scene = Scene([body, high, low])
    scene.place(np.stack([T, high.T_frame_body, low.T_frame_body]))
    expected = min(scene.distance(0, 1), scene.distance(0, 2))
    found = to_stock(body, T, stepped())
    if expected > 1e-4:
        assert found == pytest.approx(expected, abs=0.71 * 0.5 * MM)
    else:
        assert found < 0.71 * 0.5 * MM


def test_distance_to_a_mesh_is_never_too_large() -> None:
    T = pose.make(np.eye(3), np.array([0.02, 0.02, 0.03]))
    assert to_stock(BODIES["mesh"], T, stepped()) == pytest.approx(-0.005, abs=1e-6)  # 15 mm below its centre, 5 deep
    lifted = pose.make(np.eye(3), np.array([0.02, 0.02, 0.06]))
    assert to_stock(BODIES["mesh"], lifted, stepped()) == pytest.approx(0.025, abs=1e-6)


def test_coarse_columns_are_never_lower_than_the_stock() -> None:
    stock = HeightMap.from_box((0.0, 0.0, 0.0), (0.03, 0.03, 0.01), 0.1 * MM)
    stock.z[:] = 0.01 * np.random.default_rng(1).random(stock.z.shape, dtype=np.float32)
    stock.refresh()
    wide = coarse(stock)
    times = round(wide.cell_m / stock.cell_m)
    assert times == 5
    again = np.repeat(np.repeat(wide.z, times, axis=0), times, axis=1)[: stock.z.shape[0], : stock.z.shape[1]]
    assert np.all(again >= stock.z)
    assert wide.z.max() == stock.z.max()


def test_a_holder_is_a_row_of_cylinders() -> None:
    pieces = holder(3, [(0.03, 0.01), (0.05, 0.02), (0.05, 0.03), (0.09, 0.03)])
    assert [(body.tool, body.cuts, body.shape) for body in pieces] == [(3, False, "cylinder")] * 2
    assert [body.size_m for body in pieces] == [pytest.approx((0.02, 0.01)), pytest.approx((0.03, 0.02))]
    assert pieces[0].T_frame_body[:3, 3] == pytest.approx([0.0, 0.0, -0.04])  # behind the tip


def test_a_convex_mesh_is_one_body_as_far_away_as_its_box(tmp_path: Path) -> None:
    trimesh.creation.box(extents=(20, 40, 60)).export(tmp_path / "box.stl")
    (points,) = convex_pieces(tmp_path / "box.stl")
    body, probe = hull("m", "base", np.eye(4), points, surrounds=True), along("p", "base", 0 * Z, Z * 0.01, 0.005)
    same = CollisionBody("b", "base", "box", np.eye(4), (0.01, 0.02, 0.03))
    scene = Scene([body, same, probe])
    for at in ([0.1, 0.02, 0.0], [0.0, -0.09, 0.05], [0.03, 0.04, 0.08]):
        scene.place(np.stack([body.T_frame_body, np.eye(4), pose.make(rotation.about_y(0.4), np.array(at))]))
        assert scene.distance(0, 2) == pytest.approx(scene.distance(1, 2), abs=1e-5)


def test_a_hollow_mesh_leaves_its_hollow_free(tmp_path: Path) -> None:
    """A ring of 100 mm with a bore of 60 mm: a probe of 10 mm in the bore has room, its hull has none."""
    trimesh.creation.annulus(r_min=30, r_max=50, height=20).export(tmp_path / "ring.stl")
    pieces = [hull("ring", "base", np.eye(4), p, surrounds=True) for p in convex_pieces(tmp_path / "ring.stl")]
    assert 1 < len(pieces) <= MOST_PIECES
    probe = along("p", "base", -0.02 * Z, 0.02 * Z, 0.005)
    scene = Scene([*pieces, probe])
    for x, expected in ((0.0, 25.0), (0.04, -5.0), (0.07, 15.0)):
        places = [body.T_frame_body for body in pieces]
        scene.place(np.stack([*places, pose.make(np.eye(3), x * X)]))
        near = min(scene.distance(k, len(pieces)) for k in range(len(pieces)))
        assert near < 0.0 if expected < 0.0 else near / MM == pytest.approx(expected, abs=5.0)


@pytest.mark.parametrize("content", [None, b"", b"solid nothing\nendsolid nothing\n", b"\x00" * 100])
def test_a_mesh_that_cannot_be_read_is_refused(tmp_path: Path, content: bytes | None) -> None:
    file = tmp_path / "body.stl"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(FileFormatError, match="body"):
        convex_pieces(file)

"""Meshes as points: triangles of STL, OBJ and PLY, covered with points of even density."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core import file_content
from counterflex.core.arrays import Float, batches
from counterflex.core.errors import FileFormatError
from counterflex.files.scan.scan import PointStore, Scan

LIMIT_TRIANGLES: Final = 20_000_000
POINTS: Final = 3_000_000
"""Points that a mesh is covered with, about."""
_STL_HEAD: Final = 84
_TRIANGLE: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def is_binary_stl(path: Path) -> bool:
    """Whether the size of a file is that of a binary STL with the count of triangles in it, or almost."""
    with path.open("rb") as stream:
        head = stream.read(_STL_HEAD)
    if len(head) < _STL_HEAD or path.suffix.lower() != ".stl":
        return False
    return not (head.lstrip().startswith(b"solid") and b"\x00" not in head)


def read_mesh(path: Path, kind: str) -> Scan:
    """Read a mesh and cover its triangles with points: meshes of scanners are coarse where the part is flat.

    Args:
        path: The file.
        kind: ``stl``, ``obj`` or ``ply``.

    Raises:
        FileFormatError: It cannot be read, is truncated, has no triangles or more than twenty million.
    """
    corners = _binary_stl(path) if kind == "stl" and is_binary_stl(path) else _by_library(path, kind)
    store = PointStore(path, f"mesh ({kind.upper()}), {len(corners)} triangles")
    finite = np.isfinite(corners).all(axis=(1, 2))
    if not finite.any():
        raise FileFormatError("the mesh has no triangle of finite numbers", where=str(path), value=len(corners))
    corners = corners[finite]
    for points in _covering(corners):
        store.add(points)
    return store.scan()


def read_ply_cloud(path: Path) -> Scan:
    """Read the vertices of a PLY file without faces whose vertices come behind other elements.

    Raises:
        FileFormatError: It cannot be read.
    """
    import trimesh  # heavy

    with file_content.readable(path, "a cloud of points (PLY)", "Export it again"):
        vertices = np.asarray(trimesh.load(path, file_type="ply", process=False).vertices, np.float64)
    store = PointStore(path, "cloud of points (PLY)")
    store.add(vertices.reshape(-1, 3))
    return store.scan()


def _binary_stl(path: Path) -> Any:
    with path.open("rb") as stream:
        count = int(np.frombuffer(stream.read(_STL_HEAD)[80:84], "<u4")[0])
        room = path.stat().st_size - _STL_HEAD
        if room < count * _TRIANGLE.itemsize:
            raise FileFormatError(
                "the STL file ends too early",
                where=str(path),
                value=f"{max(room, 0) // _TRIANGLE.itemsize} triangles",
                limit=count,
            )
        if count > LIMIT_TRIANGLES:
            raise _too_many(path, count)
        return np.fromfile(stream, _TRIANGLE, count)["corners"]


def _by_library(path: Path, kind: str) -> Any:
    """Triangles (t, 3, 3) as trimesh reads them."""
    import trimesh  # heavy

    with file_content.readable(path, f"a mesh ({kind.upper()})", "Export it again"):
        mesh = trimesh.load(path, file_type=kind, process=False, force="mesh")
        faces = np.asarray(getattr(mesh, "faces", np.empty((0, 3))))
        if len(faces) > LIMIT_TRIANGLES:
            raise _too_many(path, len(faces))
        if len(faces) == 0:
            raise FileFormatError("the mesh has no triangles", where=str(path), hint="Export points as PLY or XYZ")
        return np.asarray(mesh.vertices, np.float64)[faces]


def _too_many(path: Path, count: int) -> FileFormatError:
    return FileFormatError(
        "the mesh has too many triangles",
        where=str(path),
        value=count,
        limit=f"<= {LIMIT_TRIANGLES}",
        hint="Export the points instead, or a thinned mesh",
    )


def _covering(corners: Any) -> Any:
    """Points on the triangles, as many on each as its area is of the whole; their centroids where they are small."""
    parts = list(batches(len(corners), 1 << 18))
    area = np.concatenate([_area(corners[part]) for part in parts])
    total = float(area.sum())
    share = area / total * POINTS if total > 0.0 else np.zeros(len(area))
    rng = np.random.default_rng(0)
    for part in parts:
        number = np.maximum(1, np.floor(share[part] + rng.random(len(share[part])))).astype(np.int64)
        number[area[part] == 0.0] = 0
        owner = np.repeat(np.arange(part.start, part.stop), number)
        for some in batches(len(owner), 1 << 20):
            triangle = np.asarray(corners[owner[some]], np.float64)
            # square root: even over the triangle; a lone point stands at the centroid
            u, v = np.sqrt(rng.random(len(triangle))), rng.random(len(triangle))
            yield _at(triangle, 1.0 - u, u * (1.0 - v), u * v)


def _at(triangle: Float, a: Float, b: Float, c: Float) -> Float:
    out: Float = a[:, None] * triangle[:, 0] + b[:, None] * triangle[:, 1] + c[:, None] * triangle[:, 2]
    return out


def _area(corners: Any) -> Float:
    corners = np.asarray(corners, np.float64)
    out: Float = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return out

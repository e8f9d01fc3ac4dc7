"""Bodies from STL meshes, as convex pieces: distances are those of convex bodies.

A convex mesh is one piece. The surface of any other one is divided at the middle of its longest side until the pieces
are small; each is replaced by its hull, so that a hollow is filled by no more than the size of a piece.
"""

from __future__ import annotations

import heapq
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core import file_content
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.core.units import MM

MOST_PIECES: Final = 96
"""Of one mesh: each is one more body for every row of a program."""
SMALL: Final = 1.0 / 16.0
"""Size of a piece by the diagonal of the mesh below which it is not divided any more."""
LARGEST_M: Final = 20.0
THICK_M: Final = 0.05 * MM
"""A flat piece is made so thick to either side: a hull needs a volume."""


def convex_pieces(path: Path) -> list[Float]:
    """Read an STL mesh in mm and divide it into convex pieces.

    Args:
        path: The file.

    Returns:
        Corners (k, 3) m of each piece, at least one.

    Raises:
        FileFormatError: The file cannot be read, holds no triangle, or is implausibly large.
    """
    import trimesh  # heavy

    with file_content.readable(path, "an STL mesh of a body"):
        with path.open("rb") as stream:
            mesh: Any = trimesh.load_mesh(stream, file_type="stl")
        empty = len(mesh.faces) == 0
    if empty or not np.all(np.isfinite(mesh.vertices)):
        raise FileFormatError("a body has no triangles, or corners that are not finite", where=str(path))
    diagonal = float(np.linalg.norm(mesh.extents))
    if not 0.0 < diagonal * MM <= LARGEST_M:
        size, limit = f"{diagonal * MM:g} m", f"<= {LARGEST_M:g} m"
        raise FileFormatError("a body is implausibly large", where=str(path), value=size, limit=limit, hint="Use mm")
    out: list[Float] = []
    for part in mesh.split(only_watertight=False):
        out += [part.vertices * MM] if part.is_watertight and part.is_convex else _divided(part, diagonal)
    return [_thick(np.asarray(points, dtype=np.float64)) for points in out]


def _divided(part: Any, diagonal: float) -> list[Float]:
    """Corners (k, 3) m of small pieces of a surface."""
    import trimesh  # heavy

    vertices, faces = trimesh.remesh.subdivide_to_size(part.vertices, part.faces, max_edge=2.0 * SMALL * diagonal,
                                                       max_iter=20)  # fmt: skip
    triangles = np.asarray(vertices)[np.asarray(faces)]
    heap = [(-_size(triangles), 0, triangles)]
    done: list[Float] = []
    count = 1
    while heap and len(heap) + len(done) < MOST_PIECES:
        size, _, piece = heapq.heappop(heap)
        middle = piece.mean(axis=1)
        axis = int(np.argmax(np.ptp(piece.reshape(-1, 3), axis=0)))
        lower = middle[:, axis] <= np.median(middle[:, axis])
        if -size <= SMALL * diagonal or lower.all() or not lower.any():
            done.append(piece)
            continue
        for some in (piece[lower], piece[~lower]):
            heapq.heappush(heap, (-_size(some), count, some))
            count += 1
    return [piece.reshape(-1, 3) * MM for piece in (*done, *(piece for _, _, piece in heap))]


def _size(triangles: Float) -> float:
    return float(np.linalg.norm(np.ptp(triangles.reshape(-1, 3), axis=0)))


def _thick(points_m: Float) -> Float:
    """The same points, to both sides along every axis where they lie in one plane."""
    spread = np.linalg.svd(points_m - points_m.mean(axis=0), compute_uv=False)
    if spread[2] > 1e-3 * spread[0]:
        return points_m
    shifts = THICK_M * np.concatenate([np.eye(3), -np.eye(3)])
    return (points_m[:, None, :] + shifts).reshape(-1, 3)

"""Table ``[cell]`` of a cell file: coarse bodies that a preflight compares, in place of assumed ones or beside them."""

from __future__ import annotations

import heapq
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import Field, model_validator

from counterflex.core import file_content
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.core.similar import twice
from counterflex.core.units import MM
from counterflex.files.schema import PoseTable, Table
from counterflex.geometry import pose
from counterflex.plan.preflight.bodies import CollisionBody, along, hull

# Bodies from STL meshes, as convex pieces: distances are those of convex bodies.
# A convex mesh is one piece. The surface of any other one is divided at the middle of its longest side until the pieces
# are small; each is replaced by its hull, so that a hollow is filled by no more than the size of a piece.

MOST_PIECES: Final = 96
"""Of one mesh: each is one more body for every row of a program."""
SMALL: Final = 1.0 / 16.0
"""Size of a piece by the diagonal of the mesh below which it is not divided any more."""
LARGEST_M: Final = 20.0
THICK_M: Final = 0.05 * MM
"""A flat piece is made so thick to either side: a hull needs a volume."""


def convex_pieces(path: Path) -> list[Float]:
    """Read an STL mesh in mm and divide it into convex pieces.

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


Frame = Literal["base", "joint1", "joint2", "joint3", "joint4", "joint5", "joint6", "flange", "tcp", "part"]
Size = Annotated[float, Field(gt=0.0, le=20000.0)]
MOST_BODIES: Final = 64


class CoarseBodyTable(PoseTable):
    """A box about its pose; a capsule or cylinder from its pose along z; a mesh; none: the assumed body is left out."""

    name: Annotated[str, Field(min_length=1, max_length=40)]
    shape: Literal["box", "capsule", "cylinder", "mesh", "none"]
    frame: Frame = "base"
    size_mm: tuple[Size, Size, Size] | None = None
    radius_mm: Size | None = None
    length_mm: Annotated[float, Field(ge=0.0, le=20000.0)] | None = None
    stl: Annotated[str, Field(min_length=1, max_length=500)] | None = None
    source: str = ""

    @model_validator(mode="after")
    def _sizes(self) -> CoarseBodyTable:
        keys = ("size_mm", "radius_mm", "length_mm", "stl")
        given = {key for key in keys if getattr(self, key) is not None}
        needed = {"box": {"size_mm"}, "mesh": {"stl"}, "none": set()}.get(self.shape, {"radius_mm", "length_mm"})
        if given != needed:
            expected = " and ".join(key for key in keys if key in needed) or "no size"
            raise ValueError(f"a body of shape {self.shape} has {expected}; got {', '.join(sorted(given)) or 'none'}")
        return self

    @property
    def surrounds(self) -> bool:
        """It belongs to the surroundings, not to the robot."""
        return self.frame in ("base", "part") and self.name not in ROBOT_BODIES

    def pieces(self, folder: Path) -> list[CollisionBody]:
        """The body in SI; a mesh as convex pieces. None for shape ``none``."""
        if self.shape == "mesh":
            T = self.matrix()
            points = convex_pieces(folder / (self.stl or ""))
            return [hull(self.name, self.frame, T, some, surrounds=self.surrounds) for some in points]
        return [] if self.shape == "none" else [self.body()]

    def body(self) -> CollisionBody:
        """The body in SI; not for shapes ``none`` and ``mesh``."""
        T, surrounds = self.matrix(), self.surrounds
        if self.shape == "box":
            half = tuple(0.5 * MM * edge for edge in self.size_mm or ())
            return CollisionBody(self.name, self.frame, "box", T, half, assumed=False, surrounds=surrounds)
        ends = pose.transform(T, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, (self.length_mm or 0.0) * MM]]))
        shape: Literal["capsule", "cylinder"] = "capsule" if self.shape == "capsule" else "cylinder"
        return along(
            self.name,
            self.frame,
            ends[0],
            ends[1],
            (self.radius_mm or 0.0) * MM,
            shape,
            assumed=False,
            surrounds=surrounds,
        )


ROBOT_BODIES: Final = ("foot",)
"""Bodies that stand still and are part of the robot."""


class SurroundingsTable(Table):
    """Bodies of robot and surroundings."""

    body: Annotated[tuple[CoarseBodyTable, ...], Field(max_length=MOST_BODIES)] = ()

    @model_validator(mode="after")
    def _unique(self) -> SurroundingsTable:
        if (name := twice([row.name for row in self.body])) is not None:
            raise ValueError(f"two bodies are named '{name}'; names must differ")
        return self

    def bodies(self, folder: Path = Path()) -> tuple[list[CollisionBody], list[str]]:
        """Bodies that are there, and names of assumed ones that are not.

        Args:
            folder: Of the cell file: names of meshes are relative to it.
        """
        there = [piece for row in self.body for piece in row.pieces(folder)]
        return there, [row.name for row in self.body if row.shape == "none"]

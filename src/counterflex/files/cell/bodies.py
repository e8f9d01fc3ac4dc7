"""Table ``[cell]`` of a cell file: coarse bodies that a preflight compares, in place of assumed ones or beside them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field, model_validator

from counterflex.core.units import MM
from counterflex.files.cell.body_mesh import convex_pieces
from counterflex.files.schema import PoseTable, Table
from counterflex.geometry import pose
from counterflex.plan.preflight.bodies import Body, along, hull

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

    def pieces(self, folder: Path) -> list[Body]:
        """The body in SI; a mesh as convex pieces. None for shape ``none``.

        Args:
            folder: That file names are relative to.

        Raises:
            FileFormatError: The mesh cannot be read.
        """
        if self.shape == "mesh":
            T = self.matrix()
            points = convex_pieces(folder / (self.stl or ""))
            return [hull(self.name, self.frame, T, some, surrounds=self.surrounds) for some in points]
        return [] if self.shape == "none" else [self.body()]

    def body(self) -> Body:
        """The body in SI; not for shapes ``none`` and ``mesh``."""
        T, surrounds = self.matrix(), self.surrounds
        if self.shape == "box":
            half = tuple(0.5 * MM * edge for edge in self.size_mm or ())
            return Body(self.name, self.frame, "box", T, half, assumed=False, surrounds=surrounds)
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
        names = [row.name for row in self.body]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"two bodies are named '{name}'; names must differ")
        return self

    def bodies(self, folder: Path = Path()) -> tuple[list[Body], list[str]]:
        """Bodies that are there, and names of assumed ones that are not.

        Args:
            folder: Of the cell file: names of meshes are relative to it.

        Raises:
            FileFormatError: A mesh cannot be read.
        """
        there = [piece for row in self.body for piece in row.pieces(folder)]
        return there, [row.name for row in self.body if row.shape == "none"]

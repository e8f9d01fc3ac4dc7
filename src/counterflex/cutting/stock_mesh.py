"""Stock from a triangle mesh."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float, Float32, Int
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.file_content import readable
from counterflex.core.jit import kernel

STL_UNIT_M: Final = 1e-3
"""STL files carry no unit; CAM systems write mm."""
SMALLEST_SIDE_M: Final = 2e-3
LARGEST_SIDE_M: Final = 10.0


def upper_surface(
    vertices_m: Float, faces: Int, x0_m: float, y0_m: float, cell_m: float, shape: tuple[int, int]
) -> Float:
    """Highest point of a mesh over each cell centre, by filling the plan view of every triangle.

    Args:
        vertices_m: (n, 3) m.
        faces: (m, 3) vertex indices.
        x0_m: x of the centre of cell [0, 0], m; y0_m likewise.
        y0_m: See x0_m.
        cell_m: Side of a cell, m.
        shape: (ny, nx).

    Returns:
        (ny, nx) m, minus infinity where no triangle lies.
    """
    out = np.full(shape, -np.inf)
    _fill(
        np.ascontiguousarray(vertices_m, dtype=np.float64),
        np.ascontiguousarray(faces, dtype=np.int64),
        x0_m,
        y0_m,
        cell_m,
        out,
    )
    return out


@kernel("void(float64[:, ::1], int64[:, ::1], float64, float64, float64, float64[:, ::1])", entry=True)
def _fill(vertices: Float, faces: Int, x0: float, y0: float, cell: float, out: Float) -> None:
    """Raise every cell centre inside a triangle's plan view to the triangle's plane (edges included)."""
    ny, nx = out.shape
    for f in range(faces.shape[0]):
        ax, ay, az = vertices[faces[f, 0], 0], vertices[faces[f, 0], 1], vertices[faces[f, 0], 2]
        bx, by, bz = vertices[faces[f, 1], 0], vertices[faces[f, 1], 1], vertices[faces[f, 1], 2]
        cx, cy, cz = vertices[faces[f, 2], 0], vertices[faces[f, 2], 1], vertices[faces[f, 2], 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        i_low = max(0, math.ceil((min(ax, bx, cx) - x0) / cell))
        i_high = min(nx - 1, math.floor((max(ax, bx, cx) - x0) / cell))
        j_low = max(0, math.ceil((min(ay, by, cy) - y0) / cell))
        j_high = min(ny - 1, math.floor((max(ay, by, cy) - y0) / cell))
        for j in range(j_low, j_high + 1):
            y = y0 + j * cell
            for i in range(i_low, i_high + 1):
                x = x0 + i * cell
                u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                w = 1.0 - u - v
                # An edge between two triangles belongs to both: without the slack a cell centre on it falls through.
                if u >= -1e-12 and v >= -1e-12 and w >= -1e-12:
                    out[j, i] = max(out[j, i], u * az + v * bz + w * cz)


def read_stl(path: str | os.PathLike[str], unit_m: float = STL_UNIT_M) -> tuple[Float, Int]:
    """Read a closed STL body.

    Args:
        path: STL file, binary or text.
        unit_m: Length of one unit of the file, m.

    Returns:
        Vertices (n, 3) in m and faces (m, 3).

    Raises:
        FileFormatError: The file cannot be read, is no STL, or its surface is not closed.
        InputError: The size is implausible, as when the unit is wrong.
    """
    import trimesh

    where = str(path)
    with readable(path, "an STL file", "Export it again"), Path(path).open("rb") as stream:
        mesh: Any = trimesh.load_mesh(stream, file_type="stl")
        vertices: Float = np.array(mesh.vertices, dtype=np.float64)
        faces: Int = np.array(mesh.faces, dtype=np.int64)
    if len(faces) < 4:
        raise FileFormatError("STL file holds no body", where=where, value=f"{len(faces)} triangles")
    if not np.all(np.isfinite(vertices)):
        raise FileFormatError("STL file holds a coordinate that is not finite", where=where)
    if not mesh.is_watertight:
        raise FileFormatError(
            "stock mesh is not watertight",
            where=where,
            hint="Export a closed solid, or repair the mesh in the CAD system",
        )
    vertices = vertices * unit_m
    size = np.ptp(vertices, axis=0)
    if size.max() < SMALLEST_SIDE_M or size.max() > LARGEST_SIDE_M:
        small = size.max() < SMALLEST_SIDE_M
        raise InputError(
            f"stock mesh is implausibly {'small' if small else 'large'}",
            where=where,
            value=" x ".join(f"{v / STL_UNIT_M:.4g}" for v in size) + " mm",
            limit=f"{SMALLEST_SIDE_M / STL_UNIT_M:g} mm to {LARGEST_SIDE_M / STL_UNIT_M:g} mm",
            hint="STL carries no unit and is read in mm; was it written in " + ("m or inch?" if small else "um?"),
        )
    return vertices, faces


def heights_from_stl(
    path: str | os.PathLike[str], cell_m: float, unit_m: float = STL_UNIT_M
) -> tuple[float, float, float, Float32]:
    """Upper surface of a closed STL body on a grid: x0, y0, bottom (m) and heights (ny, nx).

    Cells whose centre no triangle covers are at the bottom. Undercuts are filled, as nothing below the upper surface
    can be represented.

    Raises:
        FileFormatError: See :func:`read_stl`.
        InputError: See :func:`read_stl`; or the cell is not positive.
    """
    if not (math.isfinite(cell_m) and cell_m > 0.0):
        raise InputError("cell size is out of range", value=cell_m, limit="> 0 m")
    vertices, faces = read_stl(path, unit_m)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    nx, ny = (math.ceil(round(float(high[k] - low[k]) / cell_m, 6)) for k in (0, 1))
    if nx * ny > 200_000_000:
        raise InputError("height map is too large", value=f"{nx} x {ny} cells", hint="Make the cell larger")
    x0, y0, bottom = (float(low[0]) + 0.5 * cell_m, float(low[1]) + 0.5 * cell_m, float(low[2]))
    surface = upper_surface(vertices, faces, x0, y0, cell_m, (ny, nx))
    heights: Float32 = np.where(np.isfinite(surface), np.maximum(surface, bottom), bottom).astype(np.float32)
    return x0, y0, bottom, heights

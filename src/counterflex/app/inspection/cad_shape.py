"""A CAD mesh as the nominal part of an inspection."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.cutting.stock_mesh import read_stl
from counterflex.evaluate.inspection.mesh_shape import MeshShape
from counterflex.evaluate.inspection.nominal_part import LARGEST_BALL_M, REACH_M
from counterflex.evaluate.surface import NominalSurface

_FITS_M = 1.0 * MM


def read_shape(path: Path, surface: NominalSurface) -> MeshShape:
    """Read a CAD mesh (STL, mm, part frame).

    Args:
        surface: What the program makes; the mesh must lie in the same place.

    Raises:
        FileFormatError: It cannot be read, or its surface is not closed.
        InputError: It lies elsewhere than the blank.
    """
    vertices, faces = read_stl(path)
    stock = surface.stock
    ny, nx = stock.z.shape
    low = np.array([stock.x0_m - 0.5 * stock.cell_m, stock.y0_m - 0.5 * stock.cell_m, stock.bottom_m])
    high = np.array([low[0] + nx * stock.cell_m, low[1] + ny * stock.cell_m, float(stock.z.max())])
    off = np.abs(np.stack([vertices.min(axis=0) - low, vertices.max(axis=0) - high]))
    if off.max() > _FITS_M:
        raise InputError(
            "the CAD mesh is not where the blank is",
            where=f"--nominal {path}",
            value=_box(vertices.min(axis=0), vertices.max(axis=0)),
            limit=f"{_box(low, high)} within {_FITS_M / MM:g} mm",
            hint="Export it in mm, in the part frame, as it comes off the machine",
        )
    return MeshShape(vertices, faces, REACH_M + LARGEST_BALL_M)


def _box(low: Float, high: Float) -> str:
    """Two corners in mm."""
    return " to ".join(", ".join(f"{value / MM:.2f}" for value in corner) for corner in (low, high)) + " mm"

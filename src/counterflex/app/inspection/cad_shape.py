"""A CAD mesh or solid as the nominal part."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.remarks import remark
from counterflex.core.units import MM
from counterflex.cutting.stock_mesh import read_stl
from counterflex.evaluate.inspection.mesh_shape import CadSolid, MeshShape
from counterflex.evaluate.inspection.nominal_part import LARGEST_BALL_M, REACH_M
from counterflex.evaluate.surface import NominalSurface
from counterflex.files.step_file import ENDINGS, StepSolid, read_step

_FITS_M = 1.0 * MM


def read_shape(path: Path, surface: NominalSurface) -> MeshShape | CadSolid:
    """Read a CAD solid (STEP, in the unit of the file) or mesh (STL, mm), part frame.

    Of several solids the one counts that lies where the blank is.

    Args:
        surface: What the program makes; the mesh must lie in the same place.

    Raises:
        FileFormatError: It cannot be read, or its surface is not closed.
        InputError: It lies elsewhere than the blank.
    """
    reach = REACH_M + LARGEST_BALL_M
    if path.suffix.lower() not in ENDINGS:
        vertices, faces = read_stl(path)
        _require_fit(surface, vertices.min(axis=0), vertices.max(axis=0), path, "in mm, ")
        return MeshShape(vertices, faces, reach)
    solid = read_step(path, lambda solids: _choose(solids, surface, path), reach)
    _require_fit(surface, solid.vertices.min(axis=0), solid.vertices.max(axis=0), path)
    for name in solid.not_measured:
        remark(f"{path.name}: tolerance not looked at: {name}")
    return solid


def _choose(solids: list[StepSolid], surface: NominalSurface, path: Path) -> StepSolid:
    off = {name: _off(surface, low, high) for name, low, high, _ in solids}
    best = min(solids, key=lambda solid: off[solid[0]])
    fitting = [name for name, value in off.items() if value <= _FITS_M]
    if len(fitting) > 1:
        raise InputError(
            "several solids lie where the blank is",
            where=f"--nominal {path}",
            value=", ".join(fitting),
            hint="Export the part alone",
        )
    if len(solids) > 1:
        remark(f"{path.name}: of {len(solids)} solids {best[0]} lies where the blank is and is the part")
    return best


def _boxes(surface: NominalSurface) -> tuple[Float, Float]:
    """Boxes (2, 6) m of the blank and of what the program leaves of it."""
    stock, left = surface.stock, surface.kept
    ny, nx = stock.z.shape
    low = np.array([stock.x0_m - 0.5 * stock.cell_m, stock.y0_m - 0.5 * stock.cell_m, stock.bottom_m])
    high = np.array([low[0] + nx * stock.cell_m, low[1] + ny * stock.cell_m, float(stock.z.max())])
    j, i = (np.flatnonzero(left.any(axis=axis)) for axis in (1, 0))
    if len(i) == 0:
        return np.concatenate([low, high]), np.concatenate([low, high])
    least = np.array([*(low[:2] + stock.cell_m * np.array([i[0], j[0]])), stock.bottom_m])
    most = np.array([*(low[:2] + stock.cell_m * (np.array([i[-1], j[-1]]) + 1)), float(surface.nominal.z[left].max())])
    return np.concatenate([low, high]), np.concatenate([least, most])


def _off(surface: NominalSurface, low: Float, high: Float) -> float:
    """Largest distance of a side of a box from that of the blank, or of what the program leaves of it, m."""
    box = np.concatenate([low, high])
    return float(np.minimum(*(np.abs(box - one) for one in _boxes(surface))).max())


def _require_fit(surface: NominalSurface, low: Float, high: Float, path: Path, unit: str = "") -> None:
    if _off(surface, low, high) > _FITS_M:
        blank = _boxes(surface)[0]
        raise InputError(
            "the CAD part is not where the blank is",
            where=f"--nominal {path}",
            value=_box(low, high),
            limit=f"{_box(blank[:3], blank[3:])} within {_FITS_M / MM:g} mm",
            hint=f"Export it {unit}in the part frame, as it comes off the machine",
        )


def _box(low: Float, high: Float) -> str:
    """Two corners in mm."""
    return " to ".join(", ".join(f"{value / MM:.2f}" for value in corner) for corner in (low, high)) + " mm"

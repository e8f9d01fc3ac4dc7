"""Rows of the preflight about the nominal part: what the program gouges or leaves on each face of a CAD solid."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from counterflex.app.inputs import Job
from counterflex.app.inspection.judging import nominal_of
from counterflex.app.proof.cut_logs import log_of_path, top_of
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM, PERCENT, UM
from counterflex.evaluate.inspection.cad_rows import even_points
from counterflex.evaluate.inspection.mesh_shape import CadSolid
from counterflex.evaluate.inspection.nominal_part import NominalPart
from counterflex.evaluate.measured_values import height_at
from counterflex.files.cell.cell import Cell
from counterflex.files.step_file import ENDINGS
from counterflex.path.toolpath import ToolPath
from counterflex.plan.preflight.row import NOT_LOOKED_AT, Row, Verdict
from counterflex.twin.plant.simulate import mounted_tools

CHECK: Final = "nominal geometry"
LIMIT_M: Final = 50.0 * UM
"""Of a face without a tolerance of profile or position: five times the usual tolerance of a CAM system."""
_MOST_ROWS: Final = 12
_DEEPEST_M: Final = 5.0 * MM
"""Distances to what was cut are known up to this."""


def nominal_rows(cad: Path, job: Job, cell: Cell, path: ToolPath) -> list[Row]:
    """One row for each face that is off by more than its limit, the worst first, and one for all others.

    Args:
        cad: STEP file, part frame.
        path: The path whose rows the rows name.

    Raises:
        FileFormatError: The STEP file cannot be read.
        InputError: It is no STEP file, or the part is not where the blank is.
    """
    if cad.suffix.lower() not in ENDINGS:
        raise InputError("the faces of a part are read from STEP", where=f"--nominal {cad}", limit=", ".join(ENDINGS))
    if cell.tool_turns or cell.R_part_plane is not None:
        what = "the tool turns" if cell.tool_turns else "the program works in another plane than XY"
        return [Row(CHECK, NOT_LOOKED_AT, what=f"{what}: faces are compared where the tool stays along part z")]
    part = nominal_of(job, cell, cad)
    solid = part.shape
    assert isinstance(solid, CadSolid)
    log = log_of_path(job.path, cell, top_of(cell, job.path.p_part_tcp))
    off, largest = [], 0.0
    for k, face in enumerate(solid.faces):
        triangles = solid.triangles[solid.owner == k]
        points = np.concatenate([even_points(solid.vertices[triangles])[0], solid.vertices[np.unique(triangles)]])
        left = _left(points, part, log.distance(points))
        limit = min((face.limits[name][1] for name in ("profile", "position") if name in face.limits), default=LIMIT_M)
        worst = int(np.argmax(np.abs(left)))
        if abs(left[worst]) > limit:
            share = float(np.mean(np.abs(left) > limit)) / PERCENT
            point = _nearest(points[worst], path, cell)
            off.append(_row(face.name, left[worst], limit, points[worst], share, point))
        else:
            largest = max(largest, abs(float(left[worst])))
    off.sort(key=lambda row: -(row.value or 0.0))
    if len(off) == len(solid.faces) <= _MOST_ROWS:
        return off  # no face is left that could be said to be right
    more = f"; {len(off) - _MOST_ROWS} more are off" if len(off) > _MOST_ROWS else ""
    what = f"{len(solid.faces) - len(off)} of {len(solid.faces)} faces of {cad.name} as the program makes them{more}"
    return [*off[:_MOST_ROWS], Row(CHECK, "fail" if more else "ok", largest, LIMIT_M, "m", what=what)]


def _row(name: str, left: float, limit: float, place: Float, share: float, point: int) -> Row:
    at = ", ".join(f"{value / MM:.2f}" for value in place)
    word = "material left" if left > 0.0 else "gouged" if left > -_DEEPEST_M else "gouged by more than that,"
    what = f"{word} at {at} mm; {share:.0f} % of the face is off"
    advice = "Check program, zero and tool; a corner sharper than the tool keeps material"
    verdict: Verdict = "fail" if left < 0.0 else "warning"
    return Row(f"{CHECK}: {name}", verdict, abs(float(left)), limit, "m", point, what, advice=advice)


def _left(points: Float, part: NominalPart, inside_uncut: Float) -> Float:
    """Material over places of the nominal surface, (n,) m: they lie so deep in what the program leaves of the blank.

    Negative: they lie outside of it, the program gouges the part.
    """
    low, high = part.faces.low, part.faces.high
    sides = np.concatenate([points - low, high - points], axis=1)
    inset = np.clip(points[:, :2], low[:2] + 1.0 * UM, high[:2] - 1.0 * UM)
    over = height_at(part.stock, inset) - points[:, 2]
    blank = np.minimum(sides.min(axis=1), np.nan_to_num(over, nan=np.inf))
    cut = height_at(part.surface.nominal, inset) < points[:, 2] - part.surface.nominal.cell_m
    far = np.where(cut, -np.inf, np.inf)  # further from every sweep than distances are known
    deep = np.where(np.isnan(inside_uncut), far, inside_uncut)
    out: Float = np.clip(np.minimum(deep, blank), -_DEEPEST_M, None)
    return out


def _nearest(place: Float, path: ToolPath, cell: Cell) -> int:
    """Row of a path at which the tool comes nearest to a place, or goes deepest beyond it."""
    numbers, which = np.unique(mounted_tools(path), return_inverse=True)
    cutters = [cell.cutter(int(number)) for number in numbers]
    radius, corner = (
        np.array([getattr(cutter, name) for cutter in cutters])[which] for name in ("radius_m", "corner_radius_m")
    )
    step = place - path.p_part_tcp
    aside = np.hypot(step[:, 0], step[:, 1]) - (radius - corner)
    under = corner - step[:, 2]
    outside = np.hypot(np.maximum(aside, 0.0), np.maximum(under, 0.0)) + np.minimum(np.maximum(aside, under), 0.0)
    return int(np.argmin(outside - corner))

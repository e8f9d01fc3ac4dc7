"""Rows of the preflight about the nominal part: what the program gouges or leaves on each face of a CAD solid."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.app.inputs import Job
from counterflex.app.inspection.judging import nominal_of
from counterflex.app.proof.cut_logs import log_of_path, top_of
from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM, PERCENT, UM
from counterflex.evaluate.inspection.cad_rows import even_points
from counterflex.evaluate.inspection.mesh_shape import CadSolid
from counterflex.evaluate.inspection.nominal_part import NominalPart
from counterflex.evaluate.measured_values import height_at
from counterflex.files.cell.cell import Cell
from counterflex.files.step_file import ENDINGS
from counterflex.path.toolpath import ToolPath
from counterflex.plan.preflight.row import NOT_LOOKED_AT, Row
from counterflex.twin.plant.simulate import mounted_tools

CHECK: Final = "nominal geometry"
LIMIT_M: Final = 50.0 * UM
"""Of a face without a tolerance of profile or position: five times the usual tolerance of a CAM system."""
_MOST_ROWS: Final = 12
_DEEPEST_M: Final = 5.0 * MM
"""Distances to what was cut are known up to this."""


@dataclass(frozen=True, eq=False)
class _OffFace:
    name: str
    limit_m: float
    points: Float  # (n, 3) m
    left_m: Float  # (n,) m, material over the face; negative: missing under it

    @property
    def worst(self) -> int:
        return int(np.argmax(np.abs(self.left_m)))

    @property
    def over(self) -> Bool:
        out: Bool = np.abs(self.left_m) > self.limit_m
        return out


def nominal_rows(cad: Path, job: Job, cell: Cell, path: ToolPath) -> list[Row]:
    """One row for each face off by more than its limit, and one for all others.

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
    faces = _off_faces(part, job, cell)
    bad = sorted((face for face in faces if face.over.any()), key=lambda face: -abs(face.left_m[face.worst]))
    rows = [_row(face, path, cell) for face in bad[:_MOST_ROWS]]
    good = [abs(face.left_m[face.worst]) for face in faces if not face.over.any()]
    more = f"; {len(bad) - _MOST_ROWS} more are off" if len(bad) > _MOST_ROWS else ""
    what = f"{len(good)} of {len(faces)} faces of {cad.name} as the program makes them{more}"
    worst = max(good, default=0.0)
    return [*rows, Row(CHECK, "fail" if more else "ok", worst, LIMIT_M, "m", what=what)]


def _off_faces(part: NominalPart, job: Job, cell: Cell) -> list[_OffFace]:
    solid = part.shape
    assert isinstance(solid, CadSolid)
    log = log_of_path(job.path, cell, top_of(cell, job.path.p_part_tcp))
    out = []
    for k, face in enumerate(solid.faces):
        triangles = solid.triangles[solid.owner == k]
        points = np.concatenate([even_points(solid.vertices[triangles])[0], solid.vertices[np.unique(triangles)]])
        limits = [face.limits[name][1] for name in ("profile", "position") if name in face.limits]
        out.append(_OffFace(face.name, min(limits, default=LIMIT_M), points, _left(points, part, log.distance(points))))
    return out


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
    return np.clip(np.minimum(deep, blank), -_DEEPEST_M, None)


def _row(face: _OffFace, path: ToolPath, cell: Cell) -> Row:
    worst = face.worst
    left, place = float(face.left_m[worst]), face.points[worst]
    at = ", ".join(f"{value / MM:.2f}" for value in place)
    word = "material left" if left > 0.0 else "gouged" if left > -_DEEPEST_M else "gouged by more than that,"
    share = np.mean(face.over) / PERCENT
    return Row(
        f"{CHECK}: {face.name}",
        "fail" if left < 0.0 else "warning",
        abs(left),
        face.limit_m,
        "m",
        _nearest(place, path, cell),
        f"{word} at {at} mm; {share:.0f} % of the face is off",
        advice="Check program, zero and tool; a corner sharper than the tool keeps material",
    )


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

"""Scans of real parts, or logs of the tool's path, laid on the part that their program makes, and measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from counterflex import __version__
from counterflex.app.inputs import Job, read_in_plane
from counterflex.app.inspection.summary import InspectedScan, summary_of
from counterflex.app.inspection.tool_log import LogHow, ToolLog
from counterflex.app.inspection.tool_path import InspectedPath, judged_path
from counterflex.app.proof.cut_logs import log_of_path, top_of
from counterflex.app.proof.judge import candidates_of, outline_of, reference_of
from counterflex.app.robot_programs import inputs_of
from counterflex.core import file_content
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.remarks import remark
from counterflex.core.units import MM
from counterflex.evaluate.features import FeatureRow
from counterflex.evaluate.inspection.cad_rows import CadFeatures
from counterflex.evaluate.inspection.cloud import Cloud, ScanUnit, thinned
from counterflex.evaluate.inspection.clutter import CLEARANCE_M, cluttered_pose, off_part, without
from counterflex.evaluate.inspection.coarse import NoPose, coarse_pose
from counterflex.evaluate.inspection.coverage import Coverage, coverage
from counterflex.evaluate.inspection.feature_rows import features_of_part, inspected_features, with_uncertainty
from counterflex.evaluate.inspection.mesh_shape import CadSolid
from counterflex.evaluate.inspection.nominal_part import NominalPart, NominalShape, nominal_part
from counterflex.evaluate.inspection.part_deviations import FREE
from counterflex.evaluate.inspection.registration import LEAST_POINTS, aligned, register
from counterflex.evaluate.inspection.scanned_part import ScannedPart, scanned_part
from counterflex.evaluate.inspection.size_errors import ScaleEstimate, ball_error, common_offset, scale_of
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.scan.read import read_scan
from counterflex.files.scan.scan import UNITS, Scan
from counterflex.geometry import pose

POINTS: int = 600_000
"""Points that a scan of all six faces is thinned to, about."""
LEAST_PITCH_M = 0.05 * MM
OTHER_PART = 0.2
"""Share of points on no surface of the part above which a scan is of another part."""


@dataclass(frozen=True)
class How:
    """Settings by which a scan is read and laid on the part."""

    unit: str | None = None  # Name of its unit; None: found
    datum: str | None = None  # Names of the datum faces, separated by commas; None: all that the program leaves alone
    datum_points: Path | None = None  # Table of points of the scan and of the part, or None
    aligned: bool = False  # The scan is in the part frame already
    # Of the probe, where the points are centres of its ball; 0: they lie on the surface; None: what the file says, and
    # points that look like centres are refused
    ball_diameter_m: float | None = None
    clearance_m: float | None = None  # Points further from the blank are cut away; None: 3 mm


@dataclass(frozen=True, eq=False)
class Inspection:
    """One or two parts, judged."""

    job: Job
    cell: Cell  # Where
    parts: dict[str, InspectedScan | InspectedPath]  # ``part``, or ``before`` and ``after``
    features: tuple[FeatureRow, ...]  # Measured on each
    # By part, areas of the machined surface and of each feature by what is known about them
    covered: dict[str, tuple[Coverage, Mapping[str, Coverage]]]
    summary: dict[str, Any]  # What ``summary.json`` holds


def inspect(
    program: Path,
    cell_file: Path,
    measured: Path,
    *,
    how: How | LogHow,
    before: Path | None = None,
    nominal: Path | None = None,
    tolerances_m: Mapping[tuple[str, str], float] | None = None,
    progress: Progress = silent,
) -> Inspection:
    """Judge scans of one or two parts, or logs of the tool; see :func:`counterflex.app.inspection.inspect.run`."""
    cell, job = read_in_plane(program, read_cell(cell_file))
    files = {"part": measured} if before is None else {"before": before, "after": measured}
    read: dict[str, Scan | ToolLog] = {
        name: read_scan(file) if isinstance(how, How) else ToolLog.read(file, how, cell, job.path)
        for name, file in files.items()
    }
    progress(0.15)
    part = nominal_of(job, cell, nominal)
    progress(0.4)
    parts: dict[str, InspectedScan | InspectedPath] = {}
    for k, (name, one) in enumerate(read.items()):
        if isinstance(one, ToolLog):
            parts[name] = judged_path(one, part, job, cell)
        elif isinstance(how, How):
            outline = outline_of(job.path, cell)
            parts[name] = judged(
                one, part, job.path.p_part_tcp, how, str(files[name]), outline, R_part_plane=cell.R_part_plane
            )
        progress(0.4 + 0.4 * (k + 1) / len(read))
    named = {name: one.part for name, one in parts.items()}
    candidates = features_of_part(next(iter(named.values())), candidates_of(job.path, cell))
    scales = {name: one.scale for name, one in parts.items() if isinstance(one, InspectedScan)}
    features = inspected_features(candidates, named, tolerances_m, scales)
    features += _of_faces(part.shape, nominal, named, tolerances_m, scales)
    _require_used(tolerances_m or {}, features)
    covered = {name: coverage(one, candidates) for name, one in named.items()}
    summary = {
        "job": "inspect",
        "program": program.name,
        "cell": cell.name,
        "inputs": inputs_of(program, cell_file),
        "nominal": "program" if nominal is None else nominal.name,
        "judged": "surface" if isinstance(how, How) else "tool path",
        **summary_of(parts, features, covered),
        "counterflex": __version__,
    }
    progress(0.9)
    return Inspection(job, cell, parts, features, covered, summary)


def _of_faces(
    shape: NominalShape,
    cad: Path | None,
    parts: Mapping[str, Any],
    tolerances_m: Mapping[tuple[str, str], float] | None,
    scales: Mapping[str, ScaleEstimate],
) -> tuple[FeatureRow, ...]:
    """Rows of the faces of a CAD solid; none of a tool's path, which shows no surface."""
    if cad is None or not isinstance(shape, CadSolid):
        return ()
    scanned = {name: one for name, one in parts.items() if isinstance(one, ScannedPart)}
    if not scanned:
        remark(f"{cad.name}: its faces are not looked at: a log of the tool measures no surface")
        return ()
    measure = CadFeatures(shape, cad.name, tolerances_m)
    return with_uncertainty(measure, scanned, scales, measure.place_sigma_m)


def _require_used(tolerances_m: Mapping[tuple[str, str], float], features: tuple[FeatureRow, ...]) -> None:
    measured = [(row.feature, row.quantity) for row in features]
    for feature, quantity in tolerances_m:
        if (feature, quantity) not in measured:
            raise InputError(
                "a tolerance is given of what is not measured on this part",
                value=f"{quantity} of {feature}",
                limit=", ".join(f"{q} of {f}" for f, q in measured) or "nothing is",
            )


def nominal_of(job: Job, cell: Cell, cad: Path | None = None) -> NominalPart:
    """The part that a program makes, or the one of a CAD file with its floors, walls and datum faces.

    Raises:
        InputError: The tool turns while it cuts, or a CAD file is given and the tool is tilted.
    """
    surface = reference_of(job, cell).surface
    if surface is None:
        raise InputError(
            "parts that a turning tool cuts have no floors and walls to be inspected",
            where=job.program.name,
            limit="a program with one direction of the tool",
        )
    shape: NominalShape = log_of_path(job.path, cell, top_of(cell, job.path.p_part_tcp))
    if cad is not None:
        if cell.R_part_plane is not None:
            raise InputError(
                "a CAD file lies along the axes of the part, and this program mills along another direction",
                where=f"--nominal {cad}",
                hint="Judge the scan against what the program makes: leave --nominal out",
            )
        from counterflex.app.inspection.cad_shape import read_shape

        shape = read_shape(cad, surface)
    return nominal_part(surface, shape)


def judged(
    scan: Scan,
    part: NominalPart,
    p_part_tcp: Float,
    how: How,
    where: str,
    outline: Float | None = None,
    R_part_plane: Float | None = None,
) -> InspectedScan:
    """Lay one scan on the nominal part and judge it.

    Args:
        p_part_tcp: (n, 3) m, the undisturbed path, part frame.
        outline: (n, 2) m, of the tool at each row of the path; None: one tool.
        R_part_plane: Axes of the plane that the nominal part is given in, in the part frame; None: those of the part.

    Raises:
        InputError: It does not fit the part.
    """
    stated = how.unit
    if stated is None and scan.unit_m is not None:
        stated = min(UNITS, key=lambda name: abs(np.log(UNITS[name] / (scan.unit_m or 1.0))))
    sized = ScanUnit.of(scan.sample(200_000), part.diagonal_m, UNITS, stated, where)
    R_plane_part = np.eye(3) if R_part_plane is None else R_part_plane.T
    unit, unit_m, cloud, T_start = _placed(scan, part, how, sized, where, pose.make(R_plane_part))
    ball = _ball(scan, how, unit_m)
    clearance = CLEARANCE_M if how.clearance_m is None else how.clearance_m
    aside = off_part(pose.transform(T_start, cloud.points), part.faces, clearance + (ball or 0.0))
    cut_away = int(cloud.count[aside].sum())
    if np.count_nonzero(~aside) < LEAST_POINTS:
        raise InputError(
            "the scan lies beside the part",
            where=where,
            value=f"{np.count_nonzero(aside)} of {len(cloud)} places more than {clearance / MM:g} mm off the blank",
            hint="Is it in the part frame? Without --aligned its pose is searched",
        )
    cloud = without(cloud, aside)
    names = part.faces.chosen(how.datum)
    if how.aligned:
        registration = aligned(part, T_start)
    else:
        if how.datum is None:
            names = _seen(names, cloud.points, part, T_start, ball or 0.0)
        registration = register(cloud, part, T_start, names, where, ball)
    result = scanned_part(cloud, part, registration, p_part_tcp, ball or 0.0, outline)
    if ball is None:
        offset = common_offset(result.rows, registration.centre, not how.aligned)
        if offset is not None:
            raise ball_error(offset, where)
    _check_same(result, where)
    scale = scale_of(result.rows, part.faces)
    return InspectedScan(Path(where).name, scan, unit, result, cloud.outliers, cut_away, ball or 0.0, scale)


def _ball(scan: Scan, how: How, unit_m: float) -> float | None:
    """Radius of the ball whose centres the points are, m; None: nobody says."""
    if how.ball_diameter_m is not None:
        return 0.5 * how.ball_diameter_m
    return scan.ball_radius * unit_m if scan.ball_radius > 0.0 else None


def _placed(
    scan: Scan, part: NominalPart, how: How, sized: ScanUnit, where: str, T_plane_part: Float
) -> tuple[str, float, Cloud, Float]:
    """Unit, points and about the pose of a scan.

    Where its extent is that of the part, the pose is searched by it; else, or where that fails, in what was scanned
    beside the part.
    """
    pitch = max(LEAST_PITCH_M, float(np.sqrt(part.area_m2 / POINTS)))
    fault = sized.fault
    for unit, unit_m in sized.choices:
        try:
            cloud = thinned(scan.chunks, unit_m, pitch)
        except InputError as few:
            raise fault or few from few
        origin = pose.make(p=scan.origin * unit_m)  # points are counted from the first one
        if how.aligned:
            return unit, unit_m, cloud, T_plane_part @ origin
        if how.datum_points is not None:
            return unit, unit_m, cloud, T_plane_part @ _start(how.datum_points, unit_m) @ origin
        if sized.fault is None:
            try:
                return unit, unit_m, cloud, coarse_pose(cloud, part, where, _ball(scan, how, unit_m) or 0.0).T_part_scan
            except NoPose as no_pose:
                fault = no_pose
        match = cluttered_pose(cloud, part)
        if match is not None:
            return unit, unit_m, cloud, match.T_part_scan
    if fault is None:
        raise AssertionError("a scan has a unit")
    raise fault


def _seen(names: tuple[str, ...], points: Float, part: NominalPart, T_start: Float, ball: float) -> tuple[str, ...]:
    """The faces that the scan shows: at least thirty of its points, or as many as the others in a small cloud."""
    moved = pose.transform(T_start, points)
    least = 30 if len(points) > 500 else 1
    seen = []
    for name in names:
        normal, distance = part.faces.plane(name)
        near = np.flatnonzero(np.abs(moved @ normal - distance - ball) < 3.0 * MM)
        if np.count_nonzero(part.faces.on(name, moved[near])) >= least:
            seen.append(name)
    return tuple(seen) or names


def _start(file: Path, unit_m: float) -> Float:
    """Pose of a scan by points of it and of the part: columns scan x y z in its unit, part x y z in mm."""
    text = file_content.text(file)
    try:
        lines = [line for line in text.splitlines() if line.split("#")[0].strip()] or ["nan"]
        rows = np.atleast_2d(np.loadtxt(lines, delimiter="," if "," in text else None, comments="#"))
    except ValueError as fault:
        raise FileFormatError(
            "datum points are not readable",
            where=str(file),
            value=str(fault)[:60],
            limit="lines of six numbers: scan x, y, z in its unit, part x, y, z in mm",
        ) from fault
    if rows.shape[1] != 6 or len(rows) < 3 or not np.all(np.isfinite(rows)):
        raise FileFormatError(
            "datum points have another shape",
            where=str(file),
            value=f"{rows.shape[0]} lines of {rows.shape[1]} numbers",
            limit="3 or more lines of six: scan x, y, z in its unit, part x, y, z in mm",
        )
    T_part_scan, left = pose.register(rows[:, 3:] * MM, rows[:, :3] * unit_m)
    worst = float(np.linalg.norm(left, axis=1).max())
    if worst > 5.0 * MM:
        raise InputError(
            "the datum points of the scan are not those of the part",
            where=str(file),
            value=f"{worst / MM:.1f} mm apart after the best fit",
            limit="<= 5 mm",
        )
    return T_part_scan


def _check_same(part: ScannedPart, where: str) -> None:
    """Refuse a scan of another part, or one that shows nothing of what was machined."""
    if part.unmatched_share > OTHER_PART:
        raise InputError(
            "the scan is of another part, or much beside it was scanned",
            where=where,
            value=f"{100.0 * part.unmatched_share:.0f} % of its points are on no surface of the part within 3 mm",
            limit=f"<= {100.0 * OTHER_PART:.0f} %",
            hint="Is the program the one that made it? Less beside the part counts with a smaller --clearance-mm",
        )
    if not np.any(part.rows.face != FREE):
        raise InputError(
            "the scan shows nothing of what the program machines",
            where=where,
            value=f"{len(part.rows)} points, all on faces of the blank",
        )

"""The job ``firstcut``: propose a coupon; from its measured faces write a cell file with what they show."""

from __future__ import annotations

import datetime
import hashlib
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.correction.scans import PartScan
from counterflex.app.first_cut import posterior
from counterflex.app.first_cut.coupon import COLUMNS, ProposedCoupon, coupon, shown, table
from counterflex.app.inputs import Job, faults_in, read_in_plane, setting_of
from counterflex.app.prediction_interval import YIELD
from counterflex.core import atomic, file_content
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.core.result import Parts, Summary, Warned
from counterflex.core.units import MM, MRAD, UM
from counterflex.cutting.coefficients import KienzleLaw, LinearEdgeLaw
from counterflex.evaluate.inspection.part_deviations import PartDeviations
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.measured import IdentifiedTable, IdentifiedValue
from counterflex.files.cell.update import check_update, updated_text
from counterflex.files.small_table import are_columns, number, read_rows
from counterflex.files.summary_file import write_folder_summary
from counterflex.identify.data.changes import AxisPlay, AxisServo, Change, CuttingLaw, ElementCompliance
from counterflex.plan.compensate import plan as make_plan
from counterflex.plan.plan import Plan

RECIPE: Final = "first_cut"
PROGRAM, TABLE, CELL = "coupon.ngc", "measure.csv", "cell.toml"
NOISE_M: Final = 15.0 * UM
"""Standard deviation of a reading of a probe in the spindle or of a calliper."""
LARGEST_M: Final = 3.0 * MM
"""Largest error of a face: more is a slip of the pen, or another part."""
LEAST: Final = 12
"""Places below which nothing is identified."""
_NEAR_M: Final = 1.0 * MM
"""A place belongs to a stretch that passes it so near along the feed; readings of a scan are averaged within it."""
_ON_FACE_M: Final = 0.05 * MM
_ROUNDS: Final = 4
"""Estimates, each about what the cell of the one before predicts."""
_DETERMINED: Final = 0.999
"""Standard deviation over that before, below which the part says something of an element."""
_FAR: Final = 5.0
"""Standard deviations beyond which a reading is named."""
_Reading = tuple[str, int, str, int, Float, float]
"""Line of the table, number, face, axis, place (3,) m, measured minus nominal coordinate, m."""
_DIRECTIONS: Final = ("tx", "ty", "tz", "rx", "ry", "rz")


def propose(
    cell_file: str | Path, out: str | Path, *, tool: int, feed_mm_min: float, rpm: float, depth_mm: float | None = None
) -> ProposedCoupon:
    """Write the program of the coupon and the table to fill in; all files or none.

    Raises:
        InputError: The blank is too small for the tool, or the tool does not fit.
    """
    cell = read_cell(cell_file, assume_class=True)
    _ = cell.T_base_part  # refused here, not when the coupon is milled: the robot holds the part
    made = coupon(cell, tool, feed_mm_min=feed_mm_min, rpm=rpm, depth_mm=depth_mm)
    with atomic.atomic_folder(out) as staging:
        atomic.write_text(staging / PROGRAM, made.text)
        atomic.write_text(staging / TABLE, table(made.places))
        summary = shown(cell, tool, made)
        write_folder_summary(staging, summary)
    return summary


def run(
    program: str | Path,
    cell_file: str | Path,
    out: str | Path,
    *,
    measured: str | Path | None = None,
    part: str | Path | None = None,
    sigma_m: float = NOISE_M,
    progress: Progress = silent,
) -> FirstCut:
    """Identify from a part and write ``cell.toml`` and ``summary.json``; all files or none.

    Args:
        program: That the part was made by, uncompensated.
        measured: Table of measured faces.
        part: A scanned or simulated part instead, as ``correct`` takes it; its faces are those of the table beside the
            program.
        sigma_m: Standard deviation of a reading of the table.

    Raises:
        CounterflexError: Files do not fit together, or a value is out of its range; one line says what and where.
    """
    begin, parts = time.perf_counter(), in_parts(progress, {"planning": 4.0, "identifying": 2.0})
    cell, job = read_in_plane(program, read_cell(cell_file, assume_class=True))
    if not isinstance(cell.force_law, KienzleLaw | LinearEdgeLaw):
        raise InputError("the forces of this law are not told apart", value=type(cell.force_law).__name__)
    file = Path(program).parent / TABLE if measured is None else Path(measured)
    scan = None if part is None else PartScan.read(Path(part), Path(program), job, cell, 0).deviations
    listed = _read(file, filled=part is None)  # what is wrong with the files is told before anything is planned
    plan = _planned(job, cell, parts["planning"])
    places = _placed(listed, plan, cell, sigma_m)
    if scan is not None:
        places = _of_part(places, scan, cell, plan, str(part))
    parts["identifying"](0.0)
    names, patterns = posterior.patterns_of(plan, cell, places)
    parts["identifying"](0.5)
    planned = places.off_m - patterns.predicted_m
    with atomic.atomic_folder(out) as staging:
        about = np.zeros(1)  # of the logarithms
        for turn in range(_ROUNDS):
            estimate = posterior.estimated(names, patterns, places, cell)
            last = turn + 1 == _ROUNDS
            unseen, expected = posterior.left_out(names, patterns, places, cell)
            fit = estimate.widened(unseen, expected) if last else posterior.held(estimate, about)
            about = fit.value
            narrower, alone = posterior.share_left(fit, patterns)
            entry = _entry(fit, cell, alone, unseen, planned, [file if part is None else Path(part)])
            known = check_update(updated_text(cell, _changes(fit, cell), entry, staging), staging / CELL)
            if not last:  # a tool that yields more cuts less: what the new cell predicts takes its place
                lost = posterior.lost_by_factor(plan, cell, known, places)
                patterns = patterns.through(posterior.moved(plan, known, places), lost, fit)
        text = updated_text(cell, _changes(fit, cell), entry, Path(out))
        atomic.write_text(staging / CELL, text)
        summary = FirstCut(_summary(fit, places, unseen, planned, narrower, cell, job))
        summary |= {"seconds": round(time.perf_counter() - begin, 3), "counterflex": __version__}
        write_folder_summary(staging, summary)
    progress(1.0)
    return summary


def _planned(job: Job, cell: Cell, progress: Progress) -> Plan:
    """Return the plan of a program that is milled as it is."""
    with faults_in(job):
        return make_plan(job.path, job.line_of_motion, cell.stock(), setting_of(cell), progress=progress)


def _read(file: Path, *, filled: bool) -> list[_Reading]:
    """The readings of a table; where it is not ``filled`` in, each as nominal."""
    rows = read_rows(file)
    if not rows or not are_columns(rows[0][1], COLUMNS, COLUMNS):
        raise FileFormatError(
            "other columns than those of measured faces", where=str(file),
            value=",".join(rows[0][1]) if rows else "none", limit=",".join(COLUMNS),
        )  # fmt: skip
    read: list[_Reading] = []
    lines: dict[tuple[float, ...], int] = {}
    for line, cells in rows[1:]:
        where, by = f"{file}:{line}", dict(zip(rows[0][1], cells, strict=False))
        if len(cells) != len(COLUMNS):
            raise FileFormatError("a row of another length", where=where, value=len(cells), limit=len(COLUMNS))
        if filled and not by["measured_mm"]:
            continue
        axis, p, off_m = _place(by, where, filled=filled)
        if first := lines.get((axis, *p.tolist())):
            raise FileFormatError(
                "the same place twice", where=where, value=f"as in line {first}", limit="once: the mean of its readings"
            )
        lines[(axis, *p.tolist())] = line
        read.append((where, int(number(by["number"], f"{where} number")), by["face"], axis, p, off_m))
    if len(read) < LEAST:
        raise FileFormatError("too few measured places", where=str(file), value=len(read), limit=f">= {LEAST}")
    return read


def _placed(readings: list[_Reading], plan: Plan, cell: Cell, sigma_m: float) -> posterior.MeasuredCoordinates:
    """The readings, each at the row of the plan whose tool made the place."""
    row = np.array([_row_at(plan, cell, p, axis, where) for where, _, _, axis, p, _ in readings])
    faces = [f"{name} {int(line)}" for (_, _, name, _, _, _), line in zip(readings, plan.line[row], strict=True)]
    face = np.unique(faces, return_inverse=True)[1]
    axis, ordinal, off = (np.array([one[k] for one in readings]) for k in (3, 1, 5))
    return posterior.MeasuredCoordinates(row, axis, face, ordinal, off, sigma_m)


def _place(by: Mapping[str, str], where: str, *, filled: bool) -> tuple[int, Float, float]:
    """Axis, place (3,) m and measured minus nominal coordinate, m, of a row."""
    if by["axis"] not in ("x", "y", "z"):
        raise FileFormatError("no axis of the part", where=where, value=by["axis"], limit="x, y or z")
    axis = "xyz".index(by["axis"])
    p = np.array([number(by[f"{a}_mm"], f"{where} {a}_mm") for a in "xyz"]) * MM
    nominal = number(by["nominal_mm"], f"{where} nominal_mm") * MM
    if abs(nominal - p[axis]) > UM:
        raise FileFormatError(
            "the nominal coordinate is not that of the place", where=f"{where} nominal_mm",
            value=f"{nominal / MM:g} mm", limit=f"{by['axis']}_mm = {p[axis] / MM:g}",
        )  # fmt: skip
    value = number(by["measured_mm"], f"{where} measured_mm") * MM if filled else nominal
    if abs(value - nominal) > LARGEST_M:
        raise FileFormatError(
            "a face is farther from its nominal place than any cut", where=f"{where} measured_mm",
            value=f"{value / MM:g} mm, nominal {nominal / MM:g} mm", limit=f"within {LARGEST_M / MM:g} mm",
        )  # fmt: skip
    return axis, p, float(value - nominal)


def _row_at(plan: Plan, cell: Cell, p: Float, axis: int, where: str) -> int:
    """Row of the plan whose tool made a place on a wall or a floor."""
    path = plan.path
    tip = path.p_part_tcp
    radius = np.array([cell.cutter(int(tool)).radius_m if tool > 0 else 0.0 for tool in path.tool])
    if axis == 2:
        off, distance = np.abs(tip[:, 2] - p[2]), np.hypot(*(tip[:, :2] - p[:2]).T)
    else:
        off = np.abs(np.abs(tip[:, axis] - p[axis]) - radius)
        distance = np.where(tip[:, 2] <= p[2], np.abs(tip[:, 1 - axis] - p[1 - axis]), np.inf)
    made = plan.cutting & (off < _ON_FACE_M)
    if not np.any(made) or np.min(distance[made]) > _NEAR_M:
        raise InputError(
            "no cut of the program makes this face", where=where,
            value=f"{'xyz'[axis]} at X{p[0] / MM:g} Y{p[1] / MM:g} Z{p[2] / MM:g}",
            limit=f"within {_NEAR_M / MM:g} mm along the feed",
        )  # fmt: skip
    return int(np.flatnonzero(made)[np.argmin(distance[made])])


def _of_part(
    places: posterior.MeasuredCoordinates, scan: PartDeviations, cell: Cell, plan: Plan, where: str
) -> posterior.MeasuredCoordinates:
    """The same places measured on a scanned or simulated part: the median about each."""
    tip, off, sigma = plan.path.p_part_tcp[places.row], [], []
    keep = []
    for k, a in enumerate(places.axis.tolist()):
        normal = scan.normals[:, a]
        side = np.sign(normal)
        radius = cell.cutter(int(plan.path.tool[places.row[k]])).radius_m
        if a == 2:
            near = np.hypot(*(scan.points[:, :2] - tip[k, :2]).T) < _NEAR_M
            on = np.abs(scan.points[:, 2] - tip[k, 2]) < _ON_FACE_M
        else:
            near = np.abs(scan.points[:, 1 - a] - tip[k, 1 - a]) < _NEAR_M
            on = np.abs(scan.points[:, a] - (tip[k, a] - side * radius)) < 0.5 * MM
            on &= scan.points[:, 2] > tip[k, 2]
        chosen = near & on & (np.abs(normal) > 0.95)
        if np.any(chosen):
            keep.append(k)
            off.append(float(np.median(scan.deviation_m[chosen] * side[chosen])))
            sigma.append(float(np.median(scan.standard_deviation_m[chosen])))
    if len(keep) < LEAST:
        raise InputError(
            "the part shows too few of the faces of the table", where=where, value=len(keep), limit=f">= {LEAST}"
        )
    seen = places.only(np.array(keep))
    return replace(seen, off_m=np.array(off), sigma_m=float(np.median(sigma)))


def _changes(fit: posterior.Posterior, cell: Cell) -> list[Change]:
    factors = fit.factors
    out: list[Change] = [CuttingLaw(cell.force_law.scaled((*factors.force.tolist(),)))]
    index = {name: i for i, name in enumerate(cell.chain.names)}
    for name, factor in zip(fit.elements, factors.elements.tolist(), strict=True):
        out.append(ElementCompliance(name, factor * cell.chain.compliance[index[name]]))
    given, chain = cell.class_drives, cell.planning_chain
    if given is None:
        return out
    for axis in given.servo_axes:
        loop = (chain.servo or ())[axis]
        assert loop is not None
        out.append(AxisServo(axis, replace(loop, speed_gain_nm_s=loop.speed_gain_nm_s / float(factors.drives[0]))))
    for axis, band, friction in zip(given.play_axes, *np.split(factors.play, 2), strict=True):
        lost = (chain.play or ())[axis]
        assert lost is not None
        dry = tuple(float(friction) * torque for torque in lost.friction_nm)
        out.append(AxisPlay(axis, replace(lost, half_band_rad=float(band) * lost.half_band_rad, friction_nm=dry)))
    return out


def _entry(
    fit: posterior.Posterior, cell: Cell, alone: float, unseen: Float, planned: Float, data: list[Path]
) -> IdentifiedTable:
    """Provenance; standard deviations are those of independent values that leave the same doubt of the deflection."""
    index, k = {name: i for i, name in enumerate(cell.chain.names)}, len(fit.elements)
    before, after = (np.sqrt(np.diag(P))[3 : 3 + k] for P in (fit.before, fit.covariance))
    determined = after < _DETERMINED * before
    spread = np.where(determined, before * alone, before)
    values = [
        IdentifiedValue(
            name=f"force.{name}", value=factor, sigma=factor * float(np.sqrt(fit.covariance[j, j])), unit=""
        )
        for j, (name, factor) in enumerate(zip(posterior.FORCES, fit.factors.force.tolist(), strict=True))
    ]
    for name, factor, sigma, seen in zip(
        fit.elements,
        fit.factors.elements.tolist(),
        spread.tolist(),
        np.where(determined, "determined", "prior"),
        strict=True,
    ):
        for d, compliance in zip(_DIRECTIONS, (factor * cell.chain.compliance[index[name]]).tolist(), strict=True):
            if compliance > 0.0:
                unit = "m/N" if d[0] == "t" else "rad/(N m)"
                values.append(
                    IdentifiedValue(
                        name=f"{name}.{d}", value=compliance, sigma=sigma * compliance, unit=unit, seen=str(seen)
                    )
                )
    given = cell.class_drives
    if given is not None and given.servo_axes:
        factor, sigma = float(fit.factors.drives[0]), float(fit.sigma.drives[0])
        values.append(IdentifiedValue(name=YIELD, value=factor, sigma=factor * sigma, unit=""))
    for axis, angle, sigma in posterior.lost_rad(fit, cell):
        values.append(IdentifiedValue(name=f"axis{axis + 1}.lost", value=angle / MRAD, sigma=sigma / MRAD, unit="mrad"))
    return IdentifiedTable(
        recipe=RECIPE,
        date=datetime.datetime.now(tz=datetime.UTC).strftime("%Y-%m-%d %H:%M:%S UTC"),
        data=tuple(file.name for file in data),
        data_sha256=tuple(_digest(file) for file in data),
        counterflex=__version__,
        holdout=f"faces left out in turn: {_rms(unseen) / UM:.0f} um, by the cell file before "
        f"{_rms(planned) / UM:.0f} um",
        values=tuple(values),
    )


def _digest(path: Path) -> str:
    """SHA-256 of a file; of a folder, of the names and contents of its files."""
    files = [path] if path.is_file() else sorted(file for file in path.rglob("*") if file.is_file())
    digest = hashlib.sha256()
    for file in files:
        digest.update(file_content.content(file))
    return digest.hexdigest()


def _rms(values: Float) -> float:
    return float(np.sqrt(np.mean(values**2)))


class FirstCut(Summary):
    """Constants found by a coupon."""

    def _shown(self) -> Parts:
        yield self.rows(
            "constants",
            "Found on {places} places",
            "constant | times that of the cell file=factor:.2f | standard deviation={percent:g} %",
            "Of each by itself; together they are known better: see below",
        )
        yield self.line(
            "faces off what the cell file predicts by {planned_rms_um:g} um (root mean square), by the new one "
            "{left_rms_um:g} um; faces left out in turn {left_out_rms_um:g} um"
        )
        yield self.line("doubt of the deflection: {doubt_of_deflection_left_percent:g} % of that before")
        yield from map(Warned, self["warnings"])
        if self["far_places"]:
            yield Warned(self.line("far off what all others show, look at them again: places {far_places}"))
        if self["left_out_rms_um"] >= self["planned_rms_um"]:
            yield Warned(
                "a face left out is foretold no better than by the cell file: every face is needed, and programs that "
                "load the arm otherwise than the coupon may gain little. Measure more places"
            )


def _summary(
    fit: posterior.Posterior,
    places: posterior.MeasuredCoordinates,
    unseen: Float,
    planned: Float,
    narrower: float,
    cell: Cell,
    job: Job,
) -> dict[str, Any]:
    factors, sigma = np.exp(fit.value[:-3]).tolist(), np.sqrt(np.diag(fit.covariance)).tolist()
    constants = [
        {"constant": name, "factor": round(factor, 3), "percent": round(100.0 * doubt, 1)}
        for name, factor, doubt in zip(fit.names(cell), factors, sigma, strict=False)
    ]
    far: Int = np.flatnonzero(np.abs(fit.left_m) > _FAR * np.maximum(places.sigma_m, _rms(fit.left_m)))
    return {
        "job": "firstcut",
        "program": Path(job.program.name).name,
        "cell": cell.name,
        "places": len(places.row),
        "constants": constants,
        "doubt_of_deflection_left_percent": round(100.0 * narrower, 1),
        "planned_rms_um": round(_rms(planned) / UM, 1),
        "left_rms_um": round(_rms(fit.left_m) / UM, 1),
        "left_out_rms_um": round(_rms(unseen) / UM, 1),
        "offset_um": [round(float(v) / UM, 1) for v in fit.value[-3:]],
        "far_places": places.number[far].tolist(),
        "warnings": posterior.doubts(fit, places, places.off_m - planned, cell),
    }

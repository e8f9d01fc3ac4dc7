"""Preflight of a program on a cell: the table in shop units, and the page with the joint margins along the path."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.coarse_bodies import coarse_bodies
from counterflex.app.compensation.program_size import program_size
from counterflex.app.inputs import AS_IT_IS, Job, Reading, read_in_plane, setting_of
from counterflex.app.inspection.judging import nominal_of
from counterflex.app.proof.cut_logs import log_of_path, top_of
from counterflex.core import atomic
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.core.result import Parts, ShownTable, Summary, fill
from counterflex.core.units import DEG, MM, MM_PER_MIN, MS, PERCENT, UM, plain
from counterflex.evaluate.inspection.cad_rows import even_points
from counterflex.evaluate.inspection.mesh_shape import CadSolid
from counterflex.evaluate.inspection.nominal_part import NominalPart
from counterflex.evaluate.measured_values import height_at
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.step_file import ENDINGS
from counterflex.files.summary_file import write_summary
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.preflight.preflight import Preflight, preflight
from counterflex.plan.preflight.process.cut_rows import AsWritten, Machining
from counterflex.plan.preflight.row import NOT_LOOKED_AT, RANK, Row, Verdict
from counterflex.plan.preflight.speed_row import slower, speed_in_cut
from counterflex.programs.approximation import approximation_m
from counterflex.programs.program import Program
from counterflex.programs.robot_text.program import RobotProgram
from counterflex.programs.stated.remarks import Stated
from counterflex.programs.stated.two_readings import stated_postures
from counterflex.twin.plant.simulate import mounted_tools

CHECK: Final = "nominal geometry"
LIMIT_M: Final = 50.0 * UM
"""Of a face without a tolerance of profile or position: five times the usual tolerance of a CAM system."""
_MOST_ROWS: Final = 12
_DEEPEST_M: Final = 5.0 * MM  # Distances to what was cut are known up to this


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


SHOP: Final[dict[str, tuple[str, float]]] = {
    "rad": ("deg", DEG),
    "rad/s": ("deg/s", DEG),
    "rad/s2": ("deg/s2", DEG),
    "m": ("mm", MM),
    "m/s": ("mm/min", MM_PER_MIN),
    "m3": ("mm3", MM**3),
    "s": ("ms", MS),
    "share": ("%", 0.01),
}
"""Unit that a row is shown in, and its SI value, by SI unit."""
READING, CHECKING = "reading the program", "checking"


@dataclass(frozen=True, eq=False)
class Checked:
    """A checked program."""

    job: Job
    result: Preflight
    summary: dict[str, Any]  # What is printed as JSON and written to ``summary.json``

    def _page(self) -> Any:
        from counterflex.report.preflight.page import PreflightData

        result, n = self.result, len(self.result.q)
        path = result.path
        return PreflightData(
            title=f"Preflight: {self.summary['program']}",
            subtitle=f"{self.summary['cell']}, {self.summary['robot']}",
            checks=self.summary["checks"],
            failed=result.failed,
            time_s=path.time_s[:n],
            margin_deg=result.margin_rad / DEG,
            least_deg=next(
                (r["limit"] for r in self.summary["checks"] if r["check"] == "joint limits" and r["limit"]), 0.0
            ),
            line=self.job.line_of_motion[path.motion[:n]],
            points=[row.point if row.point is not None and row.point < n else None for row in result.rows],
            cutting=path.kind[:n] == 1,
            bodies=self.summary["bodies"],
            curves=_curves(result),
        )


def check(
    program: str | Path,
    cell: Cell,
    *,
    reading: Reading = AS_IT_IS,
    language: str | None = None,
    nominal: Path | None = None,
    progress: Progress = silent,
) -> Checked:
    """Check a program on a cell.

    Args:
        language: Of the robot, for the size of the program, see
            :func:`counterflex.app.compensation.program_size.program_size`.
        nominal: STEP file of the part that the program is to make, or None.

    Raises:
        CounterflexError: The program cannot be read, or the cell describes no milling. What the program cannot do on
            the cell is a row of the table, not an error.
    """
    begin, parts = time.perf_counter(), in_parts(progress, {READING: 1.0, CHECKING: 9.0})
    # Its depth of cut is volume over length: shorter steps than the cells of the stock would make that grainy
    cell, job = read_in_plane(program, cell, reading=reading, step_s=math.inf, may_move=True)
    parts[READING](1.0)
    tables, stock = cell.tables, cell.stock()
    result = preflight(
        job.machined,
        stock,
        setting_of(cell, job, chain=cell.chain, part_may_be_held=True),
        tables.limits.preflight(tables.controller, cell.robot),
        machining_of(cell),
        coarse_bodies(job, cell, stock),
        as_written(job, cell, language, known_offsets=reading.parameters is not None or bool(cell.work_offsets)),
        parts[CHECKING],
    )
    if nominal is not None:
        result = replace(result, rows=(*result.rows, *nominal_rows(nominal, job, cell, result.path)))
    rows = [shown(row, result, job, cell) for row in result.rows]
    summary = {
        "program": job.program.name,
        "cell": cell.label,
        "robot": cell.robot.name,
        "failed": result.failed,
        "counts": {verdict: sum(row.verdict == verdict for row in result.rows) for verdict in RANK},
        "checks": rows,
        "bodies": [
            {"name": body.name, "frame": body.frame, "shape": body.shape, "assumed": body.assumed}
            for body in result.bodies
        ],
        **_path_speed(result),
        "points": len(result.path),
        "points_reached": len(result.q),
        "seconds": round(time.perf_counter() - begin, 3),
        "counterflex": __version__,
    }
    return Checked(job, result, summary)


def machining_of(cell: Cell) -> Machining:
    """Tools, spindle, stiffness and monitoring as the cell file states them."""
    unknown = cell.unknown_axes
    rigid = f"axes {', '.join(str(axis + 1) for axis in unknown)}" if unknown else ""
    monitor = cell.tables.monitor
    sample_s = None if monitor is None else monitor.sample_ms * MS
    return Machining(cell.process_limits, {tool.number: tool.bounds for tool in cell.tables.tools}, rigid, sample_s)


def as_written(job: Job, cell: Cell, language: str | None, *, known_offsets: bool) -> AsWritten:
    """Statements of a program about its run on the controller.

    Args:
        known_offsets: A parameter file or the cell file gives the work offsets.
    """
    remarks, program = Stated.of(job.program, known_offsets), job.program
    silent_spindle = remarks.robot and not any(motion.spindle_rad_s for motion in program.motions)
    wired = remarks.robot and bool(cell.tables.controller.spindle.of_language(program.dialect).clockwise)
    end = int(np.flatnonzero(job.path.motion == job.path.motion[0])[-1])
    known = bool(np.all(job.path.p_part_tcp[end, 2] == job.sampled.p_part_tcp[end, 2]))
    return AsWritten(
        approximation_m(program), program_size(job, cell, language), remarks, known, silent_spindle and not wired,
        0 if remarks.robot else _arrival(program), program.left_out if isinstance(program, RobotProgram) else (),
        stated_postures(program) if remarks.robot else None, remarks.robot and not wired,
    )  # fmt: skip


def _arrival(program: Program) -> int:
    """Motion at whose end the program has named X, Y and Z; letters that it never names count for nothing."""
    named = dict.fromkeys("XYZ", 0)
    for block in reversed(program.blocks):
        if block.motion_count:
            named |= {word.letter: block.first_motion for word in block.words if word.letter in named}
    return max(named.values())


def _path_speed(result: Preflight) -> dict[str, Any]:
    """Return how the path speed is held in the cut; nothing where nothing is reached or cut."""
    along = result.along
    speed = None if along is None else speed_in_cut(along.held, along.cutting)
    if speed is None:
        return {}
    figures = {
        **plain(speed, "cut_mm:3 slower_mm:3"),
        "slower_percent": round(speed.share / PERCENT, 3),
        **plain(speed, "more_s:3 lowest_mm_min:2"),
        "causes_percent": {text: round(share / PERCENT, 2) for text, _, share in speed.causes},
    }
    return {"path_speed": figures}


def shown(row: Row, result: Preflight, job: Job, cell: Cell) -> dict[str, Any]:
    """A row in shop units, with the line of the program and the place in the part frame."""
    unit, size = SHOP.get(row.unit, (row.unit, 1.0))
    line = at = None
    if row.point is not None:
        point = min(row.point, len(result.path) - 1)
        motion = int(result.path.motion[point])
        p_part = result.path.p_part_tcp[point]
        p_part = p_part if cell.R_part_plane is None else cell.R_part_plane @ p_part
        line, at = int(job.line_of_motion[motion]), np.round(p_part / MM, 3).tolist()
    return {
        **plain(row, "check verdict"),
        "value": _plain(row.value, size),
        "limit": _plain(row.limit, size),
        "unit": unit,
        "line": line,
        "place": None if line is None else job.program.place(line),
        "at_mm": at,
        **plain(row, "what missing advice"),
    }


def _plain(value: float | None, size: float) -> float | None:
    return None if value is None else float(f"{value / size:.6g}")


_ORDER: Final = ("fail", "warning", "ok")


class PreflightSummary(Summary):
    """Checks of a program before it runs."""

    def _shown(self) -> Parts:
        checks = [row | {"has": _number(row["value"], row["unit"])} for row in self["checks"]]
        looked_at = [
            row | {"limit": _number(row["limit"], row["unit"])} for row in checks if row["verdict"] != "not looked at"
        ]
        looked_at.sort(key=lambda row: _ORDER.index(row["verdict"]))
        columns = "check | verdict | value=has | limit | worst=place | what"
        yield ShownTable.of(self.line("{program} on {cell}"), columns, looked_at)
        for row in looked_at:
            if row["advice"]:
                yield fill("{verdict}: {check}: {advice}", row)
        if left_out := [row for row in checks if row["verdict"] == "not looked at"]:
            yield "not looked at, and what it needs:"
        for row in left_out:
            here = ", ".join(text for text in (row["has"], row["what"], row["place"]) if text)
            needs = f"{row['missing']} ({here})" if row["missing"] and here else row["missing"] or here
            yield f"  {row['check']}: {needs}"
        yield self.line(
            "{counts[fail]} fail, {counts[warning]} warning, {counts[not looked at]} not looked at, {counts[ok]} ok"
        )


def _number(value: float | None, unit: str) -> str:
    if value is None:
        return ""
    return f"{value:.0f} {unit}".rstrip() if abs(value) >= 1000.0 else f"{value:.4g} {unit}".rstrip()


def run(
    program: str | Path,
    cell_file: str | Path,
    out: str | Path | None = None,
    *,
    reading: Reading = AS_IT_IS,
    language: str | None = None,
    nominal: Path | None = None,
    progress: Progress = silent,
) -> PreflightSummary:
    """Check a program; with ``out``, write ``summary.json`` and ``report.html`` there: both or none.

    Args:
        out: Folder, made when missing; None writes nothing.
    """
    cell = read_cell(cell_file)
    if out is None:
        done = check(program, cell, reading=reading, language=language, nominal=nominal, progress=progress)
        return PreflightSummary(done.summary)
    with atomic.atomic_folder(out) as staging:
        done = check(program, cell, reading=reading, language=language, nominal=nominal, progress=progress)
        write_summary(staging / "summary.json", done.summary)
        from counterflex.report.page import write_page

        write_page(done._page().page(), staging / "report.html")
    return PreflightSummary(done.summary)


def _curves(result: Preflight) -> Any:
    """Return what the pictures along the path show; None where nothing is reached."""
    if result.along is None or len(result.q) == 0:
        return None
    from counterflex.report.preflight.path_figures import PathCurves

    along, held, bounds, n = result.along, result.along.held, result.bounds, len(result.q)
    feed = result.path.kind[:n] == FEED
    way = np.cumsum(held.length_m)
    blocks = along.blocks
    cuts = blocks.cuts
    return PathCurves(
        way_m=way,
        at_feed=feed,
        programmed_m_s=held.programmed_m_s,
        held_m_s=held.at_m_s,
        slow=along.cutting & slower(held),
        joint_speeds_rad_s=along.joint_speeds_rad_s,
        joint_accelerations_rad_s2=along.joint_accelerations_rad_s2,
        speed_limits_rad_s=bounds.joint_speeds_rad_s,
        acceleration_limits_rad_s2=bounds.joint_accelerations_rad_s2,
        point_way_m=way[blocks.point[cuts]],
        point_length_m=blocks.length_m[cuts],
        point_least_m=blocks.feed_m_s[cuts] * bounds.least_block_s,
        reversals=[(event.point, event.axis) for event in along.reversals],
    )

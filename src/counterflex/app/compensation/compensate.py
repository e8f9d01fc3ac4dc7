"""The main job: a program in, the same program compensated out, with the plan and a summary beside it."""

from __future__ import annotations

import dataclasses
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from counterflex import __version__
from counterflex.app.compensation.feed_for_tolerance import lowered_plan, shown_feed
from counterflex.app.compensation.prediction import chatter_said, figures, prediction
from counterflex.app.compensation.robot_program import check_machine, left_out, other_lengths, routine_name, tool_data
from counterflex.app.inputs import AS_IT_IS, Job, Reading, faults_in, read_job, setting_of
from counterflex.core import atomic
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.core.units import DEG, MM, MS, UM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.plan_file import write_plan
from counterflex.files.summary_file import write_summary
from counterflex.geometry import pose
from counterflex.path.toolpath import tool_orientation
from counterflex.plan.compensate import plan as make_plan
from counterflex.plan.feed_for_tolerance import FeedTolerance, at_feed
from counterflex.plan.plan import Plan, job_hash
from counterflex.programs.compensated import CompensatedPath, marks
from counterflex.programs.gcode.write.writer import write_gcode
from counterflex.programs.krl.writer import KrlSettings, KrlWriter
from counterflex.programs.long_dwells import long_dwells
from counterflex.programs.rapid.writer import RapidSettings, RapidWriter
from counterflex.robot.model.elastic_region import beyond_regions

Language = Literal["gcode", "krl", "rapid"]
TOLERANCE_M = (0.1 * UM, 1000.0 * UM)
"""Smallest and largest tolerance of the written path."""
READING, PLANNING, WRITING = "reading the program", "planning", "writing the program"
WORK = {READING: 1.5, PLANNING: 35.0, WRITING: 1.5}
"""Parts of the work with what they cost: between those of a small part and of 90 000 moves; planning tells its own."""
PAGE = "writing the report"
_PAGE_SHARE = 0.05
LANGUAGES: tuple[Language, ...] = ("gcode", "krl", "rapid")


@dataclass(frozen=True, eq=False)
class Compensated:
    """Result of the job.

    Attributes:
        plan: Everything predicted and decided.
        files: Program files by name, text.
        written: What the writer says about them, plain values.
        summary: What ``summary.json`` holds.
        encoding: Of the program files, that of the source.
    """

    plan: Plan
    files: dict[str, str]
    written: dict[str, Any]
    summary: dict[str, Any]
    encoding: str


def compensate(
    program: str | Path,
    cell: Cell,
    *,
    language: Language = "gcode",
    reading: Reading = AS_IT_IS,
    tolerance_m: float = 5.0 * UM,
    normal_only: bool = False,
    predict: bool = True,
    feed: FeedTolerance | None = None,
    progress: Progress = silent,
) -> Compensated:
    """Plan and write a compensated program.

    Args:
        program: G-code file.
        cell: The cell.
        language: Of the output.
        reading: How the program is read.
        tolerance_m: Largest distance between the written path and the planned one.
        normal_only: Correct square to the feed only.
        predict: Predict what the uncompensated program does and what remains after compensation.
        feed: Lower the feed where what remains would be outside a tolerance; None leaves it alone.
        progress: Progress callback, fraction 0 to 1.

    Raises:
        CounterflexError: The program, the cell or the reach does not allow it; one line says what and where.
    """
    if language not in LANGUAGES:
        raise InputError("unknown output language", value=language, limit=", ".join(LANGUAGES))
    if not TOLERANCE_M[0] <= tolerance_m <= TOLERANCE_M[1]:
        raise InputError(
            "the tolerance of the written path is out of range",
            where="--tolerance-um",
            value=f"{tolerance_m / UM:g}",
            limit=f"{TOLERANCE_M[0] / UM:g} to {TOLERANCE_M[1] / UM:g}",
        )
    if feed is not None and not predict:
        raise InputError("without a prediction no feed can be found for a tolerance", where="--no-predict")
    begin = time.perf_counter()
    parts = in_parts(progress, WORK)
    planning = parts[PLANNING]
    parts[READING](0.0)
    job = read_job(program, cell, reading=reading)
    carried = marks("\n".join(job.program.lines))
    if carried:
        raise InputError(
            "the program is compensated already and would be compensated twice",
            where=Path(program).name,
            value=f"job {', '.join(carried)}",
            hint="Give the original program",
        )
    if language != "gcode":
        check_machine(job, cell, language)
    setting = setting_of(cell, normal_only=normal_only, orientation=language != "gcode")
    with faults_in(job):
        if feed is None:
            plan = make_plan(
                job.path, job.line_of_motion, cell.stock(), setting, predict=predict, progress=parts[PLANNING]
            )
        else:
            lowered = lowered_plan(job, cell, setting, feed, planning)
            plan = lowered.plan
            job = replace(job, path=plan.path, sampled=at_feed(job.sampled, lowered.share))
    parts[WRITING](0.0)
    files, written = write(job, plan, cell, language, tolerance_m)
    written["tolerance_um"] = round(tolerance_m / UM, 3)
    written["lines_in"] = len("\n".join(job.program.lines).splitlines())
    written["lines_out"] = sum(len(text.splitlines()) for name, text in files.items() if not name.endswith(".dat"))
    predicted = figures(plan)
    said = (*long_dwells(job.program), *_beyond_measured(cell, plan), *chatter_said(predicted["chatter"]))
    written["warnings"] = [*written.get("warnings", ()), *said]
    parts[WRITING](1.0)
    about = {
        "job": "compensate",
        "program": Path(program).name,
        "cell": cell.name,
        "robot": cell.chain.name,
        "language": language,
        "files": list(files),
        "job_hash": job_hash(plan),
        "written": written,
        "prediction": predicted,
        **({} if feed is None else {"feed": shown_feed(lowered, feed)}),
        "seconds": round(time.perf_counter() - begin, 3),
        "counterflex": __version__,
    }
    return Compensated(plan, files, written, about, job.program.encoding)


def _beyond_measured(cell: Cell, plan: Plan) -> list[str]:
    """What is told where the path leaves the angles that errors of the drives or compliances were measured at."""
    known = cell.drive_errors
    ranges = {axis: [f"{angle / DEG:.0f}" for angle in known.measured_rad[axis]] for axis in known.outside(plan.q)}
    return [
        f"axis {axis + 1} leaves the angles at which its periodic errors were measured ({low} to {high} deg, "
        "[drive_error] measured_deg): there they fade to nothing"
        for axis, (low, high) in ranges.items()
    ] + beyond_regions(cell.chain.regions, plan.q)


def run(
    program: str | Path,
    cell_file: str | Path,
    out: str | Path,
    *,
    report: bool = True,
    progress: Progress = silent,
    **options: Any,
) -> dict[str, Any]:
    """Do the job on files: program files, ``plan.parquet``, ``summary.json`` and ``report.html`` in ``out``.

    Either all files are written or none.

    Args:
        program: G-code file.
        cell_file: Cell file.
        out: Folder; made when missing.
        report: Write the HTML page.
        progress: Progress callback, fraction 0 to 1.
        options: As for :func:`compensate`.

    Returns:
        The summary.
    """
    cell = read_cell(cell_file)
    with atomic.atomic_folder(out) as staging:
        parts = in_parts(progress, {"compensating": 1.0 - _PAGE_SHARE, PAGE: _PAGE_SHARE})
        result = compensate(program, cell, progress=parts["compensating"], **options)
        parts[PAGE](0.0)
        about = {key: result.summary[key] for key in ("program", "cell", "robot", "counterflex")}
        for name, text in result.files.items():
            atomic.write_bytes(staging / name, text.encode(result.encoding, errors="replace"))
        write_plan(staging / "plan.parquet", result.plan, about)
        write_summary(staging / "summary.json", result.summary)
        if report:
            from counterflex.report.page import prediction_page, write_page

            write_page(prediction_page(prediction(result.plan, cell, result.summary)), staging / "report.html")
        parts[PAGE](1.0)
    return result.summary


def write(
    job: Job, plan: Plan, cell: Cell, language: Language, tolerance_m: float = 5.0 * UM
) -> tuple[dict[str, str], dict[str, Any]]:
    """Write a plan in a program language.

    Returns:
        Program files by name, and what the writer says about them.
    """
    nominal = job.sampled if language == "gcode" else job.path
    commanded = CompensatedPath.from_correction(nominal, plan.correction_part, plan.rotvec_part)
    if language == "gcode":
        text = write_gcode(job.program, commanded, tolerance_m=tolerance_m, cell=cell.name, job=job_hash(plan))
        said = {key: value for key, value in dataclasses.asdict(text).items() if key != "text"}
        return {Path(job.program.name).name: text.text}, _shop(said)
    Rs_part_nominal = tool_orientation(plan.path.axis_part, cell.tables.posture.rotation_about_tool_deg * DEG)
    Ts_part_tcp = commanded.poses(Rs_part_nominal)
    controller = cell.tables.controller
    name = routine_name(Path(job.program.name).stem)
    lines = cell.machine_functions(language).lines
    data = tool_data(job, cell, language)
    if language == "krl":
        robot_text = KrlWriter(
            job.program,
            job.path,
            Ts_part_tcp,
            KrlSettings(
                name=name,
                start_axes_rad=[float(angle) for angle in plan.q[0]],
                tool=controller.tool_number,
                base=controller.base_number,
                rapid_m_s=controller.rapid_mm_s * MM,
                acc_m_s2=controller.acceleration_mm_s2 * MM,
                blend_m=controller.blending_mm * MM,
                cycle_s=controller.cycle_ms * MS,
                cell=cell.name,
                job=job_hash(plan),
                tool_data={tool: int(value) for tool, value in data.items()},
            ),
            tolerance_m=tolerance_m,
            block_lines=lines,
        ).text()
    else:
        mass, com = _payload(cell)
        robot_text = RapidWriter(
            job.program,
            job.path,
            Ts_part_tcp,
            RapidSettings(
                name=name,
                start_axes_rad=[float(angle) for angle in plan.q[0]],
                T_flange_tcp=cell.controller_chain.T_flange_tcp,
                T_base_part=cell.T_base_part,
                tool_mass_kg=mass,
                p_flange_cog=com,
                rapid_m_s=controller.rapid_mm_s * MM,
                cycle_s=controller.cycle_ms * MS,
                cell=cell.name,
                job=job_hash(plan),
                tool_data=data,
            ),
            tolerance_m=tolerance_m,
            block_lines=lines,
        ).text()
    robot_text = replace(
        robot_text, warnings=(*robot_text.warnings, *left_out(job.program), *other_lengths(job.program))
    )
    said = {key: value for key, value in dataclasses.asdict(robot_text).items() if key != "files"}
    return robot_text.files, _shop(said)


def _payload(cell: Cell) -> tuple[float, list[float]]:
    """Mass and centre of gravity of the end effector in the flange frame."""
    T_flange_body, total, moment = np.eye(4), 0.0, np.zeros(3)
    for body in cell.end_effector.segments:
        T_flange_body = T_flange_body @ body.T_prev_seg
        total += body.mass_kg
        moment = moment + body.mass_kg * pose.transform(T_flange_body, body.p_seg_com)
    if total == 0.0:
        return 1.0, [0.0, 0.0, 0.001]
    return total, [float(value) for value in moment / total]


def _shop(said: dict[str, Any]) -> dict[str, Any]:
    """Writer's figures with shop units in their names."""
    out: dict[str, Any] = {}
    for key, value in said.items():
        if key.endswith("_m"):
            out[key[:-2] + "_um"] = round(float(value) / UM, 3)
        elif key.endswith("_rad"):
            out[key[:-4] + "_deg"] = round(float(value) / DEG, 5)
        else:
            out[key] = list(value) if isinstance(value, tuple) else value
    return out

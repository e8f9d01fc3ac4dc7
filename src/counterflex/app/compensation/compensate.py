"""The main job: a program in, the same program compensated out, with the plan and a summary beside it.

read (`app.inputs.read_job`) -> cell (`files.cell.cell.read_cell`) -> plan (`plan.compensate.plan`, five stages:
`solve_joints`, `undisturbed_cut`, `static_correction`, `dynamic_trial`, `predict_deviations`) -> write
(`languages.write`).
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from counterflex import __version__
from counterflex.app.compensation.languages import own_language, require_tolerance, write
from counterflex.app.compensation.prediction import calm_feed, prediction, summary_of
from counterflex.app.compensation.robot_program import check_machine
from counterflex.app.cost_of_unknown_stiffness import require_stiffness_for
from counterflex.app.external_moves import require_allowed, require_clear
from counterflex.app.inputs import AS_IT_IS, Job, Reading, faults_in, in_plane_of, read_in_plane, setting_of
from counterflex.app.robot_programs import inputs_of, with_files
from counterflex.core import atomic
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.core.units import UM, plain
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.plan_file import CLASS_ASSUMED, EXTERNAL_PLACES, TOOL_TURNS, WORKING_PLANE, write_plan
from counterflex.files.summary_file import write_folder_summary
from counterflex.path.external_axes import ExternalPlaces
from counterflex.path.toolpath import ToolPath
from counterflex.plan.compensate import plan as make_plan
from counterflex.plan.feed_for_tolerance import ROUNDS, FeedTolerance, LoweredFeed, lower_feed
from counterflex.plan.feed_limits import LimitedFeed, known, limit_feed
from counterflex.plan.inputs import CompensationInputs, Setting, solve_joints
from counterflex.plan.plan import Plan
from counterflex.programs.compensated import refuse_compensated
from counterflex.programs.language import LANGUAGES, dialect_at


def limited_feed(job: Job, cell: Cell, setting: Setting) -> LimitedFeed | None:
    """The program at feeds within ``[process_limits]``; None where the cell file has no limit that a feed keeps."""
    if not any(known(cell.process_limits(tool.number)) for tool in cell.tables.tools):
        return None
    line = job.line_of_motion[job.path.motion]
    inputs = CompensationInputs(job.path, line, cell.stock(), setting, solve_joints(job.path, line, setting).q)
    return limit_feed(inputs, job.feeds, cell.process_limits)


def shown_limits(limited: LimitedFeed) -> dict[str, Any]:
    """Return what became of the feed, in shop units."""
    return {
        "extra_s": round(limited.extra_s, 3),
        "kept": all(line.kept for line in limited.lines),
        "lines": [line.shown() for line in limited.lines],
    }


def lowered_plan(job: Job, cell: Cell, setting: Setting, wish: FeedTolerance, progress: Progress) -> LoweredFeed:
    """Plan a program at feeds for a tolerance, see :func:`counterflex.plan.feed_for_tolerance.lower_feed`.

    Args:
        progress: Progress callback, fraction 0 to 1, a share for each round that may come.
    """
    rounds = iter(range(ROUNDS + 1))
    return lower_feed(
        job.path, job.feeds, wish, lambda path: _plan_round(job, cell, setting, progress, next(rounds), path)
    )


def _plan_round(job: Job, cell: Cell, setting: Setting, progress: Progress, done: int, path: ToolPath) -> Plan:
    return make_plan(
        path,
        job.line_of_motion,
        cell.stock(),
        setting,
        feeds=job.feeds,
        predict=True,
        progress=lambda fraction, what="": progress(
            (done + fraction) / (ROUNDS + 1.0), f"round {done + 1}: {what}" if what else ""
        ),
    )


def shown_feed(lowered: LoweredFeed, wish: FeedTolerance) -> dict[str, Any]:
    """Return what became of the feed, in shop units."""
    return {
        **plain(wish, "tolerance_um:3 least_percent=least:3 least_chip_um:3"),
        **plain(lowered, "extra_s:3"),
        "time_s": round(float(lowered.plan.path.time_s[-1]), 3),
        **plain(lowered, "worst_before_um=before_m:1 worst_after_um=after_m:1"),
        "reached": bool(lowered.after_m <= wish.tolerance_m),
        "rounds": lowered.rounds,
        "lines": [line.shown() for line in lowered.lines],
    }


READING, PLANNING, WRITING = "reading the program", "planning", "writing the program"
WORK = {READING: 1.5, PLANNING: 35.0, WRITING: 1.5}
"""Parts of the work with what they cost: between those of a small part and of 90 000 moves; planning tells its own."""
PAGE, _PAGE_SHARE = "writing the report", 0.05


@dataclass(frozen=True, eq=False)
class Compensated:
    """Result of the job."""

    plan: Plan
    files: dict[str, str]
    written: dict[str, Any]  # What the writer says about them, plain values
    summary: dict[str, Any]  # What ``summary.json`` holds
    encoding: str  # Of the program files, that of the source
    limited: LimitedFeed | None = None  # What ``[process_limits]`` made of the feed; None where they state none
    places: ExternalPlaces | None = None  # Of external axes that move along the program; None where they stand


def compensate(
    program: str | Path,
    cell: Cell,
    *,
    language: str | None = None,
    reading: Reading = AS_IT_IS,
    tolerance_m: float = 5.0 * UM,
    normal_only: bool = False,
    predict: bool = True,
    feed: FeedTolerance | None = None,
    programmed_feed: bool = False,
    progress: Progress = silent,
) -> Compensated:
    """Plan and write a compensated program.

    Args:
        language: Of the output, one of :func:`counterflex.programs.language.at_prompt`; None is that of
            the program.
        tolerance_m: Largest distance between the written path and the planned one.
        normal_only: Correct square to the feed only.
        predict: Predict what the uncompensated program does and what remains after compensation.
        feed: Lower the feed where what remains would be outside a tolerance; None leaves it alone.
        programmed_feed: Leave the feed as programmed: for a robot that runs the original program, corrected online.

    Raises:
        CounterflexError: The program, the cell or the reach does not allow it; one line says what and where.
    """
    require_tolerance(tolerance_m)
    if feed is not None and not predict:
        raise InputError("without a prediction no feed can be found for a tolerance", where="--no-predict")
    begin, parts = time.perf_counter(), in_parts(progress, WORK)
    parts[READING](0.0)
    cell, job = read_in_plane(program, cell, reading=reading, may_move=True)
    refuse_compensated(job.program)
    own = own_language(job.program)
    language = own if language is None else language
    dialect = job.program.dialect if language == own else dialect_at(language, "write")
    kind = LANGUAGES[dialect]
    if kind.robot and language != own:
        check_machine(job, cell, dialect)
    require_stiffness_for(job, cell, parts[PLANNING])
    setting = setting_of(
        cell, job, normal_only=normal_only, orientation=kind.orientation or job.words is not None, part_may_be_held=True
    )
    require_allowed(job.path, setting, cell, job.program)
    with faults_in(job):
        limited = None if programmed_feed else limited_feed(job, cell, setting)
        slowed = job if limited is None else replace(job, path=limited.path)
        if feed is None:
            plan = make_plan(
                slowed.path,
                job.line_of_motion,
                cell.stock(),
                setting,
                feeds=None if programmed_feed else job.feeds,
                predict=predict,
                progress=parts[PLANNING],
            )
        else:
            lowered = lowered_plan(slowed, cell, setting, feed, parts[PLANNING])
            plan = lowered.plan
    require_clear(plan.path, plan.volume_m3, job.program)
    parts[WRITING](0.0)
    files, facts = write(job, plan, cell, language, tolerance_m)
    about = summary_of(job, plan, cell, language, files=files, written=facts, tolerance_m=tolerance_m)
    parts[WRITING](1.0)
    if limited is not None:
        about |= {"feed_limits": shown_limits(limited), "calm_feed": calm_feed(slowed, plan, cell)}
    about |= {} if feed is None else {"feed": shown_feed(lowered, feed)}
    about |= in_plane_of(cell)
    about |= {"seconds": round(time.perf_counter() - begin, 3), "counterflex": __version__}
    about = with_files(about, job.program)
    return Compensated(plan, files, about["written"], about, job.program.encoding, limited, job.places)


def run(
    program: str | Path,
    cell_file: str | Path,
    out: str | Path,
    *,
    assume_class: bool = False,
    report: bool = True,
    shown: str | Path | None = None,
    progress: Progress = silent,
    **options: Any,
) -> dict[str, Any]:
    """Write program files, ``plan.parquet``, ``summary.json`` and ``report.html`` into ``out``: all or none of them.

    Args:
        assume_class: Give axes that no stiffness is known of the median of the robot's class, and say so.
        shown: The program as commands on the page name it; None: as ``program``.
    """
    cell = read_cell(cell_file, assume_class=assume_class)
    with atomic.atomic_folder(out) as staging:
        parts = in_parts(progress, {"compensating": 1.0 - _PAGE_SHARE, PAGE: _PAGE_SHARE})
        inputs = inputs_of(program, cell_file)
        result = compensate(program, cell, progress=parts["compensating"], **options)
        result.summary["inputs"] = inputs
        parts[PAGE](0.0)
        write_folder(result, cell, program if shown is None else shown, staging, report=report)
        parts[PAGE](1.0)
    return result.summary


def write_programs(result: Compensated, folder: Path) -> None:
    """Write the program files into a folder."""
    for name, text in result.files.items():
        atomic.write_bytes(folder / name, text.encode(result.encoding, errors="replace"))


def write_folder(result: Compensated, cell: Cell, program: str | Path, folder: Path, *, report: bool = True) -> None:
    """Write all files of a compensation into a folder.

    Args:
        program: The original program, as commands on the page name it.
        folder: Where; best one that appears when it is whole (:func:`counterflex.core.atomic.atomic_folder`).
    """
    about = {key: result.summary[key] for key in ("program", "cell", "robot", "counterflex")}
    about |= {} if cell.class_stiffness is None else {CLASS_ASSUMED: True}
    about |= {key: result.summary[key] for key in (WORKING_PLANE, TOOL_TURNS) if key in result.summary}
    about |= {} if result.places is None else {EXTERNAL_PLACES: len(result.places.values)}
    about |= {"feed_lowered_s": result.summary["calm_feed"]["extra_s"]}
    write_programs(result, folder)
    write_plan(folder / "plan.parquet", result.plan, about, cell.chain.axes)
    write_folder_summary(folder, result.summary)
    if report:
        from counterflex.report.page import prediction_page, write_page

        page = prediction(result.plan, cell, result.summary, result.limited, program, result.places)
        write_page(prediction_page(page), folder / "report.html")

"""The whole main job, proven: compensate a program, machine it before and after on simulated cells, judge, report.

For every truth seed the original and the compensated program are machined on the same simulated cell. The planner knows
what the cell file states (truth level ``catalogue``). As a second figure the program is compensated again with the
truth's exact constants (truth level ``exact``): the remaining error is that of the method, not of the model.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from counterflex import __version__
from counterflex.app.compensation.compensate import limited_feed
from counterflex.app.compensation.languages import own_language, write
from counterflex.app.compensation.prediction import calm_feed, figures
from counterflex.app.cost_of_unknown_stiffness import assumed, require_stiffness_for
from counterflex.app.inputs import (
    AS_IT_IS,
    Job,
    Reading,
    faults_in,
    in_plane_of,
    in_working_plane,
    read_in_plane,
    read_job,
    setting_of,
)
from counterflex.app.long_jobs.workers import Shares, count_of, done_one_by_one, interrupts_deferred, pool_of, share
from counterflex.app.prediction_interval import with_intervals
from counterflex.app.proof import simulate
from counterflex.app.proof.judge import JudgedRun, ProofResult, judge, reference_of
from counterflex.app.proof.truth import exact_setting, truth_of
from counterflex.app.robot_programs import companions, digest, inputs_of, with_files
from counterflex.app.unknown_stiffness import unknown_stiffness
from counterflex.core import atomic, file_content
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.evaluate.summary import SeedResult, TruthLevel, summary
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.plan_file import CLASS_ASSUMED, TOOL_TURNS, WORKING_PLANE, write_plan
from counterflex.files.summary_file import write_folder_summary, write_run
from counterflex.path.toolpath import ToolPath
from counterflex.plan.compensate import plan as make_plan
from counterflex.plan.plan import Plan
from counterflex.twin.plant.record import Record
from counterflex.twin.truth.family import FIRST_SEED, MILD, Family
from counterflex.twin.truth.file import write_truth
from counterflex.twin.truth.truth import Truth

_LEVELS: tuple[tuple[TruthLevel, str], ...] = (("catalogue", "compensated"), ("exact", "exact"))
PLANNING, STARTING, MACHINING, JUDGING = "planning", "starting the simulated cells", "machining", "judging"
_PLANNING_S: Final = 0.2
"""Seconds that planning takes for a second of the program, as measured; likewise machining it and judging it."""
_MACHINING_S: Final = 0.2
_JUDGING_S: Final = 0.02
_START_S: Final = 6.0
_BEGUN: Final = 1e-6  # Share of a task that says that it has begun


def prove(
    program: str | Path,
    cell_file: str | Path,
    scratch: Path,
    *,
    seeds: Sequence[int] = (FIRST_SEED,),
    family: Family = MILD,
    exact: bool = True,
    assume_class: bool = False,
    workers: int | None = None,
    reading: Reading = AS_IT_IS,
    progress: Progress = silent,
) -> ProofResult:
    """Compensate, machine, judge.

    Args:
        scratch: Folder for programs handed to the simulated cells.
        exact: Also machine the program planned with the truth's exact constants.
        assume_class: Plan with the median of the robot's class where no stiffness is known; the truths then are robots
            of that class.
        workers: Processes; None is one per core.

    Raises:
        InputError: There are no seeds, or the program removes nothing.
    """
    if not seeds:
        raise InputError("there are no truth seeds")
    inputs = inputs_of(program, cell_file)
    cell, job = read_in_plane(program, read_cell(cell_file, assume_class=assume_class), reading=reading)
    simulate.require_simulated(cell)
    require_stiffness_for(job, cell)
    begin = time.perf_counter()
    count = len(seeds) * (3 if exact else 2)
    parts = in_parts(progress, _work(float(job.path.time_s[-1]), seeds, count, count_of(workers, count), exact=exact))
    parts[PLANNING](0.0)
    slowed, plan = _planned(job, cell, Path(program).name, _saying(parts[PLANNING], PLANNING))
    files, written = write(job, plan, cell, own_language(job.program))
    timing = {"planning": time.perf_counter() - begin}
    truths = {seed: truth_of(cell, seed, family) for seed in seeds}
    compensated = _program(scratch / "compensated", files, job.program.encoding)
    tasks: list[tuple[tuple[int, str], Path]] = []
    for seed, truth in truths.items():
        tasks += [((seed, "nominal"), Path(program)), ((seed, "compensated"), compensated)]
        if exact:
            part = _saying(parts[_exact_part(seed)], PLANNING)
            tasks.append(
                ((seed, "exact"), _exact_program(job, slowed.path, cell, truth, scratch / f"exact-{seed}", part))
            )
    begin = time.perf_counter()
    records = _machine_all(tasks, cell_file, truths, workers, reading, parts)
    timing["machining"] = time.perf_counter() - begin
    begin = time.perf_counter()
    parts[JUDGING](0.0)
    reference = reference_of(job, cell)
    judged: dict[tuple[int, str], JudgedRun] = {}
    for key, record in records.items():
        judged[key] = judge(reference, record, record.stock, simulate.columns_of(record))
        parts[JUDGING](len(judged) / len(records))
    timing["judging"] = time.perf_counter() - begin
    results = [
        SeedResult(seed, level, {"nominal": judged[seed, "nominal"].variant, "compensated": judged[seed, name].variant})
        for level, name in _LEVELS
        for seed in truths
        if (seed, name) in judged
    ]
    about = {
        "job": "prove",
        "program": Path(job.program.name).name,
        "cell": cell.name,
        "robot": cell.chain.name,
        "family": family.name,
        "inputs": inputs | {"machined_sha256": digest(compensated)},
        "prediction": with_intervals(figures(plan, cell.chain.axes), plan, cell),
        "calm_feed": calm_feed(slowed, plan, cell),
        "written": written | {"warnings": [*written.get("warnings", ()), *unknown_stiffness(cell)]},
        **assumed(cell),
        **in_plane_of(cell),
        "seconds": {name: round(value, 2) for name, value in timing.items()},
        "counterflex": __version__,
    }
    progress(1.0)
    return ProofResult(reference, plan, truths, judged, files, with_files(summary(results, about), job.program), timing)


def run(
    program: str | Path,
    cell_file: str | Path,
    out: str | Path,
    *,
    seeds: Sequence[int] = (FIRST_SEED,),
    family: Family = MILD,
    exact: bool = True,
    assume_class: bool = False,
    workers: int | None = None,
    reading: Reading = AS_IT_IS,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Do the job on files.

    Writes ``original/`` and ``compensated/`` (the program before and after), ``plan.parquet``, for every seed
    ``truth-N.toml``, for the first seed ``nominal.parquet`` and ``compensated.parquet`` (path and force as machined)
    with the two height maps beside them, ``summary.json`` and ``report.html``; all of them or none.
    """
    from counterflex.app.proof.report import proof_page
    from counterflex.report.page import write_page

    with atomic.atomic_folder(out) as staging:
        proof = prove(
            program,
            cell_file,
            staging,
            seeds=seeds,
            family=family,
            exact=exact,
            assume_class=assume_class,
            workers=workers,
            reading=reading,
            progress=progress,
        )
        for folder in staging.glob("exact-*"):
            for file in folder.iterdir():
                file.unlink()
            folder.rmdir()
        (staging / "original").mkdir()
        for file in (Path(program), *companions(Path(program))):
            atomic.write_bytes(staging / "original" / file.name, file_content.content(file))
        simulate.keep_cell(read_cell(cell_file, assume_class=assume_class), staging)
        about = {key: proof.summary[key] for key in ("program", "cell", "robot", "counterflex")}
        about |= {CLASS_ASSUMED: True} if assume_class else {}
        about |= {key: proof.summary[key] for key in (WORKING_PLANE, TOOL_TURNS) if key in proof.summary}
        lowered = proof.summary["calm_feed"]
        write_plan(
            staging / "plan.parquet",
            proof.plan,
            {**about, "feed_lowered_s": lowered["extra_s"]},
            proof.reference.cell.chain.axes,
        )
        for seed, truth in proof.truths.items():
            write_truth(staging / f"truth-{seed}.toml", truth)
        for variant in ("nominal", "compensated"):
            item = proof.judged[proof.first_seed, variant]
            write_run(staging / f"{variant}.parquet", item.run, {**about, "seed": proof.first_seed, "variant": variant})
            simulate.save_part(item.actual, item.columns, staging, f"{variant}-")
        write_folder_summary(staging, proof.summary)
        write_page(proof_page(proof), staging / "report.html")
    return proof.summary


def _program(folder: Path, files: dict[str, str], encoding: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        atomic.write_bytes(folder / name, text.encode(encoding, errors="replace"))
    return folder / next(iter(files))


def _work(time_s: float, seeds: Sequence[int], tasks: int, workers: int, *, exact: bool) -> dict[str, float]:
    """Seconds that the parts of a proof take, for a program that takes ``time_s``; only their shares count."""
    first = {PLANNING: 1.0 + _PLANNING_S * time_s}
    exact_parts = {_exact_part(seed): 1.0 + 0.5 * _PLANNING_S * time_s for seed in seeds} if exact else {}
    starting = {STARTING: _START_S} if workers > 1 else {}
    return {
        **first,
        **exact_parts,
        **starting,
        MACHINING: 0.5 + _MACHINING_S * time_s * math.ceil(tasks / workers),
        JUDGING: 0.3 + _JUDGING_S * time_s * tasks,
    }


def _exact_part(seed: int) -> str:
    return f"{PLANNING}, seed {seed}"


def _exact_program(job: Job, path: ToolPath, cell: Cell, truth: Truth, folder: Path, progress: Progress) -> Path:
    """The program compensated with the truth's exact constants."""
    setting = exact_setting(job, cell, truth)
    plan = make_plan(path, job.line_of_motion, cell.stock(), setting, feeds=job.feeds, predict=False, progress=progress)
    return _program(folder, write(job, plan, cell, own_language(job.program))[0], job.program.encoding)


def _machine_one(
    program: Path,
    cell_file: Path,
    truth: Truth,
    reading: Reading,
    task: int,
    original: Path,
    progress: Progress | None = None,
) -> Record:
    report = progress
    if report is None:
        report = share(task)
        report(_BEGUN)
    cell = in_working_plane(original, read_cell(cell_file), reading)
    job = read_job(program, cell, reading=reading)
    return simulate.machine(job, cell, truth, progress=report)


def _planned(job: Job, cell: Cell, name: str, progress: Progress) -> tuple[Job, Plan]:
    """The job at the feeds that its modes allow, and its plan."""
    with faults_in(job):
        limited = limited_feed(job, cell, setting_of(cell, job, part_may_be_held=True))
        slowed = job if limited is None else replace(job, path=limited.path)
        plan = make_plan(
            slowed.path,
            job.line_of_motion,
            cell.stock(),
            setting_of(cell, job, orientation=job.words is not None, part_may_be_held=True),
            feeds=job.feeds,
            progress=progress,
        )
    if not plan.cutting.any():
        raise InputError(
            "the program removes no material from the blank",
            where=name,
            hint="Check the part frame, the blank and the program's zero",
        )
    return slowed, plan


def _report_all(parts: Mapping[str, Progress], shares: Shares, ended: int, count: int, begin: float) -> None:
    done = shares.sum([1.0] * count)
    if done > 0.0:
        parts[MACHINING](done, f"{MACHINING}, {ended} of {count} done")
    else:  # nothing tells how far a process is that starts but the time
        parts[STARTING](1.0 - math.exp((begin - time.monotonic()) / _START_S))


def _machine_all(
    tasks: list[tuple[tuple[int, str], Path]],
    cell_file: str | Path,
    truths: dict[int, Truth],
    workers: int | None,
    reading: Reading,
    parts: Mapping[str, Progress],
) -> dict[tuple[int, str], Record]:
    count, original = count_of(workers, len(tasks)), tasks[0][1]
    records: dict[tuple[int, str], Record] = {}
    if count == 1:
        named = in_parts(parts[MACHINING], {f"{MACHINING}, seed {key[0]}, {key[1]}": 1.0 for key, _ in tasks})
        for i, ((key, path), (name, part)) in enumerate(zip(tasks, named.items(), strict=True)):
            records[key] = _machine_one(
                path, Path(cell_file), truths[key[0]], reading, i, original, _saying(part, name)
            )
        return records
    shares, begin = Shares(len(tasks)), time.monotonic()
    with pool_of(count, shares) as pool:
        with interrupts_deferred():
            waiting = {
                pool.submit(_machine_one, path, Path(cell_file), truths[key[0]], reading, i, original): key
                for i, (key, path) in enumerate(tasks)
            }
        for done in done_one_by_one(waiting, lambda: _report_all(parts, shares, len(records), len(tasks), begin)):
            records[waiting[done]] = done.result()
    return {key: records[key] for key, _ in tasks}


def _saying(progress: Progress, what: str) -> Progress:
    return lambda fraction, _="": progress(fraction, what)

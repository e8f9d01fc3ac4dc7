"""The whole main job, proven: compensate a program, machine it before and after on simulated cells, judge, report.

For every truth seed the original and the compensated program are machined on the same simulated cell. The planner knows
the cell file only (truth level ``seeded``). As a second figure the program is compensated again by a planner that was
told the truth's constants (truth level ``same``): what then remains is the error of the method, not of the model.
"""

from __future__ import annotations

import concurrent.futures
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from counterflex import __version__
from counterflex.app import simulate
from counterflex.app.compensate import write
from counterflex.app.evaluate import Judged, Reference, judge, reference_of
from counterflex.app.inputs import Job, faults_in, read_job, setting_of
from counterflex.app.prediction import figures
from counterflex.app.truth import knowing, truth_of
from counterflex.app.workers import count_of, interrupts_held, pool_of
from counterflex.core import atomic
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.evaluate.summary import SeedResult, TruthLevel, summary
from counterflex.files.cell import Cell, read_cell
from counterflex.files.plan_file import write_plan
from counterflex.files.run_file import Run, write_run
from counterflex.files.summary_file import write_summary
from counterflex.plan.compensate import plan as make_plan
from counterflex.plan.plan import Plan
from counterflex.twin.record import Record
from counterflex.twin.truth import Truth
from counterflex.twin.truth_file import write_truth

FIRST_SEED = 1
_LEVELS: tuple[tuple[TruthLevel, str], ...] = (("seeded", "compensated"), ("same", "told"))


@dataclass(frozen=True, eq=False)
class Proof:
    """What the job found.

    Attributes:
        reference: Original program, cell, undisturbed part.
        plan: What the planner decided, knowing the cell file.
        truths: By seed.
        judged: By (seed, variant): ``nominal``, ``compensated``, ``told`` (planner told the truth's constants).
        program_files: Compensated program.
        summary: What ``summary.json`` holds.
        timing: Seconds per step.
    """

    reference: Reference
    plan: Plan
    truths: dict[int, Truth]
    judged: dict[tuple[int, str], Judged]
    program_files: dict[str, str]
    summary: dict[str, Any]
    timing: dict[str, float]


def prove(
    program: str | Path,
    cell_file: str | Path,
    scratch: Path,
    *,
    seeds: int = 1,
    told: bool = True,
    workers: int | None = None,
    progress: Progress = silent,
) -> Proof:
    """Compensate, machine, judge.

    Args:
        program: G-code file.
        cell_file: Cell file: all the planner knows.
        scratch: Folder for programs handed to the simulated cells.
        seeds: Number of truth seeds, from 1 on.
        told: Also machine what a planner told the truth's constants would command.
        workers: Processes; None is one per core.
        progress: Told the fraction done.

    Raises:
        InputError: There are no seeds, or the program removes nothing.
        CounterflexError: As the jobs it consists of.
    """
    if seeds < 1:
        raise InputError("number of truth seeds is out of range", value=seeds, limit=">= 1")
    cell = read_cell(cell_file)
    job = read_job(program, cell)
    begin = time.perf_counter()
    progress(0.0, "planning")
    with faults_in(job):
        plan = make_plan(
            job.path, job.line_of_motion, cell.stock(), setting_of(cell), progress=_shifted(progress, 0.0, 0.1)
        )
    if not plan.cutting.any():
        raise InputError(
            "the program removes nothing from the blank: there is nothing to prove",
            where=Path(program).name,
            hint="Check the part frame, the blank and the program's zero",
        )
    files, written = write(job, plan, cell, "gcode")
    timing = {"planning": time.perf_counter() - begin}
    truths = {seed: truth_of(cell, seed) for seed in range(FIRST_SEED, FIRST_SEED + seeds)}
    compensated = _program(scratch / "compensated", files, job.program.encoding)
    tasks: list[tuple[tuple[int, str], Path]] = []
    for seed, truth in truths.items():
        tasks += [((seed, "nominal"), Path(program)), ((seed, "compensated"), compensated)]
        if told:
            tasks.append(((seed, "told"), _told_program(job, cell, truth, scratch / f"told-{seed}")))
    begin = time.perf_counter()
    records = _machine_all(tasks, cell_file, truths, workers, _shifted(progress, 0.1, 0.8))
    timing["machining"] = time.perf_counter() - begin
    begin = time.perf_counter()
    progress(0.9, "judging")
    reference = reference_of(job, cell)
    judged = {key: judge(reference, _as_run(record), record.stock) for key, record in records.items()}
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
        "prediction": figures(plan),
        "written": written,
        "seconds": {name: round(value, 2) for name, value in timing.items()},
        "counterflex": __version__,
    }
    progress(1.0)
    return Proof(reference, plan, truths, judged, files, summary(results, about), timing)


def run(
    program: str | Path,
    cell_file: str | Path,
    out: str | Path,
    *,
    seeds: int = 1,
    told: bool = True,
    workers: int | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Do the job on files.

    Writes ``original/`` and ``compensated/`` (the program before and after), ``plan.parquet``, for every seed
    ``truth-N.toml``, for the first seed ``nominal.parquet`` and ``compensated.parquet`` (path and force as machined)
    with the two height maps beside them, ``summary.json`` and ``report.html``; all of them or none.

    Returns:
        The summary.
    """
    from counterflex.app.report import proof_page
    from counterflex.report.page import write_page

    with atomic.atomic_folder(out) as staging:
        proof = prove(program, cell_file, staging, seeds=seeds, told=told, workers=workers, progress=progress)
        for folder in staging.glob("told-*"):
            for file in folder.iterdir():
                file.unlink()
            folder.rmdir()
        name = Path(program).name
        (staging / "original").mkdir()
        atomic.write_bytes(staging / "original" / name, Path(program).read_bytes())
        atomic.write_bytes(staging / "cell.toml", Path(cell_file).read_bytes())
        about = {key: proof.summary[key] for key in ("program", "cell", "robot", "counterflex")}
        write_plan(staging / "plan.parquet", proof.plan, about)
        for seed, truth in proof.truths.items():
            write_truth(staging / f"truth-{seed}.toml", truth)
        for variant in ("nominal", "compensated"):
            item = proof.judged[FIRST_SEED, variant]
            write_run(staging / f"{variant}.parquet", item.run, {**about, "seed": FIRST_SEED, "variant": variant})
            item.actual.save(staging / f"{variant}-surface.npz")
        write_summary(staging / "summary.json", proof.summary)
        write_page(proof_page(proof), staging / "report.html")
    return proof.summary


def _program(folder: Path, files: dict[str, str], encoding: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        atomic.write_bytes(folder / name, text.encode(encoding, errors="replace"))
    return folder / next(iter(files))


def _told_program(job: Job, cell: Cell, truth: Truth, folder: Path) -> Path:
    """The program compensated by a planner that was told the truth's constants."""
    chain, law = knowing(cell, truth)
    plan = make_plan(job.path, job.line_of_motion, cell.stock(), setting_of(cell, chain=chain, law=law), predict=False)
    return _program(folder, write(job, plan, cell, "gcode")[0], job.program.encoding)


def _machine_one(program: Path, cell_file: Path, truth: Truth) -> Record:
    cell = read_cell(cell_file)
    return simulate.machine(read_job(program, cell), cell, truth)


def _machine_all(
    tasks: list[tuple[tuple[int, str], Path]],
    cell_file: str | Path,
    truths: dict[int, Truth],
    workers: int | None,
    progress: Progress,
) -> dict[tuple[int, str], Record]:
    count = count_of(workers, len(tasks))
    records: dict[tuple[int, str], Record] = {}
    if count == 1:
        for i, (key, path) in enumerate(tasks):
            progress(i / len(tasks), f"machining, seed {key[0]}, {key[1]}")
            records[key] = _machine_one(path, Path(cell_file), truths[key[0]])
        return records
    with pool_of(count) as pool:
        with interrupts_held():
            waiting = {pool.submit(_machine_one, path, Path(cell_file), truths[key[0]]): key for key, path in tasks}
        for done in concurrent.futures.as_completed(waiting):
            records[waiting[done]] = done.result()
            progress(len(records) / len(tasks), f"machined {len(records)} of {len(tasks)}")
    return {key: records[key] for key, _ in tasks}


def _shifted(progress: Progress, begin: float, length: float) -> Callable[..., None]:
    return lambda fraction, what="": progress(begin + length * fraction, what)


def _as_run(record: Record) -> Run:
    return Run(**{name: getattr(record, name) for name in Run.__dataclass_fields__})

"""Capacity of a campaign: tasks an hour on this machine, what a task costs the job, and what 100 machines would do.

Usage: ``python benchmarks/campaign_capacity.py [--quick] [--seeds N] [--json]``. Costs are processor time, so that
other work on the machine counts little; wall time stands beside them. The extrapolation assumes as many tasks ready as
there are cores, cores like these, and a core for job and scheduler: it is the smaller of what the cores do and what the
job can hand out.

Without ``--quick`` a worker is killed in the middle of a campaign, then the job itself (SIGKILL); the same command then
goes on, and its table must be that of the campaign that nobody disturbed.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import polars

from counterflex.app.campaign import campaign
from counterflex.app.campaign.axes import Grid, Placement
from counterflex.app.campaign.campaign import FILE
from counterflex.app.long_jobs.cluster import cluster
from counterflex.app.long_jobs.executors import Executor
from counterflex.app.long_jobs.step_cache import DONE
from counterflex.app.long_jobs.task import Reads, Task, Writes
from counterflex.app.long_jobs.task_graph import run_tasks
from counterflex.app.long_jobs.workers import Shares
from counterflex.core.progress import Progress, silent
from seeds_option import seeds_of

ROOT = Path(__file__).resolve().parents[1]
CELL, PROGRAM = ROOT / "examples/cells/kr300_d16_small.toml", ROOT / "examples/programs/groove.ngc"
READ_BYTES, WRITTEN_BYTES = 20_000, 200_000
"""Of a task that does nothing: a program, a cell and a truth; what a recipe writes."""


class Job(NamedTuple):
    """Job of a campaign."""

    cell: Path
    program: Path
    places: Sequence[Placement]


WHOLE = Job(CELL, PROGRAM, (Placement("near", {"x_mm": 1250.0}), Placement("far", {"x_mm": 1500.0})))
MACHINES, CORES = 100, 16
_DIES_AFTER = 3


def nothing(source: str, folder: str) -> dict[str, int]:
    (Path(folder) / "out").write_bytes(os.urandom(WRITTEN_BYTES))
    return {"read": len(Path(source).read_bytes())}


def timed(job: Callable[[], None]) -> dict[str, float]:
    """Wall time, and processor time of this process and of the workers that ended, s."""
    wall, own = time.perf_counter(), time.process_time()
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    job()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    workers = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"wall_s": time.perf_counter() - wall, "job_s": time.process_time() - own, "workers_s": workers}


def overhead(count: int, folder: Path) -> dict[str, float]:
    """Cost of tasks that do nothing, s for each; start and end of the workers apart."""
    (folder / "in").write_bytes(os.urandom(READ_BYTES))
    tasks = [
        Task(f"{k}", "", nothing, (Reads(str(folder / "in")), Writes(str(folder / f"{k}")))) for k in range(count + 2)
    ]

    def run(chosen: list[Task], executor: Executor) -> None:
        run_tasks(chosen, 1, silent, start=lambda *_: contextlib.nullcontext(executor))

    begin = time.perf_counter()
    with cluster(folder, count=2)(Shares(1), lambda: None) as executor:
        run(tasks[:2], executor)
        ready = time.perf_counter()
        cost = timed(lambda: run(tasks[2:], executor))
        over = time.perf_counter()
    end = time.perf_counter()
    return {
        "start_wall_s": ready - begin + end - over,
        "task_wall_s": cost["wall_s"] / count,
        "task_job_s": cost["job_s"] / count,
    }


def campaign_of(
    out: Path, seeds: Sequence[int], workers: int | str | None = 2, progress: Progress = silent, job: Job = WHOLE
) -> None:
    grid = Grid([job.program], job.places, ["present"])
    campaign.run(job.cell, out, grid=grid, seeds=seeds, recipes=[], workers=workers, progress=progress)


def small(folder: Path) -> Job:
    """A smoke test: the first 8 mm of the groove in a coarse blank, at one placement."""
    texts = {
        "cell.toml": CELL.read_text(encoding="utf-8").replace("cell_mm = 0.2", "cell_mm = 1.0"),
        "start.ngc": PROGRAM.read_text(encoding="utf-8").replace("G1 X72 F1500", "G1 X0 F1500"),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return Job(folder / "cell.toml", folder / "start.ngc", WHOLE.places[:1])


def capacity(seeds: Sequence[int], out: Path, job: Job) -> dict[str, float]:
    """Tasks of a campaign: groove.ngc at two placements, planned and machined."""
    cost = timed(lambda: campaign_of(out, seeds, job=job))
    tasks = len(list(out.rglob(DONE)))
    return {"tasks": tasks, **cost, "task_workers_s": cost["workers_s"] / tasks, "task_job_s": cost["job_s"] / tasks}


def extrapolated(task_s: float, job_s: float) -> dict[str, float]:
    """Tasks an hour of MACHINES machines: what their cores do, and what one job can hand out."""
    cores, job = MACHINES * CORES * 3600.0 / task_s, 3600.0 / job_s
    return {"cores_per_hour": cores, "job_per_hour": job, "per_hour": min(cores, job)}


def killed(out: Path, seeds: Sequence[int], undisturbed: Path) -> dict[str, Any]:
    """Kill a worker, then the job; go on; compare."""
    from distributed import Client, LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0") as running:
        address = running.scheduler_address
        with Client(address, set_as_default=False) as client:
            child = subprocess.Popen(
                [sys.executable, __file__, "--dies", address, str(out), ",".join(f"{n}-{n}" for n in seeds)]
            )
            while not list(out.rglob(DONE)):
                time.sleep(0.05)
            os.kill(next(iter(client.run(os.getpid).values())), signal.SIGKILL)
            child.wait()
            stored = {file: file.stat().st_mtime_ns for file in out.rglob(DONE) if "found" in file.read_text()}
        campaign_of(out, seeds, address)
    again = [file for file, at_ns in stored.items() if file.stat().st_mtime_ns != at_ns]
    same = polars.read_parquet(out / FILE).equals(polars.read_parquet(undisturbed / FILE))
    return {"job_ended_by": child.returncode, "stored": len(stored), "made_again": len(again), "same_table": same}


def dies(address: str, out: Path, seeds: Sequence[int]) -> None:
    """The job that is killed: after three results."""

    def report(fraction: float, what: str = "") -> None:  # noqa: ARG001
        if sum("found" in file.read_text() for file in out.rglob(DONE)) >= _DIES_AFTER:
            os.kill(os.getpid(), signal.SIGKILL)

    campaign_of(out, seeds, address, report)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few tasks, nobody is killed: a smoke test")
    parser.add_argument("--seeds", type=seeds_of, default="3", help="simulated cells")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--dies", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.dies:
        dies(options.dies[0], Path(options.dies[1]), seeds_of(options.dies[2]))
        return
    seeds = [1] if options.quick else options.seeds
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        figures: dict[str, Any] = {"overhead": overhead(20 if options.quick else 200, place)}
        job = small(place) if options.quick else WHOLE
        figures["campaign"] = capacity(seeds, place / "undisturbed", job)
        figures["machines"] = extrapolated(figures["campaign"]["task_workers_s"], figures["overhead"]["task_job_s"])
        if not options.quick:
            figures["killed"] = killed(place / "killed", seeds, place / "undisturbed")
    if options.json:
        print(json.dumps(figures, indent=2))
        return
    empty, whole, many = figures["overhead"], figures["campaign"], figures["machines"]
    print(f"start and end of two workers      {empty['start_wall_s']:8.2f} s wall")
    print(
        f"a task that does nothing          {1e3 * empty['task_wall_s']:8.1f} ms wall, "
        f"{1e3 * empty['task_job_s']:.1f} ms CPU of job and scheduler"
    )
    print(
        f"campaign, {whole['tasks']:.0f} tasks on two workers  {whole['wall_s']:8.1f} s wall; "
        f"{whole['task_workers_s']:.2f} s CPU a task, start included: {3600.0 / whole['task_workers_s']:.0f} tasks an "
        "hour and core"
    )
    print(
        f"{MACHINES} machines of {CORES} cores          {many['per_hour']:8.0f} tasks an hour: the cores could do "
        f"{many['cores_per_hour']:.0f}, one job hands out {many['job_per_hour']:.0f}"
    )
    if "killed" in figures:
        end = figures["killed"]
        print(
            f"worker and job killed             {end['stored']:8d} results stored, {end['made_again']} made again, "
            f"table the same: {end['same_table']}"
        )
        if end["made_again"] or not end["same_table"] or end["job_ended_by"] != -signal.SIGKILL:
            sys.exit("a result was lost or made again")


if __name__ == "__main__":
    main()

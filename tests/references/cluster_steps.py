"""Tasks for tests of the cluster, and a job that is killed after some results."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from counterflex.app.long_jobs.cluster import cluster
from counterflex.app.long_jobs.step_cache import DONE
from counterflex.app.long_jobs.task import Reads, Task, Writes
from counterflex.app.long_jobs.task_graph import run_tasks
from counterflex.core.errors import ReachError
from counterflex.core.progress import Progress, silent

COUNT = 8
KILLS = 2
"""Number of the task whose worker is killed."""
DIES_AFTER = 4
"""Results after which the job is killed."""


def copied(source: str, folder: str, k: int, log: str, *, progress: Progress = silent) -> dict[str, int]:
    """Copy a file with a number behind it; on its first try number 2 kills its own worker."""
    progress(0.5)
    if k == KILLS and not Path(f"{log}.killed").exists():
        Path(f"{log}.killed").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    with Path(log).open("a", encoding="ascii") as stream:
        stream.write(f"{k}\n")
    text = Path(source).read_text(encoding="ascii")
    (Path(folder) / "copy.txt").write_text(f"{text}{k}", encoding="ascii")
    return {"k": k}


def joined(folder: str, *sources: str) -> dict[str, str]:
    """The texts of all copies."""
    texts = [Path(source, "copy.txt").read_text(encoding="ascii") for source in sources]
    (Path(folder) / "all.txt").write_text(" ".join(texts), encoding="ascii")
    return {"all": " ".join(texts)}


def unreachable(source: str) -> None:
    """Raise what a job may raise."""
    raise ReachError("out of reach", where=f"{source}:3", value=1.5, limit="<= 1", hint="Move the part")


def broken() -> float:
    """Raise what no job may raise."""
    return 1.0 / 0.0


def named(name: str) -> dict[str, str]:
    """Its own name."""
    return {"name": name}


def settings() -> dict[str, object]:
    """What a worker process of this machine is told."""
    return {"ctrl_c": signal.getsignal(signal.SIGINT) == signal.SIG_IGN, "threads": os.environ["OPENBLAS_NUM_THREADS"]}


def tasks_in(root: Path, log: Path) -> list[Task]:
    """Eight copies, and one that joins them."""
    copies = [
        Task(
            f"copy {k}",
            f"copy {k}",
            copied,
            (Reads(str(root / "in.txt")), Writes(str(root / f"copy-{k}")), k, str(log)),
            tells=True,
        )
        for k in range(COUNT)
    ]
    arguments = (Writes(str(root / "all")), *(Reads(str(root / f"copy-{k}")) for k in range(COUNT)))
    return [*copies, Task("all", "all", joined, arguments, tuple(task.name for task in copies))]


def main(address: str, folder: str, log: str) -> None:
    """Run the tasks on a scheduler, and die silently."""
    root = Path(folder)

    def dies(fraction: float, what: str = "") -> None:
        if len(list(root.glob(f"*/{DONE}"))) >= DIES_AFTER:
            os.kill(os.getpid(), signal.SIGKILL)

    run_tasks(tasks_in(root, Path(log)), 1, dies, start=cluster(root, scheduler=address))

"""A job on a cluster: workers and the job itself are killed, and no result is lost or there twice."""

from __future__ import annotations

import contextlib
import logging
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import cluster_steps as steps
from counterflex.app.long_jobs.cluster import cluster
from counterflex.app.long_jobs.executors import Executor
from counterflex.app.long_jobs.scheduler import open_to_others, require_scheduler, require_scheduler_address
from counterflex.app.long_jobs.step_cache import DONE
from counterflex.app.long_jobs.task import Failed, Reads, Task
from counterflex.app.long_jobs.task_graph import run_tasks
from counterflex.app.long_jobs.workers import Shares
from counterflex.core.errors import InputError
from counterflex.core.progress import silent


class Noting:
    """An executor that notes what it is given."""

    def __init__(self, executor: Executor, given: list[str]) -> None:
        self.slots, self.ended, self._submit, self._given = executor.slots, executor.ended, executor.submit, given

    def submit(self, place: int, task: Task) -> None:
        self._given.append(task.name)
        self._submit(place, task)


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """A scheduler that outlives its clients, with two workers."""
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=logging.CRITICAL
    ) as running:
        yield str(running.scheduler_address)


@pytest.mark.long
def test_a_killed_worker_and_a_killed_job_cost_no_result(scheduler: str, tmp_path: Path) -> None:
    root, log = tmp_path / "job", tmp_path / "log"
    root.mkdir()
    (root / "in.txt").write_text("x", encoding="ascii")
    job = f"import sys; sys.path[:] = {sys.path!r}; import cluster_steps; cluster_steps.main(*sys.argv[1:])"
    ended = subprocess.run([sys.executable, "-c", job, scheduler, str(root), str(log)])
    assert ended.returncode == -signal.SIGKILL
    stored = {file.parent.name.replace("-", " ") for file in root.glob(f"copy-*/{DONE}")}
    assert len(stored) == steps.DIES_AFTER

    shares: list[float] = []
    given: list[str] = []

    def report(fraction: float, what: str = "") -> None:
        shares.append(fraction)

    @contextlib.contextmanager
    def noted(told: Shares, tell: Callable[[], None]) -> Iterator[Executor]:
        with cluster(root, scheduler=scheduler)(told, tell) as executor:
            yield Noting(executor, given)

    tasks = steps.tasks_in(root, log)
    results = run_tasks(tasks, 1, report, start=noted)
    everything = " ".join(f"x{k}" for k in range(steps.COUNT))
    assert results == {"all": {"all": everything}, **{f"copy {k}": {"k": k} for k in range(steps.COUNT)}}
    assert (root / "all" / "all.txt").read_text(encoding="ascii") == everything
    assert log.with_name("log.killed").exists()  # a worker was lost on the way
    assert sorted(given) == sorted({task.name for task in tasks} - stored)  # each once, and what was stored not again
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_faults_come_back_and_the_others_go_on(scheduler: str, tmp_path: Path) -> None:
    file = tmp_path / "in.txt"
    file.touch()
    tasks = [
        Task("far", "", steps.unreachable, (Reads(str(file)),)),
        Task("waits", "", steps.unreachable, (Reads(str(file)),), ("far",)),
        Task("near", "", len, ("abc",)),
    ]
    results = run_tasks(tasks, 1, silent, start=cluster(tmp_path, scheduler=scheduler), keep_going=True)
    said = f"{file}:3: out of reach; got 1.5; expected <= 1. Move the part"
    assert results == {"far": Failed(said), "waits": Failed(said), "near": 3}
    with pytest.raises(RuntimeError, match="division by zero"):
        run_tasks([Task("x", "", steps.broken)], 1, silent, start=cluster(tmp_path, scheduler=scheduler))


def test_the_same_workers_do_a_second_job(scheduler: str, tmp_path: Path) -> None:
    """Places count from zero again: what they gave before must not be taken for the new results."""
    with cluster(tmp_path, scheduler=scheduler)(Shares(1), lambda: None) as executor:

        def start(*_: Any) -> contextlib.AbstractContextManager[Executor]:
            return contextlib.nullcontext(executor)

        for job in range(6):
            tasks = [Task(f"{job}-{k}", "", steps.named, (f"{job}-{k}",)) for k in range(4)]
            results = run_tasks(tasks, 1, silent, start=start)
            assert results == {task.name: {"name": task.name} for task in tasks}


def test_workers_of_this_machine_leave_ctrl_c_to_the_job(tmp_path: Path) -> None:
    results = run_tasks([Task("x", "", steps.settings)], 1, silent, start=cluster(tmp_path))
    assert results["x"] == {"ctrl_c": True, "threads": "1"}


def test_nobody_listens() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(InputError, match="no scheduler answers there.*refused") as fault:
        require_scheduler(f"127.0.0.1:{port}")
    assert f"tcp://127.0.0.1:{port}" in str(fault.value)
    assert "dask scheduler" in str(fault.value)


@pytest.mark.parametrize(
    "address", ["", "host", "host:", "host:port", "host:99999", "http://host:80", "tcp://host:1/x", "inproc://a:1"]
)
def test_what_is_no_address(address: str) -> None:
    with pytest.raises(InputError, match="no address of a scheduler"):
        require_scheduler_address(address)


def test_who_is_warned() -> None:
    assert require_scheduler_address("10.0.0.1:8786") == "tcp://10.0.0.1:8786"
    assert "no keys" in open_to_others("tcp://10.0.0.1:8786")
    assert "no keys" in open_to_others("tcp://cluster.example:8786")
    for address in ("tls://10.0.0.1:8786", "tcp://127.0.0.1:8786", "tcp://localhost:8786", "tcp://[::1]:8786"):
        assert open_to_others(address) == ""

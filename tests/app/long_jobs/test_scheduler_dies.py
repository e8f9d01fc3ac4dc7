"""A scheduler of another process, reached with keys: it dies in the middle of a job, and a new one goes on."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import sysconfig
from collections.abc import Callable, Iterator
from pathlib import Path

import dask.config
import pytest
from distributed.security import Security

import cluster_steps as steps
from counterflex.app.long_jobs.cluster import cluster
from counterflex.app.long_jobs.scheduler import connected
from counterflex.app.long_jobs.step_cache import DONE
from counterflex.app.long_jobs.task_graph import run_tasks
from counterflex.core.errors import InputError, SimulationError
from counterflex.core.progress import silent

DASK = Path(sysconfig.get_path("scripts")) / "dask"
DIES_AFTER = 3


def _keys(folder: Path) -> dict[str, str]:
    """Configuration of TLS with an authority made for this test."""
    made = Security.temporary()
    files = {"ca": made.tls_ca_file, "cert": made.tls_worker_cert, "key": made.tls_worker_key}
    for name, content in files.items():
        (folder / f"{name}.pem").write_text(str(content), encoding="ascii")
    roles = {
        f"distributed.comm.tls.{role}.{name}": str(folder / f"{name}.pem")
        for role in ("scheduler", "worker", "client")
        for name in ("cert", "key")
    }
    return {"distributed.comm.tls.ca-file": str(folder / "ca.pem"), **roles}


@contextlib.contextmanager
def _process(keys: dict[str, str], *words: str) -> Iterator[subprocess.Popen[bytes]]:
    told = {"DASK_" + key.upper().replace(".", "__").replace("-", "_"): value for key, value in keys.items()}
    paths = os.pathsep.join(path for path in sys.path if path)
    process = subprocess.Popen(
        [DASK, *words],
        env={**os.environ, **told, "PYTHONPATH": paths},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@contextlib.contextmanager
def _cluster(keys: dict[str, str], port: int) -> Iterator[tuple[str, Callable[[], None]]]:
    """A scheduler and one worker as processes of their own; its address, and what kills the scheduler."""
    address = f"tls://127.0.0.1:{port}"
    served = ("--host", "tls://127.0.0.1", "--port", str(port), "--no-dashboard")
    with (
        _process(keys, "scheduler", *served) as first,
        _process(keys, "worker", address, "--nthreads", "1", "--no-dashboard", "--no-nanny"),
    ):
        yield address, first.kill


def _connected(address: str) -> None:
    """Wait until the scheduler listens."""
    while True:
        with contextlib.suppress(InputError), connected(address) as client:
            client.wait_for_workers(1)
            return


@pytest.mark.long
def test_a_scheduler_that_dies_costs_no_result(tmp_path: Path) -> None:
    root, log, mine, other = (tmp_path / name for name in ("job", "log", "mine", "other"))
    for folder in (root, mine, other):
        folder.mkdir()
    (root / "in.txt").write_text("x", encoding="ascii")
    log.with_name("log.killed").touch()  # no worker is killed in this test
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    keys = _keys(mine)
    tasks = steps.tasks_in(root, log)
    with dask.config.set(keys):
        with _cluster(keys, port) as (address, kill):
            _connected(address)

            def dies(fraction: float, what: str = "") -> None:
                if len(list(root.glob(f"*/{DONE}"))) >= DIES_AFTER:
                    kill()

            with pytest.raises(SimulationError, match="the scheduler has gone") as fault:
                run_tasks(tasks, 1, dies, start=cluster(root, scheduler=address))
            assert "the same command continues" in str(fault.value)
        stored = {file.parent.name.replace("-", " ") for file in root.glob(f"*/{DONE}")}
        assert DIES_AFTER <= len(stored) < len(tasks)
        with _cluster(keys, port) as (address, _):
            _connected(address)
            results = run_tasks(tasks, 1, silent, start=cluster(root, scheduler=address))
            with dask.config.set(_keys(other)), pytest.raises(InputError, match="keys"):
                connected(address)
    assert results["all"] == {"all": " ".join(f"x{k}" for k in range(steps.COUNT))}
    done = log.read_text(encoding="ascii").split()
    assert set(done) == {str(k) for k in range(steps.COUNT)}
    assert all(done.count(name.removeprefix("copy ")) == 1 for name in stored if name != "all")

"""Worker processes: one thread of linear algebra each, as many as there is work for, the job's own settings kept."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from counterflex.app.long_jobs.workers import MOST, ONE_THREAD, Shares, count_of, done_one_by_one, pool_of, share


def settings() -> dict[str, str | None]:
    return {name: os.environ.get(name) for name in ONE_THREAD}


def test_workers_have_one_thread_and_the_job_keeps_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(ONE_THREAD[0], "7")
    monkeypatch.delenv(ONE_THREAD[1], raising=False)
    with pool_of(1) as pool:
        assert pool.submit(settings).result() == dict.fromkeys(ONE_THREAD, "1")
    assert os.environ[ONE_THREAD[0]] == "7"
    assert ONE_THREAD[1] not in os.environ


def test_a_fault_ends_the_workers_and_restores_the_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(ONE_THREAD[0], raising=False)
    with pytest.raises(ValueError, match="stop"), pool_of(1) as pool:
        pool.submit(settings).result()
        raise ValueError("stop")
    assert ONE_THREAD[0] not in os.environ


_JOB = """
import os, sys, time
from counterflex.app.long_jobs.workers import pool_of
with pool_of(2) as pool:
    pool.submit(os.getpid).result()
    for _ in range(4):
        pool.submit(time.sleep, 1e6)
    print("works", flush=True)
    time.sleep(1e6)
"""


@pytest.mark.parametrize("way", [signal.SIGTERM, signal.SIGKILL])
def test_workers_end_with_the_job_however_it_ends(way: signal.Signals) -> None:
    """All processes of the job hold its output; it is at its end only when the last of them has gone."""
    job = subprocess.Popen([sys.executable, "-c", _JOB], stdout=subprocess.PIPE)
    assert job.stdout is not None
    assert job.stdout.readline() == b"works\n"
    job.send_signal(way)
    rest, _ = job.communicate(timeout=60)
    assert rest == b""
    assert job.returncode == -way


def test_number_of_workers() -> None:
    assert count_of(None, 1) == 1
    assert count_of(8, 3) == 3
    assert count_of(500, 1000) == MOST
    assert count_of(2, 0) == 1
    assert 1 <= count_of(None, 1000) <= MOST


def half_done(task: int) -> float:
    share(task)(0.5)
    share(task)(0.25)
    return 0.5


def test_workers_tell_how_much_of_their_task_is_done() -> None:
    shares, seen = Shares(2), []
    with pool_of(1, shares) as pool:
        waiting = [pool.submit(half_done, task) for task in range(2)]
        for done in done_one_by_one(waiting, lambda: seen.append(shares.sum([1.0, 3.0]))):
            assert done.result() == 0.5
    assert shares.sum([1.0, 3.0]) == 0.5  # it never falls
    assert seen == sorted(seen)
    share(0)(1.0)  # outside a worker nobody listens


def test_a_task_that_counts_more_moves_more() -> None:
    shares = Shares(2)
    shares.of(1)(1.0)
    assert shares.sum([1.0, 3.0]) == 0.75

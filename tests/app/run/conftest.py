"""Runs over sockets start many processes: these are forks of one that has imported what they need."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator
from typing import Any

import pytest

FROM_NOTHING = ("test_process_start", "test_run_lost", "test_recorder_stands")
"""Tests of how processes start and end: each of theirs begins as one of a run does."""


@pytest.fixture(autouse=True, scope="module")
def forked(request: pytest.FixtureRequest) -> Iterator[None]:
    """Processes of a run, and that of the simulated cell, are forked from one that waits with all of it imported."""
    name = request.module.__name__.rpartition(".")[2]
    if name in FROM_NOTHING or "forkserver" not in multiprocessing.get_all_start_methods():
        yield
        return
    genuine = multiprocessing.get_context
    forks = genuine("forkserver")
    forks.set_forkserver_preload(["loaded_run"])

    def context(method: str | None = None) -> Any:
        return forks if method == "spawn" else genuine(method)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(multiprocessing, "get_context", context)
        yield

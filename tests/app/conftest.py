"""Shared by the tests of the jobs: the small cell, a rigid one, programs, processes that are forks."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator
from multiprocessing import forkserver
from pathlib import Path
from typing import Any

import pytest

CELLS = Path(__file__).resolve().parents[1] / "data" / "cells"
REFERENCES = str(Path(__file__).resolve().parents[1] / "references")
FORKED = ("run", "panel", "opcua")
"""Folders of tests whose loops run over sockets."""
FROM_NOTHING = ("test_process_start", "test_recorder_stands")
"""Tests of how processes start and end: each of theirs begins as one of a run does."""
GROOVE = "G21 G17 G90\nM6 T1\nM3 S13000\nG0 Z60\nG0 X-12 Y15\nG0 Z36\nG1 X52 F1500\nG0 Z60\nM5\nM2\n"

ProgramFile = Callable[..., Path]


@pytest.fixture(scope="session")
def small() -> Path:
    """A robot that bends."""
    return CELLS / "small.toml"


@pytest.fixture(scope="session")
def stiff() -> Path:
    """A robot that does not."""
    return CELLS / "rigid.toml"


@pytest.fixture
def program(tmp_path: Path) -> ProgramFile:
    def write(text: str = GROOVE, name: str = "part.ngc") -> Path:
        file = tmp_path / "source" / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(text, encoding="ascii", newline="")
        return file

    return write


@pytest.fixture(autouse=True, scope="module")
def forked(request: pytest.FixtureRequest) -> Iterator[None]:
    """Processes of a run, and that of the simulated cell, are forked from one that waits with all of it imported."""
    loops = request.path.parent.name in FORKED and request.path.stem not in FROM_NOTHING
    if not loops or "forkserver" not in multiprocessing.get_all_start_methods():
        yield
        return
    genuine = multiprocessing.get_context
    forks = genuine("forkserver")

    def context(method: str | None = None) -> Any:
        if method not in ("spawn", "forkserver"):
            return genuine(method)
        with pytest.MonkeyPatch.context() as patched:
            patched.setenv(
                "PYTHONPATH", REFERENCES
            )  # Python 3.11 preloads what it finds by this alone, and tells nobody
            forks.set_forkserver_preload(["loaded_run"])
            forkserver.ensure_running()
        return forks

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(multiprocessing, "get_context", context)
        yield

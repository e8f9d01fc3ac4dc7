"""Folders that are read only: the first worker of a run of the suite makes them, the others wait for it."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

try:
    import fcntl
except ImportError:  # each worker makes its own
    fcntl = None  # type: ignore[assignment]


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], None]) -> Path:
    """Return a folder of this run of the suite; ``make`` fills it once."""
    root = factory.getbasetemp()
    if fcntl is None:
        make(folder := factory.mktemp(name))
        return folder
    if "PYTEST_XDIST_WORKER" in os.environ:
        root = root.parent
    folder, done = root / name, root / f"{name}.done"
    with (root / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # freed when the file is closed, or its process dies
        if not done.exists():
            folder.mkdir()
            make(folder)
            done.touch()
    return folder

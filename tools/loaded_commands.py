"""Run the console script in a process that has the libraries loaded already: a fork of one that waits for nothing else.

Importing takes a command one to three seconds of processor time, and the docs print two hundred of them. Each still
runs in a process of its own that begins with no state of another one: same script, words, folder and environment.
"""

from __future__ import annotations

import atexit
import importlib
import importlib.abc
import multiprocessing
import os
import pkgutil
import runpy
import sys
import threading
from collections.abc import Mapping, Sequence
from importlib.machinery import ModuleSpec
from multiprocessing import forkserver
from pathlib import Path
from types import ModuleType
from typing import Any, Final

_LEFT_OUT: Final = ("polars", "distributed", "dask", "pyarrow", "concurrent.futures.process")
"""They start threads when they are imported, and threads do not survive a fork: each command imports them itself."""


class _Refused(importlib.abc.MetaPathFinder):
    def find_spec(
        self,
        fullname: str,
        path: Sequence[str] | None,  # noqa: ARG002
        target: ModuleType | None = None,  # noqa: ARG002
    ) -> ModuleSpec | None:
        if fullname in _LEFT_OUT:
            raise ImportError(f"{fullname} is not loaded before a fork", name=fullname)
        return None


def load() -> None:
    """Import what commands import, and have Numba's compiler ready.

    Raises:
        RuntimeError: A library has started a thread: no process may be forked from this one.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command itself does before it imports NumPy
    os.environ.setdefault("MUJOCO_GL", "disable")
    refused = _Refused()
    sys.meta_path.insert(0, refused)
    try:
        for room in map(importlib.import_module, ("counterflex.cli", "counterflex.app", "counterflex.report")):
            for item in pkgutil.walk_packages(room.__path__, f"{room.__name__}.", onerror=lambda _: None):
                try:
                    importlib.import_module(item.name)
                except ImportError as fault:
                    if fault.name not in _LEFT_OUT:
                        raise
    finally:
        sys.meta_path.remove(refused)
    from numba.core.registry import cpu_target

    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()
    tasks = Path("/proc/self/task")
    if threading.active_count() > 1 or (tasks.is_dir() and len(list(tasks.iterdir())) > 1):
        raise RuntimeError("a library has started a thread when it was imported: leave it out here")


def context(*, many: bool = False) -> Any:
    """Context that starts processes for :func:`ended`; None where the system has no forks.

    Args:
        many: So many that it is worth reading all compiled kernels for them (:mod:`loaded_kernels`), some seconds.
    """
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return None
    found = multiprocessing.get_context("forkserver")
    found.set_forkserver_preload([f"{__name__}_now", *(["loaded_kernels_now"] if many else [])])
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = str(Path(__file__).parent)  # it imports by this alone, and skips what it does not find
    try:
        forkserver.ensure_running()
    finally:
        if before is None:
            del os.environ["PYTHONPATH"]
        else:
            os.environ["PYTHONPATH"] = before
    return found


def ended(
    forks: Any, words: list[str], folder: Path, environment: Mapping[str, str], output: Path, most_s: float
) -> int | str:
    """Run a console script of this environment: its exit status, or what became of it.

    Args:
        forks: Of :func:`context`.
        words: Its name, or the path of a script, and what follows it on the command line.
        folder: Working folder.
        environment: All of it.
        output: File that its output is added to.
        most_s: After this time it is ended.
    """
    script = Path(sys.executable).parent / words[0]
    process = forks.Process(target=run, args=(str(script), words[1:], str(folder), dict(environment), str(output)))
    process.start()
    process.join(most_s)
    if process.exitcode is None:
        process.kill()
        process.join()
        return f"did not end in {most_s:g} s"
    return int(process.exitcode)


def run(script: str, words: list[str], folder: str, environment: dict[str, str], output: str) -> None:
    """In a process of its own: run a console script to its end.

    Args:
        script: Its path.
        words: What follows it on the command line.
        folder: Working folder.
        environment: All of it.
        output: File that standard output and standard error are written to.
    """
    stream = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for descriptor in (1, 2):
        os.dup2(stream, descriptor)
    os.close(stream)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    multiprocessing.process.ORIGINAL_DIR = folder  # type: ignore[attr-defined]
    sys.argv = [script, *words]
    sys.path[:] = [str(Path(script).parent), *(place for place in sys.path if place != str(Path(__file__).parent))]
    try:
        runpy.run_path(script, run_name="__main__")
    except BaseException:
        sys.stdout.flush()  # what was printed before a fault stands before it
        raise
    finally:
        atexit._run_exitfuncs()

"""Compile the kernels before they are needed, in as many processes as there are cores; say which are there."""

from __future__ import annotations

import gc
import importlib
import multiprocessing
import os
import re
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import counterflex
from counterflex.core import shipped
from counterflex.core.jit import COMPILES, Kernel, entries
from counterflex.core.progress import Progress, silent

_ENTRY: Final = re.compile(r"^@kernel\(.*?^def ", re.MULTILINE | re.DOTALL)
_COST_S: Final = {
    "runtime.cycle": 64.0,
    "cutting.tridexel.column_kernels": 51.0,
    "plan.cut_kernel": 17.0,
    "plan.turning_cut.kernel": 10.0,
    "robot.elasticity.kernels.lanes": 10.0,
    "plan.posture.survey_kernel": 9.0,
}
"""Processor time of the modules that take longest, s: they begin first, so that none is left over when all others have
ended, and the time left is told by their weight."""
_OTHERS_S: Final = 2.5  # Of any other module


@dataclass(frozen=True)
class KernelState:
    """One kernel that Python calls."""

    name: str  # Module below the package, and function
    kept: str  # "native", "shipped" or "missing" before anything was compiled
    # Processor time that compiling it took, with all kernels that it calls and that were not there; None where it was
    # not compiled
    seconds: float | None = None


def modules(rooms: Sequence[str] = ()) -> list[str]:
    """Return the modules that hold kernels which Python calls, those that take longest first.

    Args:
        rooms: Of the package, or modules and folders in them: ``plan``, ``cutting.tridexel``; none: all.
    """
    root = Path(counterflex.__file__).parent
    names = []
    for file in sorted(root.rglob("*.py")):
        name = ".".join(file.relative_to(root).with_suffix("").parts)
        requested = not rooms or any(f"{name}.".startswith(f"{room}.") for room in rooms)
        if requested and any("entry=True" in one for one in _ENTRY.findall(file.read_text(encoding="utf-8"))):
            names.append(name)
    return sorted(names, key=lambda name: -_COST_S.get(name, _OTHERS_S))


def states(rooms: Sequence[str] = ()) -> list[KernelState]:
    """Return where the code of each kernel lies; compiles nothing."""
    return [KernelState(_name(one), one.kept()) for name in modules(rooms) for one in _kernels(name)]


def warm(
    rooms: Sequence[str] = (), *, native: bool = False, jobs: int | None = None, progress: Progress = silent
) -> list[KernelState]:
    """Compile what is missing.

    Args:
        rooms: Of the package; none: all.
        native: Also what the package brings for a baseline processor, for this one: some 20 % faster in batches.
        jobs: Processes; None: as many as there are cores.
    """
    todo = modules(rooms)
    done: list[KernelState] = []
    context = multiprocessing.get_context("spawn")
    before = os.environ.get(shipped.NATIVE_ONLY)
    if native:
        os.environ[shipped.NATIVE_ONLY] = "1"
    try:
        with ProcessPoolExecutor(min(jobs or os.cpu_count() or 1, len(todo) or 1), context) as pool:
            cost = {pool.submit(_compile, name): _COST_S.get(name, _OTHERS_S) for name in todo}
            total, waiting = sum(cost.values()), set(cost)
            try:
                while waiting:
                    ended, waiting = wait(waiting, timeout=1.0, return_when=FIRST_COMPLETED)
                    for one in ended:
                        done += one.result()
                    progress(1.0 - sum(cost[one] for one in waiting) / total, "compiling kernels")
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
    finally:
        if before is None:
            os.environ.pop(shipped.NATIVE_ONLY, None)
        else:
            os.environ[shipped.NATIVE_ONLY] = before
    return sorted(done, key=lambda one: -(one.seconds or 0.0))


def _kernels(module: str) -> Iterator[Kernel]:
    name = f"counterflex.{module}"
    importlib.import_module(name)
    yield from (one for one in entries(name) if one.py_func.__module__ == name) if COMPILES else ()


def _name(one: Kernel) -> str:
    return f"{one.py_func.__module__.removeprefix('counterflex.')}.{one.py_func.__qualname__}"


def _compile(module: str) -> list[KernelState]:
    """Compile the kernels of a module that are not there, in a process that does nothing else."""
    gc.set_threshold(50_000)  # looking for circles after every 700 objects of the compiler took an eighth of the time
    out = []
    for one in _kernels(module):
        kept, begin = str(one.kept()), time.process_time()
        if kept == "missing":
            one.compile_stated()
        out.append(KernelState(_name(one), kept, time.process_time() - begin if kept == "missing" else None))
    return out

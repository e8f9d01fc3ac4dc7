"""Compiled kernels: one decorator that keeps types for the checker and a cache that cannot go stale.

Numba's on-disk cache does not see changes in other source files, and it needs a writable place. Each kernel is
therefore cached in a folder named after a hash of its module and of every kernel module that this one imports, under a
per-user cache folder or, where that is not writable, a temporary one.
Set ``NUMBA_DISABLE_JIT=1`` to step through kernels in plain Python.
"""

from __future__ import annotations

import functools
import hashlib
import os
import re
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np

F = TypeVar("F", bound=Callable[..., Any])

prange = numba.prange

_PACKAGE = Path(__file__).resolve().parents[1]
_IMPORT = re.compile(rb"^from counterflex((?:\.\w+)*) import (?:\(([^)]*)\)|([^\n(]+))", re.MULTILINE)


def _imported(source: bytes) -> set[str]:
    """Dotted names below the package that a source text may import as modules."""
    found = set()
    for match in _IMPORT.finditer(source):
        base = match.group(1).decode().lstrip(".")
        found.add(base)
        for name in (match.group(2) or match.group(3)).decode().replace("\n", " ").split(","):
            word = name.split(" as ")[0].strip()
            if word:
                found.add(f"{base}.{word}".lstrip("."))
    return found


@functools.cache
def _closure(module: str) -> frozenset[str]:
    """Kernel modules that a module's kernels can depend on, itself included (dotted names below the package)."""
    todo, seen = [module], set()
    while todo:
        name = todo.pop()
        file = _PACKAGE / (name.replace(".", "/") + ".py")
        if name in seen or not file.is_file():
            continue
        seen.add(name)
        todo.extend(_imported(file.read_bytes()) - seen)
    return frozenset(seen)


@functools.cache
def _cache_root() -> Path:
    """Where compiled kernels are kept: a per-user folder, or a temporary one where that is not writable."""
    if "COUNTERFLEX_CACHE" in os.environ:
        return Path(os.environ["COUNTERFLEX_CACHE"])
    base = os.environ.get("XDG_CACHE_HOME") or (
        os.environ.get("LOCALAPPDATA") if sys.platform == "win32" else str(Path.home() / ".cache")
    )
    for parent in (Path(base or tempfile.gettempdir()), Path(tempfile.gettempdir())):
        root = parent / "counterflex"
        try:
            root.mkdir(parents=True, exist_ok=True)
            probe = root / f".probe-{os.getpid()}"
            probe.touch()
            probe.unlink()
        except OSError:
            continue
        return root
    return Path(tempfile.mkdtemp(prefix="counterflex-"))


@functools.cache
def cache_folder(module: str) -> Path:
    """Folder for the compiled kernels of a module, named after all sources they depend on.

    Args:
        module: Full dotted name, for example ``counterflex.plan.cut_kernel``.
    """
    name = module.removeprefix("counterflex.")
    digest = hashlib.sha256(f"{numba.__version__} {sys.version_info[:2]}".encode())
    for dependency in sorted(_closure(name)):
        digest.update(dependency.encode())
        digest.update((_PACKAGE / (dependency.replace(".", "/") + ".py")).read_bytes())
    return _cache_root() / f"{name}-{digest.hexdigest()[:16]}"


def _with_records(signature: str, records: dict[str, np.dtype[np.record]]) -> Any:
    """A signature in which the names of records stand for their types."""
    return eval(signature, vars(numba.types) | {name: numba.from_dtype(kind) for name, kind in records.items()})


def kernel(
    signature: Any = None,
    *,
    parallel: bool = False,
    fast: bool = False,
    inline: bool = False,
    waits: bool = False,
    **records: np.dtype[np.record],
) -> Callable[[F], F]:
    """Compile a pure array function with Numba, cached on disk.

    Args:
        signature: Numba signature string, list of them, or None to compile at the first call. Kernels of the
            online loop must state it: then a wrong argument type is a TypeError and never a compilation.
        parallel: Allow ``prange``. Never for kernels called by the online process.
        fast: Allow re-association of sums (``fastmath={'reassoc','contract','nsz','arcp'}``), never NaN tricks.
        inline: Let Numba inline the function into its callers.
        waits: Called from Python it may wait long: other threads of the process run meanwhile.
        records: Types (:func:`counterflex.core.records.record`) by the name that the signature string gives them:
            ``kernel("void(Memory[::1], Row, float64)", Memory=MEMORY, Row=ROW)``, an array of them and an open one.

    Returns:
        A decorator that keeps the Python signature for the type checker.
    """
    options: dict[str, Any] = {
        "cache": True,
        "nogil": parallel or waits,
        "parallel": parallel,
        "error_model": "numpy",
        "fastmath": {"reassoc", "contract", "nsz", "arcp"} if fast else {"contract"},
    }
    if records:
        signature = _with_records(signature, records)
    if inline:
        options["inline"] = "always"

    def decorate(function: F) -> F:
        numba.config.CACHE_DIR = str(cache_folder(function.__module__))
        compiled = numba.njit(**options) if signature is None else numba.njit(signature, **options)
        return cast(F, compiled(function))

    return decorate

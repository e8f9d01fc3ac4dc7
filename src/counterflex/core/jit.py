"""Compiled kernels: one decorator that keeps types for the checker and a cache that cannot go stale.

Numba's on-disk cache does not see changes in other source files, and it needs a writable place. The cache folder
is therefore named after a hash of every kernel source of the package, and falls back to a temporary folder.
Set ``NUMBA_DISABLE_JIT=1`` to step through kernels in plain Python.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])


def _source_hash() -> str:
    package = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    for source in sorted(package.rglob("*.py")):
        data = source.read_bytes()
        if b"core.jit import" in data:
            digest.update(source.relative_to(package).as_posix().encode())
            digest.update(data)
    return digest.hexdigest()[:16]


def _cache_dir() -> Path:
    """Folder for compiled kernels: a per-user cache, or a temporary one where that is not writable."""
    if "NUMBA_CACHE_DIR" in os.environ:
        return Path(os.environ["NUMBA_CACHE_DIR"])
    base = os.environ.get("XDG_CACHE_HOME") or (
        os.environ.get("LOCALAPPDATA") if sys.platform == "win32" else str(Path.home() / ".cache")
    )
    leaf = f"kernels-{_source_hash()}-py{sys.version_info.major}{sys.version_info.minor}"
    for root in (Path(base or tempfile.gettempdir()) / "counterflex", Path(tempfile.gettempdir()) / "counterflex"):
        try:
            folder = root / leaf
            folder.mkdir(parents=True, exist_ok=True)
            probe = folder / f".probe-{os.getpid()}"
            probe.touch()
            probe.unlink()
        except OSError:
            continue
        return folder
    return Path(tempfile.mkdtemp(prefix="counterflex-kernels-"))


os.environ.setdefault("NUMBA_CACHE_DIR", str(_cache_dir()))

import numba  # noqa: E402  (the cache folder must be chosen before numba is imported)

prange = numba.prange


def kernel(
    signature: Any = None, *, parallel: bool = False, fast: bool = False, inline: bool = False
) -> Callable[[F], F]:
    """Compile a pure array function with Numba, cached on disk.

    Args:
        signature: Numba signature string, list of them, or None to compile at the first call. Kernels of the
            online loop must state it: then a wrong argument type is a TypeError and never a compilation.
        parallel: Allow ``prange``. Never for kernels called by the online process.
        fast: Allow re-association of sums (``fastmath={'reassoc','contract','nsz','arcp'}``), never NaN tricks.
        inline: Let Numba inline the function into its callers.

    Returns:
        A decorator that keeps the Python signature for the type checker.
    """
    options: dict[str, Any] = {
        "cache": True,
        "nogil": parallel,
        "parallel": parallel,
        "error_model": "numpy",
        "fastmath": {"reassoc", "contract", "nsz", "arcp"} if fast else {"contract"},
    }
    if inline:
        options["inline"] = "always"

    def decorate(function: F) -> F:
        compiled = numba.njit(**options) if signature is None else numba.njit(signature, **options)
        return cast(F, compiled(function))

    return decorate

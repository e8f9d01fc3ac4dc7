"""Compiled kernels that come with the package: made once for a baseline processor, so that nobody waits for a compiler.

They lie beside the package's modules, in a folder that is only read. Its list, ``kernels.json``, states what they were
made for and the SHA-256 of each file: compiled code is executed when it is read, and a file that is not the one listed
is not read. A clone has no such folder, nor has a wheel for any platform.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

FOLDER: Final = Path(__file__).resolve().parents[1] / "kernels"
LIST: Final = "kernels.json"
NATIVE_ONLY: Final = "COUNTERFLEX_NATIVE"
"""Set to 1, the shipped code is left alone: what is needed is compiled for this processor."""


@dataclass(frozen=True)
class Baseline:
    """A processor that others of its kind can stand for."""

    cpu: str  # LLVM's name of it
    features: tuple[str, ...]  # What a processor must have to run its code, as LLVM names them


BASELINES: Final = {
    "x86_64": Baseline(
        "x86-64-v3",
        (
            "avx",
            "avx2",
            "bmi",
            "bmi2",
            "cx16",
            "f16c",
            "fma",
            "lzcnt",
            "movbe",
            "popcnt",
            "sse3",
            "sse4.1",
            "sse4.2",
            "ssse3",
        ),
    ),
    "aarch64": Baseline("generic", ("neon",)),
}
"""By the machine's name (``platform.machine()``). x86-64-v3: System V ABI, AMD64 supplement 1.0, section 3.1.1."""


@dataclass(frozen=True)
class Shipped:
    """Compiled code and its list in the package."""

    target: tuple[str, str, str]  # Triple, processor and features, as Numba's index of compiled code names them
    features: tuple[str, ...]  # What this processor must have
    files: dict[str, str]  # SHA-256 of each file by its path below :data:`FOLDER`


@functools.cache
def listed() -> Shipped | None:
    """Return what the package brings; None where it brings nothing, or is to be left alone."""
    if os.environ.get(NATIVE_ONLY, "0") not in ("", "0"):
        return None
    try:
        read = json.loads((FOLDER / LIST).read_text(encoding="utf-8"))
    except OSError:
        return None
    return Shipped(tuple(read["target"]), tuple(read["features"]), dict(read["files"]))


@functools.cache
def _fits() -> bool:
    """Return whether this processor has all that the shipped code uses."""
    from llvmlite import binding

    what = listed()
    own = binding.get_host_cpu_features()
    return what is not None and all(own.get(name, False) for name in what.features)


def folder(name: str) -> Path | None:
    """Return the folder of shipped code of a module; None where there is none that this processor can run.

    Args:
        name: Of the folder (:func:`counterflex.core.jit.folder_name`).
    """
    place = FOLDER / name
    return place if listed() is not None and place.is_dir() and _fits() else None


def is_listed(file: Path) -> bool:
    """Return whether a file is the one that the list states."""
    what = listed()
    try:
        digest = hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError:
        return False
    return what is not None and what.files.get(file.relative_to(FOLDER).as_posix()) == digest

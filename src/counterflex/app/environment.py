"""Processor, compiler and libraries: besides the files they decide on the last bit of a result."""

from __future__ import annotations

import platform

import numba
import numpy as np
from llvmlite.binding import get_host_cpu_name


def environment() -> dict[str, str]:
    """Return what decides on the last bit besides the files: processor, compiler, libraries."""
    return {
        "processor": f"{platform.machine()} {get_host_cpu_name()}",
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
    }

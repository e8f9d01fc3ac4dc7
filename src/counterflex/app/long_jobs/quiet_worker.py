"""Start of every worker process of a local cluster (a preload module of dask)."""

from __future__ import annotations

import signal
from typing import Any


def dask_setup(_worker: Any) -> None:
    """Leave Ctrl-C to the job: a terminal sends it to every process, and only the job itself is to answer."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

"""Run logs of a straight cut along x, with figures that are known: for tests of what is read out of logs."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from counterflex.core.arrays import Float
from counterflex.files.logs.run_log import RunLogWriter
from counterflex.runtime.record_ring import WIDTH, column
from counterflex.runtime.state.supervisor import Cause, State

CYCLES = 600
FEED = 0.02


def rows_of(*, bend_m: float = 1e-4, sent_m: float = -8e-5, ratio: float = 1.0, force_n: float = 200.0) -> Float:
    """A straight cut along x, tool pointing down: bent to the left, corrected to the right, and a hold at the end."""
    rows = np.zeros((CYCLES, WIDTH))
    k = np.arange(CYCLES)

    def put(name: str, values: Any) -> None:
        rows[:, column(name)] = values

    put("counter_ms", 4 * k)
    put("received_ns", 1e9 + 4e6 * k)
    put("sent_ns", 1e9 + 4e6 * k + 1e5)
    for name in ("elapsed", "w_good", "cutting", "nominal_R00"):
        put(name, 1.0)
    put("nominal_R11", -1.0)
    put("nominal_R22", -1.0)
    put("nominal_x", FEED * 0.004 * k)
    put("path_m", FEED * 0.004 * k)
    put("deflection_y", bend_m)
    put("deflection_x", 5e-4)  # along the feed: not counted
    put("correction_y", sent_m)
    put("wrench_fy", force_n)
    put("predicted_fy", force_n / ratio)
    put("force_ratio", ratio)
    put("out_state", np.where(k < 500, State.ACTIVE, State.HOLD))
    put("out_cause", np.where(k < 500, 0, Cause.OPERATOR))
    put("cycle", k + 1)
    return rows


def write(
    folder: Path,
    rows: Float,
    *,
    begun_s: float = 0.0,
    program: str = "a" * 64,
    plan: bool = False,
    cell: Path | None = None,
) -> Path:
    """Write records as the log of a run of ``groove.ngc``; with a plan, it is one that is not there any more."""
    names = {"program": "groove.ngc"} | ({"plan": "plan.parquet"} if plan else {})
    hashes = {} if cell is None else {"cell": hashlib.sha256(cell.read_bytes()).hexdigest()}
    names |= {} if cell is None else {"cell": str(cell)}
    about = {
        "counterflex": "0.1.0",
        "files": names,
        "sha256": {"program": program, "plan": hashlib.sha256(b"none").hexdigest(), **hashes},
        "compensated": plan,
        "wall_minus_monotonic_ns": round((1.8e9 + begun_s) * 1e9),
    }
    log = RunLogWriter(folder, about)
    log.add(rows, 1.0)
    log.note({"time_ns": int(1.5e9), "who": "anna", "action": "stop", "done": True})
    log.close()
    return folder

"""Run logs made from a plan: the planned force by other constants, late, with noise, weight and drift of the sensor."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from counterflex.app.production.runs import planned_cut
from counterflex.core.arrays import Float
from counterflex.files.cell.cell import read_cell
from counterflex.files.logs.run_log import RunLogWriter
from counterflex.files.plan_file import read_plan
from counterflex.identify.production.alignment import PlannedCut, force_of
from counterflex.runtime.record_ring import WIDTH, column

PERIOD_S = 0.004
DELAY_S = 0.03


def cut_of(cell: Path, plan: Path) -> PlannedCut:
    """The plan as maps."""
    read, about = read_plan(plan)
    return planned_cut(read, about, read_cell(cell), plan, compensated=True)


def rows_of(
    plan: Path, cut: PlannedCut, terms: Float, *, factor: float = 1.0, noise_n: float = 3.0, seed: int = 0
) -> Float:
    """(m, WIDTH) records of a run on the plan.

    Args:
        plan: Plan file.
        cut: Its maps.
        terms: True law.
        factor: By which the tool is worn.
        noise_n: Standard deviation of the force.
        seed: Of the noise.
    """
    read, _ = read_plan(plan)
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, read.path.time_s[-1] + 0.3, PERIOD_S)
    planned = read.path.time_s + 1e-9 * np.arange(len(read.path))
    force = factor * force_of(cut.maps_m, terms)
    rows = np.zeros((len(time), WIDTH))
    late = np.searchsorted(planned, time - DELAY_S).clip(0, len(force) - 1)
    offset = np.array([4.0, -7.0, 11.0]) + rng.normal(0.0, 5.0, 3) + np.outer(time / time[-1], [1.0, 0.0, -2.0])
    for k, axis in enumerate("xyz"):
        rows[:, column(f"nominal_{axis}")] = np.interp(time, planned, cut.p_part[:, k])
        rows[:, column(f"wrench_f{axis}")] = force[late, k] + offset[:, k] + rng.normal(0.0, noise_n, len(time))
    for k in range(6):
        rows[:, column(f"q{k + 1}")] = np.interp(time, planned, read.q[:, k])
    count = np.arange(len(time))
    rows[:, column("counter_ms")] = 1000.0 * PERIOD_S * count
    rows[:, column("received_ns")] = 1e9 * (1.0 + time + 100.0 * seed)
    rows[:, column("elapsed")] = 1.0
    rows[:, column("cycle")] = 1.0 + count
    return rows


def write_rows(
    folder: Path, rows: Float, plan: Path, cell: Path, change: Callable[[dict[str, Any]], None] | None = None
) -> Path:
    """Write records as the log of a run."""
    about = {
        "counterflex": "0.1.0",
        "sha256": {
            name: hashlib.sha256(file.read_bytes()).hexdigest() for name, file in (("plan", plan), ("cell", cell))
        },
        "files": {"plan": str(plan), "cell": str(cell)},
        "compensated": True,
        "wall_minus_monotonic_ns": 0,
    }
    if change is not None:
        change(about)
    log = RunLogWriter(folder, about)
    log.add(rows, 1.0)
    log.close()
    return folder

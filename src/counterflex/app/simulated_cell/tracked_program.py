"""The job `twin track`: a program in the air on the simulated cell, logged by a tracker."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.inputs import AS_IT_IS, Reading, read_job
from counterflex.app.proof.simulate import check_same_cell, controller, tools_of
from counterflex.core import atomic
from counterflex.core.progress import Progress, silent
from counterflex.core.units import MM
from counterflex.files.cell.cell import read_cell
from counterflex.files.logs.tracker_log import log_text
from counterflex.files.summary_file import write_summary
from counterflex.twin.laboratory.laboratory import laboratory
from counterflex.twin.laboratory.slots import TrackedProgram
from counterflex.twin.truth.file import read_truth

LOG: Final = "tracker.csv"


def run(
    program: str | Path,
    cell_file: str | Path,
    truth_file: str | Path,
    out: str | Path,
    *,
    cycles: int = 1,
    seed: int = 0,
    reading: Reading = AS_IT_IS,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Run a program and write ``tracker.csv`` and ``summary.json``.

    Args:
        cell_file: What the controller believes.
        truth_file: How the cell really is.
        cycles: How often the program runs.
        seed: Of the tracker's noise.
        reading: How the program is read.

    Raises:
        CounterflexError: A file cannot be used, or the robot does not reach the path.
    """
    cell, truth = read_cell(cell_file), read_truth(truth_file)
    check_same_cell(cell, truth, str(truth_file))
    job = read_job(program, cell, reading=reading)
    tracked = TrackedProgram.of(
        job.machined,
        truth=truth,
        laboratory=laboratory(seed),
        controller=controller(cell),
        cutter={number: cell.cutter(number) for number in tools_of(job.path)},
        datum_points_part=cell.datum_points_part if cell.part.measured_with == "robot" else None,
        cycles=cycles,
        progress=progress,
    )
    summary = {
        "job": "twin track",
        "program": Path(program).name,
        "cell": cell.name,
        "truth": truth.name,
        "seed": seed,
        "cycles": cycles,
        "readings": len(tracked.time_s),
        "seconds_of_motion": round(float(tracked.time_s[-1]), 3),
        "readings_per_s": round(1.0 / float(np.median(np.diff(tracked.time_s))), 3),
        "sigma_mm": tracked.sigma_m / MM,
        "frame": "part, as registered",
        "counterflex": __version__,
    }
    with atomic.atomic_folder(out) as staging:
        atomic.write_text(staging / LOG, log_text(tracked.time_s, tracked.Ts_part_tcp, tracked.sigma_m))
        write_summary(staging / "summary.json", summary)
    return summary

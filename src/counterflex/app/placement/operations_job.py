"""Write a cell file with a place of the external axes for each operation of a program."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.inputs import AS_IT_IS, faults_in
from counterflex.app.placement.candidates_table import table_of
from counterflex.app.placement.operations import per_operation, require_operations
from counterflex.app.placement.placement import (
    CUTTING,
    ROUNDING,
    SEARCHING,
    TABLE,
    PlacementSummary,
    placement_of,
    prepared,
)
from counterflex.app.placement.region import Wish
from counterflex.core import atomic
from counterflex.core.errors import ReachError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.core.units import DEG
from counterflex.files.cell.cell import read_cell
from counterflex.files.cell.set_up import text_with_place
from counterflex.files.summary_file import write_summary

OPERATIONS: Final = "a place for each operation"


def run(
    program: str | Path, cell_file: str | Path, out: str | Path, *, progress: Progress = silent, **options: Any
) -> PlacementSummary:
    """Write what :func:`~counterflex.app.placement.placement.run` does, with a place for each operation.

    One place for all operations may be impossible: then ``candidates.csv`` is not written.
    """
    cell, out = read_cell(cell_file), Path(out)
    parts = in_parts(progress, {CUTTING: 2.0, SEARCHING: 6.0, OPERATIONS: 6.0})
    reading, surface = options.get("reading", AS_IT_IS), options.get("surface", "both")
    with atomic.atomic_folder(out) as staging:
        given = prepared(program, cell, reading, surface, parts[CUTTING])
        require_operations(program, given.cell, given.task)
        done, why = None, ""
        try:
            done = placement_of(program, cell, given=given, progress=parts[SEARCHING], **options)
        except ReachError as fault:
            why = f"{fault.what}: {fault.value}"
        one = None if done is None else (done.stand, done.chosen.best.branch, done.chosen.best.rotation_rad)
        damping = -np.inf if done is None else done.summary["chosen"]["damping_in_cut"]
        with faults_in(given.job):
            divided = per_operation(
                program, given, (options.get("wish") or Wish()).region(given.frame), reading=reading, one=one,
                least_damping=-np.inf if damping is None else min(0.0, damping - ROUNDING),
                progress=parts[OPERATIONS],
            )  # fmt: skip
        nothing = dict.fromkeys(("present", "posture_alone", "chosen", "reduction_percent"))
        summary = done.summary if done is not None else {
            "program": given.job.program.name, "cell": given.cell.label, "robot": given.cell.robot.name,
            "surface": surface, "external_axes": [axis.name for axis in given.frame.axes], **nothing,
            "one_place_refused": why, "counterflex": __version__,
        }  # fmt: skip
        summary = summary | divided.summary
        text = text_with_place(
            cell.path, divided.stand.part, divided.branch, divided.rotation_rad / DEG, out, None, divided.stand.axes,
            divided.moves,
        )  # fmt: skip
        atomic.write_text(staging / "cell.toml", text)
        if done is not None:
            atomic.write_text(staging / TABLE, table_of(done.judged, given.cell))
        write_summary(staging / "summary.json", summary)
    return PlacementSummary(summary)

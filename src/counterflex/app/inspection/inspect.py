"""The job ``inspect``: a scan of a real part against the part that its program makes."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any, Final

from counterflex.app.inspection.judging import How, inspect
from counterflex.core import atomic
from counterflex.core.progress import Progress, silent
from counterflex.core.units import UM
from counterflex.files.part_deviations import MeasuredPart, write_part_deviations
from counterflex.files.summary_file import write_summary

DEVIATIONS: Final = "deviations.parquet"
REPORT: Final = "report.html"
SUMMARY: Final = "summary.json"


def run(
    program: Path,
    cell_file: Path,
    scan: Path,
    out: Path,
    *,
    how: How,
    before: Path | None = None,
    nominal: Path | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Do the job on files.

    Writes ``deviations.parquet`` (of the last part), ``summary.json`` and ``report.html`` into ``out``.

    Args:
        program: The program that made the part, uncompensated: what was to be made.
        cell_file: Its cell, for blank and tools.
        scan: Of the part.
        out: Folder.
        how: How the scans are read and laid on the part.
        before: Scan of an earlier part to compare with, or None.
        nominal: CAD mesh to judge against in place of what the program makes, or None.
        progress: Progress callback, fraction 0 to 1.

    Returns:
        The summary.

    Raises:
        FileFormatError: A file is missing, damaged or of another format.
        InputError: A scan does not fit the part.
    """
    inspection = inspect(program, cell_file, scan, how=how, before=before, nominal=nominal, progress=progress)
    last = list(inspection.parts.values())[-1]
    from counterflex.app.inspection.page import page_of  # plotly is heavy
    from counterflex.report.page import write_page

    registration = last.part.registration
    measured = MeasuredPart(
        program.name,
        hashlib.sha256(program.read_bytes()).hexdigest(),
        last.file,
        last.unit,
        registration.faces,
        registration.residual_m / UM,
    )
    with atomic.atomic_folder(out) as staging:
        write_part_deviations(staging / DEVIATIONS, last.part.rows, measured)
        write_summary(staging / SUMMARY, inspection.summary)
        write_page(page_of(inspection), staging / REPORT)
    progress(1.0)
    return inspection.summary

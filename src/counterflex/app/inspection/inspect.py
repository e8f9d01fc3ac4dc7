"""The job ``inspect``: a scan of a real part, or a log of the tool's path, against what its program makes."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from counterflex.app.inspection.judging import How, Inspection, inspect
from counterflex.app.inspection.summary import InspectedScan, InspectionSummary
from counterflex.app.inspection.tool_log import LogHow
from counterflex.app.inspection.tool_path import InspectedPath, path_rows
from counterflex.core import atomic, file_content
from counterflex.core.progress import Progress, silent
from counterflex.core.units import UM
from counterflex.files.part_deviations import MeasuredPart, write_part_deviations
from counterflex.files.summary_file import write_folder_summary
from counterflex.files.tool_path_file import LoggedPath, write_tool_path

DEVIATIONS: Final = "deviations.parquet"
TOOL_PATH: Final = "tool-path.parquet"
REPORT: Final = "report.html"


def run(
    program: Path,
    cell_file: Path,
    measured: Path,
    out: Path,
    *,
    how: How | LogHow,
    before: Path | None = None,
    nominal: Path | None = None,
    tolerances_m: Mapping[tuple[str, str], float] | None = None,
    more: Callable[[Path, dict[str, Any]], None] | None = None,
    progress: Progress = silent,
) -> InspectionSummary:
    """Do the job on files.

    Writes ``deviations.parquet`` (of the last part; ``tool-path.parquet`` of a log), ``summary.json`` and
    ``report.html`` into ``out``.

    Args:
        program: The program that made the part, uncompensated: what was to be made.
        measured: Scan of the part, or log of the tool's path.
        how: How scans, or logs, are read and laid on the part.
        before: The same of an earlier part to compare with, or None.
        nominal: CAD mesh to judge against in place of what the program makes, or None.
        tolerances_m: (feature, quantity) to +- tolerance, m; general tolerances for what is not listed.
        more: Writes more into the folder, given the one that it is made in and the summary.

    Raises:
        FileFormatError: A file is missing, damaged or of another format.
        InputError: What was measured does not fit the part.
    """
    inspection = inspect(
        program,
        cell_file,
        measured,
        how=how,
        before=before,
        nominal=nominal,
        tolerances_m=tolerances_m,
        progress=progress,
    )
    with atomic.atomic_folder(out) as staging:
        write_folder(inspection, program, staging)
        if more is not None:
            more(staging, inspection.summary)
    progress(1.0)
    return InspectionSummary(inspection.summary)


def write_folder(inspection: Inspection, program: Path, folder: Path) -> None:
    """Write measured places of the last part, summary and page into a folder."""
    from counterflex.app.inspection.page import page_of  # plotly is heavy
    from counterflex.report.page import write_page

    _write_rows(folder, inspection, list(inspection.parts.values())[-1], program)
    write_folder_summary(folder, inspection.summary)
    write_page(page_of(inspection), folder / REPORT)


def _write_rows(folder: Path, inspection: Inspection, last: InspectedScan | InspectedPath, program: Path) -> None:
    """Write the measured places: of a surface, or of the path of the tool."""
    digest = hashlib.sha256(file_content.content(program)).hexdigest()
    if isinstance(last, InspectedPath):
        logged = LoggedPath(
            program.name, digest, last.file, last.log.position, last.log.frame, frame_fitted=last.log.fitted
        )
        write_tool_path(folder / TOOL_PATH, path_rows(last, inspection.job, inspection.cell), logged)
        return
    registration = last.part.registration
    measured = MeasuredPart(
        program.name, digest, last.file, last.unit, registration.faces, registration.residual_m / UM
    )
    write_part_deviations(folder / DEVIATIONS, last.part.rows.turned(inspection.cell.R_part_plane), measured)

"""Judge a benchmark part from its scan, and compare results of several laboratories."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from counterflex import __version__
from counterflex.app.benchmark_part.part import PROGRAM, program_sha256, program_text, require_cell, tolerances_m
from counterflex.app.inspection.judging import How
from counterflex.core import atomic
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.units import MM, UM, plain
from counterflex.files.benchmark_result import (
    MEASURED,
    NAME,
    BenchmarkResult,
    FeatureResult,
    read_benchmark_result,
    write_benchmark_result,
)
from counterflex.files.cell.cell import read_cell

RESULT: Final = "result.json"


@dataclass(frozen=True)
class BenchmarkConditions:
    """Person, robot and method that milled the part."""

    laboratory: str
    method: str  # How its program was made: `corrected`, `online`, ...
    robot: str | None = None  # Name; None: that of the cell
    material: str | None = None  # Name; None: that of the cell


def judge(
    cell_file: Path, scan: Path, out: Path, about: BenchmarkConditions, *, how: How, progress: Progress = silent
) -> BenchmarkResult:
    """Judge a scan against drawing and tolerances.

    Writes what ``inspect`` writes and ``result.json`` into ``out``.

    Raises:
        CounterflexError: The cell is not that of the part, or the scan is not of it; nothing is written.
    """
    from counterflex.app.inspection import inspect

    cell = read_cell(cell_file)
    require_cell(cell)
    law = cell.tables.material
    robot, material = about.robot or cell.name, about.material or ("not stated" if law is None else law.name)
    with tempfile.TemporaryDirectory(prefix="counterflex-") as scratch:
        program = Path(scratch) / PROGRAM
        atomic.write_text(program, program_text())
        summary = inspect.run(
            program,
            cell_file,
            scan,
            out,
            how=how,
            tolerances_m=tolerances_m(),
            more=lambda folder, made: write_benchmark_result(folder / RESULT, result_of(made, robot, material, about)),
            progress=progress,
        )
    return result_of(summary, robot, material, about)


def result_of(summary: dict[str, Any], robot: str, material: str, about: BenchmarkConditions) -> BenchmarkResult:
    """The result that a summary of ``inspect`` holds. Raises InputError: something of the part is not in the scan."""
    part = summary["parts"]["part"]
    rows = {(row["feature"], row["quantity"]): row for row in summary["features"] if "part" in row}
    missing = [row for row in MEASURED if (row.feature, row.quantity) not in rows]
    if missing:
        raise InputError(
            f"the scan does not show all that is measured on {NAME}",
            where=part["scan"]["file"],
            value=f"{missing[0].quantity} of {missing[0].feature} is missing",
            hint="Scan the walls and floors of both grooves and of the pocket",
        )
    return BenchmarkResult(
        laboratory=about.laboratory,
        robot=robot,
        material=material,
        method=about.method,  # type: ignore[arg-type]  # the model refuses others
        program_sha256=program_sha256(),
        scan=part["scan"]["file"],
        scan_points=part["scan"]["points"],
        scan_noise_um=part["scan"]["noise_um"],
        placed_by=tuple(part["registration"]["datum_faces"]),
        residual_um=part["registration"]["residual_um"],
        surface_p997_mm=part["surface"]["p997_mm"],
        features=tuple(_feature(rows[row.feature, row.quantity]) for row in MEASURED),
        counterflex=__version__,
    )


def _feature(row: dict[str, Any]) -> FeatureResult:
    part = row["part"]
    return FeatureResult(
        feature=row["feature"],
        quantity=row["quantity"],
        nominal_mm=row["nominal_mm"],
        tolerance_mm=row["tolerance_mm"],
        worst_mm=part["worst_mm"],
        mean_mm=part["mean_mm"],
        uncertainty_um=round(2.0 * part["standard_deviation_um"], 2),
        within=part["within"],
    )


def compare(files: Sequence[Path]) -> dict[str, Any]:
    """Results side by side.

    Returns:
        ``results`` (who, how, surface, how many quantities are within) and ``features`` (worst deviation of each, um).

    Raises:
        FileFormatError: A file is no result.
        InputError: Results of other paths are not comparable.
    """
    results = [read_benchmark_result(file) for file in files]
    for file, result in zip(files, results, strict=True):
        if result.program_sha256 != program_sha256():
            raise InputError(
                f"the part was not made by the path of {NAME}, version 1", where=str(file),
                value=result.program_sha256[:12], limit=program_sha256()[:12],
            )  # fmt: skip
    return {
        "part": NAME,
        "results": [
            {
                "file": str(file),
                **plain(result, "label robot material surface_p997_mm"),
                "within": sum(row.within for row in result.features),
                "of": len(result.features),
            }
            for file, result in zip(files, results, strict=True)
        ],
        "features": [
            {
                "feature": row.feature,
                "quantity": row.quantity,
                "tolerance_um": round(row.tolerance_mm * MM / UM, 1),
                "deviation_um": [round(result.features[k].deviation_mm * MM / UM, 1) for result in results],
                "within": [result.features[k].within for result in results],
            }
            for k, row in enumerate(MEASURED)
        ],
    }

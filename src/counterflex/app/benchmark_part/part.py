"""The benchmark part: its program, what is measured on it, and its tolerances."""

from __future__ import annotations

import csv
import hashlib
import io
from importlib import resources
from pathlib import Path
from typing import Final

from counterflex.app.benchmark_part.drawing import drawing
from counterflex.app.benchmark_part.drawing_pdf import pdf_of
from counterflex.core import atomic
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.files.benchmark_result import MEASURED, NAME
from counterflex.files.cell.cell import Cell

PROGRAM: Final = "cf1.ngc"
DRAWING: Final = "cf1.svg"
PRINTED: Final = "cf1.pdf"
TOLERANCES: Final = "cf1-tolerances.csv"
BLANK_M: Final = (60.0 * MM, 60.0 * MM, 40.0 * MM)
DIAMETERS_M: Final = {1: 16.0 * MM, 2: 10.0 * MM}
_CLOSE_M: Final = 0.01 * MM


def program_text() -> str:
    """The program, G-code."""
    return (resources.files("counterflex.app.benchmark_part") / PROGRAM).read_text(encoding="utf-8")


def program_sha256(text: str | None = None) -> str:
    """SHA-256 of a program without comments, speeds, feeds and blank lines: of what it moves, and with what.

    Args:
        text: G-code; None: the program of the benchmark part.
    """
    kept = []
    for line in (program_text() if text is None else text).splitlines():
        words = line.partition("(")[0].upper().split()
        motion = [word for word in words if word[0] not in "FSN"]
        if motion:
            kept.append(" ".join(motion))
    return hashlib.sha256("\n".join(kept).encode()).hexdigest()


def tolerances_m() -> dict[tuple[str, str], float]:
    """Feature and quantity to permitted deviation, +- m (a one-sided zone where the nominal value is 0)."""
    return {(row.feature, row.quantity): row.tolerance_mm * MM for row in MEASURED}


def tolerances_text() -> str:
    """The tolerances as CSV, as ``inspect --tolerances`` reads them."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("feature", "quantity", "tolerance_mm"))
    writer.writerows((row.feature, row.quantity, f"{row.tolerance_mm:g}") for row in MEASURED)
    return text.getvalue()


def write(out: Path) -> list[str]:
    """Write program, drawing and tolerances into a folder, all or none.

    Returns:
        Names of the files.

    Raises:
        OutputError: The folder cannot be written.
    """
    sheet = drawing()
    files = {
        PROGRAM: program_text().encode(),
        DRAWING: sheet.encode(),
        PRINTED: pdf_of(sheet),
        TOLERANCES: tolerances_text().encode(),
    }
    with atomic.atomic_folder(out) as staging:
        for name, content in files.items():
            atomic.write_bytes(staging / name, content)
    return list(files)


def require_cell(cell: Cell) -> None:
    """Refuse a cell that has another blank or other tools than the benchmark part.

    Raises:
        InputError: What is different.
    """
    where = cell.path.name
    stock = cell.part.stock
    low, high = (None, None) if stock is None else (stock.box_min_mm, stock.box_max_mm)
    expected = (0.0, 0.0, 0.0, *(size / MM for size in BLANK_M))
    given = () if low is None or high is None else (*low, *high)
    if len(given) != len(expected) or any(abs(a - b) * MM > _CLOSE_M for a, b in zip(given, expected, strict=True)):
        raise InputError(
            f"the blank is not that of {NAME}", where=f"{where}: part.stock", value=f"{low}, {high}",
            limit="box_min_mm = [0, 0, 0], box_max_mm = [60, 60, 40]",
        )  # fmt: skip
    for number, diameter in DIAMETERS_M.items():
        mounted = cell.cutter(number).diameter_m
        if abs(mounted - diameter) > _CLOSE_M:
            raise InputError(
                f"tool T{number} is not that of {NAME}", where=f"{where}: tools",
                value=f"{mounted / MM:g} mm", limit=f"{diameter / MM:g} mm",
            )  # fmt: skip

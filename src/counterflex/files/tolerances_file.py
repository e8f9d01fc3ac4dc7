"""Tolerances of a drawing as text: columns ``feature,quantity,tolerance_mm``, one row for each quantity."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

from counterflex.core.errors import FileFormatError
from counterflex.core.units import MM
from counterflex.files.small_table import read_rows

COLUMNS: Final = ("feature", "quantity", "tolerance_mm")
LARGEST_MM: Final = 100.0


def read_tolerances(path: str | Path) -> dict[tuple[str, str], float]:
    """Read tolerances.

    Returns:
        (feature, quantity) to permitted deviation, +- m (width of the zone where the nominal value is 0).

    Raises:
        FileFormatError: Missing, not text, other columns, a row twice, or a tolerance that is no size.
    """
    file = Path(path)
    rows = read_rows(file)
    if not rows or tuple(rows[0][1]) != COLUMNS:
        raise FileFormatError(
            "other columns than those of tolerances",
            where=f"{file}:{rows[0][0] if rows else 1}",
            value=",".join(rows[0][1]) if rows else "none",
            limit=",".join(COLUMNS),
        )
    tolerances: dict[tuple[str, str], float] = {}
    for number, row in rows[1:]:
        where = f"{file}:{number}"
        if len(row) != len(COLUMNS):
            raise FileFormatError("a row of another length", where=where, value=len(row), limit=len(COLUMNS))
        try:
            size = float(row[2])
        except ValueError as fault:
            raise FileFormatError("tolerance_mm is no number", where=where, value=row[2]) from fault
        if not (math.isfinite(size) and 0.0 < size <= LARGEST_MM):
            raise FileFormatError(
                "tolerance_mm is no size", where=where, value=row[2], limit=f"above 0, {LARGEST_MM:g}"
            )
        if (row[0], row[1]) in tolerances:
            raise FileFormatError("the same quantity twice", where=where, value=f"{row[1]} of {row[0]}")
        tolerances[row[0], row[1]] = size * MM
    return tolerances

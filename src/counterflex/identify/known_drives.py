"""Periodic errors of drives as the cell file's ``[drive_error]`` table has them, and back into that table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

from counterflex.core.units import URAD
from counterflex.identify.changes import TableValues
from counterflex.identify.model import CellModel
from counterflex.robot.drive_error import DriveError, DriveErrors

TABLE: Final = "drive_error"


def known_drive_errors(cell: CellModel) -> DriveErrors:
    """What the cell file says; nothing where it has no such table."""
    table: Mapping[str, Any] = cell.tables.get(TABLE) or {}
    return DriveErrors(
        tuple(
            DriveError(axis, int(order), float(sine) * URAD, float(cosine) * URAD)
            for axis in range(6)
            for order, sine, cosine in table.get(f"axis{axis + 1}") or ()
        )
    )


def drive_error_table(known: DriveErrors, found: Iterable[DriveError], source: str) -> TableValues:
    """The table with what was found added to what was known."""
    values: dict[str, float | str | bool | list[float] | list[list[float]]] = {}
    merged = known.merged(found)
    for axis in range(6):
        rows = [
            [t.order, float(f"{t.sine_rad / URAD:.6g}"), float(f"{t.cosine_rad / URAD:.6g}")]
            for t in merged.terms
            if t.axis == axis
        ]
        if rows:
            values[f"axis{axis + 1}"] = rows
    values["source"] = source
    return TableValues(TABLE, values)

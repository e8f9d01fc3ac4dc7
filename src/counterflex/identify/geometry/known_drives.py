"""Errors of drives as the cell file's ``[drive_error]`` and ``[axis_sag]`` tables have them, and back into these."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MRAD, URAD
from counterflex.identify.data.changes import TableValues
from counterflex.identify.data.model import CellModel
from counterflex.robot.elasticity.axis_sag import AxisSag
from counterflex.robot.elasticity.drive_error import DriveError, DriveErrors

TABLE: Final = "drive_error"
SAG_TABLE: Final = "axis_sag"
_SAG_KEYS: Final = ("axis2_by_link2_mrad", "axis2_by_link3_mrad", "axis3_by_link3_mrad")


def known_drive_errors(cell: CellModel) -> DriveErrors:
    """What the cell file says; nothing where it has no such table."""
    table: Mapping[str, Any] = cell.tables.get(TABLE) or {}
    return DriveErrors(
        tuple(
            DriveError(axis, int(order), float(sine) * URAD, float(cosine) * URAD)
            for axis in range(6)
            for order, sine, cosine in table.get(f"axis{axis + 1}") or ()
        ),
        tuple((float(low) * DEG, float(high) * DEG) for low, high in table.get("measured_deg") or ()),
        _known_sag(cell),
    )


def _known_sag(cell: CellModel) -> AxisSag | None:
    table: Mapping[str, Any] = cell.tables.get(SAG_TABLE) or {}
    if not table:
        return None
    rows = [table.get(key) or (0.0, 0.0) for key in _SAG_KEYS]
    return AxisSag(cell.nominal_chain, np.array(rows, dtype=np.float64).ravel() * MRAD)


def axis_sag_table(known: DriveErrors, added_rad: Float, source: str) -> TableValues:
    """The table of sag with what was found added to what was known.

    ``added_rad``: (6,) rad, to be added, in the order of :data:`counterflex.robot.elasticity.axis_sag.TERMS`.
    """
    whole = added_rad if known.sag is None else added_rad + known.sag.moments_rad
    values: dict[str, float | str | bool | list[float] | list[list[float]]] = {
        key: [float(f"{v / MRAD:.6g}") for v in pair] for key, pair in zip(_SAG_KEYS, whole.reshape(3, 2), strict=True)
    }
    values["source"] = source
    return TableValues(SAG_TABLE, values)


def drive_error_table(known: DriveErrors, added: Iterable[DriveError], q: Float, source: str) -> TableValues:
    """The table with what was found added to what was known.

    ``q``: (m, 6) rad, the angles it was found from; where something was known, both ranges have to hold.
    """
    low, high = np.floor(q.min(axis=0) / DEG), np.ceil(q.max(axis=0) / DEG)
    if known.terms and known.measured_rad:
        before = np.array(known.measured_rad) / DEG
        both_low, both_high = np.maximum(low, before[:, 0]), np.minimum(high, before[:, 1])
        differs = both_low > both_high
        low, high = np.where(differs, low, both_low), np.where(differs, high, both_high)
    values: dict[str, float | str | bool | list[float] | list[list[float]]] = {}
    merged = known.merged(added)
    for axis in range(6):
        rows = [
            [t.order, float(f"{t.sine_rad / URAD:.6g}"), float(f"{t.cosine_rad / URAD:.6g}")]
            for t in merged.terms
            if t.axis == axis
        ]
        if rows:
            values[f"axis{axis + 1}"] = rows
    values["measured_deg"] = [[float(f"{a:.6g}"), float(f"{b:.6g}")] for a, b in zip(low, high, strict=True)]
    values["source"] = source
    return TableValues(TABLE, values)

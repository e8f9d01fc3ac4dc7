"""Tables of a cell file that identification writes: calibrated geometry, and where identified values come from."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from counterflex.files.schema import Table

Shift = Annotated[float, Field(ge=-100.0, le=100.0)]
"""Displacement of a calibration, mm or mrad."""


class CalibrationTable(Table):
    """Displacement of what follows one segment against the nominal geometry, constant in the segment's frame."""

    segment: str
    x_mm: Shift = 0.0
    y_mm: Shift = 0.0
    z_mm: Shift = 0.0
    rx_mrad: Shift = 0.0
    ry_mrad: Shift = 0.0
    rz_mrad: Shift = 0.0
    source: str = ""


class IdentifiedValue(Table):
    """One identified number with its standard deviation."""

    name: str
    value: float
    sigma: Annotated[float, Field(ge=0.0)]
    unit: str
    seen: str = "determined"


class IdentifiedTable(Table):
    """One identification that this cell file holds the result of."""

    recipe: str
    date: str
    data: tuple[str, ...]
    data_sha256: tuple[str, ...]
    counterflex: str
    holdout: str
    values: tuple[IdentifiedValue, ...] = ()

"""Touches of one place between cuts as text: one row per touch, by a probe or a tracker at the same programmed pose.

Columns ``time_s,x_mm,y_mm,z_mm`` in part axes and, where known, ``spindle_rpm`` (mean since the row before),
``sigma_um`` and ``temperature_c`` of the spindle, in any order. Lines that begin with ``#`` are comments. A temperature
may be missing in any row but the first, from which the others count.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.core.units import MM, RPM, UM
from counterflex.evaluate.thermal.growth import Touches
from counterflex.files.small_table import are_columns, read_rows

NEEDED: Final = ("time_s", "x_mm", "y_mm", "z_mm")
KNOWN: Final = (*NEEDED, "spindle_rpm", "sigma_um", "temperature_c")
USUAL_UM: Final = 5.0
"""Uncertainty of a touch where the file does not say it."""


def read_touches(path: str | Path) -> Touches:
    """Read touches; deviations are from the first.

    Raises:
        FileFormatError: Missing, not text, other columns, not a number, or a temperature that the first touch lacks.
        InputError: Fewer than two touches, times that do not rise, or an uncertainty that is not above 0.
    """
    file = Path(path)
    names, rows = _table(file)
    column = {name: np.array([row[names.index(name)] for row in rows]) for name in names}
    n = len(rows)
    place = np.stack([column[name] for name in NEEDED[1:]], axis=1) * MM
    warm = column.get("temperature_c", np.full(n, np.nan))
    known = np.isfinite(warm)
    if known.any() and not known[0]:
        k = int(np.argmax(known))
        raise FileFormatError(
            "temperature_c of the first touch is missing, and later ones count from it",
            where=str(file),
            value=f"{warm[k]:g} first at time_s {column['time_s'][k]:g}",
            hint="Enter the temperature of the first touch, or leave out the rows before it",
        )
    still: Float = np.zeros(n)
    return Touches(
        time_s=column["time_s"],
        deviation_m=place - place[0],
        speed_rad_s=np.abs(column.get("spindle_rpm", still)) * RPM,
        sigma_m=column.get("sigma_um", np.full(n, USUAL_UM)) * UM,
        warmer_k=warm - warm[0],
    )


def _table(file: Path) -> tuple[list[str], list[list[float]]]:
    table = read_rows(file)
    names = [name.strip() for name in table[0][1]] if table else []
    if not are_columns(names, NEEDED, KNOWN):
        raise FileFormatError(
            "other columns than those of touches",
            where=f"{file}:{table[0][0] if table else 1}",
            value=",".join(names) or "none",
            limit=f"{','.join(NEEDED)} and of spindle_rpm, sigma_um, temperature_c those that are known",
        )
    return names, [_numbers(row, names, f"{file}:{n}") for n, row in table[1:]]


def _numbers(row: list[str], names: list[str], where: str) -> list[float]:
    if len(row) != len(names):
        raise FileFormatError("a row of another length", where=where, value=len(row), limit=len(names))
    out = []
    for name, text in zip(names, row, strict=True):
        try:
            value = float(text) if text.strip() else math.nan
        except ValueError as fault:
            raise FileFormatError(f"{name} is no number", where=where, value=text) from fault
        if not math.isfinite(value) and (name != "temperature_c" or math.isinf(value)):
            raise FileFormatError(f"{name} is not finite", where=where, value=text or "nothing")
        out.append(value)
    return out

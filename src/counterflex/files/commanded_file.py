"""Commanded poses or a commanded path as text: one point per line, in the order in which they are run.

Columns ``x_mm,y_mm,z_mm``, and ``a_deg,b_deg,c_deg`` (intrinsic z-y'-x'', as KUKA) where orientations are judged; of a
path further ``speed_mm_s``, the same in every line. Lines that begin with ``#`` are comments.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.core.units import DEG, MM, MM_PER_S
from counterflex.files.small_table import are_columns, number, read_rows
from counterflex.geometry import pose

POSITION: Final = ("x_mm", "y_mm", "z_mm")
ANGLES: Final = ("a_deg", "b_deg", "c_deg")
SPEED: Final = "speed_mm_s"


def read_commanded(path: str | Path) -> tuple[Float, bool, float | None]:
    """Read commanded points.

    Returns:
        Poses (k, 4, 4) m, whether their orientations are given, and the speed in m/s or None.

    Raises:
        FileFormatError: Missing, not text, other columns, not a number, a speed that is not above 0 or changes.
    """
    file = Path(path)
    table = read_rows(file)
    if len(table) < 2:
        raise FileFormatError("the file has no rows", where=str(file))
    names = [name.strip() for name in table[0][1]]
    turned = set(ANGLES) <= set(names)
    unlike = set(ANGLES) & set(names) and not turned
    if unlike or not are_columns(list(set(names)), POSITION, (*POSITION, *ANGLES, SPEED)):
        raise FileFormatError(
            "other columns than those of commanded points",
            where=f"{file}:{table[0][0]}",
            value=",".join(names),
            limit=f"{','.join(POSITION)}[,{','.join(ANGLES)}][,{SPEED}]",
        )
    if len(set(names)) != len(names):
        raise FileFormatError("a column stands twice", where=f"{file}:{table[0][0]}", value=",".join(names))
    values = np.array(
        [[number(cell, f"{file}:{n}") for cell in _cells(row, names, f"{file}:{n}")] for n, row in table[1:]]
    )
    column = dict(zip(names, values.T, strict=True))
    angles = np.stack([column[name] for name in ANGLES], axis=1) * DEG if turned else np.zeros((len(values), 3))
    Ts = pose.from_xyz_zyx(np.stack([column[name] for name in POSITION], axis=1) * MM, angles)
    speed = column.get(SPEED)
    if speed is None:
        return Ts, turned, None
    if float(speed.min()) <= 0.0 or float(np.ptp(speed)) > 0.0:
        raise FileFormatError(
            "the speed of a path is one value above 0",
            where=str(file),
            value=f"{speed.min():g} to {speed.max():g} mm/s",
        )
    return Ts, turned, float(speed[0]) * MM_PER_S


def _cells(row: list[str], names: list[str], place: str) -> list[str]:
    if len(row) != len(names):
        raise FileFormatError("values in a line", where=place, value=len(row), limit=len(names))
    return row

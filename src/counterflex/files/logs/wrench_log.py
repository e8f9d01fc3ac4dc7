"""Recorded loads as text: columns ``time_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm`` in any order, one row per sample."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.files.small_table import number, read_rows

COLUMNS: Final = ("time_s", "fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm")


def read_wrench_log(path: str | Path) -> tuple[Float, Float]:
    """Read a record of loads.

    Returns:
        Times (n,) s, increasing, and loads (n, 6) N, N m.

    Raises:
        FileFormatError: Missing, not text, other columns, not a number, fewer than two rows, times that do not go on.
    """
    file = Path(path)
    table = read_rows(file)
    if not table:
        raise FileFormatError("the file is empty", where=str(file))
    names = [name.strip() for name in table[0][1]]
    if sorted(names) != sorted(COLUMNS):
        raise FileFormatError(
            "other columns than those of a load", where=f"{file}:1", value=",".join(names), limit=",".join(COLUMNS)
        )
    order = [names.index(name) for name in COLUMNS]
    rows = []
    for line, row in table[1:]:
        if len(row) != len(COLUMNS):
            raise FileFormatError("values in a line", where=f"{file}:{line}", value=len(row), limit=len(COLUMNS))
        rows.append([number(row[k], f"{file}:{line}") for k in order])
        if len(rows) > 1 and rows[-1][0] <= rows[-2][0]:
            raise FileFormatError("time does not go on", where=f"{file}:{line}", value=rows[-1][0])
    if len(rows) < 2:
        raise FileFormatError("fewer than two rows", where=str(file), value=len(rows), limit=">= 2")
    values = np.array(rows)
    return values[:, 0], values[:, 1:]

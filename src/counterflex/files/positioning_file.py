"""Approaches to targets along an axis as text, for a test of positioning by ISO 230-2.

Columns ``target_mm`` and one of ``position_mm``, ``deviation_um``, ``deviation_mm``; where known ``direction`` (``+``
or ``-``, ``up`` or ``down``). Without it the rows are in the order of the test, and a direction is that from the target
before; where the same target comes again, the axis overran it and came back.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.errors import FileFormatError
from counterflex.core.units import MM, UM
from counterflex.evaluate.iso230.positioning import DOWN, UP, Approaches
from counterflex.files.small_table import read_rows

TARGET: Final = "target_mm"
MEASURED: Final = {"position_mm": MM, "deviation_mm": MM, "deviation_um": UM}
IGNORED: Final = ("run", "time_s", "temperature_c")
_WAYS: Final = {
    **dict.fromkeys(("+", "up", "1", "+1", "forward", "positive"), UP),
    **dict.fromkeys(("-", "down", "-1", "backward", "negative"), DOWN),
}


def read_approaches(path: str | Path) -> Approaches:
    """Read approaches.

    Raises:
        FileFormatError: Missing, not text, other columns, a number that is none, or a direction that is none.
    """
    file = Path(path)
    rows = read_rows(file)
    names = [name.strip().lower() for name in rows[0][1]] if rows else []
    measured = [name for name in names if name in MEASURED]
    known = {TARGET, "direction", *MEASURED, *IGNORED}
    if TARGET not in names or len(measured) != 1 or len(set(names)) != len(names) or not set(names) <= known:
        raise FileFormatError(
            "other columns than those of a test of positioning",
            where=f"{file}:{rows[0][0] if rows else 1}",
            value=",".join(names) or "none",
            limit=f"{TARGET}, one of {', '.join(MEASURED)}, and direction where it is known",
        )
    for number, row in rows[1:]:
        if len(row) != len(names):
            raise FileFormatError("a row of another length", where=f"{file}:{number}", value=len(row), limit=len(names))
    target = np.array([_number(row, names, TARGET, f"{file}:{n}") for n, row in rows[1:]]) * MM
    value = np.array([_number(row, names, measured[0], f"{file}:{n}") for n, row in rows[1:]]) * MEASURED[measured[0]]
    if len(target) < 2:
        raise FileFormatError("the table holds no approaches", where=str(file), value=len(target))
    if measured[0] == "position_mm":
        value = value - target
    if "direction" in names:
        direction = np.array([_way(row[names.index("direction")], f"{file}:{n}") for n, row in rows[1:]], np.int64)
    else:
        direction = _by_order(target)
    return Approaches(target, value, direction)


def _number(row: list[str], names: list[str], name: str, where: str) -> float:
    text = row[names.index(name)]
    try:
        value = float(text)
    except ValueError as fault:
        raise FileFormatError(f"{name} is no number", where=where, value=text) from fault
    if not math.isfinite(value):
        raise FileFormatError(f"{name} is not finite", where=where, value=text)
    return value


def _way(text: str, where: str) -> int:
    way = _WAYS.get(text.strip().lower())
    if way is None:
        raise FileFormatError("no direction", where=where, value=text, limit="+ or -, up or down")
    return way


def _by_order(target: np.ndarray[tuple[int], np.dtype[np.float64]]) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Direction of each approach by the targets before it; of the first by the one after it."""
    step = np.sign(np.diff(target)).astype(np.int64)
    out = np.zeros(len(target), np.int64)
    out[0] = next((int(one) for one in step if one), UP)
    for k, one in enumerate(step, 1):
        out[k] = one or -out[k - 1]
    return out

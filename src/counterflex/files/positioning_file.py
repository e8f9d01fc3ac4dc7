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
from counterflex.files.small_table import are_columns, read_rows

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
    (number, header), *rows = read_rows(file) or [(1, [])]
    names = [name.strip().lower() for name in header]
    measured = [name for name in MEASURED if name in names]
    if len(measured) != 1 or not are_columns(names, (TARGET,), (TARGET, "direction", *MEASURED, *IGNORED)):
        raise FileFormatError(
            "other columns than those of a test of positioning",
            where=f"{file}:{number}",
            value=",".join(names) or "none",
            limit=f"{TARGET}, one of {', '.join(MEASURED)}, and direction where it is known",
        )
    places = [_row(row, names, f"{file}:{number}") for number, row in rows]
    target, value = (
        np.array([_number(row, name, where) for where, row in places]) * unit
        for name, unit in ((TARGET, MM), (measured[0], MEASURED[measured[0]]))
    )
    if len(target) < 2:
        raise FileFormatError("the table holds no approaches", where=str(file), value=len(target))
    if measured[0] == "position_mm":
        value = value - target
    if "direction" not in names:
        return Approaches(target, value, _by_order(target))
    return Approaches(target, value, np.array([_way(row["direction"], where) for where, row in places], np.int64))


def _row(row: list[str], names: list[str], where: str) -> tuple[str, dict[str, str]]:
    if len(row) != len(names):
        raise FileFormatError("a row of another length", where=where, value=len(row), limit=len(names))
    return where, dict(zip(names, row, strict=True))


def _number(row: dict[str, str], name: str, where: str) -> float:
    text = row[name]
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

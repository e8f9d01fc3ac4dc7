"""Small tables that people write: a header and rows, separated by commas, semicolons or tabs.

A spreadsheet saves what it calls CSV with the separators of its language: semicolons and decimal commas in most of
Europe. Where the header has a semicolon or a tab, that is the separator, and a comma inside a number is its decimal
mark.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from counterflex.core import file_content
from counterflex.core.errors import FileFormatError
from counterflex.core.units import MM

_TOLERANCES: Final = ("feature", "quantity", "tolerance_mm")
_LARGEST_MM: Final = 100.0
_COMMA: Final = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_SEPARATOR: Final = re.compile(r"sep=([,;\t])\s*", re.IGNORECASE)
"""First line by which spreadsheets say their separator."""
_GROUPED: Final = re.compile(r"[+-]?\d{1,3}(?:\.\d{3})+,\d+")


def read_rows(path: str | Path) -> list[tuple[int, list[str]]]:
    """Read the rows of a table; the first one is the header. Blank lines and lines that begin with # are left out.

    Args:
        path: The file, UTF-8.

    Returns:
        Number of the line and cells without blanks around them, decimal points in numbers.

    Raises:
        FileFormatError: The file cannot be read, or a row has decimal commas between commas.
    """
    return rows_of(file_content.text(path, "Save it as CSV, UTF-8"), str(path))


def rows_of(text: str, where: str) -> list[tuple[int, list[str]]]:
    """As :func:`read_rows`, of a text.

    Raises:
        FileFormatError: A row has decimal commas between commas, or a number is grouped by points.
    """
    separator, lines = _separated(text.splitlines(), where)
    with file_content.readable(where, "a table", "Save it as CSV, UTF-8"):
        table = list(csv.reader(lines, delimiter=separator))
    stripped = ((number, [cell.strip() for cell in row]) for number, row in enumerate(table, start=1))
    rows = [(number, cells) for number, cells in stripped if any(cells) and not cells[0].startswith("#")]
    if separator != ",":
        return [(number, [_with_point(cell, f"{where}:{number}") for cell in cells]) for number, cells in rows]
    for number, cells in rows:
        if len(cells) > len(rows[0][1]):
            raise FileFormatError(
                "a row has more cells than the header", where=f"{where}:{number}", value=f"{len(cells)} cells",
                limit=len(rows[0][1]),
                hint="With decimal commas, separate the columns by semicolons; or write decimal points",
            )  # fmt: skip
    return rows


def _separated(lines: list[str], where: str) -> tuple[str, list[str]]:
    """The separator of a table, and its lines without one that states it."""
    stated = _SEPARATOR.fullmatch(lines[0]) if lines else None
    if stated is not None:
        lines = ["", *lines[1:]]
    header = next((line for line in lines if line.strip() and not line.lstrip().startswith("#")), "")
    separator = stated[1] if stated is not None else next((mark for mark in (";", "\t") if mark in header), ",")
    if separator not in header and len(header.split()) > 1:
        raise FileFormatError(
            "the header has no separator", where=where, value=header.strip()[:60], limit="commas, semicolons or tabs"
        )
    return separator, lines


def are_columns(names: Sequence[str], needed: Iterable[str], known: Iterable[str]) -> bool:
    """Return whether the names of a header are known, each stands once, and those that are needed are among them."""
    return set(needed) <= set(names) <= set(known) and len(set(names)) == len(names)


def _with_point(cell: str, where: str) -> str:
    if _GROUPED.fullmatch(cell):
        raise FileFormatError(
            "a number is grouped by points", where=where, value=cell, limit=cell.replace(".", ""),
            hint="Save the table without thousands separators",
        )  # fmt: skip
    return cell.replace(",", ".") if _COMMA.fullmatch(cell) else cell


def number(text: str, where: str, decimal: str = ".") -> float:
    """A finite number with a decimal point, or with a decimal comma where ``decimal`` says so."""
    try:
        value = float(text.strip().replace(decimal, ".") if decimal not in text or "." not in text else text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FileFormatError("not a finite number", where=where, value=repr(text.strip()))
    return value


def read_tolerances(path: str | Path) -> dict[tuple[str, str], float]:
    """Read tolerances of a drawing: columns ``feature,quantity,tolerance_mm``, one row for each quantity.

    Returns:
        (feature, quantity) to permitted deviation, +- m (width of the zone where the nominal value is 0).

    Raises:
        FileFormatError: Missing, not text, other columns, a row twice, or a tolerance that is no size.
    """
    file = Path(path)
    rows = read_rows(file)
    if not rows or tuple(rows[0][1]) != _TOLERANCES:
        raise FileFormatError(
            "other columns than those of tolerances",
            where=f"{file}:{rows[0][0] if rows else 1}",
            value=",".join(rows[0][1]) if rows else "none",
            limit=",".join(_TOLERANCES),
        )
    tolerances: dict[tuple[str, str], float] = {}
    for number, row in rows[1:]:
        where = f"{file}:{number}"
        if len(row) != len(_TOLERANCES):
            raise FileFormatError("a row of another length", where=where, value=len(row), limit=len(_TOLERANCES))
        try:
            size = float(row[2])
        except ValueError as fault:
            raise FileFormatError("tolerance_mm is no number", where=where, value=row[2]) from fault
        if not (math.isfinite(size) and 0.0 < size <= _LARGEST_MM):
            raise FileFormatError(
                "tolerance_mm is no size", where=where, value=row[2], limit=f"above 0, {_LARGEST_MM:g}"
            )
        if (row[0], row[1]) in tolerances:
            raise FileFormatError("the same quantity twice", where=where, value=f"{row[1]} of {row[0]}")
        tolerances[row[0], row[1]] = size * MM
    return tolerances

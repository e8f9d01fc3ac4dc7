"""Small tables that people write: a header and rows, separated by commas, semicolons or tabs.

A spreadsheet saves what it calls CSV with the separators of its language: semicolons and decimal commas in most of
Europe. Where the header has a semicolon or a tab, that is the separator, and a comma inside a number is its decimal
mark.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import Final

from counterflex.core import file_content
from counterflex.core.errors import FileFormatError

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
    lines = text.splitlines()
    stated = _SEPARATOR.fullmatch(lines[0]) if lines else None
    if stated is not None:
        lines[0] = ""
    header = next((line for line in lines if line.strip() and not line.lstrip().startswith("#")), "")
    separator = stated[1] if stated is not None else next((mark for mark in (";", "\t") if mark in header), ",")
    if separator not in header and len(header.split()) > 1:
        raise FileFormatError(
            "the header has no separator", where=where, value=header.strip()[:60], limit="commas, semicolons or tabs"
        )
    out: list[tuple[int, list[str]]] = []
    with file_content.readable(where, "a table", "Save it as CSV, UTF-8"):
        rows = list(csv.reader(lines, delimiter=separator))
    for number, row in enumerate(rows, start=1):
        cells = [cell.strip() for cell in row]
        if not any(cells) or cells[0].startswith("#"):
            continue
        if separator != ",":
            cells = [_with_point(cell, f"{where}:{number}") for cell in cells]
        elif out and len(cells) > len(out[0][1]):
            raise FileFormatError(
                "a row has more cells than the header", where=f"{where}:{number}", value=f"{len(cells)} cells",
                limit=len(out[0][1]),
                hint="With decimal commas, separate the columns by semicolons; or write decimal points",
            )  # fmt: skip
        out.append((number, cells))
    return out


def _with_point(cell: str, where: str) -> str:
    if _GROUPED.fullmatch(cell):
        raise FileFormatError(
            "a number is grouped by points", where=where, value=cell, limit=cell.replace(".", ""),
            hint="Save the table without thousands separators",
        )  # fmt: skip
    return cell.replace(",", ".") if _COMMA.fullmatch(cell) else cell

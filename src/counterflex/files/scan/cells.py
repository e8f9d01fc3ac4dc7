"""Cells of a table as text: separators, decimal marks, grouped digits, marks of missing values."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

MISSING: Final = frozenset(
    {"", "*", "**", "***", "****", "-", "--", "---", "nan", "n/a", "na", "#n/a", "null", "none", "missing", "?"}
)
"""Cells of a point that was not measured: PolyWorks writes ``*``, spreadsheets ``#N/A``."""
_GROUPED: Final = {
    mark: re.compile(rf"[+-]?\d{{1,3}}(?:{re.escape(mark)}\d{{3}})+(?:[.,]\d*)?(?:[eE][+-]?\d+)?")
    for mark in (",", ".", "'", " ", "\u00a0", "\u202f", "\u2019")
}
_SHAPE: Final = re.compile(r"[+-]?[\d.,' \u00a0\u202f\u2019]*\d[\d.,' \u00a0\u202f\u2019]*(?:[eE][+-]?\d+)?")


@dataclass(frozen=True)
class Decimals:
    """Form in which numbers are written."""

    comma: bool = False
    group: str = ""  # Mark between groups of three digits, or ""

    @classmethod
    def of(cls, cells: Iterable[str]) -> Decimals:
        """Notation of cells, none of which holds a separator.

        Where a cell has both marks, the last one is the decimal mark. A comma alone is one, unless it stands twice in
        a cell or other cells have a decimal point.
        """
        numbers = [cell for cell in cells if _SHAPE.fullmatch(cell)]
        quote = next((m for m in ("'", " ", "\u00a0", "\u202f", "\u2019") if any(m in c.strip() for c in numbers)), "")
        if any(0 <= c.rfind(".") < c.rfind(",") or c.count(".") > 1 for c in numbers):
            return cls(True, ".")
        point, comma = any("." in c for c in numbers), any("," in c for c in numbers)
        if any(c.count(",") > 1 for c in numbers) or (point and comma):
            return cls(False, ",")
        return cls(comma, quote)

    def number(self, cell: str) -> float | None:
        """Number of a cell; None where it is none in this notation."""
        text = cell
        if self.group and self.group in text:
            if not _GROUPED[self.group].fullmatch(text):
                return None
            text = text.replace(self.group, "")
        if self.comma:
            if "." in text:
                return None
            text = text.replace(",", ".")
        try:
            return float(text) if "_" not in text else None
        except ValueError:
            return None

    @property
    def plain(self) -> bool:
        """True where a number is written with a point and nothing else."""
        return not self.comma and not self.group


def split(line: str, separator: str | None) -> list[str]:
    """Cells of a line; separators within quotes are none."""
    if separator is not None and '"' in line:
        return [cell.strip() for cell in next(csv.reader([line.strip()], delimiter=separator), [])]
    return [cell.strip().strip('"') for cell in line.strip().split(separator)]

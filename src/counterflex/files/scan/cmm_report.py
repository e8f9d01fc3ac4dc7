"""Reports of coordinate measuring machines that give a point in more than one cell per axis.

Two forms are read: one row for each axis under a header (``Feature, Axis, Nominal, Actual`` or ``AX NOMINAL MEAS``),
and ``P1, X=1.5, Y=2.5, Z=3.5`` on one line or on several. Rows of other axes (D, R, A) belong to features whose centre
lies on no surface: these are left out.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.errors import FileFormatError
from counterflex.files.scan.number_lines import MISSING, Decimals, split
from counterflex.files.scan.scan import UNITS, PointStore, Scan

_AXES: Final = ("x", "y", "z")
_MEASURED: Final = re.compile(r"(?<![a-z])(?:meas|act|ist)")
_GIVEN: Final = re.compile(
    r"(?<![A-Za-z0-9_])([A-Za-z]{1,2})\s*[=:]\s*([+-]?[\d.,']+(?:[eE][+-]?\d+)?|\*+)(?![A-Za-z0-9])"
)
_UNIT: Final = re.compile(r"\bunits?\s*[=:]\s*(mm|in|inch|inches|cm|m|um)\b", re.IGNORECASE)
_SAMPLE: Final = 400


@dataclass(frozen=True)
class RowsOfAxes:
    """Places of the cells of a report with one row for each axis."""

    separator: str | None  # Between cells; None: any space
    axis: int
    value: int
    label: int | None  # Column of the name of the point, or None

    @classmethod
    def of(cls, rows: list[list[str]], axis: int, separator: str | None, where: str) -> RowsOfAxes:
        """Find the columns of the report by its header."""
        first = next(k for k, row in enumerate(rows) if len(row) > axis and row[axis].lower() in _AXES)
        label = axis - 1 if axis > 0 else None
        decimals = Decimals.of([cell for row in rows[first : first + 60] for cell in row])
        numeric = [k for k in range(axis + 1, len(rows[first])) if decimals.number(rows[first][k]) is not None]
        named = [[k for k, cell in enumerate(row) if _MEASURED.search(cell.lower())] for row in reversed(rows[:first])]
        for columns in (*named, numeric):
            if len(columns) == 1 and columns[0] in numeric:
                return cls(separator, axis, columns[0], label)
        raise FileFormatError(
            "the report has one row for each axis, and its header does not say which value was measured",
            where=where,
            value=", ".join(rows[max(first - 1, 0)])[:60],
            limit="one column named Actual, Measured or Meas",
        )


@dataclass
class _Points:
    """Gathers axes into points: a new one begins where an axis comes again or the name changes."""

    points: list[list[float]] = field(default_factory=list)
    left_out: int = 0
    _label: str = ""
    _now: dict[str, float] = field(default_factory=dict)

    def add(self, label: str, axis: str, value: float) -> None:
        if axis in self._now or (label and self._label and label != self._label):
            self.end()
        self._label = label or self._label
        self._now[axis] = value

    def end(self) -> None:
        if set(_AXES) == set(self._now):
            self.points.append([self._now[axis] for axis in _AXES])
        elif self._now:
            self.left_out += 1
        self._now = {}
        self._label = ""


def rows_of_axes(lines: list[str], where: str) -> RowsOfAxes | None:
    """Layout of a report with one row for each axis; None where a text is none.

    Raises:
        FileFormatError: It is one, and its header does not say which value was measured.
    """
    for separator in (";", "\t", ",", "|", None):
        rows = [split(line, separator) for line in lines[:_SAMPLE] if line.strip()]
        for column in range(3):
            letters = [row[column].lower() for row in rows if len(row) > column + 1]
            if all(letters.count(axis) >= 1 for axis in _AXES) and sum(one in _AXES for one in letters) >= 0.3 * len(
                letters
            ):
                return RowsOfAxes.of(rows, column, separator, where)
    return None


def read_rows_of_axes(path: Path, lines: Iterable[str], layout: RowsOfAxes) -> Scan:
    """Read a report with one row for each axis.

    Raises:
        FileFormatError: A measured value is no number, or no point has all three axes.
    """
    gathered, unit, decimals = _Points(), None, None
    every = list(lines)
    for number, line in enumerate(every, 1):
        unit = _unit(line, unit)
        row = split(line, layout.separator)
        if len(row) <= max(layout.axis, layout.value) or not re.fullmatch(r"[A-Za-z]{1,2}", row[layout.axis]):
            gathered.end()
            continue
        if decimals is None:
            decimals = Decimals.of([split(one, layout.separator)[-1] for one in every[:_SAMPLE] if one.strip()] + row)
        cell = row[layout.value]
        value = np.nan if cell.lower() in MISSING else decimals.number(cell)
        axis = row[layout.axis].lower()
        if value is None:
            if axis in _AXES:
                raise FileFormatError(f"{cell[:30]!r} is no number", where=f"{path}:{number}", value=line.strip()[:60])
            continue
        gathered.add("" if layout.label is None else row[layout.label], axis, value)
    return _scan(path, gathered, "report of a measuring machine, one row for each axis", unit)


def gives_axes(lines: list[str]) -> bool:
    """Return whether a text gives its points as ``X=.. Y=.. Z=..``."""
    text = "\n".join(line for line in lines[:_SAMPLE] if not line.lstrip().startswith("#"))
    letters = [match[1].lower() for match in _GIVEN.finditer(text)]
    return all(axis in letters for axis in _AXES)


def read_given_axes(path: Path, lines: Iterable[str]) -> Scan:
    """Read points given as ``P1, X=1.5, Y=2.5, Z=3.5``, on one line or on several.

    Raises:
        FileFormatError: A value is no number, or no point has all three axes.
    """
    gathered, unit = _Points(), None
    for number, line, given in _given(lines):
        unit = _unit(line, unit)
        if not given and line.strip():
            gathered.end()
        decimals = Decimals.of([text for _, text in given])
        for axis, text in given:
            value = np.nan if text in MISSING else decimals.number(text)
            if value is None:
                raise FileFormatError(f"{text[:30]!r} is no number", where=f"{path}:{number}", value=line.strip()[:60])
            gathered.add("", axis, value)
        if {axis for axis, _ in given} >= set(_AXES):
            gathered.end()
    return _scan(path, gathered, "report of a measuring machine, X= Y= Z=", unit)


def _given(lines: Iterable[str]) -> Iterator[tuple[int, str, list[tuple[str, str]]]]:
    for number, line in enumerate(lines, 1):
        yield number, line, [(m[1].lower(), m[2].rstrip(",.")) for m in _GIVEN.finditer(line)]


def _unit(line: str, unit: str | None) -> str | None:
    match = _UNIT.search(line)
    if match is None:
        return unit
    return {"in": "inch", "inches": "inch"}.get(match[1].lower(), match[1].lower())


def _scan(path: Path, gathered: _Points, kind: str, unit: str | None) -> Scan:
    gathered.end()
    if not gathered.points:
        raise FileFormatError(
            "no point of the report has x, y and z",
            where=str(path),
            value=f"{gathered.left_out} features of other axes" if gathered.left_out else None,
            hint="Points on surfaces are judged; centres of circles lie on none",
        )
    left_out = f", {gathered.left_out} features that are no points left out" if gathered.left_out else ""
    store = PointStore(path, kind + left_out)
    store.add(np.array(gathered.points))
    return store.scan(None if unit is None else UNITS[unit])

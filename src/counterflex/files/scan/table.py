"""Points in a table of text: ASC, XYZ, PTS, TXT, CSV, with a header or without."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.files.scan.cmm_report import gives_axes, read_given_axes, read_rows_of_axes, rows_of_axes
from counterflex.files.scan.number_lines import MISSING, Decimals, line_blocks, numbers, separators, split, text_stream
from counterflex.files.scan.scan import UNITS, PointStore, Scan

_HEAD: Final = 1 << 16
_SAMPLE: Final = 200
_NOMINAL: Final = ("nom", "theo", "soll", "target", "cad")
_DEVIATION: Final = ("dev", "err", "diff", "delta", "abw", "sigma", "tol", "dx", "dy", "dz")
_MEASURED: Final = ("meas", "act", "ist", "actual")
_COLUMN_WORDS: Final = (*_NOMINAL, *_DEVIATION, *_MEASURED, "axis", "feature", "value", "radius", "theta", "phi")
_AXIS: Final = re.compile(r"(?:pos|coord|p|pt|point)?([xyz])(?:\d|pos|coord|coordinate|axis)?")
_UNIT_WORDS: Final = {"in": "inch", "inches": "inch", "inch": "inch", **{name: name for name in UNITS}}
_CELLS: Final = re.compile(rb'"|[,;\t|][ ]*[,;\t|\n]|[nN]/[aA]|null|none|(?<![\w.])-+(?![\d.])')
"""What makes a block be read cell by cell: quotes, empty cells, words for a missing value."""
_MARKS: Final = re.compile(rb"(?<![^\s,;|])\*+(?![^\s,;|])")  # Points that were not measured, as PolyWorks writes them


@dataclass(frozen=True)
class _Layout:
    """Places of the points in the lines."""

    skipped: int  # Lines before the first row
    columns: int
    xyz: tuple[int, int, int]  # Which of them are x, y, z
    separator: str | None  # Between fields; None: any space
    decimals: Decimals
    plain: bool  # Every field is a number without quotes
    unit: str | None  # Name of the unit in the header, or None
    count: int | None  # Number of rows that the first line announces, or None

    @classmethod
    def of(cls, lines: list[str], path: Path) -> _Layout:
        """Find out how the table is laid out."""
        rows = [k for k, line in enumerate(lines) if line.strip() and not _is_comment(line)]
        first, separator, decimals = _first_row(lines, rows, path)
        words = split(lines[first], separator)
        header, count = _above(lines[:first], words, separator)
        named = None if header is None else _named_columns(header, len(words), separator, decimals, path)
        numeric = [k for k, word in enumerate(words) if decimals.number(word) is not None]
        x, y, z = numeric[_counts_up([lines[k] for k in rows if k >= first][:_SAMPLE], separator, numeric) :][:3]
        xyz, unit = ((x, y, z), None) if named is None else named
        holds = {*numeric, *(k for k, word in enumerate(words) if word.lower() in MISSING)}
        plain = '"' not in lines[first] and len(holds) == len(words)
        return cls(first, len(words), xyz, separator, decimals, plain, unit, count)


def read_table(path: Path) -> Scan:
    """Read x, y, z of a table.

    Columns are found by a header (``x``, ``y_mm``, ``Meas X``, ``X [in]``; nominal values, deviations and normals
    beside them are left out); without one the first three numbers of a line count, behind a number that counts the
    lines. A first line of one whole number is
    the number of points (PTS). Rows with a mark for a missing value (``*``) are counted and left out. Reports with one
    row for each axis, or with ``X=.. Y=.. Z=..``, are translation by their lines.

    Raises:
        FileFormatError: No numbers, a word in place of one, lines of different length, another number of points than
            announced, or a header without x, y, z.
    """
    with text_stream(path) as stream:
        head = stream.read(_HEAD)
    lines = _lines(head, path)
    if gives_axes(lines):
        return read_given_axes(path, _whole(path))
    report = rows_of_axes(lines, str(path))
    if report is not None:
        return read_rows_of_axes(path, _whole(path), report)
    layout = _Layout.of(lines, path)
    store = PointStore(path, "table of points")
    rows = 0
    for block in _rows(path, layout):
        rows += len(block)
        store.add(block)
    if layout.count is not None and rows != layout.count:
        raise FileFormatError(
            "the number of points is not the one in the first line", where=str(path), value=rows, limit=layout.count
        )
    return store.scan(None if layout.unit is None else UNITS[layout.unit])


def _whole(path: Path) -> list[str]:
    """Lines of a report, which has some thousand of them at most."""
    with text_stream(path) as stream:
        return stream.read().decode("utf-8", "replace").splitlines()


def _lines(head: bytes, path: Path) -> list[str]:
    """The first lines of a text."""
    if b"\x00" in head:
        raise FileFormatError("the file is binary and of no known format", where=str(path), hint=FORMATS)
    lines = head.removeprefix(b"\xef\xbb\xbf").decode("utf-8", "replace").splitlines()
    if len(head) == _HEAD and len(lines) > 1:
        lines = lines[:-1]  # the last one may be cut off
    return lines


def _first_row(lines: list[str], rows: list[int], path: Path) -> tuple[int, str | None, Decimals]:
    """The first line with three numbers, its separator, and how numbers are written."""
    if not rows:
        raise FileFormatError("the file is empty", where=str(path), hint=FORMATS)
    for k in rows:
        if (match := _separator(lines, rows, k)) is not None:
            return k, *match
    line = lines[rows[0]].strip()[:60]
    raise FileFormatError("no line holds three numbers", where=str(path), value=line, hint=FORMATS)


def _named_columns(
    header: list[str], count: int, separator: str | None, decimals: Decimals, path: Path
) -> tuple[tuple[int, int, int], str | None] | None:
    """Columns and unit that the header names, or None."""
    named = _columns(header, path)
    if named is None and _names_columns(header, count, separator, decimals):
        raise FileFormatError(
            "the header names no columns of x, y and z",
            where=str(path),
            value=", ".join(header)[:80],
            hint="Name them x, y, z, or leave the header out where the first three numbers are x, y, z",
        )
    return named


def _above(lines: list[str], words: list[str], separator: str | None) -> tuple[list[str] | None, int | None]:
    """Header and announced number of rows, as far as the lines above the first row state them."""
    rows = [line for line in lines if line.strip() and not _is_comment(line)]
    count = int(rows[-1]) if rows and rows[-1].strip().isdigit() else None
    if rows and count is None:
        return split(rows[-1], separator), None
    comments = [line.lstrip("#/ \t") for line in lines if _is_comment(line)]
    header = split(comments[-1], separator) if comments else []
    return header if len(header) == len(words) else None, count


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(("#", "//"))


def _counts_up(lines: list[str], separator: str | None, numeric: list[int]) -> bool:
    """Return whether the first of four or more numbers is that of the line: whole, and one more from line to line."""
    if len(numeric) < 4 or len(lines) < 3:
        return False
    cells = [row[numeric[0]] for row in (split(line, separator) for line in lines) if len(row) > numeric[0]]
    if not all(cell.isdigit() for cell in cells):
        return False
    return all(int(after) == int(before) + 1 for before, after in itertools.pairwise(cells))


def _names_columns(header: list[str], columns: int, separator: str | None, decimals: Decimals) -> bool:
    """Return whether a line above the first row names its columns, and is no title."""
    if len(header) != columns or any(decimals.number(cell) is not None for cell in header):
        return False
    return separator is not None or any(word.lower().startswith(_COLUMN_WORDS) for word in header)


FORMATS: Final = (
    "Read are PLY, STL, OBJ, tables of x y z (ASC, XYZ, PTS, TXT, CSV), PTX, E57, PCD, LAS and LAZ, DMIS output and QIF"
)


def _separator(lines: list[str], rows: list[int], first: int) -> tuple[str | None, Decimals] | None:
    """Separator of a line that holds at least three numbers, and how they are written in it and the lines after it."""
    for separator in (";", "\t", "|", None, ","):
        some = [split(lines[k], separator) for k in rows if k >= first][:_SAMPLE]
        if len(some[0]) < 3:
            continue
        decimals = (
            Decimals() if separator == "," and '"' not in lines[first] else Decimals.of(c for row in some for c in row)
        )
        if sum(decimals.number(word) is not None for word in some[0]) >= 3:
            return separator, decimals
    return None


def _columns(header: list[str], path: Path) -> tuple[tuple[int, int, int], str | None] | None:
    """Columns of measured x, y, z and their unit; None where no word of the header is an axis."""
    place: dict[str, list[tuple[bool, int]]] = {"x": [], "y": [], "z": []}
    unit = None
    for k, name in enumerate(header):
        words = [word for word in re.split(r"[^a-z0-9]+", name.lower()) if word]
        axis = next((letter[1] for word in words if (letter := _AXIS.fullmatch(word))), None)
        if axis is None or any(word.startswith((*_NOMINAL, *_DEVIATION)) for word in words):
            continue
        unit = next((_UNIT_WORDS[word] for word in words if word in _UNIT_WORDS), unit)
        place[axis].append((any(word.startswith(_MEASURED) for word in words), k))
    if not any(place.values()):
        return None
    x, y, z = (_measured(axis, place[axis], header, path) for axis in "xyz")
    return (x, y, z), unit


def _measured(axis: str, named: list[tuple[bool, int]], header: list[str], path: Path) -> int:
    """Column of an axis: the only one of those that say that they were measured, or of all."""
    measured = [k for stated, k in named if stated] or [k for _, k in named]
    if len(measured) != 1:
        raise FileFormatError(
            f"the header names {'no' if not measured else 'several'} columns of measured {axis}",
            where=str(path),
            value=", ".join(header)[:80],
            hint="Name them x, y, z, or Meas X, Meas Y, Meas Z beside Nom X, Nom Y, Nom Z",
        )
    return measured[0]


def _rows(path: Path, layout: _Layout) -> Iterator[Float]:
    """Points of the file, block by block."""
    line, translation = 1, separators(layout.decimals)
    with text_stream(path) as stream:
        for block in line_blocks(stream):
            lines = block.count(b"\n")
            if line == 1:
                block = block.removeprefix(b"\xef\xbb\xbf")
                block = b"\n" * layout.skipped + block.split(b"\n", layout.skipped)[-1]
            if layout.plain and translation is not None and _CELLS.search(block) is None:
                marked = _MARKS.sub(b"nan", block) if b"*" in block else block
                yield numbers(marked, layout.columns, translation, path, line)[:, layout.xyz]
            else:
                yield _labelled(block, layout, path, line)
            line += lines


def _labelled(block: bytes, layout: _Layout, path: Path, first_line: int) -> Float:
    """Points of lines that also hold words."""
    rows = []
    for number, line in enumerate(block.decode("utf-8", "replace").split("\n"), first_line):
        if not line.strip() or line.lstrip().startswith(("#", "//")):
            continue
        words = split(line, layout.separator)
        if len(words) <= max(layout.xyz):
            raise FileFormatError(
                "the line has fewer columns than the first", where=f"{path}:{number}", value=line.strip()[:60]
            )
        cells = [words[k] for k in layout.xyz]
        row = [np.nan if cell.lower() in MISSING else layout.decimals.number(cell) for cell in cells]
        if None in row:
            wrong = cells[row.index(None)]
            raise FileFormatError(f"{wrong[:30]!r} is no number", where=f"{path}:{number}", value=line.strip()[:60])
        rows.append(row)
    return np.array(rows, dtype=np.float64).reshape(-1, 3)

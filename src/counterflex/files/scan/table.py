"""Points in a table of text: ASC, XYZ, PTS, TXT, CSV, with a header or without."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.files.scan.number_lines import DECIMAL_COMMAS, SPACES, line_blocks, numbers
from counterflex.files.scan.scan import UNITS, PointStore, Scan

_HEAD: Final = 1 << 16
_DECIMAL_COMMA: Final = re.compile(r"\d,\d")
_NOMINAL: Final = ("nom", "theo", "soll", "target", "cad")
_DEVIATION: Final = ("dev", "err", "diff", "delta", "abw", "sigma", "tol", "dx", "dy", "dz")
_MEASURED: Final = ("meas", "act", "ist", "actual")
_UNIT_WORDS: Final = {"in": "inch", "inches": "inch", "inch": "inch", **{name: name for name in UNITS}}


@dataclass(frozen=True)
class _Layout:
    """Where the points stand in the lines.

    Attributes:
        skipped: Lines before the first row.
        columns: Fields in a line.
        xyz: Which of them are x, y, z.
        table: Translation of separators.
        separator: Between fields; None: any space.
        plain: Every field is a number.
        unit: Name of the unit in the header, or None.
        count: Number of rows that the first line announces, or None.
    """

    skipped: int
    columns: int
    xyz: tuple[int, int, int]
    table: bytes
    separator: str | None
    plain: bool
    unit: str | None
    count: int | None


def read_table(path: Path) -> Scan:
    """Read x, y, z of a table.

    Columns are found by a header (``x``, ``y_mm``, ``Meas X``, ``X [in]``; nominal values, deviations and normals
    beside them are left out); without one the first three numbers of a line count. A first line of one whole number is
    the number of points (PTS).

    Raises:
        FileFormatError: No numbers, a word in place of one, lines of different length, another number of points than
            announced, or a header without x, y, z.
    """
    with path.open("rb") as stream:
        layout = _layout(stream.read(_HEAD), path)
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


def _layout(head: bytes, path: Path) -> _Layout:
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise FileFormatError("the text is UTF-16", where=str(path), hint="Save it as UTF-8 or ASCII")
    if b"\x00" in head:
        raise FileFormatError("the file is binary and of no known format", where=str(path), hint=_FORMATS)
    text = head.removeprefix(b"\xef\xbb\xbf").decode("utf-8", "replace")
    lines = text.splitlines()
    if len(head) == _HEAD and len(lines) > 1:
        lines = lines[:-1]  # the last one may be cut off
    rows = [k for k, line in enumerate(lines) if line.strip() and not line.lstrip().startswith(("#", "//"))]
    first = next((k for k in rows if _fields(lines[k]) is not None), None)
    if first is None:
        what = "the file is empty" if not rows else "no line holds three numbers"
        raise FileFormatError(what, where=str(path), value=lines[rows[0]].strip()[:60] if rows else None, hint=_FORMATS)
    separator, comma = _fields(lines[first]) or (None, False)
    words = _split(lines[first], separator)
    before = [lines[k] for k in rows if k < first]
    count = int(before[-1]) if before and before[-1].strip().isdigit() else None
    header = None if not before or count is not None else _split(before[-1], separator)
    comments = [line.lstrip("#/ \t") for line in lines[:first] if line.lstrip().startswith(("#", "//"))]
    if header is None and comments and len(_split(comments[-1], separator)) == len(words):
        header = _split(comments[-1], separator)
    numeric = [k for k, word in enumerate(words) if _number(word, comma) is not None]
    xyz, unit = (numeric[0], numeric[1], numeric[2]), None
    if header is not None:
        named = _columns(header, path)
        if named is not None:
            xyz, unit = named
    table = DECIMAL_COMMAS if comma else SPACES
    plain = len(numeric) == len(words)
    return _Layout(first, len(words), xyz, table, separator, plain, unit, count)


_FORMATS: Final = "Read are PLY, STL, OBJ, tables of x y z (ASC, XYZ, PTS, TXT, CSV), DMIS output and QIF"


def _split(line: str, separator: str | None) -> list[str]:
    words = line.strip().split(separator)
    return [word.strip().strip('"') for word in words]


def _number(word: str, comma: bool) -> float | None:
    try:
        return float(word.replace(",", ".") if comma else word)
    except ValueError:
        return None


def _fields(line: str) -> tuple[str | None, bool] | None:
    """Separator of a line that holds at least three numbers, and whether its decimals have a comma."""
    for separator in (";", "\t", None, ","):
        words = _split(line, separator)
        comma = separator != "," and any(_DECIMAL_COMMA.search(word) for word in words) and "." not in line
        if sum(_number(word, comma) is not None for word in words) >= 3:
            return separator, comma
    return None


def _columns(header: list[str], path: Path) -> tuple[tuple[int, int, int], str | None] | None:
    """Columns of measured x, y, z and their unit; None where no word of the header is an axis."""
    place: dict[str, list[tuple[bool, int]]] = {"x": [], "y": [], "z": []}
    unit = None
    for k, name in enumerate(header):
        words = [word for word in re.split(r"[^a-z0-9]+", name.lower()) if word]
        axis = next((word for word in words if word in place), None)
        if axis is None:
            continue
        if any(word.startswith((*_NOMINAL, *_DEVIATION)) for word in words):
            continue
        unit = next((_UNIT_WORDS[word] for word in words if word in _UNIT_WORDS), unit)
        place[axis].append((any(word.startswith(_MEASURED) for word in words), k))
    if not any(place.values()):
        return None
    chosen = []
    for axis, named in place.items():
        measured = [k for stated, k in named if stated] or [k for _, k in named]
        if len(measured) != 1:
            raise FileFormatError(
                f"the header names {'no' if not measured else 'several'} columns of measured {axis}",
                where=str(path),
                value=", ".join(header)[:80],
                hint="Name them x, y, z, or Meas X, Meas Y, Meas Z beside Nom X, Nom Y, Nom Z",
            )
        chosen.append(measured[0])
    return (chosen[0], chosen[1], chosen[2]), unit


def _rows(path: Path, layout: _Layout) -> Iterator[Float]:
    """Points of the file, block by block."""
    line = 1
    with path.open("rb") as stream:
        for block in line_blocks(stream):
            lines = block.count(b"\n")
            if line == 1:
                block = block.removeprefix(b"\xef\xbb\xbf")
                block = b"\n" * layout.skipped + block.split(b"\n", layout.skipped)[-1]
            if layout.plain:
                values = numbers(block, layout.columns, layout.table, path, line)
            else:
                values = _labelled(block, layout, path, line)
            yield values[:, layout.xyz] if layout.plain else values
            line += lines


def _labelled(block: bytes, layout: _Layout, path: Path, first_line: int) -> Float:
    """Points of lines that also hold words."""
    comma = layout.table is DECIMAL_COMMAS
    rows = []
    for number, line in enumerate(block.decode("utf-8", "replace").split("\n"), first_line):
        if not line.strip() or line.lstrip().startswith(("#", "//")):
            continue
        words = _split(line, layout.separator)
        if len(words) <= max(layout.xyz):
            raise FileFormatError(
                "the line has fewer columns than the first", where=f"{path}:{number}", value=line.strip()[:60]
            )
        row = [_number(words[k], comma) for k in layout.xyz]
        if None in row:
            wrong = words[layout.xyz[row.index(None)]]
            raise FileFormatError(f"{wrong[:30]!r} is no number", where=f"{path}:{number}", value=line.strip()[:60])
        rows.append(row)
    return np.array(rows, dtype=np.float64).reshape(-1, 3)

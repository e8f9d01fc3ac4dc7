"""Tables of measured data as laboratories write them: CSV of any habit, or Parquet, with the line of every row kept.

Cells stay text until a channel asks for them, so that columns nobody needs may hold anything.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl

from counterflex.core import file_content
from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import FileFormatError
from counterflex.core.similar import close_to
from counterflex.files.dataset.instrument_files import instrument_columns
from counterflex.files.dataset.manifest import FileTable

_SHOWN: Final = 16
"""Columns of a file that are named where one is not there."""
_NUMBER: Final = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_MISSING: Final = frozenset({"", "nan", "#n/a", "n/a", "na", "#nv", "null", "none", "-", "--"})
"""Cells that hold no number, as spreadsheets and instruments write them."""
_SPACES: Final = str.maketrans({"\u00a0": " ", "\u202f": " ", "\u2009": " ", "\u2212": "-"})
_BOMS: Final = ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"), (b"\xef\xbb\xbf", "utf-8-sig"))
_WORKBOOKS: Final = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1")  # First bytes of .xlsx and .ods, and of .xls
_MARK_NAMES: Final = {"\t": "tab"}
Reference = str | int
"""A column: text of its header, or its number from 1."""

_COMMA_GROUPS: Final = r"[+-]?\d{1,3}(,\d{3})+\Z"
_DECIMAL_COMMA: Final = r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?\Z"
_DECIMAL_POINT: Final = r"[+-]?\d*\.\d+(?:[eE][+-]?\d+)?\Z"
_GROUPS: Final = r"[+-]?\d{1,3}([ '.,])\d{3}(\1\d{3})*.*\Z"
_OTHER_NOTATION: Final = r"(?:[+-]?\d[\d.,]*[dD][+-]?\d+|0[xX][0-9a-fA-F]+)\Z"
_WITH_UNIT: Final = r"[+-]?\d[\d.,]*\s*[A-Za-z°%]"


@dataclass(frozen=True, eq=False)
class TextTable:
    """Rows of one file."""

    path: Path
    how: FileTable
    header: tuple[str, ...]  # Names of the columns, stripped; ``#1``, ``#2`` without a header line
    lines: Int  # (n,) line of the file on which each row begins
    columns: tuple[Sequence[str] | Float, ...]  # Cells of each column, stripped
    data: bytes = field(repr=False, default=b"")  # The bytes of the file, for the fingerprint

    def __len__(self) -> int:
        return len(self.lines)

    def find(self, reference: Reference, where: str) -> int:
        """Place of a column. Raises FileFormatError: there is none, or two of the name."""
        if isinstance(reference, int):
            if reference > len(self.header):
                raise FileFormatError(
                    "there is no such column",
                    where=where,
                    value=f"number {reference}",
                    limit=f"1..{len(self.header)} in {self.path.name}",
                )
            return reference - 1
        requested = reference.removeprefix(self.how.prefix) if self.how.prefix else reference
        places = [i for i, name in enumerate(self.header) if name == requested.strip()]
        if len(places) == 1:
            return places[0]
        if places:
            raise FileFormatError(
                "two columns have the same header",
                where=where,
                value=repr(reference),
                limit=f"one column in {self.path.name}",
                hint=f"Name it by its number instead: {' or '.join(str(i + 1) for i in places)}",
            )
        raise FileFormatError(
            f"{self.path.name} has no such column", where=where, value=repr(reference), hint=self._hint(requested)
        )

    def _hint(self, column: str) -> str:
        other = _other_separator(self.how, self.header)
        if other is not None:
            return f"The file has one column only. {other}"
        close = close_to(column, self.header, 1)
        shown = ", ".join(self.header[:_SHOWN]) + (", ..." if len(self.header) > _SHOWN else "")
        return (f"Did you mean '{close[0]}'? " if close else "") + f"Columns: {shown}"

    def numbers(self, place: int) -> tuple[Float, Bool]:
        """Numbers of a column and which rows have none.

        Returns:
            (n,) numbers, NaN where there is none; (n,) True there.

        Raises:
            FileFormatError: A cell holds something else.
        """
        cells = self.columns[place]
        if isinstance(cells, np.ndarray):
            return cells, ~np.isfinite(cells)
        missing = _MISSING | {mark.lower() for mark in self.how.missing}
        out = np.empty(len(cells))
        decimal, thousands = self.how.decimal, self.how.thousands
        grouped = re.compile(rf"[+-]?\d{{1,3}}(?:{re.escape(thousands)}\d{{3}})+(?!\d)") if thousands else None
        for row, cell in enumerate(cells):
            text = cell
            if text.lower() in missing:
                out[row] = np.nan
                continue
            if grouped is not None and thousands in text:
                match = grouped.match(text)
                if match is None or thousands in text[match.end() :]:
                    raise self._fault(place, row, cell)
                text = text[: match.end()].replace(thousands, "") + text[match.end() :]
            if decimal == ",":
                if "." in text:
                    raise self._fault(place, row, cell)
                text = text.replace(",", ".")
            if _NUMBER.fullmatch(text):
                out[row] = float(text)
            else:
                raise self._fault(place, row, cell)
        too_large = np.isinf(out)
        if np.any(too_large):
            raise self._fault(place, int(np.argmax(too_large)), cells[int(np.argmax(too_large))])
        return out, np.isnan(out)

    def words(self, place: int) -> list[str]:
        """Cells of a column as text."""
        return [str(cell) for cell in self.columns[place]]

    def place_of(self, column: int, row: int) -> str:
        """Return where a cell stands, for messages."""
        return f"{self.path}:{int(self.lines[row])}: column '{self.header[column]}'"

    def _fault(self, place: int, row: int, cell: str) -> FileFormatError:
        how, line = self.how, int(self.lines[row])
        mark = cell.lstrip("+-0123456789")[:1]
        hints = (
            (how.separator == ",", _COMMA_GROUPS, 'Does it group digits? Write thousands = "," into the manifest'),
            (how.decimal == ".", _DECIMAL_COMMA, 'Is it a decimal comma? Write decimal = "," into the manifest'),
            (how.decimal == ",", _DECIMAL_POINT, 'Is it a decimal point? Write decimal = "." into the manifest, or '
                                                 'thousands = "." if it groups digits'),
            (not how.thousands, _GROUPS, f'Does it group digits? Write thousands = "{mark}" into the manifest'),
            (True, _OTHER_NOTATION, "Write it as 1234.5 or 1.2345E3"),
            (not how.header_line and row == 0, "", f"Does the file have a header? header_line = {line}"),
            (True, _WITH_UNIT, "Units belong into the manifest, not into the cells"),
            (row == 0, "", f"A second line of headers or units is left out by skip_lines = [{line}]"),
            (True, "", "A mark for missing values is declared by missing = [...] in the manifest"),
        )  # fmt: skip
        return FileFormatError(
            "the cell is not a number",
            where=self.place_of(place, row),
            value=repr(cell if len(cell) <= 40 else cell[:40] + "..."),
            limit=f"a number with decimal '{how.decimal}'",
            hint=next(hint for applies, pattern, hint in hints if applies and re.match(pattern, cell)),
        )


def read_table(path: Path, how: FileTable) -> TextTable:
    """Read one file.

    Args:
        path: CSV (or any text with a separator), Parquet by its ending ``.parquet``, or a file of an instrument
            (:mod:`counterflex.files.dataset.instrument_files`).

    Raises:
        FileFormatError: Missing, not readable, rows with too many cells, no rows.
    """
    data = file_content.content(path)
    if data.startswith(_WORKBOOKS):
        raise FileFormatError(
            "a spreadsheet workbook is not read",
            where=str(path),
            limit="text (CSV) or Parquet",
            hint="Save the sheet as CSV (UTF-8); separator and decimal go into the manifest",
        )
    columns = instrument_columns(path, data, how.part)
    if columns is not None:
        if len(columns.lines) == 0:
            raise FileFormatError("the file has no rows", where=str(path))
        return TextTable(path, how, columns.names, columns.lines, columns.values, data)
    if how.part is not None:
        raise FileFormatError(
            "the file has no parts", where=f"{path}: part", value=repr(how.part), limit="for .lvm, .tdms and .mat"
        )
    table = _parquet(path, how, data) if path.suffix.lower() == ".parquet" else _text(path, how, data)
    if len(table) == 0:
        raise FileFormatError("the file has no rows", where=str(path), hint="Check header_line and skip_lines")
    return table


def _parquet(path: Path, how: FileTable, data: bytes) -> TextTable:
    frame = file_content.parquet(path, data)
    columns: list[Sequence[str] | Float] = []
    for name, kind in frame.schema.items():
        if kind.is_numeric():
            columns.append(frame[name].cast(pl.Float64).fill_null(float("nan")).to_numpy().astype(np.float64))
        else:
            columns.append([_clean(str(cell)) if cell is not None else "" for cell in frame[name].to_list()])
    lines = np.arange(1, frame.height + 1, dtype=np.int64)
    return TextTable(path, how, tuple(frame.columns), lines, tuple(columns), data)


def _decode(path: Path, how: FileTable, data: bytes) -> str:
    encoding = next((name for mark, name in _BOMS if data.startswith(mark)), how.encoding)
    try:
        return data.decode(encoding)
    except LookupError as fault:
        raise FileFormatError("there is no such encoding", where=str(path), value=repr(encoding)) from fault
    except UnicodeDecodeError as fault:
        line = data[: fault.start].count(b"\n") + 1
        raise FileFormatError(
            f"the file is not written in {encoding}",
            where=f"{path}:{line}",
            value=f"byte 0x{data[fault.start]:02x}",
            hint='Files from spreadsheets are often encoding = "cp1252"',
        ) from fault


def _clean(cell: str) -> str:
    return cell.translate(_SPACES).strip()


def _text(path: Path, how: FileTable, data: bytes) -> TextTable:
    text = _decode(path, how, data)
    if "\0" in text:
        raise FileFormatError("not a text file: it contains zero bytes", where=str(path))
    header, lines, rows = _rows(path, how, text)
    if not text.strip():
        raise FileFormatError("the file is empty", where=str(path))
    if how.header_line and header is None:
        count = len(text.splitlines())
        raise FileFormatError(
            "the header line is not in the file",
            where=str(path),
            value=f"line {how.header_line}",
            limit=f"1..{count}",
            hint="Set header_line, or 0 where there is none",
        )
    names = _names(path, how, header, rows)
    for line, row in zip(lines, rows, strict=True):
        while len(row) > len(names) and not row[-1]:
            row.pop()
        if len(row) > len(names):
            raise FileFormatError(
                "the row has more cells than the header",
                where=f"{path}:{line}",
                value=len(row),
                limit=f"at most {len(names)}",
                hint=_too_many(how, names, line),
            )
        row.extend([""] * (len(names) - len(row)))
    columns = tuple(list(column) for column in zip(*rows, strict=True)) if rows else tuple([] for _ in names)
    return TextTable(path, how, names, np.array(lines, dtype=np.int64), columns, data)


def _rows(path: Path, how: FileTable, text: str) -> tuple[list[str] | None, list[int], list[list[str]]]:
    """Cells of the header, if it is there; numbers of the lines that hold data, and their cells."""
    separator = {"tab": "\t", "space": " "}.get(how.separator, how.separator)
    header: list[str] | None = None
    lines: list[int] = []
    rows: list[list[str]] = []
    # One line end for all, so that the count of lines is that of every editor.
    reader = csv.reader(
        io.StringIO(text.replace("\r\n", "\n").replace("\r", "\n"), newline=""),
        delimiter=separator,
        skipinitialspace=separator == " ",
    )
    begin = 1
    try:
        for cells in reader:
            line, begin = begin, reader.line_num + 1
            if line < how.header_line or line in how.skip_lines:
                continue
            if how.comment and cells and cells[0].lstrip().startswith(how.comment):
                continue
            cleaned = [_clean(cell) for cell in cells]
            if line == how.header_line:
                header = cleaned
            elif any(cleaned):
                lines.append(line)
                rows.append(cleaned)
    except csv.Error as fault:
        raise FileFormatError(f"not a readable table: {fault}", where=f"{path}:{reader.line_num}") from fault
    return header, lines, rows


def _other_separator(how: FileTable, names: Sequence[str]) -> str | None:
    """Return what to write where a header of one cell holds the mark of another separator."""
    marks = [mark for mark in (";", "\t", ",", "|") if mark in names[0] and mark != how.separator]
    if len(names) > 1 or not marks:
        return None
    return f'Is its separator another? separator = "{_MARK_NAMES.get(marks[0], marks[0])}"'


def _too_many(how: FileTable, names: Sequence[str], line: int) -> str | None:
    other = _other_separator(how, names)
    if other is not None:
        comma = ' and decimal = ","' if ";" in names[0] and how.separator == "," else ""
        return other + comma
    if len(names) == 1 and how.header_line:
        return (
            f"Line {how.header_line} is taken for the header and has one cell: is it a title? Say which line has the "
            f"names: header_line = {line}"
        )
    return "Is a decimal comma taken for a separator?" if how.separator == "," else None


def _names(path: Path, how: FileTable, header: list[str] | None, rows: list[list[str]]) -> tuple[str, ...]:
    if header is None:
        width = max((len(row) for row in rows), default=0)
        return tuple(f"#{i + 1}" for i in range(width))
    while header and not header[-1]:
        header.pop()
    if not header:
        raise FileFormatError("the header line is empty", where=str(path), hint="Set header_line, or 0 for none")
    decimals = [name.replace(",", ".") if how.decimal == "," else name for name in header]
    numbers = [_NUMBER.fullmatch(name) is not None for name in decimals]
    missing = [name.lower() in _MISSING for name in decimals]
    if any(numbers) and np.all(np.logical_or(numbers, missing)) and not _counts_up(decimals):
        # Taken for names, the first measurement would be lost silently.
        raise FileFormatError(
            "the header line holds numbers only",
            where=f"{path}:{how.header_line}",
            value=", ".join(header[:4]) + (", ..." if len(header) > 4 else ""),
            limit="names of columns",
            hint='A file without names has header_line = 0; its columns are then 1, 2, ... or "#1", "#2", ...; '
            f"if these are names, add skip_lines = [{how.header_line}]",
        )
    return tuple(header)


def _counts_up(cells: Sequence[str]) -> bool:
    """Return whether numbers are those of columns, 0, 1, 2 or 1, 2, 3, and so names."""
    return len(cells) > 1 and any(all(cell == str(i + k) for i, cell in enumerate(cells)) for k in (0, 1))

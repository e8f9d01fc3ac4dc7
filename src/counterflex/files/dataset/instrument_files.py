"""Tables in files of instruments and of MATLAB: ``.mat`` by scipy, ``.tdms`` by npTDMS, ``.lvm`` with its segments."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import scipy

from counterflex.core import file_content
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import FileFormatError

LVM: Final = b"LabVIEW Measurement"
TDMS: Final = b"TDSm"
MATLAB: Final = b"MATLAB "
_END: Final = "***End_of_Header***"
_SPECIAL: Final = ("***Start_Special***", "***End_Special***")
_DECIMAL: Final = "Decimal_Separator"
_MAT_HEAD: Final = 128
_MAT_COMPRESSED: Final = 15


@dataclass(frozen=True, eq=False)
class InstrumentColumns:
    """Columns of one length."""

    names: tuple[str, ...]
    values: tuple[Float, ...]  # (n,) each; nan where there is no number
    lines: Int  # (n,) lines of the file, or numbers of the rows from 1

    @classmethod
    def of_lvm(cls, path: Path, data: bytes, part: str | int | None) -> InstrumentColumns:
        """Segments with the same channels one after the other; the column ``Segment`` counts them from 1."""
        lines = data.decode("utf-8-sig", "replace").replace("\r\n", "\n").split("\n")
        head: dict[str, list[str]] = {}
        separator = "," if any(line.startswith("Separator,") for line in lines[:30]) else "\t"
        place = _header(lines, 0, separator, head)
        decimal = (head.get(_DECIMAL) or ["."])[0]
        segments: list[InstrumentColumns] = []
        while (start := _next_segment(lines, place)) is not None:
            segment, place = _segment(path, lines, start, separator, decimal, len(segments) + 1)
            segments.append(segment)
        if not segments:
            raise FileFormatError("the file of LabVIEW has no segment with samples", where=str(path))
        if part is not None:
            if not isinstance(part, int) or not 1 <= part <= len(segments):
                raise FileFormatError(
                    "there is no such segment", where=f"{path}: part", value=repr(part), limit=f"1..{len(segments)}"
                )
            return segments[part - 1]
        return _joined(segments, path)

    @classmethod
    def of_tdms(cls, path: Path, data: bytes, part: str | int | None) -> InstrumentColumns:
        """Read the columns of a TDMS file."""
        try:
            from nptdms import TdmsFile
        except ImportError as fault:
            raise FileFormatError(
                "TDMS files are read by the library npTDMS, which is not installed",
                where=str(path),
                hint='Install it: pip install "counterflex[formats]"',
            ) from fault
        with file_content.readable(path, "a TDMS file"):
            file = TdmsFile.read(io.BytesIO(data))
            groups = {group.name: _channels(group) for group in file.groups()}
        groups = {name: columns for name, columns in groups.items() if columns}
        if part is not None:
            if part not in groups:
                raise FileFormatError(
                    "there is no such group", where=f"{path}: part", value=repr(part), limit=", ".join(groups) or "none"
                )
            groups = {str(part): groups[str(part)]}
        single = len(groups) == 1
        columns: dict[str, Float] = {
            name if single else f"{group}/{name}": value
            for group, some in groups.items()
            for name, value in some.items()
        }
        return _of_one_length(path, columns, "group")

    @classmethod
    def of_matlab(cls, path: Path, data: bytes, part: str | int | None) -> InstrumentColumns:
        """Read the columns of a MATLAB file."""
        if data.startswith((b"MATLAB 7.3", b"\x89HDF")):
            raise FileFormatError(
                "a MATLAB file of version 7.3 is not read", where=str(path), hint="Save it with save(..., '-v7')"
            )
        with file_content.readable(path, "a MATLAB file"):
            file_content.require_small(path, _unpacked_bytes(data))
            content = scipy.io.loadmat(io.BytesIO(data), simplify_cells=True)
        columns = _flat({name: value for name, value in content.items() if not name.startswith("__")}, "")
        if part is not None:
            chosen = {
                name: v for name, v in columns.items() if name == part or name.startswith((f"{part}.", f"{part} "))
            }
            if not chosen:
                limit = ", ".join(dict.fromkeys(name.split(".")[0].split(" ")[0] for name in columns))
                raise FileFormatError("there is no such variable", where=f"{path}: part", value=repr(part), limit=limit)
            columns = chosen
        return _of_one_length(path, columns, "variable")


def instrument_columns(path: Path, data: bytes, part: str | int | None) -> InstrumentColumns | None:
    """Read a file of an instrument; None where it is none.

    Args:
        part: Segment of an ``.lvm`` (from 1), group of a ``.tdms``, variable or structure of a ``.mat``; None: all that
            go together.

    Raises:
        FileFormatError: It cannot be read, there is no such part, or its parts do not go together.
    """
    if data.lstrip(b"\xef\xbb\xbf").startswith(LVM):
        return InstrumentColumns.of_lvm(path, data, part)
    if data.startswith(TDMS):
        return InstrumentColumns.of_tdms(path, data, part)
    if data.startswith(MATLAB) or path.suffix.lower() == ".mat":
        return InstrumentColumns.of_matlab(path, data, part)
    return None


def _joined(segments: Sequence[InstrumentColumns], path: Path) -> InstrumentColumns:
    names = [one.names for one in segments]
    if len(set(names)) > 1:
        other = next(k for k, one in enumerate(names) if one != names[0])
        raise FileFormatError(
            "segments of the file have other channels than the first",
            where=f"{path}:{int(segments[other].lines[0])}",
            value=", ".join(names[other])[:80],
            limit=", ".join(names[0])[:80],
            hint=f"Name one of its {len(segments)} segments: part = 1 under [[files]]",
        )
    values = tuple(np.concatenate(columns) for columns in zip(*(one.values for one in segments), strict=True))
    return InstrumentColumns(names[0], values, np.concatenate([one.lines for one in segments]))


def _header(lines: Sequence[str], start: int, separator: str, into: dict[str, list[str]]) -> int:
    """Read keys up to the end of a header; the place behind it."""
    for k in range(start, len(lines)):
        if lines[k].startswith(_END):
            return k + 1
        cells = lines[k].split(separator)
        into[cells[0]] = cells[1:]
    return len(lines)


def _next_segment(lines: Sequence[str], place: int) -> int | None:
    """Return where the header of the next segment begins; blocks of other data before it are passed over."""
    special = False
    for k in range(place, len(lines)):
        if lines[k].startswith(_SPECIAL):
            special = lines[k].startswith(_SPECIAL[0])
        elif not special and lines[k].startswith("Channels"):
            return k
    return None


def _segment(
    path: Path, lines: Sequence[str], start: int, separator: str, decimal: str, number: int
) -> tuple[InstrumentColumns, int]:
    head: dict[str, list[str]] = {}
    first = _header(lines, start, separator, head)
    titles = [cell.strip() for cell in lines[first].split(separator)] if first < len(lines) else []
    while titles and titles[-1] in ("", "Comment"):
        titles.pop()
    if not titles:
        raise FileFormatError("a segment has no channels", where=f"{path}:{start + 1}")
    values = _values(path, lines, first + 1, separator, decimal, len(titles))
    stop = first + 1 + len(values)
    names = [title or ("X_Value" if j == 0 else f"#{j + 1}") for j, title in enumerate(titles)]
    if len(values) and np.isnan(values[:, 0]).all() and "Delta_X" in head:  # files without a column of times
        x0, step = (_number((head.get(key) or ["0"])[0], decimal, path, start + 1) for key in ("X0", "Delta_X"))
        values[:, 0] = x0 + step * np.arange(len(values))
    columns = (*values.T, np.full(len(values), float(number)))
    return InstrumentColumns((*_once(names), "Segment"), columns, np.arange(first + 2, stop + 1, dtype=np.int64)), stop


def _values(path: Path, lines: Sequence[str], first: int, separator: str, decimal: str, count: int) -> Float:
    """Numbers (n, count) of the lines up to an empty one or the next header."""
    rows = []
    for number, line in enumerate(lines[first:], first + 1):
        if not line.strip() or line.startswith(("Channels", "***")):
            break
        cells = line.split(separator)[:count]
        rows.append([_number(cell, decimal, path, number) for cell in [*cells, *[""] * (count - len(cells))]])
    return np.array(rows, dtype=np.float64).reshape(-1, count)


def _number(cell: str, decimal: str, path: Path, line: int) -> float:
    text = cell.strip().replace(decimal, ".") if decimal != "." else cell.strip()
    if not text:
        return np.nan
    try:
        return float(text)
    except ValueError as fault:
        raise FileFormatError("the cell is not a number", where=f"{path}:{line}", value=repr(cell[:40])) from fault


def _once(names: Sequence[str]) -> list[str]:
    """Names, with the count behind those that come again."""
    out: list[str] = []
    for name in names:
        out.append(name if name not in out else f"{name} {sum(one.split(' ')[0] == name for one in out) + 1}")
    return out


def _channels(group: Any) -> dict[str, Float]:
    """Numbers of the channels of a group; their times as ``time_s`` where they are stated."""
    out: dict[str, Float] = {}
    for channel in group.channels():
        values = np.asarray(channel[:])
        if values.dtype.kind not in "biuf" or len(values) == 0:
            continue
        out[channel.name] = values.astype(np.float64)
        step = channel.properties.get("wf_increment")
        if step and "time_s" not in out:
            start = float(channel.properties.get("wf_start_offset", 0.0))
            out["time_s"] = np.asarray(start + float(step) * np.arange(len(values)), np.float64)
    return out


def _unpacked_bytes(data: bytes) -> int:
    """Return the size of the unpacked elements of a MATLAB file (level 5), counted only to just above the limit."""
    head = {b"IM": "<II", b"MI": ">II"}.get(data[126:128])
    size, at = len(data), _MAT_HEAD
    while head is not None and at + 8 <= len(data) and size <= file_content.LARGEST_TABLE_BYTES:
        kind, length = struct.unpack_from(head, data, at)
        at += 8
        if kind == _MAT_COMPRESSED:
            unpack, rest = zlib.decompressobj(), data[at : at + length]
            while rest and size <= file_content.LARGEST_TABLE_BYTES:
                size += len(unpack.decompress(rest, 2**20))
                rest = unpack.unconsumed_tail
        at += length
    return size


def _flat(content: Mapping[str, Any], before: str) -> dict[str, Float]:
    """Vectors by name; columns of a matrix by name and number, fields of a structure by ``structure.field``."""
    out: dict[str, Float] = {}
    for name, value in content.items():
        if isinstance(value, Mapping):
            out |= _flat(value, f"{before}{name}.")
            continue
        array = np.asarray(value)
        if array.dtype.kind not in "biuf" or array.ndim not in (1, 2) or array.size < 2:
            continue
        if array.ndim == 1:
            out[f"{before}{name}"] = array.astype(np.float64)
        else:
            out |= {f"{before}{name} {k + 1}": array[:, k].astype(np.float64) for k in range(array.shape[1])}
    return out


def _of_one_length(path: Path, columns: Mapping[str, Float], kind: str) -> InstrumentColumns:
    """Columns as one table. Raises FileFormatError: there are none, or they have different lengths."""
    lengths = {len(value) for value in columns.values()}
    if not lengths:
        raise FileFormatError("the file holds no columns of numbers", where=str(path))
    if len(lengths) > 1:
        shown = ", ".join(f"{name} ({len(value)})" for name, value in list(columns.items())[:8])
        raise FileFormatError(
            "columns of the file have different lengths",
            where=str(path),
            value=shown,
            hint=f'Name the {kind} that is meant: part = "..." under [[files]]',
        )
    return InstrumentColumns(tuple(columns), tuple(columns.values()), np.arange(1, lengths.pop() + 1, dtype=np.int64))

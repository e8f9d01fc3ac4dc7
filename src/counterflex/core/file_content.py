"""Read files: every fault of the system or of a library becomes one :class:`FileFormatError`.

All readers pass here: :func:`content` and :func:`text` for a whole file, :func:`json_value` for JSON, and
:func:`readable` around a library that opens or decodes a file by itself. A test holds the code to it.
"""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import re
import stat
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from counterflex.core.errors import CounterflexError, FileFormatError
from counterflex.core.moving import settle
from counterflex.core.similar import missing_file
from counterflex.core.system_fault import system_fault

if TYPE_CHECKING:
    import polars


_BY_FIRST_BYTES: Final[tuple[tuple[bytes, str], ...]] = (
    (b"PK\x03\x04", "a spreadsheet workbook (.xlsx, .ods) or another zip archive"),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "a spreadsheet workbook (.xls) or another Office file"),
    (b"PAR1", "a Parquet table"),
    (b"\x89MCAP", "a run log (MCAP)"),
    (b"\x89HDF\r\n", "an HDF5 or MATLAB file"),
    (b"MATLAB 5.0 MAT-file", "a MATLAB file"),
    (b"TDSm", "a TDMS file of LabVIEW"),
    (b"LabVIEW Measurement", "a measurement file of LabVIEW (.lvm)"),
    (b"ASTM-E57", "a scan (E57)"),
    (b"LASF", "a scan (LAS)"),
    (b"ISO-10303-21", "a CAD model (STEP)"),
    (b"glTF", "a model (glTF)"),
    (b"OFF\n", "a mesh (OFF)"),
    (b"#VRML", "a model (VRML)"),
    (b"%PDF", "a PDF file"),
    (b"\x1f\x8b", "a gzip archive"),
)
_TABLE_MARKS: Final = (";", "\t", ",")
_GCODE: Final = re.compile(r"\s*(?:N\d+\s*)?[GMT]\d", re.IGNORECASE)
_TOML: Final = re.compile(r"\s*(?:(?:[A-Za-z0-9_.\-]+|\"[^\"]*\"|'[^']*')\s*=|\[\[?[^\[\]]+\]\]?\s*\Z)")


def of_bytes(data: bytes) -> str | None:
    """Return the kind of a binary file by its first bytes, or None where nothing is known about them."""
    return next((name for head, name in _BY_FIRST_BYTES if data.startswith(head)), None)


def of_text(text: str) -> str | None:
    """Return the kind of a text: table of data, G-code, JSON, XML; None where it looks like TOML with a mistake."""
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")][:5]
    if not lines:
        return None
    marked = {"<": "an XML file", "{": "a JSON file"}.get(lines[0].lstrip()[0])
    if marked is not None:
        return marked
    if any(map(_TOML.match, lines)):
        return None
    if any(map(_GCODE.match, lines)):
        return "a G-code program"
    separated = any(all(mark in line for line in lines) for mark in _TABLE_MARKS)
    return "a table of data (CSV)" if separated and len(lines) > 1 else None


LARGEST_BYTES: Final = 2**30
"""Largest file that is read whole: ten times what a program of a million lines has."""
LARGEST_TABLE_BYTES: Final = 2**31
"""Most bytes that a table or an archive may unpack to: a plan of five million points has as many."""
_PIECE: Final = 2**20
_LONGEST: Final = 80  # Characters of a library's message that are printed
_AGAIN: Final = "Write or copy it again"
_UTF_16: Final = (b"\xff\xfe", b"\xfe\xff")


@contextlib.contextmanager
def readable(
    path: str | os.PathLike[str], kind: str, hint: str = _AGAIN, family: type[FileFormatError] = FileFormatError
) -> Iterator[None]:
    """Raise what the system or a library says of a file as one error.

    Only the reading belongs into the block: every exception in it is taken for a fault of the file.

    Args:
        kind: What it should be, with its article: ``"a Parquet table"``.
        hint: What to do where the content is wrong.

    Raises:
        FileFormatError: Missing, a folder, not permitted, damaged, of another kind, or in a folder whose writing was
            broken off and cannot be completed.
    """
    settle(path)
    try:
        yield
    except (CounterflexError, KeyboardInterrupt, SystemExit, GeneratorExit):
        raise
    except BaseException as fault:  # a panic in Rust is no Exception
        raise _refusal(Path(path), kind, hint, fault, family) from fault


def content(path: str | os.PathLike[str], family: type[FileFormatError] = FileFormatError) -> bytes:
    """Return the bytes of a file.

    Raises:
        FileFormatError: Missing, a folder, not permitted, or larger than :data:`LARGEST_BYTES`.
    """
    with readable(path, "a file", family=family), Path(path).open("rb") as stream:
        status = os.fstat(stream.fileno())
        if status.st_size > LARGEST_BYTES:
            raise _too_large(path, f"{status.st_size} bytes", family)
        if stat.S_ISREG(status.st_mode):
            return stream.read()
        pieces, size = [], 0
        while piece := stream.read(_PIECE):  # a device or a pipe may never end
            pieces.append(piece)
            size += len(piece)
            if size > LARGEST_BYTES:
                raise _too_large(path, "more", family)
    return b"".join(pieces)


def _too_large(path: str | os.PathLike[str], value: str, family: type[FileFormatError]) -> FileFormatError:
    return family("the file is too large", where=str(path), value=value, limit=f"at most {LARGEST_BYTES} bytes")


def text(path: str | os.PathLike[str], hint: str = "Save it as UTF-8 text") -> str:
    """Return the text of a file in UTF-8, with or without byte order mark.

    Args:
        hint: What to do where it is no such text.

    Raises:
        FileFormatError: Missing, a folder, not permitted, or another encoding; names kind of file or byte and line.
    """
    return decoded(content(path), path, hint)


def decoded(data: bytes, path: str | os.PathLike[str], hint: str = "Save it as UTF-8 text") -> str:
    """Return bytes of a file as text, see :func:`text`."""
    try:
        decoded_text = data.decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        kind = "text in UTF-16" if data.startswith(_UTF_16) else of_bytes(data)
        byte = f"byte 0x{data[fault.start]:02x} in line {data[: fault.start].count(10) + 1}"
        raise FileFormatError("not a text file in UTF-8", where=str(path), value=kind or byte, hint=hint) from fault
    if "\0" in decoded_text:
        line = decoded_text[: decoded_text.index("\0")].count("\n") + 1
        raise FileFormatError("not a text file: it contains zero bytes", where=f"{path}:{line}", hint=hint)
    return decoded_text


def json_value(path: str | os.PathLike[str], kind: str = "JSON", hint: str = _AGAIN) -> Any:
    """Return the value of a JSON file."""
    content_text = text(path, hint)
    with readable(path, kind, hint):
        return json.loads(content_text)


def require_small(path: str | os.PathLike[str], unpacked_bytes: int) -> None:
    """Refuse a packed file by the size that it states before it is unpacked.

    Raises:
        FileFormatError: It would take more than :data:`LARGEST_TABLE_BYTES` of memory.
    """
    if unpacked_bytes > LARGEST_TABLE_BYTES:
        raise FileFormatError(
            "the file unpacks to more than it may",
            where=str(path),
            value=f"{unpacked_bytes} bytes",
            limit=f"at most {LARGEST_TABLE_BYTES} bytes",
            hint="Export less: fewer rows, a shorter stretch of time",
        )


def parquet(path: str | os.PathLike[str], data: bytes) -> polars.DataFrame:
    """Return the table of a Parquet file whose columns are numbers, times or texts.

    Raises:
        FileFormatError: Damaged, too large when unpacked, or with columns of lists or other nested values.
    """
    import polars as pl  # heavy

    with readable(path, "a Parquet file"):
        lazy = pl.scan_parquet(io.BytesIO(data))
        schema, rows = lazy.collect_schema(), int(lazy.select(pl.len()).collect().item())
        nested = next((name for name, kind in schema.items() if kind.is_nested() or kind == pl.Binary), None)
        if nested is not None:
            raise FileFormatError(
                "a column holds no plain values", where=str(path), value=f"{nested}: {schema[nested]}"
            )
        require_small(path, 8 * rows * len(schema))
        frame = pl.read_parquet(io.BytesIO(data))
        for name in (name for name, kind in schema.items() if kind == pl.String):  # rows may share one long text
            require_small(path, int(frame[name].str.len_bytes().cast(pl.Int64).sum()))
    return frame


@contextlib.contextmanager
def arrays(path: str | os.PathLike[str], kind: str, hint: str) -> Iterator[Any]:
    """Open a file of NumPy arrays (``.npz``), which are unpacked one by one; no objects.

    Args:
        hint: What to do where it is none.
    """
    import numpy as np

    with readable(path, kind, hint), Path(path).open("rb") as stream:
        with zipfile.ZipFile(stream) as archive:
            require_small(path, sum(item.file_size for item in archive.infolist()))
        stream.seek(0)
        with np.load(stream, allow_pickle=False) as data:
            yield data


def _refusal(path: Path, kind: str, hint: str, fault: BaseException, family: type[FileFormatError]) -> FileFormatError:
    where = str(path)
    known = system_fault(fault)
    if known is not None and known.errno == errno.ENOENT:
        return family("no such file", where=where, hint=missing_file(path))
    if known is not None and known.errno == errno.EISDIR:
        return family("it is a folder", where=where, limit="a file", hint="Name a file in it")
    if known is not None:
        return family(f"cannot be read: {known.strerror}", where=where, hint="Check the file and the rights on it")
    message = " ".join(str(fault).split()) or type(fault).__name__
    if isinstance(fault, MemoryError):
        message = "more than the memory of this computer"
    if isinstance(fault, RecursionError):
        message = "nested too deeply"
    return family(f"not readable as {kind}", where=where, value=message[:_LONGEST], hint=hint)

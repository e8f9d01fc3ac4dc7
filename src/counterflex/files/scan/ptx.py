"""PTX files: scans on a grid, each with the pose of its scanner before its points. No kept library reads them."""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.files.scan.number_lines import SPACES, numbers, text_stream
from counterflex.files.scan.scan import PointStore, Scan

_HEAD: Final = 10
_WIDTHS: Final = (1, 1, 3, 3, 3, 3, 4, 4, 4, 4)
"""Numbers in the lines of a header: columns, rows, place and axes of the scanner, its pose by rows."""
_ROWS: Final = 200_000


def is_ptx(head: bytes) -> bool:
    """Return whether a text begins with the header of a PTX file."""
    lines = head.splitlines()[:_HEAD]
    return len(lines) == _HEAD and _header(lines) is not None


def read_ptx(path: Path) -> Scan:
    """Read the points of all scans, each moved by its pose; 0 0 0 is a ray without a return.

    Raises:
        FileFormatError: A header is wrong, a scan ends too early, or a word is no number.
    """
    store = PointStore(path, "cloud of points (PTX)")
    line = 1
    with text_stream(path) as stream:
        while first := _next(stream):
            lines = [first, *islice(stream, _HEAD - 1)]
            header = _header(lines)
            if header is None:
                raise FileFormatError(
                    "the header of a PTX scan is wrong",
                    where=f"{path}:{line}",
                    value=lines[0].decode("utf-8", "replace").strip()[:40],
                    limit="columns, rows, four lines of three numbers, four of four",
                )
            count, T = header
            line += _HEAD
            _points(stream, path, count, T, store, line)
            line += count
    return store.scan()


def _next(stream: BinaryIO) -> bytes:
    """The next line that holds something."""
    for line in stream:
        if line.strip():
            return line
    return b""


def _header(lines: list[bytes]) -> tuple[int, Float] | None:
    """Number of points and pose (4, 4) of a scan; None where the lines are no header."""
    try:
        rows = [[float(word) for word in line.split()] for line in lines]
    except ValueError:
        return None
    if tuple(len(row) for row in rows) != _WIDTHS or any(row[0] < 1 or row[0] % 1 for row in rows[:2]):
        return None
    return int(rows[0][0] * rows[1][0]), np.array(rows[6:]).T


def _points(stream: BinaryIO, path: Path, count: int, T: Float, store: PointStore, line: int) -> None:
    done = 0
    while done < count:
        lines = list(islice(stream, min(_ROWS, count - done)))
        if not lines:
            raise FileFormatError(
                "the PTX file ends too early", where=str(path), value=f"{done} points of a scan", limit=count
            )
        values = numbers(b"".join(lines).replace(b"\r", b""), len(lines[0].split()), SPACES, path, line + done)
        done += len(lines)
        there = values[:, :3].any(axis=1)
        moved = values[there, :3] @ T[:3, :3].T + T[:3, 3]
        store.add(moved)
        store.skip(int(np.count_nonzero(~there)))

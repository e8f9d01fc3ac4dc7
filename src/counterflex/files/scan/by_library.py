"""Formats of scans that kept libraries read: E57 (pye57), LAS and LAZ (laspy), PCD (pypcd4); extra ``formats``."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core import file_content
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.files.scan.scan import LIMIT_POINTS, PointStore, Scan

_ROWS: Final = 1_000_000
_HEAD: Final = 4096
_PCD_POINTS: Final = re.compile(rb"^(?:POINTS|WIDTH|HEIGHT)\s+(\d{1,18})\b", re.MULTILINE)
_PCD_FIRST: Final = (b"# .PCD", b"VERSION", b"FIELDS", b"COLUMNS")


def library_format(head: bytes, suffix: str) -> Callable[[Path], Scan] | None:
    """Reader of a file by its first bytes; None where no library here reads it."""
    if head.startswith(b"ASTM-E57"):
        return read_e57
    if head.startswith(b"LASF"):
        return read_las
    if suffix == ".pcd" or (head.startswith(_PCD_FIRST) and b"FIELDS" in head and b"DATA" in head):
        return read_pcd
    return None


def needed(module: str, kind: str, path: Path) -> Any:
    """Import a library of the extra. Raises FileFormatError: it is not installed."""
    try:
        return import_module(module)
    except ImportError as fault:
        raise FileFormatError(
            f"{kind} files are read by the library {module}, which is not installed",
            where=str(path),
            hint='Install it: pip install "counterflex[formats]"',
        ) from fault


def read_e57(path: Path) -> Scan:
    """Read all scans of an E57 file (ASTM E2807) in the frame of the file; the standard fixes the metre.

    Raises:
        FileFormatError: It cannot be read, or the library is not installed.
    """
    return _stored(path, "E57", _e57_blocks(needed("pye57", "E57", path), path), 1.0)


def _e57_blocks(pye57: Any, path: Path) -> Iterator[Float]:
    file = pye57.E57(str(path))
    try:
        if sum(file.get_header(k).point_count for k in range(file.scan_count)) > LIMIT_POINTS:
            raise _too_many(path)
        for k in range(file.scan_count):
            data = file.read_scan(k, ignore_missing_fields=True)
            yield np.column_stack([np.asarray(data[f"cartesian{axis}"], np.float64) for axis in "XYZ"])
    finally:
        file.close()


def read_las(path: Path) -> Scan:
    """Read the points of a LAS or LAZ file, in its unit, which the format does not state.

    Raises:
        FileFormatError: It cannot be read, or the library is not installed.
    """
    return _stored(path, "LAS", _las_blocks(needed("laspy", "LAS", path), path), None)


def _las_blocks(laspy: Any, path: Path) -> Iterator[Float]:
    with laspy.open(path) as reader:
        if reader.header.point_count > LIMIT_POINTS:
            raise _too_many(path)
        for points in reader.chunk_iterator(_ROWS):
            yield np.column_stack([np.asarray(points[axis], np.float64) for axis in "xyz"])


def read_pcd(path: Path) -> Scan:
    """Read the points of a PCD file of the Point Cloud Library, in text, binary or compressed.

    Raises:
        FileFormatError: It cannot be read, or the library is not installed.
    """
    pypcd4 = needed("pypcd4", "PCD", path)
    with file_content.readable(path, "a cloud of points (PCD)"), path.open("rb") as stream:
        head = stream.read(_HEAD)
    if max((int(count) for count in _PCD_POINTS.findall(head)), default=0) > LIMIT_POINTS:
        raise _too_many(path)
    return _stored(path, "PCD", _pcd_blocks(pypcd4, path), None)


def _pcd_blocks(pypcd4: Any, path: Path) -> Iterator[Float]:
    yield np.asarray(pypcd4.PointCloud.from_path(path).numpy(("x", "y", "z")), np.float64)


def _stored(path: Path, kind: str, blocks: Iterator[Float], unit_m: float | None) -> Scan:
    store = PointStore(path, f"cloud of points ({kind})")
    with file_content.readable(path, f"a cloud of points ({kind})", "Export it again"):
        store.extend(blocks)
    return store.scan(unit_m)


def _too_many(path: Path) -> FileFormatError:
    return FileFormatError(
        "the scan has too many points",
        where=str(path),
        limit=f"{LIMIT_POINTS:.0e}",
        hint="Export it with a larger distance of points",
    )

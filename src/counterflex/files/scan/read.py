"""Read a scan, whatever its format: told by its first bytes, by its name where those leave it open."""

from __future__ import annotations

import re
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np

from counterflex.core import file_content
from counterflex.core.arrays import Float, batches
from counterflex.core.errors import FileFormatError
from counterflex.core.file_content import of_bytes
from counterflex.files.scan.by_library import library_format
from counterflex.files.scan.number_lines import SPACES, numbers, text_stream, utf16
from counterflex.files.scan.ply import PlyHeader, vertex_blocks
from counterflex.files.scan.qif import read_qif
from counterflex.files.scan.scan import UNITS, PointStore, Scan
from counterflex.files.scan.table import read_table

LIMIT_TRIANGLES: Final = 20_000_000
POINTS: Final = 3_000_000
"""Points that a mesh is covered with, about."""
_STL_HEAD: Final = 84
_TRIANGLE: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def is_binary_stl(path: Path) -> bool:
    """Return whether the size of a file is that of a binary STL with the count of triangles in it, or almost."""
    with path.open("rb") as stream:
        head = stream.read(_STL_HEAD)
    if len(head) < _STL_HEAD or path.suffix.lower() != ".stl":
        return False
    return not (head.lstrip().startswith(b"solid") and b"\x00" not in head)


def read_mesh(path: Path, kind: str) -> Scan:
    """Read a mesh and cover its triangles with points: meshes of scanners are coarse where the part is flat.

    Args:
        kind: ``stl``, ``obj`` or ``ply``.

    Raises:
        FileFormatError: It cannot be read, is truncated, has no triangles or more than twenty million.
    """
    corners = _binary_stl(path) if kind == "stl" and is_binary_stl(path) else _by_library(path, kind)
    store = PointStore(path, f"mesh ({kind.upper()}), {len(corners)} triangles")
    finite = np.isfinite(corners).all(axis=(1, 2))
    if not finite.any():
        raise FileFormatError("the mesh has no triangle of finite numbers", where=str(path), value=len(corners))
    corners = corners[finite]
    for points in _covering(corners):
        store.add(points)
    return store.scan()


def read_ply_cloud(path: Path) -> Scan:
    """Read the vertices of a PLY file without faces whose vertices come behind other elements."""
    import trimesh  # heavy

    with file_content.readable(path, "a cloud of points (PLY)", "Export it again"):
        vertices = np.asarray(trimesh.load(path, file_type="ply", process=False).vertices, np.float64)
    store = PointStore(path, "cloud of points (PLY)")
    store.add(vertices.reshape(-1, 3))
    return store.scan()


def _binary_stl(path: Path) -> Any:
    with path.open("rb") as stream:
        count = int(np.frombuffer(stream.read(_STL_HEAD)[80:84], "<u4")[0])
        room = path.stat().st_size - _STL_HEAD
        if room < count * _TRIANGLE.itemsize:
            raise FileFormatError(
                "the STL file ends too early",
                where=str(path),
                value=f"{max(room, 0) // _TRIANGLE.itemsize} triangles",
                limit=count,
            )
        if count > LIMIT_TRIANGLES:
            raise _too_many(path, count)
        return np.fromfile(stream, _TRIANGLE, count)["corners"]


def _by_library(path: Path, kind: str) -> Any:
    """Triangles (t, 3, 3) as trimesh reads them."""
    import trimesh  # heavy

    with file_content.readable(path, f"a mesh ({kind.upper()})", "Export it again"):
        mesh = trimesh.load(path, file_type=kind, process=False, force="mesh")
        faces = np.asarray(getattr(mesh, "faces", np.empty((0, 3))))
        if len(faces) > LIMIT_TRIANGLES:
            raise _too_many(path, len(faces))
        if len(faces) == 0:
            raise FileFormatError("the mesh has no triangles", where=str(path), hint="Export points as PLY or XYZ")
        return np.asarray(mesh.vertices, np.float64)[faces]


def _too_many(path: Path, count: int) -> FileFormatError:
    return FileFormatError(
        "the mesh has too many triangles",
        where=str(path),
        value=count,
        limit=f"<= {LIMIT_TRIANGLES}",
        hint="Export the points instead, or a thinned mesh",
    )


def _covering(corners: Any) -> Any:
    """Points on the triangles, as many on each as its area is of the whole; their centroids where they are small."""
    parts = list(batches(len(corners), 1 << 18))
    area = np.concatenate([_area(corners[part]) for part in parts])
    total = float(area.sum())
    share = area / total * POINTS if total > 0.0 else np.zeros(len(area))
    rng = np.random.default_rng(0)
    for part in parts:
        number = np.maximum(1, np.floor(share[part] + rng.random(len(share[part])))).astype(np.int64)
        number[area[part] == 0.0] = 0
        owner = np.repeat(np.arange(part.start, part.stop), number)
        for some in batches(len(owner), 1 << 20):
            triangle = np.asarray(corners[owner[some]], np.float64)
            # square root: even over the triangle; a lone point stands at the centroid
            u, v = np.sqrt(rng.random(len(triangle))), rng.random(len(triangle))
            yield _at(triangle, 1.0 - u, u * (1.0 - v), u * v)


def _at(triangle: Float, a: Float, b: Float, c: Float) -> Float:
    out: Float = a[:, None] * triangle[:, 0] + b[:, None] * triangle[:, 1] + c[:, None] * triangle[:, 2]
    return out


def _area(corners: Any) -> Float:
    corners = np.asarray(corners, np.float64)
    out: Float = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return out


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


_POINT: Final = re.compile(r"FA\s*\(([^)]*)\)\s*=\s*FEAT\s*/\s*POINT\s*,\s*(\w+)\s*,(.*)", re.IGNORECASE)
_UNITS: Final = re.compile(r"UNITS\s*/\s*(\w+)", re.IGNORECASE)
_NAMES: Final = {"MM": "mm", "CM": "cm", "M": "m", "INCH": "inch"}


def is_dmis(head: bytes) -> bool:
    """Return whether a text begins like DMIS: its words stand before a slash."""
    return (
        re.search(rb"^\s*(DMISMN|DMISMD|FILNAM|UNITS|FA\s*\(|F\s*\()[^\n]*[/=]", head, re.MULTILINE | re.IGNORECASE)
        is not None
    )


def read_dmis(path: Path) -> Scan:
    """Read the measured points (``FA(name)=FEAT/POINT,CART,x,y,z,i,j,k``); ``F(...)`` are nominal and left out.

    Raises:
        FileFormatError: No measured points, polar coordinates, an unknown unit, or a word in place of a number.
    """
    with text_stream(path) as stream:
        text = stream.read().decode("utf-8", "replace").replace("\r", "")
    # a line that ends with $ goes on in the next one
    lines, start = [], 1
    for number, line in enumerate(text.split("\n"), 1):
        lines.append((start, line.rstrip().removesuffix("$")))
        if not line.rstrip().endswith("$") or line.lstrip().startswith("$$"):
            start = number + 1
    joined: dict[int, str] = {}
    for number, line in lines:
        joined[number] = joined.get(number, "") + line
    points, unit, nominal = [], None, 0
    for number, line in joined.items():
        if line.lstrip().startswith("$$"):
            continue
        unit = _unit(line, f"{path}:{number}", unit)
        nominal += re.match(r"\s*F\s*\([^)]*\)\s*=\s*FEAT\s*/\s*POINT", line, re.IGNORECASE) is not None
        match = _POINT.match(line.strip())
        if match:
            points.append(_point(match, f"{path}:{number}"))
    if not points:
        raise FileFormatError(
            "the DMIS file holds no measured points",
            where=str(path),
            value=f"{nominal} nominal points F(...)" if nominal else None,
            limit="FA(name)=FEAT/POINT,CART,x,y,z,i,j,k",
            hint="Give the output of the measurement, not its program",
        )
    store = PointStore(path, f"DMIS output, {len(points)} points")
    store.add(np.array(points))
    return store.scan(unit)


def _unit(line: str, where: str, unit: float | None) -> float | None:
    match = _UNITS.match(line.strip())
    if not match:
        return unit
    name = _NAMES.get(match[1].upper())
    if name is None:
        raise FileFormatError("unknown unit", where=where, value=match[1], limit=", ".join(_NAMES))
    return UNITS[name]


def _point(match: re.Match[str], where: str) -> list[float]:
    if match[2].upper() != "CART":
        raise FileFormatError("the point is not given in x, y, z", where=where, value=match[2], limit="CART")
    words = [word.strip() for word in match[3].split(",")]
    try:
        return [float(words[k]) for k in range(3)]
    except (ValueError, IndexError) as fault:
        raise FileFormatError(
            f"the point {match[1]} has no three numbers", where=where, value=",".join(words)[:60]
        ) from fault


def read_scan(path: Path) -> Scan:
    """Read the points of a scan.

    Read are PLY, STL (both in text or binary), OBJ, tables of x y z (ASC, XYZ, PTS, TXT, CSV), reports of measuring
    machines, PTX, DMIS output and QIF; with the extra ``formats`` E57, LAS, LAZ and PCD.
    Meshes are covered with points of even density.

    Raises:
        FileFormatError: No such file, an empty or a damaged one, another format, or no valid point in it.
    """
    with file_content.readable(path, "a scan", "Export it again, as PLY, STL or a table of x, y, z"):
        with path.open("rb") as stream:
            head = stream.read(4096)
        return _read(path, head)


def _read(path: Path, head: bytes) -> Scan:
    suffix = path.suffix.lower()
    if not head:
        raise FileFormatError("the file is empty", where=str(path))
    reader = _read_ply if head[:4].rstrip() == b"ply" else library_format(head, suffix)
    if reader is not None:
        return reader(path)
    if suffix == ".ply":
        raise FileFormatError("the file is no PLY file", where=str(path), value=repr(head[:20]), limit="ply")
    if suffix == ".stl":
        if not is_binary_stl(path) and not head.lstrip().startswith(b"solid"):
            raise FileFormatError("the file is no STL file", where=str(path), value=repr(head[:20]))
        return read_mesh(path, "stl")
    if suffix == ".obj" or re.search(rb"^v\s+[-+.\d]", head, re.MULTILINE):
        return read_mesh(path, "obj")
    other = of_bytes(head)
    if other is not None:
        raise FileFormatError(f"the file is {other}", where=str(path), limit="a cloud of points, a mesh or a table")
    if head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<"):
        return read_qif(path)
    if (encoding := utf16(head)) is not None:
        head = head.decode(encoding, "replace").removeprefix("\ufeff").encode()
    for is_such, read in ((is_ptx, read_ptx), (is_dmis, read_dmis)):
        if is_such(head):
            return read(path)
    return read_table(path)


def _read_ply(path: Path) -> Scan:
    header = PlyHeader.read(path)
    if header.faces:
        return read_mesh(path, "ply")
    if not header.plain:
        return read_ply_cloud(path)
    kind = f"cloud of points (PLY, {'text' if header.text else 'binary'})"
    return PointStore(path, kind).extend(vertex_blocks(path, header)).scan()

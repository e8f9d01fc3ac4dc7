"""Read a scan, whatever its format: told by its first bytes, by its name where those leave it open."""

from __future__ import annotations

import re
from pathlib import Path

from counterflex.core import file_content
from counterflex.core.errors import FileFormatError
from counterflex.core.file_kind import of_bytes
from counterflex.files.scan.by_library import library_format
from counterflex.files.scan.dmis import is_dmis, read_dmis
from counterflex.files.scan.mesh import is_binary_stl, read_mesh, read_ply_cloud
from counterflex.files.scan.number_lines import utf16
from counterflex.files.scan.ply import read_header, vertex_blocks
from counterflex.files.scan.ptx import is_ptx, read_ptx
from counterflex.files.scan.qif import read_qif
from counterflex.files.scan.scan import PointStore, Scan
from counterflex.files.scan.table import read_table


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
    if head[:4].rstrip() == b"ply":
        header = read_header(path)
        if header.faces:
            return read_mesh(path, "ply")
        if not header.plain:
            return read_ply_cloud(path)
        kind = f"cloud of points (PLY, {'text' if header.text else 'binary'})"
        return PointStore(path, kind).extend(vertex_blocks(path, header)).scan()
    reader = library_format(head, suffix)
    if reader is not None:
        return reader(path)
    if suffix == ".ply":
        raise FileFormatError("the file is no PLY file", where=str(path), value=repr(head[:20]), limit="ply")
    if suffix == ".stl" and not is_binary_stl(path) and not head.lstrip().startswith(b"solid"):
        raise FileFormatError("the file is no STL file", where=str(path), value=repr(head[:20]))
    if suffix == ".stl":
        return read_mesh(path, "stl")
    if suffix == ".obj" or re.search(rb"^v\s+[-+.\d]", head, re.MULTILINE):
        return read_mesh(path, "obj")
    other = of_bytes(head)
    if other is not None:
        raise FileFormatError(f"the file is {other}", where=str(path), limit="a cloud of points, a mesh or a table")
    if head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<"):
        return read_qif(path)
    encoding = utf16(head)
    if encoding is not None:
        head = head.decode(encoding, "replace").removeprefix("\ufeff").encode()
    if is_ptx(head):
        return read_ptx(path)
    if is_dmis(head):
        return read_dmis(path)
    return read_table(path)

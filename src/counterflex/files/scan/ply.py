"""Polygon files (PLY), in text or binary of either byte order: vertices as points, faces as a mesh."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.files.scan.number_lines import SPACES, line_blocks, numbers

_TYPES: Final = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_ROWS: Final = 1 << 20


@dataclass(frozen=True)
class Header:
    """What a PLY file announces."""

    text: bool
    order: str  # Byte order, ``<`` or ``>``
    names: tuple[str, ...]
    types: tuple[str, ...]
    vertices: int
    faces: int
    start: int  # Place of the first byte behind the header
    lines: int
    plain: bool = True  # The vertices come first and have single numbers only; others are read by the library


def read_header(path: Path) -> Header:
    """Read the header of a PLY file.

    Raises:
        FileFormatError: It is no header, its vertices have no x, y, z, or a count is no number.
    """
    with path.open("rb") as stream:
        return _header(stream, path)


def _header(stream: BinaryIO, path: Path) -> Header:
    order, element, lines, plain = None, "", 0, True
    counts: dict[str, int] = {}
    properties: list[tuple[str, str]] = []
    while True:
        line = stream.readline(1000)
        lines += 1
        words = line.decode("ascii", "replace").split()
        if not line or lines > 1000:
            raise FileFormatError("the header of the PLY file does not end", where=str(path))
        if words[:1] == ["end_header"]:
            break
        try:
            if words[:1] == ["format"]:
                order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[words[1]]
            elif words[:1] == ["element"]:
                element = words[1]
                plain &= element != "vertex" or not counts
                counts[element] = int(words[2])
                if counts[element] < 0:
                    raise ValueError(words[2])
            elif words[:1] == ["property"] and element == "vertex":
                plain &= words[1] != "list"
                properties.append((words[-1], _TYPES[words[1] if words[1] != "list" else words[3]]))
        except (KeyError, IndexError, ValueError) as fault:
            text = " ".join(words)[:60]
            raise FileFormatError("the header of the PLY file is wrong", where=f"{path}:{lines}", value=text) from fault
    names = tuple(name for name, _ in properties)
    if order is None or not {"x", "y", "z"} <= set(names):
        raise FileFormatError(
            "the PLY file has no vertices with x, y, z", where=str(path), value=", ".join(names) or "no vertices"
        )
    return Header(
        order == "",
        order or "<",
        names,
        tuple(kind for _, kind in properties),
        counts["vertex"],
        counts.get("face", 0),
        stream.tell(),
        lines,
        plain,
    )


def vertex_blocks(path: Path, header: Header) -> Iterator[Float]:
    """The vertices (k, 3), some at a time, in file units.

    Raises:
        FileFormatError: The file ends before the announced number of vertices, or a word is no number.
    """
    with path.open("rb") as stream:
        stream.seek(header.start)
        rows = _text_rows(stream, path, header) if header.text else _binary_rows(stream, header)
        count = 0
        for block in rows:
            count += len(block)
            yield block
    if count < header.vertices:
        raise FileFormatError(
            "the PLY file ends too early", where=str(path), value=f"{count} vertices", limit=header.vertices
        )


def _binary_rows(stream: BinaryIO, header: Header) -> Iterator[Float]:
    layout = np.dtype([(name, header.order + kind) for name, kind in zip(header.names, header.types, strict=True)])
    left = header.vertices
    while left > 0:
        data = stream.read(min(_ROWS, left) * layout.itemsize)
        rows = np.frombuffer(data[: len(data) // layout.itemsize * layout.itemsize], layout)
        if len(rows) == 0:
            return
        left -= len(rows)
        yield np.stack([rows[axis].astype(np.float64) for axis in "xyz"], axis=1)


def _text_rows(stream: BinaryIO, path: Path, header: Header) -> Iterator[Float]:
    left, line = header.vertices, header.lines + 1
    xyz = [header.names.index(axis) for axis in "xyz"]
    for block in line_blocks(stream):
        if left <= 0:
            return
        lines = block.count(b"\n")
        if lines > left:
            block = b"\n".join(block.split(b"\n", left)[:left]) + b"\n"
        rows = numbers(block, len(header.names), SPACES, path, line)
        left, line = left - len(rows), line + lines
        yield rows[:, xyz]

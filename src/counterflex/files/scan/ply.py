"""Polygon files (PLY), in text or binary of either byte order: vertices as points, faces as a mesh."""

from __future__ import annotations

import itertools
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
class PlyHeader:
    """Announcements of a PLY file."""

    text: bool
    order: str  # Byte order, ``<`` or ``>``
    names: tuple[str, ...]
    types: tuple[str, ...]
    vertices: int
    faces: int
    start: int  # Place of the first byte behind the header
    lines: int
    plain: bool = True  # The vertices come first and have single numbers only; others are read by the library

    @classmethod
    def read(cls, path: Path) -> PlyHeader:
        """Read the header of a PLY file.

        Raises:
            FileFormatError: It is no header, its vertices have no x, y, z, or a count is no number.
        """
        with path.open("rb") as stream:
            return _header(stream, path)


def _header(stream: BinaryIO, path: Path) -> PlyHeader:
    order, element, plain = None, "", True
    counts: dict[str, int] = {}
    properties: dict[str, list[str]] = {"names": [], "types": []}
    for number in itertools.count(1):
        words = _header_words(stream, number, path)
        try:
            match words:
                case ["end_header", *_]:
                    break
                case ["format", *form]:
                    order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[form[0]]
                case ["element", *of]:
                    element = of[0]
                    plain &= element != "vertex" or not counts
                    counts[element] = _count(of[1])
                case ["property", *kind] if element == "vertex":
                    plain &= kind[0] != "list"
                    properties["types"].append(_TYPES[kind[0] if kind[0] != "list" else kind[2]])
                    properties["names"].append(kind[-1])
        except (KeyError, IndexError, ValueError) as fault:
            raise FileFormatError(
                "the header of the PLY file is wrong", where=f"{path}:{number}", value=" ".join(words)[:60]
            ) from fault
    names = tuple(properties["names"])
    if order is None or not {"x", "y", "z"} <= set(names):
        raise FileFormatError(
            "the PLY file has no vertices with x, y, z", where=str(path), value=", ".join(names) or "no vertices"
        )
    return PlyHeader(
        text=order == "",
        order=order or "<",
        names=names,
        types=tuple(properties["types"]),
        vertices=counts["vertex"],
        faces=counts.get("face", 0),
        start=stream.tell(),
        lines=number,
        plain=plain,
    )


def _header_words(stream: BinaryIO, number: int, path: Path) -> list[str]:
    line = stream.readline(1000)
    if not line or number > 1000:
        raise FileFormatError("the header of the PLY file does not end", where=str(path))
    return line.decode("ascii", "replace").split()


def _count(word: str) -> int:
    if int(word) < 0:
        raise ValueError(word)
    return int(word)


def vertex_blocks(path: Path, header: PlyHeader) -> Iterator[Float]:
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


def _binary_rows(stream: BinaryIO, header: PlyHeader) -> Iterator[Float]:
    layout = np.dtype([(name, header.order + kind) for name, kind in zip(header.names, header.types, strict=True)])
    left = header.vertices
    while left > 0:
        data = stream.read(min(_ROWS, left) * layout.itemsize)
        rows = np.frombuffer(data[: len(data) // layout.itemsize * layout.itemsize], layout)
        if len(rows) == 0:
            return
        left -= len(rows)
        yield np.stack([rows[axis].astype(np.float64) for axis in "xyz"], axis=1)


def _text_rows(stream: BinaryIO, path: Path, header: PlyHeader) -> Iterator[Float]:
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

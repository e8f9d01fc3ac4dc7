"""Lines of numbers, block by block: what clouds of points and meshes in text form consist of."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError

BLOCK: Final = 1 << 24
SPACES: Final = bytes.maketrans(b",;\t|", b"    ")
"""Separators become spaces."""
DECIMAL_COMMAS: Final = bytes.maketrans(b",;\t|", b".   ")
"""The same where the comma is that of decimals."""


def line_blocks(stream: BinaryIO) -> Iterator[bytes]:
    """Whole lines, some megabytes at a time; ends of lines become those of Unix."""
    rest = b""
    while block := stream.read(BLOCK):
        whole, _, rest = (rest + block).rpartition(b"\n")
        if whole:
            yield whole.replace(b"\r", b"") + b"\n"
    if rest:
        yield rest.replace(b"\r", b"\n")


def numbers(block: bytes, columns: int, table: bytes, path: Path, first_line: int) -> Float:
    """The numbers (k, columns) of a block of lines.

    Args:
        block: Whole lines; empty ones and comments (``#``, ``//``) are left out.
        columns: Numbers in each line.
        table: Translation that leaves spaces between numbers.
        path: For the error.
        first_line: Number of the first line of the block.

    Raises:
        FileFormatError: A line has other numbers than the first, or a word is no number.
    """
    if b"#" in block or b"/" in block:
        kept = (b"" if line.lstrip().startswith((b"#", b"//")) else line for line in block.split(b"\n"))
        block = b"\n".join(kept)
    spaced = block.translate(table)
    rows = sum(1 for line in spaced.split(b"\n") if line.strip())
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            values: Float = np.fromstring(spaced.decode("ascii", "replace"), sep=" ")
        except (DeprecationWarning, ValueError):
            values = np.empty(0)
    if len(values) != rows * columns:
        raise _fault(block, columns, table, path, first_line)
    return values.reshape(rows, columns)


def _fault(block: bytes, columns: int, table: bytes, path: Path, first_line: int) -> FileFormatError:
    """Names the first line that is not as it should be."""
    for number, line in enumerate(block.split(b"\n"), first_line):
        words = line.translate(table).split()
        if not words:
            continue
        text = line.decode("utf-8", "replace").strip()[:60]
        for word in words:
            try:
                float(word)
            except ValueError:
                return FileFormatError(
                    f"{word.decode('utf-8', 'replace')[:30]!r} is no number", where=f"{path}:{number}", value=text
                )
        if len(words) != columns:
            return FileFormatError(
                "the line has another number of columns than the first",
                where=f"{path}:{number}",
                value=f"{len(words)}: {text}",
                limit=columns,
            )
    return FileFormatError("the numbers cannot be read", where=f"{path}:{first_line}")

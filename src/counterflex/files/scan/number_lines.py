"""Lines of numbers, block by block: what clouds of points and meshes in text form consist of."""

from __future__ import annotations

import csv
import io
import re
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError

MISSING: Final = frozenset(
    {"", "*", "**", "***", "****", "-", "--", "---", "nan", "n/a", "na", "#n/a", "null", "none", "missing", "?"}
)
"""Cells of a point that was not measured: PolyWorks writes ``*``, spreadsheets ``#N/A``."""
_GROUPED: Final = {
    mark: re.compile(rf"[+-]?\d{{1,3}}(?:{re.escape(mark)}\d{{3}})+(?:[.,]\d*)?(?:[eE][+-]?\d+)?")
    for mark in (",", ".", "'", " ", "\u00a0", "\u202f", "\u2019")
}
_SHAPE: Final = re.compile(r"[+-]?[\d.,' \u00a0\u202f\u2019]*\d[\d.,' \u00a0\u202f\u2019]*(?:[eE][+-]?\d+)?")


@dataclass(frozen=True)
class Decimals:
    """Form in which numbers are written."""

    comma: bool = False
    group: str = ""  # Mark between groups of three digits, or ""

    @classmethod
    def of(cls, cells: Iterable[str]) -> Decimals:
        """Notation of cells, none of which holds a separator.

        Where a cell has both marks, the last one is the decimal mark. A comma alone is one, unless it stands twice in
        a cell or other cells have a decimal point.
        """
        numbers = [cell for cell in cells if _SHAPE.fullmatch(cell)]
        quote = next((m for m in ("'", " ", "\u00a0", "\u202f", "\u2019") if any(m in c.strip() for c in numbers)), "")
        if any(0 <= c.rfind(".") < c.rfind(",") or c.count(".") > 1 for c in numbers):
            return cls(True, ".")
        point, comma = any("." in c for c in numbers), any("," in c for c in numbers)
        if any(c.count(",") > 1 for c in numbers) or (point and comma):
            return cls(False, ",")
        return cls(comma, quote)

    def number(self, cell: str) -> float | None:
        """Number of a cell; None where it is none in this notation."""
        text = cell
        if self.group and self.group in text:
            if not _GROUPED[self.group].fullmatch(text):
                return None
            text = text.replace(self.group, "")
        if self.comma:
            if "." in text:
                return None
            text = text.replace(",", ".")
        try:
            return float(text) if "_" not in text else None
        except ValueError:
            return None

    @property
    def plain(self) -> bool:
        """True where a number is written with a point and nothing else."""
        return not self.comma and not self.group


def split(line: str, separator: str | None) -> list[str]:
    """Cells of a line; separators within quotes are none."""
    if separator is not None and '"' in line:
        return [cell.strip() for cell in next(csv.reader([line.strip()], delimiter=separator), [])]
    return [cell.strip().strip('"') for cell in line.strip().split(separator)]


BLOCK: Final = 1 << 24
SPACES: Final = (bytes.maketrans(b",;\t|", b"    "), b"")
"""Separators become spaces; nothing is taken out."""


def separators(decimals: Decimals) -> tuple[bytes, bytes] | None:
    """Translation of a line into numbers with points and spaces between, and bytes to take out; None: by cells only."""
    if decimals.group not in ("", ",", ".", "'"):
        return None
    taken = decimals.group.encode()
    if decimals.comma:
        return bytes.maketrans(b",;\t|", b".   "), taken
    return SPACES[0], taken


def text_stream(path: Path) -> BinaryIO:
    """A text as bytes of UTF-8; one in UTF-16, with its mark or without, is turned into it."""
    stream = path.open("rb")
    head = stream.read(200)
    stream.seek(0)
    name = utf16(head)
    if name is None:
        return stream
    with stream:
        return io.BytesIO(stream.read().decode(name, "replace").removeprefix("\ufeff").encode())


def utf16(head: bytes) -> str | None:
    """Encoding of a text whose every other byte is zero, or that begins with a mark of UTF-16; None: another."""
    if head.startswith(b"\xff\xfe") and not head.startswith(b"\xff\xfe\x00\x00"):
        return "utf-16-le"
    if head.startswith(b"\xfe\xff"):
        return "utf-16-be"
    even, odd = head[0::2], head[1::2]
    if len(head) >= 8 and odd.count(0) > 0.9 * len(odd) and even.count(0) == 0:
        return "utf-16-le"
    if len(head) >= 8 and even.count(0) > 0.9 * len(even) and odd.count(0) == 0:
        return "utf-16-be"
    return None


def line_blocks(stream: BinaryIO) -> Iterator[bytes]:
    """Whole lines, some megabytes at a time; ends of lines become those of Unix."""
    rest = b""
    while block := stream.read(BLOCK):
        whole, _, rest = (rest + block).rpartition(b"\n")
        if whole:
            yield whole.replace(b"\r", b"") + b"\n"
    if rest:
        yield rest.replace(b"\r", b"\n")


def numbers(block: bytes, columns: int, table: tuple[bytes, bytes], path: Path, first_line: int) -> Float:
    """The numbers (k, columns) of a block of lines.

    Args:
        block: Whole lines; empty ones and comments (``#``, ``//``) are left out.
        columns: Numbers in each line.
        table: Translation that leaves spaces between numbers, and bytes that are taken out.
        first_line: Number of the first line of the block.

    Raises:
        FileFormatError: A line has other numbers than the first, or a word is no number.
    """
    if b"#" in block or b"/" in block:
        kept = (b"" if line.lstrip().startswith((b"#", b"//")) else line for line in block.split(b"\n"))
        block = b"\n".join(kept)
    spaced = block.translate(*table)
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


def _fault(block: bytes, columns: int, table: tuple[bytes, bytes], path: Path, first_line: int) -> FileFormatError:
    """Names the first line that is not as it should be."""
    for number, line in enumerate(block.split(b"\n"), first_line):
        words = line.translate(*table).split()
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

"""Text of a program file and its encoding, whatever the language."""

from __future__ import annotations

import codecs
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.core.file_content import content

_LARGEST_FILE: Final = 500_000_000


def read_text(file: Path) -> tuple[str, str]:
    """Text of a program file and its encoding: UTF-8, with or without byte order mark, else Latin-1.

    Raises:
        ProgramError: The file cannot be read, is too large, or is no text.
    """
    if file.is_file() and file.stat().st_size > _LARGEST_FILE:
        raise ProgramError("the file is too large", where=str(file), value=file.stat().st_size, limit=_LARGEST_FILE)
    data = content(file, ProgramError)
    head = data[:64]
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) or 3 * head.count(b"\0") > len(head) > 0:
        raise ProgramError("the file is in UTF-16 or UTF-32", where=str(file), hint="Save it as ASCII or UTF-8")
    if b"\0" in data:
        line = data[: data.index(b"\0")].count(b"\n") + 1
        hint = "Programs are plain text. Give the program itself, or write it again with the postprocessor"
        raise ProgramError("not a text file: it contains zero bytes", where=f"{file}:{line}", hint=hint)
    encoding = "utf-8-sig" if data.startswith(codecs.BOM_UTF8) else "utf-8"
    try:
        return data.decode(encoding), encoding
    except UnicodeDecodeError:
        return data.decode("latin-1"), "latin-1"


def refuse_mark(encoding: str, file: Path, readers: str = "no controller reads") -> None:
    """Refuse a file that begins with a byte order mark."""
    if encoding == "utf-8-sig":
        raise ProgramError(
            f"the file begins with a byte order mark, which {readers}", where=str(file),
            hint="Save it as ASCII or Latin-1, or as UTF-8 without a mark",
        )  # fmt: skip


def common_encoding(texts: Mapping[str, tuple[str, str]]) -> str:
    """Return the encoding of all files of a job, which are written back in one.

    Raises:
        ProgramError: They differ in it.
    """
    own = {encoding for text, encoding in texts.values() if not text.isascii() or encoding == "utf-8-sig"}
    if len(own) > 1:
        raise ProgramError("the files of the job are in different encodings", where=" ".join(texts),
                           value=" ".join(sorted(own)), hint="Save all of them in one encoding")  # fmt: skip
    return own.pop() if own else "utf-8"

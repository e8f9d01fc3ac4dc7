"""Finished steps of long jobs: kept on disk, recognised by a fingerprint of everything they were made from."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from counterflex import __version__
from counterflex.core import atomic
from counterflex.core.errors import FileFormatError

DONE: Final = "done.json"
"""Written last into the folder of a step: its fingerprint, and what the job needs to go on."""


def fingerprint(*files: str | Path, **facts: Any) -> str:
    """SHA-256, hex, over the bytes of files, over plain facts and over the version of this program.

    Args:
        files: Read whole; a file's name and place do not matter.
        facts: Numbers, texts, lists and tables of these.

    Raises:
        FileFormatError: A file cannot be read.
    """
    digest = hashlib.sha256()
    for file in files:
        try:
            data = Path(file).read_bytes()
        except OSError as fault:
            raise FileFormatError(f"cannot be read: {fault.strerror or fault}", where=str(file)) from fault
        digest.update(hashlib.sha256(data).digest())
    digest.update(json.dumps({"counterflex": __version__, **facts}, sort_keys=True, allow_nan=False).encode())
    return digest.hexdigest()


def finished(folder: Path, mark: str) -> dict[str, Any] | None:
    """What a step wrote when it ended, or None where it did not end, or was made from something else.

    Args:
        folder: Of the step.
        mark: Its fingerprint now.
    """
    try:
        data = json.loads((folder / DONE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(data, dict) or data.get("fingerprint") != mark:
        return None
    found = data.get("found")
    return found if isinstance(found, dict) else None


def begin(folder: Path) -> None:
    """Make a step's folder and take away the mark of an earlier, different one."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / DONE).unlink(missing_ok=True)


def finish(folder: Path, mark: str, found: Mapping[str, Any]) -> None:
    """Mark a step as finished.

    Args:
        folder: Of the step.
        mark: Its fingerprint.
        found: Plain values for those who come after it.
    """
    text = json.dumps({"fingerprint": mark, "found": dict(found)}, indent=2, allow_nan=False)
    atomic.write_text(folder / DONE, text + "\n")

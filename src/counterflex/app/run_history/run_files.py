"""Files that a run was made of, found again from its log."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def file_of_run(about: Mapping[str, Any], kind: str, folder: Path) -> Path | None:
    """A file of a run where it still is, unchanged by its SHA-256; None where it is not.

    Its path was relative to where the run was started: often the folder that the log lies in.

    Args:
        kind: ``cell``, ``plan``, ``program`` or ``rsi``.
    """
    name, sha256 = about.get("files", {}).get(kind), about.get("sha256", {}).get(kind)
    for place in () if name is None else (Path(name), folder.absolute().parent / name):
        with contextlib.suppress(OSError):
            if hashlib.sha256(place.read_bytes()).hexdigest() == sha256:
                return place
    return None

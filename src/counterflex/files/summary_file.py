"""``summary.json``: what a job did, in numbers, for people and programs."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from counterflex.core import atomic, file_content
from counterflex.core.errors import FileFormatError
from counterflex.evaluate.summary import FORMAT, VERSION
from counterflex.files.schema import check_header

_FORMER_LEVELS = {"same": "exact", "seeded": "catalogue"}
"""Truth levels of version 1 and what they are called since."""


def write_summary(path: Path, data: Mapping[str, Any]) -> None:
    """Write a summary; format and version are put first, numbers that are not finite become null."""
    atomic.write_text(path, json.dumps({"format": FORMAT, "version": VERSION, **_plain(data)}, indent=2) + "\n")


def read_summary(path: Path) -> dict[str, Any]:
    """Read a summary; the truth levels of version 1 get their present names.

    Raises:
        FileFormatError: Missing, not JSON, another format, or newer than this program.
    """
    data = file_content.json_value(path)
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise FileFormatError(f"not a {FORMAT} file", where=str(path))
    check_header(data, kind=FORMAT, version=VERSION, where=str(path))
    return _with_present_levels(data) if data["version"] == 1 else data


def _with_present_levels(data: dict[str, Any]) -> dict[str, Any]:
    """A summary of version 1 with the names of version 2 for its truth levels."""

    def named(entry: Any) -> Any:
        level = entry.get("truth_level") if isinstance(entry, dict) else None
        return {**entry, "truth_level": _FORMER_LEVELS.get(level, level)} if isinstance(level, str) else entry

    present = dict(named(data))
    seeds, over = present.get("seeds"), present.get("over_seeds")
    if isinstance(seeds, list):
        present["seeds"] = [named(entry) for entry in seeds]
    if isinstance(over, dict):
        present["over_seeds"] = {_FORMER_LEVELS.get(level, level): value for level, value in over.items()}
    return present


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value

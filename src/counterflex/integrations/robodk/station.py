"""Tools and frames of a RoboDK station, as a script on its API writes them (docs/cell-import.md)."""

from __future__ import annotations

import json
from typing import Any, Final

import numpy as np

from counterflex.app.controller_import.frames import ControllerData, DataKind
from counterflex.core import file_content
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.core.units import MM

_UNIT = 1e-6


def read_robodk(text: str, where: str) -> ControllerData:
    """``{"tools": {NAME: rows}, "frames": {NAME: rows}}``: 4 x 4 poses, mm, tools in the flange, frames in the base.

    Raises:
        FileFormatError: It is of another form.
    """
    with file_content.readable(where, "JSON", "Write it by the script of docs/cell-import.md"):
        content = json.loads(text)
    if not isinstance(content, dict) or not ({"tools", "frames"} & content.keys()):
        raise FileFormatError("the file holds no tools and frames of a station", where=where,
                              limit='{"tools": {...}, "frames": {...}}')  # fmt: skip
    out = ControllerData("RoboDK")
    for key, frames in (("tools", out.tools), ("frames", out.bases)):
        given = content.get(key, {})
        if not isinstance(given, dict):
            raise FileFormatError(f"{key} is no table of names", where=where)
        for name, rows in given.items():
            frames[str(name)] = _pose(rows, f"{where}: {key}.{name}")
    out.root_known = True
    return out


def _pose(rows: Any, where: str) -> Float:
    try:
        T = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError):
        T = np.zeros(0)
    if T.shape != (4, 4) or not np.all(np.isfinite(T)) or np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max() > _UNIT:
        raise FileFormatError("not a pose", where=where, limit="four rows of four numbers, a rotation in it, mm")
    out: Float = T.copy()
    out[:3, 3] *= MM
    return out


def read_data(text: str, where: str) -> ControllerData | None:
    """Data of a station; None of a text that is no JSON object."""
    return read_robodk(text, where) if text.lstrip().startswith("{") else None


DATA: Final = DataKind("a JSON file of a RoboDK station", read_data)

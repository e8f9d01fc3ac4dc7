"""The text of a cell file: values chosen in a form, and the line that a fault is in."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import tomlkit
from tomlkit.exceptions import TOMLKitError

from counterflex.core.errors import CounterflexError
from counterflex.files.cell.document import new_table, table_of
from counterflex.files.cell.set_up import POSE_KEYS

TOOL_KEYS: Final = ("diameter_mm", "flutes", "overhang_mm")
"""Keys of a tool that the form has."""
_AT_LINE: Final = re.compile(r"\bline (\d+)")
_HEADER: Final = re.compile(r"^\s*\[+\s*([\w.\"-]+)\s*\]+")
_PLACE: Final = re.compile(r"^[a-z_]+(\[\d+\])?(\.[a-z0-9_]+(\[\d+\])?)*$", re.IGNORECASE)


@dataclass(frozen=True)
class CellValues:
    """Values of a cell file that the form shows."""

    robot: str = ""  # Name in the catalogue; empty: described in the file
    material: str = ""  # Name in the catalogue; empty: constants in the file
    material_name: str = ""
    tools: tuple[dict[str, Any], ...] = ()
    part: Mapping[str, float] | None = None  # By key of a pose; None where the cell has no part

    @classmethod
    def of(cls, text: str) -> CellValues | None:
        """Values of a text; None where it is no TOML."""
        try:
            doc: Any = tomlkit.parse(text).unwrap()
        except TOMLKitError:
            return None
        part, material = doc.get("part"), doc.get("material", {})
        try:
            return cls(
                str(doc.get("robot", {}).get("catalog", "")),
                str(material.get("catalog", "")),
                str(material.get("name", "")),
                tuple(dict(tool) for tool in doc.get("tools", [])),
                None if part is None else {key: float(part.get(key, 0.0)) for key in POSE_KEYS},
            )
        except (AttributeError, TypeError, ValueError):
            return None


def with_values(
    text: str,
    *,
    robot: str = "",
    material: str = "",
    tool: tuple[int, Mapping[str, float | None]] | None = None,
    part: Mapping[str, float] | None = None,
) -> str:
    """Return a text with other values; comments, order and everything else are kept.

    Args:
        robot: Of the catalogue; empty leaves what is there.
        material: Of the catalogue, in place of all that the table says; empty leaves it.
        tool: Index of a tool, and its values by key; None takes a key out.
        part: Pose by key.
    """
    doc = tomlkit.parse(text)
    if robot:
        table_of(doc, "robot")["catalog"] = robot
    if material:
        table = new_table()
        table["catalog"] = material
        doc["material"] = table
    if tool is not None:
        rows: Any = doc["tools"]
        _enter(rows[tool[0]], tool[1])
    if part is not None:
        here = table_of(doc, "part")
        _enter(here, {key: value for key, value in part.items() if value != 0.0 or key in here})
    return tomlkit.dumps(doc)


def _enter(table: Any, values: Mapping[str, float | None]) -> None:
    for key, value in values.items():
        if value is None:
            table.pop(key, None)
        elif table.get(key) != value:
            table[key] = int(value) if float(value).is_integer() else value


def line_of(text: str, fault: CounterflexError) -> int | None:
    """Return the line of a text that a fault of its cell file is in, counted from 1; None where it names none."""
    match = _AT_LINE.search(str(fault))
    if match is not None:
        return int(match[1])
    place = str(fault.where or "").rpartition(": ")[2]
    return _line_of_key(text.splitlines(), place) if _PLACE.match(place) else None


def _line_of_key(lines: list[str], place: str) -> int | None:
    """Line of ``tools[1].flutes``: of the key, or of the table where it is not there. Rows count from 1."""
    *_, last = keys = place.split(".")
    for depth in range(len(keys), 0, -1):
        table = ".".join(re.sub(r"\[\d+\]", "", key) for key in keys[:depth])
        rows = [int(number) for number in re.findall(r"\[(\d+)\]", ".".join(keys[:depth]))]
        starts = [k for k, line in enumerate(lines) if (match := _HEADER.match(line)) and match[1] == table]
        if starts:
            start = starts[min(max(rows[-1], 1), len(starts)) - 1] if rows else starts[0]
            end = next((k for k in range(start + 1, len(lines)) if _HEADER.match(lines[k])), len(lines))
            key = re.compile(rf"^\s*{re.escape(last)}\s*=")
            return next((k for k in range(start, end) if key.match(lines[k])), start) + 1
    return next((k + 1 for k, line in enumerate(lines) if re.match(rf"^\s*{re.escape(last)}\s*=", line)), None)

"""Each key of the cell file becomes SI in one place: a second place would need the same change, and be forgotten."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path
from typing import Any, get_args, get_origin

import counterflex
from counterflex.files.cell.controller import ControllerTable
from counterflex.files.cell.links import EgmTable
from counterflex.files.cell.online import OnlineTable
from counterflex.files.cell.planning import DynamicsTable, LimitsTable, PostureTable

SOURCE = Path(counterflex.__path__[0])
ROOMS = ("app", "cli", "files", "report")
"""Rooms that see the tables of the cell file."""
UNITS = {"DEG", "MM", "MM_PER_S", "MM_PER_MIN", "MS", "UM", "RPM", "MRAD", "pi"}
TABLES = (PostureTable, LimitsTable, DynamicsTable, ControllerTable)
ALIKE = {*EgmTable.model_fields, *OnlineTable.model_fields, "correction_mm", "correction_deg", "cycle_ms"}
"""Names that other tables have, too: a file that reads one of these may mean the other table."""


def number(annotation: Any) -> bool:
    """Whether a key is one number, that may be left out."""
    return annotation is float or (get_origin(annotation) is not tuple and any(map(number, get_args(annotation))))


KEYS = {key for table in TABLES for key, field in table.model_fields.items() if number(field.annotation)} - ALIKE


def conversions() -> dict[str, set[str]]:
    """Files, by key of these tables, that multiply or divide it by a unit."""
    found: dict[str, set[str]] = defaultdict(set)
    for file in (file for room in ROOMS for file in (SOURCE / room).rglob("*.py")):
        for product in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(product, ast.BinOp) and isinstance(product.op, ast.Mult | ast.Div):
                parts = [n.attr if isinstance(n, ast.Attribute) else n.id if isinstance(n, ast.Name) else ""
                         for n in ast.walk(product)]  # fmt: skip
                reads = {n.attr for n in ast.walk(product) if isinstance(n, ast.Attribute)} & KEYS
                if UNITS & set(parts):
                    for key in reads:
                        found[key].add(file.relative_to(SOURCE).as_posix())
    return found


def test_each_key_becomes_si_in_one_file() -> None:
    found = conversions()
    assert {"rotation_about_tool_deg", "joint_margin_deg", "mode_hz", "rapid_mm_s"} <= found.keys()
    assert {key: files for key, files in found.items() if len(files) > 1} == {}

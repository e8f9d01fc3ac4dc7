"""Reading and writing tables of a truth file: every key taken once, units in the keys, what is left over refused."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.core.units import DEG, MM
from counterflex.geometry import pose, rotation

T = TypeVar("T")
DIRECTIONS: Final = ("tx", "ty", "tz", "rx", "ry", "rz")
"""Elastic coordinates of a body, in the order of its compliance."""


def in_unit(values: Float | tuple[float, ...], unit: float) -> list[float]:
    """Numbers in a shop unit."""
    return [float(v) / unit for v in values]


def pose_to(T: Float) -> dict[str, Any]:
    """Keys of a pose (4, 4)."""
    return {"position_mm": in_unit(T[:3, 3], MM), "abc_deg": in_unit(rotation.to_zyx(T[:3, :3]), DEG)}


class TruthTable:
    """Takes keys out of a table one by one and refuses what is left."""

    def __init__(self, data: Any, where: str) -> None:
        if not isinstance(data, Mapping):
            raise FileFormatError("not a table", where=where, value=type(data).__name__)
        self._unread, self.where = dict(data), where

    def __contains__(self, key: str) -> bool:
        return key in self._unread

    def raw(self, key: str) -> Any:
        """The value of a key as it stands."""
        if key not in self._unread:
            raise FileFormatError(f"the key '{key}' is missing", where=self.where)
        return self._unread.pop(key)

    def number(self, key: str, unit: float = 1.0) -> float:
        """A finite number times ``unit``."""
        return self._number(key, self.raw(key)) * unit

    def integer(self, key: str) -> int:
        """A whole number."""
        value = self.raw(key)
        if isinstance(value, bool) or not isinstance(value, int):
            raise FileFormatError("not a whole number", where=f"{self.where}: {key}", value=repr(value))
        return value

    def axis(self) -> int:
        """Axis 0..5 from the key ``axis``, 1..6."""
        value = self.integer("axis")
        if not 1 <= value <= 6:
            raise FileFormatError("no such axis", where=f"{self.where}: axis", value=value, limit="1 .. 6")
        return value - 1

    def text(self, key: str) -> str:
        """A text."""
        value = self.raw(key)
        if not isinstance(value, str):
            raise FileFormatError("not a text", where=f"{self.where}: {key}", value=repr(value))
        return value

    def numbers(self, key: str, count: int, unit: float = 1.0) -> tuple[float, ...]:
        """A list of ``count`` numbers, times ``unit``."""
        value = self.raw(key)
        if not isinstance(value, list) or len(value) != count:
            raise FileFormatError("wrong list", where=f"{self.where}: {key}", value=repr(value)[:60], limit=count)
        return tuple(self._number(key, v) * unit for v in value)

    def texts(self, key: str, count: int) -> tuple[str, ...]:
        """A list of ``count`` texts."""
        value = self.raw(key)
        if not isinstance(value, list) or len(value) != count or not all(isinstance(v, str) for v in value):
            raise FileFormatError("wrong list", where=f"{self.where}: {key}", value=repr(value)[:60], limit=count)
        return tuple(value)

    def rows(self, key: str, without: tuple[Any, ...] | None = None) -> list[TruthTable]:
        """A list of tables; ``without``: what a missing key stands for, None: it must be there."""
        value = list(without) if without is not None and key not in self else self.raw(key)
        if not isinstance(value, list):
            raise FileFormatError("not a list of tables", where=f"{self.where}: {key}")
        return [TruthTable(row, f"{self.where}: {key}[{i + 1}]") for i, row in enumerate(value)]

    def pose(self) -> Float:
        """``T`` (4, 4) of the keys of :func:`pose_to`."""
        return pose.from_xyz_zyx(
            np.array(self.numbers("position_mm", 3, MM)), np.array(self.numbers("abc_deg", 3, DEG))
        )

    def close(self) -> None:
        """Refuse what was not taken."""
        if self._unread:
            keys = ", ".join(f"'{key}'" for key in sorted(map(str, self._unread)))
            raise FileFormatError(f"unknown key {keys}", where=self.where, hint="Remove it")

    def _number(self, key: str, value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise FileFormatError("not a finite number", where=f"{self.where}: {key}", value=repr(value))
        return float(value)


def closed(table: TruthTable, read: Callable[[TruthTable], T]) -> T:
    """Read a table with ``read``, and refuse keys that are left."""
    out = read(table)
    table.close()
    return out


class TableKey(NamedTuple):
    """One key of a table, and the field of an object that it stands for."""

    key: str
    field: str
    unit: float | str = 1.0  # of the number in the file, SI; or "axis" (1..6 for 0..5), "joint", "whole", "text"
    numbers: int = 0  # how many in a list; 0: no list
    optional: bool = False  # the key is missing where the field is None


def to_table(thing: object, keys: tuple[TableKey, ...]) -> dict[str, Any]:
    """Fields of an object as a table."""
    return {k.key: _shown(getattr(thing, k.field), k) for k in keys if getattr(thing, k.field) is not None}


def _shown(value: Any, key: TableKey) -> Any:
    if isinstance(key.unit, str):
        return value + 1 if key.unit in ("axis", "joint") else value
    if key.unit == 1.0:
        return list(value) if key.numbers else value
    return in_unit(value, key.unit) if key.numbers else value / key.unit


def from_table(table: TruthTable, kind: Callable[..., T], keys: tuple[TableKey, ...]) -> T:
    """An object of the fields that a table has keys for, which must be all of them that are not optional."""
    fields = {k.field: _read(table, k) for k in keys if not k.optional or k.key in table}
    return closed(table, lambda _: kind(**fields))


def _read(table: TruthTable, key: TableKey) -> Any:
    match key.unit:
        case "axis":
            return table.axis()
        case "joint":
            return table.integer(key.key) - 1
        case "whole":
            return table.integer(key.key)
        case "text":
            return table.text(key.key)
        case float() as unit:
            return table.numbers(key.key, key.numbers, unit) if key.numbers else table.number(key.key, unit)


def optional(top: TruthTable, key: str, kind: Callable[..., T], keys: tuple[TableKey, ...]) -> T | None:
    """An object from a table that may be missing."""
    return from_table(TruthTable(top.raw(key), f"{top.where}: {key}"), kind, keys) if key in top else None

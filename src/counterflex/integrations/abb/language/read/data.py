"""Declarations of RAPID, and aggregates as frames: for files that are not executed."""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.geometry import pose, rotation
from counterflex.integrations.abb.language.read.literals import AggregateLiteral

DECLARATION: Final = re.compile(
    r"(?:(?:LOCAL|TASK|GLOBAL)\s+)*(CONST|PERS|VAR)\s+(\w+)\s+(\w+)\s*(\{[^}]*\})?\s*(:=)?\s*", re.IGNORECASE
)
"""Groups: storage, data type, name, dimensions, assignment."""
_UNIT: Final = 1e-3
_LARGEST_MM: Final = 100_000.0


def position(item: object) -> tuple[float, float, float] | None:
    """x, y, z of ``[x,y,z]``, mm; None where it is none, or beyond every robot."""
    numbers = item.numbers((3,)) if isinstance(item, AggregateLiteral) else None
    if numbers is None or not all(abs(number.value) <= _LARGEST_MM for number in numbers):
        return None
    x, y, z = (number.value for number in numbers)
    return x, y, z


def quaternion(item: object) -> tuple[float, float, float, float] | None:
    """q1 to q4 of ``[q1,q2,q3,q4]``; None where it is none, or not of length 1."""
    numbers = item.numbers((4,)) if isinstance(item, AggregateLiteral) else None
    if numbers is None:
        return None
    q1, q2, q3, q4 = (number.value for number in numbers)
    length = float(np.sqrt(q1 * q1 + q2 * q2 + q3 * q3 + q4 * q4))
    return (q1, q2, q3, q4) if abs(length - 1.0) <= _UNIT else None


def frame(item: object) -> Float | None:
    """(4, 4) of a pose ``[[x,y,z],[q1,q2,q3,q4]]``, m; None where it is none."""
    if not isinstance(item, AggregateLiteral) or len(item.items) != 2:
        return None
    p, q = position(item.items[0]), quaternion(item.items[1])
    return None if p is None or q is None else pose.make(rotation_of(q), np.array(p) * MM)


def rotation_of(q: tuple[float, float, float, float]) -> Float:
    """(3, 3) of a quaternion, q1 scalar, its length taken out."""
    value = np.array(q)
    return rotation.from_quat_wxyz(value / np.linalg.norm(value))


def truth(item: object) -> bool | None:
    """TRUE or FALSE; None where it is neither."""
    return {"TRUE": True, "FALSE": False}.get(item.upper()) if isinstance(item, str) else None

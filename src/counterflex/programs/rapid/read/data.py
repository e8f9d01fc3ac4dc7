"""Declared and predefined data of RAPID: targets, speeds, zones, tools, work objects, numbers."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM
from counterflex.geometry import pose, rotation
from counterflex.programs.rapid.read.literals import Aggregate, aggregate
from counterflex.programs.rapid.read.scanner import Source, Statement
from counterflex.programs.robot_text.process_words import NUMBER

DECLARATION: Final = re.compile(
    r"(?:(?:LOCAL|TASK|GLOBAL)\s+)?(?:CONST|PERS|VAR)\s+(\w+)\s+(\w+)\s*(\{[^}]*\})?\s*(:=)?\s*", re.IGNORECASE
)
_ELEMENT: Final = re.compile(r"([A-Za-z]\w*)\s*\{\s*(\d+)\s*\}")
_SPEEDS: Final = (
    5, 10, 20, 30, 40, 50, 60, 80, 100, 150, 200, 300, 400, 500, 600, 800, 1000, 1500, 2000, 2500, 3000, 4000, 5000,
    6000, 7000,
)  # fmt: skip
SPEEDS: Final = {f"V{speed}": float(speed) for speed in _SPEEDS}
"""Predefined speeddata, mm/s; each has 500 deg/s. vmax is that of the robot and is not known."""
ZONES: Final = frozenset(("FINE", *(f"Z{zone}" for zone in (0, 1, 5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200))))
_UNIT: Final = 1e-3
_LARGEST_MM: Final = 100_000.0


@dataclass(frozen=True, slots=True)
class Declared:
    """A declaration.

    Attributes:
        kind: Data type, in lower case.
        name: As declared.
        start: Index of the statement.
        value: Index of the value; -1 where none is given.
        end: Index of the semicolon.
        array: It has dimensions.
    """

    kind: str
    name: str
    start: int
    value: int
    end: int
    array: bool


class Data:
    """What a module declares.

    Args:
        source: The module.
        statements: Of it.

    Raises:
        ProgramError: A name is declared twice in the module, or twice in one routine.
    """

    def __init__(self, source: Source, statements: Iterable[Statement]) -> None:
        self.source = source
        self._all: dict[tuple[str, str], Declared] = {}
        scope = ""
        for statement in statements:
            if statement.structure:
                head = re.match(r"(?:\w+\s+)?(PROC|FUNC|TRAP|ENDPROC|ENDFUNC|ENDTRAP)\b", statement.code, re.IGNORECASE)
                if head is not None:
                    scope = "" if head[1].upper().startswith("END") else f"{statement.start}"
                continue
            match = DECLARATION.match(statement.code)
            if match is None:
                continue
            key = (scope, match[2].upper())
            if key in self._all:
                raise ProgramError(
                    f"{match[2]} is declared twice", where=source.place(statement.start),
                    limit=f"once; first in line {source.line(self._all[key].start)}",
                    hint="The file may be damaged: post it again",
                )  # fmt: skip
            value = statement.start + match.end() if match[4] else -1
            self._all[key] = Declared(
                match[1].lower(), match[2], statement.start, value, statement.end, match[3] is not None
            )

    @property
    def names(self) -> frozenset[str]:
        """Names that are declared, in capitals."""
        return frozenset(name for _, name in self._all)

    def find(self, name: str, routine: int) -> Declared | None:
        """A declaration by name, as a routine that begins at an index sees it."""
        key = name.upper()
        return self._all.get((f"{routine}", key)) or self._all.get(("", key))

    def literal(self, text: str, kind: str, routine: int) -> tuple[Aggregate, Declared] | None:
        """The aggregate that a name, or an element of an array, stands for; None where it is not known."""
        match = _ELEMENT.fullmatch(text)
        declared = self.find(match[1] if match else text, routine)
        if declared is None or declared.kind != kind or declared.value < 0 or declared.array != (match is not None):
            return None
        parts = aggregate(self.source.code, declared.value, declared.end)
        if parts is None or match is None:
            return None if parts is None else (parts, declared)
        index = int(match[2])
        if not 1 <= index <= len(parts.items):
            return None
        item = parts.items[index - 1]
        return (item, declared) if isinstance(item, Aggregate) else None

    def number(self, text: str, routine: int) -> float | None:
        """Value of a number, or of a declared one; None where it is computed."""
        text = text.strip()
        if re.fullmatch(NUMBER, text):
            return float(text)
        declared = self.find(text, routine)
        if declared is None or declared.kind not in ("num", "dnum") or declared.array or declared.value < 0:
            return None
        value = self.source.code[declared.value : declared.end].strip()
        return float(value) if re.fullmatch(NUMBER, value) else None


def position(item: object) -> tuple[float, float, float] | None:
    """x, y, z of ``[x,y,z]``, mm; None where it is none, or beyond every robot."""
    numbers = item.numbers((3,)) if isinstance(item, Aggregate) else None
    if numbers is None or not all(abs(number.value) <= _LARGEST_MM for number in numbers):
        return None
    x, y, z = (number.value for number in numbers)
    return x, y, z


def quaternion(item: object) -> tuple[float, float, float, float] | None:
    """q1 to q4 of ``[q1,q2,q3,q4]``; None where it is none, or not of length 1."""
    numbers = item.numbers((4,)) if isinstance(item, Aggregate) else None
    if numbers is None:
        return None
    q1, q2, q3, q4 = (number.value for number in numbers)
    length = float(np.sqrt(q1 * q1 + q2 * q2 + q3 * q3 + q4 * q4))
    return (q1, q2, q3, q4) if abs(length - 1.0) <= _UNIT else None


def frame(item: object) -> Float | None:
    """(4, 4) of a pose ``[[x,y,z],[q1,q2,q3,q4]]``, m; None where it is none."""
    if not isinstance(item, Aggregate) or len(item.items) != 2:
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

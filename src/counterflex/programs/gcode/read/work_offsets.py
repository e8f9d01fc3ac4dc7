"""Zeros of the work offsets: which are known, and where they lie in the part.

A program says ``G54`` and not where that is. Three sources tell it: the parameters of the machine, the cell file (zeros
in the part frame), or the program itself (G10). Without any of them the zero of the first offset in force while
something moves is the zero of the part; how far any other one is from it is not known.

Coordinates that a program turns (G68), mirrors (G51.1) or writes as radius and angle (G16).

A point with program value w lies at ``Rot(Mirror(w))`` from program zero: the mirror image is taken first, then the
rotation (Fanuc, Operator's Manual, "Coordinate system rotation", "Programmable mirror image", "Polar coordinate
command"; Haas, G68).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

from counterflex.core.errors import InputError
from counterflex.core.units import DEG
from counterflex.programs.gcode.read.arc import PLANE_AXES

Six = tuple[float, float, float, float, float, float]
ZERO: Final[Six] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
LINUXCNC_OFFSETS: Final = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")
MOST_FURTHER: Final = 300
"""Largest number of an offset G54.1 P (Fanuc: 48 or 300; Haas, as G154 P: 99)."""


def further(number: int) -> str:
    """Return the name of one of the further offsets that G54.1 P and G154 P select."""
    return f"G54.1 P{number}"


OFFSET_NAMES: Final = frozenset((*LINUXCNC_OFFSETS, *(further(number) for number in range(1, MOST_FURTHER + 1))))


def six(values: Sequence[float]) -> Six:
    """Return three or six finite numbers as a six-axis point; missing rotary axes are 0."""
    numbers = [float(value) for value in values]
    if len(numbers) == 3:
        numbers += [0.0, 0.0, 0.0]
    if len(numbers) != 6 or not all(-1e9 < number < 1e9 for number in numbers):
        raise InputError("an offset needs three or six finite numbers", value=list(values))
    return (numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5])


class WorkOffsets:
    """Zeros of the work offsets, as far as they are known.

    Args:
        machine: Zeros in machine coordinates by name: x, y, z in m and, optionally, a, b, c in degrees.
        known: Machine coordinates are those that positions are given in; offsets of LinuxCNC that ``machine`` leaves
            out are zero.
        part: Zeros in the part frame by name, those of other languages among them; no other offset is known then.

    Attributes:
        reference: Offset whose zero was taken as that of the part; empty where none was.
        line: Line in which it was in force first.

    Raises:
        InputError: An unknown name, or numbers that are no offset.
    """

    def __init__(
        self,
        machine: Mapping[str, Sequence[float]] | None = None,
        known: bool = True,
        part: Mapping[str, Sequence[float]] | None = None,
    ) -> None:
        for name in machine or {}:
            if name not in OFFSET_NAMES:
                raise InputError(
                    "an unknown work offset", value=name, limit=" ".join(LINUXCNC_OFFSETS) + " G54.1 P1 ..."
                )
        self.reference, self.line = "", 0
        self.fixed = known or bool(part)
        self._machine: dict[str, list[float | None]] = {}
        self._part: dict[str, list[float | None]] = {name: list(six(values)) for name, values in (part or {}).items()}
        self._part_in_machine: list[float | None] = [0.0 if known else None] * 6
        given = {name: six(values) for name, values in (machine or {}).items()}
        for name in LINUXCNC_OFFSETS if known else given:
            self._machine[name] = list(given.get(name, ZERO))
        for name, values in given.items():
            self._machine[name] = list(values)

    def fix(self, name: str, line: int) -> None:
        """Take the zero of an offset as that of the part: something moves while it is in force."""
        if not self.fixed:
            self.fixed, self.reference, self.line = True, name, line
            self._part_in_machine = list(self._machine.get(name, [None] * 6))
            self._part[name] = [0.0] * 6

    def _value(self, name: str, axis: int) -> float | None:
        part = self._part.get(name, [None] * 6)[axis]
        if part is not None:
            return part
        zero, base = self._machine.get(name, [None] * 6)[axis], self._part_in_machine[axis]
        return None if zero is None or base is None else zero - base

    def unknown_axes(self, name: str) -> str:
        """Return the letters of the axes along which the zero of an offset is not known; none before :meth:`fix`."""
        if not self.fixed:
            return ""
        return "".join(letter for axis, letter in enumerate("XYZ") if self._value(name, axis) is None)

    def __getitem__(self, name: str) -> Six:
        """Zero of an offset in the frame of positions, m and degrees; 0 along axes that are not known."""
        return six([self._value(name, axis) or 0.0 for axis in range(6)])

    def in_machine(self, name: str, axis: int) -> float | None:
        """Return the machine coordinate of a zero, m or degrees; None where it is not known."""
        zero = self._machine.get(name, [None] * 6)[axis]
        if zero is not None:
            return zero
        part, base = self._part.get(name, [None] * 6)[axis], self._part_in_machine[axis]
        return None if part is None or base is None else part + base

    def set_in_machine(self, name: str, axis: int, value: float) -> None:
        """Set a zero in machine coordinates (G10 L2)."""
        self._machine.setdefault(name, [None] * 6)[axis] = value
        if self.fixed and name in self._part:
            self._part[name][axis] = None

    def set_here(self, name: str, axis: int, value: float) -> None:
        """Set a zero in the frame of positions (G10 L20 of LinuxCNC)."""
        self._part.setdefault(name, [None] * 6)[axis] = value
        self._machine.setdefault(name, [None] * 6)[axis] = None


Rows = tuple[tuple[float, float, float], ...]
_UNIT: Final[Rows] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Rotation:
    """Rotation in a plane about a point."""

    plane: int  # 17, 18 or 19
    centre_m: tuple[float, float]  # In the plane's axes, from program zero, m
    angle_deg: float  # From the first axis of the plane to the second


@dataclass(frozen=True)
class Frame:
    """Coordinate transforms of a program."""

    rotation: Rotation | None = None  # G68; None without
    # Place of the mirror by axis, from program zero, m (G51.1)
    mirror_m: dict[int, float] = field(default_factory=dict)
    polar: bool = False  # G16
    line: int = 0  # Line of the last change
    # Axes that a motion must name before they have a meaning again: controllers differ in where an axis is after the
    # change that no word names
    pending: frozenset[int] = frozenset()

    @cached_property
    def plain(self) -> bool:
        """Return whether program values are lengths along the axes of the part."""
        return self.rotation is None and not self.mirror_m and not self.polar and not self.pending

    @cached_property
    def rows(self) -> Rows | None:
        """Rows of the matrix from programmed axes to those of the part; None where they are parallel."""
        return None if self._matrix == _UNIT else self._matrix

    @cached_property
    def affected(self) -> frozenset[int]:
        """Axes whose values the rotation or the mirror image changes."""
        turned = () if self.rotation is None else PLANE_AXES[self.rotation.plane][:2]
        return frozenset((*turned, *self.mirror_m))

    @cached_property
    def sense(self) -> float:
        """-1 where arcs run the other way round, else 1."""
        return -1.0 if len(self.mirror_m) % 2 else 1.0

    @cached_property
    def not_written(self) -> str:
        """Reason why blocks cannot be written back with other targets."""
        return "polar coordinates (G16)" if self.polar else "a mirror image (G51.1)" if self.mirror_m else ""

    @cached_property
    def _matrix(self) -> Rows:
        rows = [[-value if axis in self.mirror_m else value for axis, value in enumerate(row)] for row in _UNIT]
        if self.rotation is not None:
            first, second, _ = PLANE_AXES[self.rotation.plane]
            c, s = math.cos(self.rotation.angle_deg * DEG), math.sin(self.rotation.angle_deg * DEG)
            a, b = rows[first], rows[second]
            rows[first] = [c * x - s * y for x, y in zip(a, b, strict=True)]
            rows[second] = [s * x + c * y for x, y in zip(a, b, strict=True)]
        return tuple((row[0], row[1], row[2]) for row in rows)

    @cached_property
    def _shift(self) -> list[float]:
        """Part coordinates of program zero, from program zero without the frame, m."""
        shift = [2.0 * self.mirror_m.get(axis, 0.0) for axis in range(3)]
        if self.rotation is not None:
            first, second, _ = PLANE_AXES[self.rotation.plane]
            c, s = math.cos(self.rotation.angle_deg * DEG), math.sin(self.rotation.angle_deg * DEG)
            x, y = shift[first] - self.rotation.centre_m[0], shift[second] - self.rotation.centre_m[1]
            shift[first] = self.rotation.centre_m[0] + c * x - s * y
            shift[second] = self.rotation.centre_m[1] + s * x + c * y
        return shift

    def to_part(self, work: Six) -> Six:
        """Return where a programmed point lies, from program zero, m and degrees."""
        if self.rows is None:
            return work
        x, y, z = (sum(m * w for m, w in zip(row, work[:3], strict=True)) for row in self.rows)
        return (x + self._shift[0], y + self._shift[1], z + self._shift[2], *work[3:])

    def to_work(self, part: Six) -> Six:
        """Return the program values of a point; the inverse of :meth:`to_part`."""
        if self.rows is None:
            return part
        away = [p - s for p, s in zip(part[:3], self._shift, strict=True)]
        x, y, z = (sum(self.rows[axis][column] * away[axis] for axis in range(3)) for column in range(3))
        return (x, y, z, *part[3:])

    def direction(self, axis: int) -> tuple[float, float, float]:
        """Return the direction of a programmed axis in the part."""
        rows = self.rows or _UNIT
        return (rows[0][axis], rows[1][axis], rows[2][axis])

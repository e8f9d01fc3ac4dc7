"""Coordinates that a program turns (G68), mirrors (G51.1) or writes as radius and angle (G16).

A point with program value w lies at ``Rot(Mirror(w))`` from program zero: the mirror image is taken first, then the
rotation (Fanuc, Operator's Manual, "Coordinate system rotation", "Programmable mirror image", "Polar coordinate
command"; Haas, G68).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

from counterflex.core.units import DEG
from counterflex.programs.gcode.read.arc import PLANE_AXES
from counterflex.programs.gcode.read.work_offsets import Six

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

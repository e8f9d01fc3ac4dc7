"""A program that was written for a robot: it states how the tool is held."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM
from counterflex.geometry import pose, rotation
from counterflex.programs.program import Program

TURNING: Final = (0, 3, 5)
"""Axes that reach more than a full turn."""


@dataclass(frozen=True, slots=True)
class StatedPosture:
    """Posture as far as it is stated; None is not."""

    front: bool | None = None  # The wrist centre lies ahead of axis 1
    # Axis 3 is beyond the angle at which the arm is straight, in the direction of elbow up of a front arm
    bent: bool | None = None
    noflip: bool | None = None  # Axis 5 is positive in the sense of the closed form

    def agrees(self, branch: str) -> bool:
        """Return whether nothing of it contradicts a posture such as ``front up noflip``."""
        arm, elbow, wrist = branch.split()
        front = arm == "front"
        own = (front, (elbow == "up") == front, wrist == "noflip")
        stated = (self.front, self.bent, self.noflip)
        return all(a is None or a == b for a, b in zip(stated, own, strict=True))


Stated = tuple[StatedPosture, str]
"""A posture and the words that state it."""


@dataclass(frozen=True, slots=True)
class StatedTurns:
    """Ranges of axes 1, 4 and 6 as the controller shows them."""

    low_deg: tuple[float, ...]
    high_deg: tuple[float, ...]
    words: str

    @classmethod
    def of(cls, numbers: Sequence[int], size_deg: float, first_deg: float, words: str) -> StatedTurns:
        """Ranges of one size that are counted by whole numbers; 0 begins at ``first_deg``."""
        low = tuple(first_deg + size_deg * number for number in numbers)
        return cls(low, tuple(value + size_deg for value in low), words)


Span = tuple[int, int]
"""Index of the first character, and the one behind the last."""
_UPRIGHT_DEG: Final = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedPoint:
    """A point that an instruction names, as it stands in the text."""

    line: int  # 1-based line of the instruction
    start: int  # Index of its word
    head: int  # Index at which its line begins, a number included
    file: str = ""  # Name of the file that it stands in
    R_tcp_tool: Float  # (3, 3) orientation of its tool frame in the cell's TCP frame
    # (4, 4) m, frame that its numbers are in, in the part frame
    T_part_frame: Float = field(default_factory=lambda: np.eye(4))
    T_frame_tool: Float | None = None  # (4, 4) m, itself in that frame; None of a place by axes, and of a wait
    named: Span = (0, 0)  # Where the instruction names it

    @property
    def T_part_tool(self) -> Float:
        """(4, 4) m, itself in the part frame."""
        out: Float = self.T_part_frame @ (np.eye(4) if self.T_frame_tool is None else self.T_frame_tool)
        return out

    @property
    def moves(self) -> bool:
        """Each run of its instruction has a correction of its own."""
        return True

    @property
    def relative(self) -> bool:
        """It counts from where the robot is: once anything is corrected, it is written as numbers."""
        return False

    def in_frame(self, p: Float, R_part_tcp: Float) -> Float:
        """(4, 4) m of its tool frame in its frame, where the cell's TCP is at p, (3,) m, in the part."""
        out: Float = pose.inverse(self.T_part_frame) @ pose.make(R_part_tcp @ self.R_tcp_tool, p)
        return out


def frame_zyx(p_mm: Sequence[float], x_deg: float, y_deg: float, z_deg: float) -> Float:
    """(4, 4) m of a place in mm and turns about fixed x, y, z in this order: ``R = Rz Ry Rx``."""
    turns = np.array([z_deg, y_deg, x_deg]) * DEG
    return pose.make(rotation.from_zyx(turns), np.asarray(p_mm, dtype=np.float64) * MM)


def angles_zyx(R: Float) -> tuple[float, float, float]:
    """Turns about x, y, z in deg of an orientation (3, 3); the inverse of :func:`frame_zyx`."""
    z, y, x = (float(angle) for angle in rotation.to_zyx(R) / DEG)
    if abs(abs(y) - 90.0) < _UPRIGHT_DEG:  # only the sum or difference of the other two counts: controllers show z = 0
        both = x - z if y > 0.0 else x + z
        x, z = both - 360.0 * round(both / 360.0), 0.0
    return x, y, z


@dataclass(frozen=True, slots=True)
class RobotProgram(Program):
    """A program in a language of robots."""

    # (motions, 3, 3) orientation of the cell's TCP frame at the end of each motion, in the part
    Rs_part_tcp: Float | None = None
    # Lines that act on the cell (outputs, waits for inputs, TRIGGER) and are not in the cell file's table
    acting: tuple[int, ...] = ()
    # File and line of each motion by axes before the first target or behind the last one: none of the path
    left_out: tuple[str, ...] = ()
    # By motion, the axes A1 to A6 (J1 to J6) at its end as the controller shows them, of motions whose target the
    # program gives by axes
    axes_deg: Mapping[int, Sequence[float]] = field(default_factory=dict)
    # By motion, the values that external axes go to along it, mm or deg by the number of the axis
    external: Mapping[int, Mapping[int, float]] = field(default_factory=dict)

    @property
    def by_axes(self) -> frozenset[int]:
        """Motions behind the first that the controller makes by axes: every one that is no line, arc or wait."""
        return frozenset(k for k, motion in enumerate(self.motions) if k > 0 and motion.kind == "rapid")

    def stops(self) -> frozenset[int]:
        """Motions at whose end the robot stops exactly, as far as the language says it."""
        return frozenset()

    def roundings_m(self) -> list[float]:
        """Distance from its end at which the rounding of each motion begins, m; 0 stops, NaN where it is not said."""
        stops = self.stops()
        return [0.0 if index in stops else float("nan") for index in range(len(self.motions))]

    def postures(self) -> dict[int, Stated]:
        """Posture of the arm that motions ask for, by index of the motion."""
        return {}

    def turns(self) -> dict[int, StatedTurns]:
        """Turns of axes 1, 4 and 6 that motions by axes ask for, by index of the motion."""
        return {}

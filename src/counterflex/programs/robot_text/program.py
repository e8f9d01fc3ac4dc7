"""A program that was written for a robot: it states how the tool is held."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from counterflex.core.arrays import Float
from counterflex.programs.program import Program
from counterflex.programs.robot_text.stated import Stated, StatedTurns


@dataclass(frozen=True, slots=True)
class RobotProgram(Program):
    """A program in a language of robots.

    Attributes:
        Rs_part_tcp: (motions, 3, 3) orientation of the cell's TCP frame at the end of each motion, in the part.
        acting: Lines that act on the cell (outputs, waits for inputs, TRIGGER) and are not in the cell file's table.
        left_out: File and line of each motion by axes before the first target or behind the last one: none of the path.
        axes_deg: By motion, the axes A1 to A6 (J1 to J6) at its end as the controller shows them, of motions whose
            target the program gives by axes.
        external: By motion, the values that external axes go to along it, mm or deg by the number of the axis.
    """

    Rs_part_tcp: Float | None = None
    acting: tuple[int, ...] = ()
    left_out: tuple[str, ...] = ()
    axes_deg: Mapping[int, Sequence[float]] = field(default_factory=dict)
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

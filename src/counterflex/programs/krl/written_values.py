"""X Y Z A B C of a KRL program while it is written: where the robot stands, and turns that lie near."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM
from counterflex.geometry import rotation
from counterflex.programs.krl.edits import Values, spelled
from counterflex.programs.krl.program import LETTERS, KrlProgram, Target


class WrittenValues:
    """Values of targets, mm and deg.

    Args:
        program: As read.

    Attributes:
        values: As written last.
    """

    def __init__(self, program: KrlProgram) -> None:
        self.program = program
        self.values: Values = dict.fromkeys(LETTERS, 0.0)

    def here(self) -> Float:
        """Written position, (3,) m."""
        return np.array([self.values[letter] for letter in "XYZ"]) * MM

    def stand(self, values: Values) -> None:
        """Values were written: the robot is there."""
        self.values = {letter: float(spelled(letter, values[letter])) for letter in LETTERS}

    def named(self, target: Target) -> Values:
        """Values of a target as read; components that are not written are those written last."""
        return {
            letter: target.components[letter].value if letter in target.components else self.values[letter]
            for letter in LETTERS
        }

    def point_of(self, target: Target) -> Float:
        """(3,) m of a target as read."""
        values = self.named(target)
        return np.array([values[letter] for letter in "XYZ"]) * MM

    def nominal_angles(self, index: int) -> Values:
        """A B C at the programmed end of a motion: as written, or of the same orientation."""
        Rs, target = self.program.Rs_part_tcp, self.program.moves[index].target
        if Rs is None:
            raise ValueError("a program without orientations")
        written = {} if target is None else {k: c.value for k, c in target.components.items() if k in "ABC"}
        return self.angles(Rs[index]) | written

    def angles(self, R_part_tcp: Float) -> Values:
        """A B C of ``$TOOL`` in deg, near those written last: of the same orientation other turns are not written."""
        R_tcp_tool = np.eye(3) if self.program.R_tcp_tool is None else self.program.R_tcp_tool
        a, b, c = (float(angle) for angle in rotation.to_zyx(R_part_tcp @ R_tcp_tool) / DEG)
        near = np.array([self.values[letter] for letter in "ABC"])
        ways = [np.array([a, b, c]), np.array([a + 180.0, 180.0 - b, c + 180.0])]
        ways = [way - 360.0 * np.round((way - near) / 360.0) for way in ways]
        best = min(ways, key=lambda way: float(np.abs(way - near).max()))
        best = np.where(np.abs(best) > 180.0, best - 360.0 * np.sign(best), best)
        return dict(zip("ABC", best.tolist(), strict=True))


def point_values(p_m: Float) -> Values:
    """X Y Z in mm of a point (3,) m."""
    return {letter: float(value) for letter, value in zip("XYZ", p_m / MM, strict=True)}

"""X Y Z A B C of a corrected path: commanded at each row, and as they were written last."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM
from counterflex.geometry import rotation
from counterflex.programs.krl.edits import Values, spelled
from counterflex.programs.krl.program import LETTERS, KrlProgram, Target
from counterflex.programs.motion_rows import MotionRows


class CommandedValues:
    """Values of targets, mm and deg, where the robot stands while a program is written.

    Args:
        program: As read.
        rows: The compensated path by motion.
        rotvec: (n, 3) rad, rotation vectors of the correction in part axes.

    Attributes:
        values: As written last.
    """

    def __init__(self, program: KrlProgram, rows: MotionRows, rotvec: Float) -> None:
        self.program, self.rows, self.rotvec = program, rows, rotvec
        self.values: Values = dict.fromkeys(LETTERS, 0.0)

    def here(self) -> Float:
        """Written position, (3,) m."""
        return np.array([self.values[letter] for letter in "XYZ"]) * MM

    def stand(self, values: Values) -> None:
        """Values were written: the robot is there."""
        self.values = {letter: float(spelled(letter, values[letter])) for letter in LETTERS}

    def named_values(self, target: Target) -> Values:
        """Values of a target as read; components that are not written are those written last."""
        return {
            letter: target.components[letter].value if letter in target.components else self.values[letter]
            for letter in LETTERS
        }

    def point_of(self, target: Target) -> Float:
        """(3,) m of a target as read."""
        values = self.named_values(target)
        return np.array([values[letter] for letter in "XYZ"]) * MM

    def nominal(self, index: int) -> Values:
        """Values at the programmed end of a motion."""
        program, target = self.program, self.program.moves[index].target
        values = point_values(np.asarray(program.motions[index].p_end)) | self._angles(self._rotation(index, 1.0))
        written = {} if target is None else {k: c.value for k, c in target.components.items() if k in "ABC"}
        return values | written

    def values_at(self, index: int, row: int) -> Values:
        """Commanded values at a row of a motion."""
        rows = self.rows
        values = point_values(rows.command[row])
        if row == rows.last[index] and not np.any(self.rotvec[row] != 0.0):
            nominal = self.nominal(index)
            return values | {letter: nominal[letter] for letter in "ABC"}
        first, last = int(rows.first[index]), int(rows.last[index])
        length = rows.along[last] - rows.along[first - 1]
        share = (rows.along[row] - rows.along[first - 1]) / length if length > 0.0 else 1.0
        return values | self._angles(rotation.exp(self.rotvec[row]) @ self._rotation(index, float(share)))

    def _rotation(self, index: int, share: float) -> Float:
        """(3, 3) programmed orientation of the TCP frame at a share of a motion."""
        Rs = self.program.Rs_part_tcp
        if Rs is None:
            raise ValueError("a program without orientations")
        end: Float = Rs[index]
        if share >= 1.0 or index == 0:
            return end
        start = Rs[index - 1]
        out: Float = start @ rotation.exp(share * rotation.log(start.T @ end))
        return out

    def _angles(self, R_part_tcp: Float) -> Values:
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

"""X Y Z A B C of a KRL program while it is written: where the robot stands in $BASE, and turns that lie near."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM
from counterflex.geometry import rotation
from counterflex.integrations.kuka.language.edits import Values, spelled
from counterflex.integrations.kuka.language.program import LETTERS, KrlProgram, Target


class WrittenValues:
    """Values of targets, mm and deg.

    Attributes:
        values: As written last, in the active base.
    """

    def __init__(self, program: KrlProgram) -> None:
        self.program = program
        self.values: Values = dict.fromkeys(LETTERS, 0.0)
        self._T_part_base: Float | None = None

    def enter(self, T_part_base: Float | None) -> None:
        """The next motion is written in a base, (4, 4) m in the part; None where it is the part frame."""
        if T_part_base is self._T_part_base:
            return
        p, R = self.here(), rotation.from_zyx(np.array([self.values[letter] for letter in "ABC"]) * DEG)
        R_part = R if self._T_part_base is None else self._T_part_base[:3, :3] @ R
        self._T_part_base = T_part_base
        R_base = R_part if T_part_base is None else T_part_base[:3, :3].T @ R_part
        angles = rotation.to_zyx(R_base) / DEG
        self.values = self.point(p) | {letter: float(v) for letter, v in zip("ABC", angles, strict=True)}

    def here(self) -> Float:
        """Written position in the part, (3,) m."""
        return self._in_part(np.array([self.values[letter] for letter in "XYZ"]) * MM)

    def point(self, p_part: Float) -> Values:
        """X Y Z in mm of a point (3,) m in the part."""
        T = self._T_part_base
        p = p_part if T is None else T[:3, :3].T @ (p_part - T[:3, 3])
        return {letter: float(value) for letter, value in zip("XYZ", p / MM, strict=True)}

    def _in_part(self, p_base: Float) -> Float:
        T = self._T_part_base
        return p_base if T is None else T[:3, :3] @ p_base + T[:3, 3]

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
        """(3,) m in the part of a target as read."""
        values = self.named(target)
        return self._in_part(np.array([values[letter] for letter in "XYZ"]) * MM)

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
        R_base_tcp = R_part_tcp if self._T_part_base is None else self._T_part_base[:3, :3].T @ R_part_tcp
        a, b, c = (float(angle) for angle in rotation.to_zyx(R_base_tcp @ R_tcp_tool) / DEG)
        near = np.array([self.values[letter] for letter in "ABC"])
        ways = [np.array([a, b, c]), np.array([a + 180.0, 180.0 - b, c + 180.0])]
        ways = [way - 360.0 * np.round((way - near) / 360.0) for way in ways]
        best = min(ways, key=lambda way: float(np.abs(way - near).max()))
        best = np.where(np.abs(best) > 180.0, best - 360.0 * np.sign(best), best)
        return dict(zip("ABC", best.tolist(), strict=True))

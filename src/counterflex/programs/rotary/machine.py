"""The milling machine that a program with rotary words was written for: from words to poses of the tool and back.

Machine axes are those of the part frame with all rotary axes at zero; the tool then lies along +z. A table axis turns
the part, a head axis turns the tool. From the bed of the machine outward, the table axes make the pose of the part and
the head axes that of the tool:

    T_machine_part = prod_table Rot(u_i, q_i about c_i),  T_machine_tool = Trans(XYZ) prod_head Rot(u_i, q_i about c_i)

so that tip and tool axis in the part are ``p = T_machine_part^-1 T_machine_tool 0`` and
``a = R_machine_part^-1 R_machine_tool z``. With tool-centre-point programming (G43.4) XYZ is ``p`` itself.

Source: ISO 841 (names and senses of axes); R.-S. Lee, C.-H. She, "Developing a postprocessor for three types of
    five-axis
machine tools", Int. J. Adv. Manuf. Technol. 13 (1997) 658-665 (the three types, tip through the pivots).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from counterflex.core.arrays import Bool, Float, as_float
from counterflex.core.errors import InputError
from counterflex.geometry import rotation

LETTERS: Final = "ABC"
SINGULAR: Final = 0.05
"""Sine of the angle below which a rotary axis hardly tilts the tool: 0.1 mrad of correction would turn it by 2 mrad."""
_STEPS: Final = 8


@dataclass(frozen=True, eq=False)
class RotaryAxis:
    """One rotary axis."""

    letter: str  # ``A``, ``B`` or ``C``
    moves: Literal["table", "head"]  # What it carries: the ``table`` with the part, or the ``head`` with the tool
    # (3,) unit vector in machine axes at zero. A positive word turns what it carries right-handed about it.
    direction: Float
    # (3,) m, a point on the axis with all axes at zero: of a table axis in the part frame, of a head axis seen from the
    # tool tip
    p_pivot: Float = field(default_factory=lambda: np.zeros(3))
    limits_rad: tuple[float, float] = (-np.inf, np.inf)  # Smallest and largest angle

    def __post_init__(self) -> None:
        """Check the numbers."""
        if self.letter not in LETTERS or len(self.letter) != 1:
            raise InputError("an unknown rotary word", value=self.letter, limit="A, B or C")
        if abs(float(np.linalg.norm(as_float("direction", self.direction, (3,)))) - 1.0) > 1e-9:
            raise InputError("the direction of a rotary axis is no unit vector", value=self.direction.tolist())
        as_float("p_pivot", self.p_pivot, (3,))

    @property
    def index(self) -> int:
        """Place among A B C."""
        return LETTERS.index(self.letter)


@dataclass(frozen=True, eq=False)
class RotaryMachine:
    """Rotary axes of a milling machine, from its bed outward.

    Raises:
        InputError: No axis, more than two, the same word twice, or axes that turn the tool about one direction only.
    """

    axes: tuple[RotaryAxis, ...]  # One or two; the table axes in their order among them, and the head axes in theirs
    # XYZ is the tool tip in the part frame without G43.4, too: a post that writes no code for it
    always_tool_centre: bool = False

    def __post_init__(self) -> None:
        """Check that the axes make a machine."""
        letters = [axis.letter for axis in self.axes]
        if not 1 <= len(letters) <= 2:
            raise InputError("a machine has one or two rotary axes", value=len(letters))
        if len(set(letters)) != len(letters):
            raise InputError("two rotary axes have the same word", value=letters[0])
        if len(letters) == 2:
            together = float(np.linalg.norm(np.cross(self.axes[0].direction, self.axes[1].direction)))
            if together < SINGULAR:
                raise InputError("both rotary axes turn about the same direction", value=" ".join(letters))

    @property
    def kind(self) -> str:
        """``table-table``, ``head-table``, ``head-head``, or of one axis ``table`` or ``head``."""
        return "-".join(sorted(axis.moves for axis in self.axes))

    def _carried(self, angle_rad: Float, moves: str) -> tuple[Float, Float]:
        """Rotation (n, 3, 3) and shift (n, 3) m that the axes of one side make together."""
        n = len(angle_rad)
        R, t = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3))
        for axis in self.axes:
            if axis.moves == moves:
                turn = rotation.exp(angle_rad[:, axis.index, None] * axis.direction)
                t = t + np.einsum("nij,nj->ni", R, axis.p_pivot - np.einsum("nij,j->ni", turn, axis.p_pivot))
                R = R @ turn
        return R, t

    def tool_axis(self, angle_rad: Float) -> Float:
        """Tool axes in the part frame.

        Args:
            angle_rad: (n, 3) words A B C.

        Returns:
            (n, 3) unit vectors from the tip to the spindle.
        """
        Rs_machine_part, _ = self._carried(angle_rad, "table")
        Rs_machine_tool, _ = self._carried(angle_rad, "head")
        out: Float = np.einsum("nji,nj->ni", Rs_machine_part, Rs_machine_tool[:, :, 2])
        return out

    def tip(self, p_program: Float, angle_rad: Float, tool_centre: Bool) -> Float:
        """Tool tips in the part frame.

        Args:
            p_program: (n, 3) m, XYZ with the offsets of the program added.
            angle_rad: (n, 3) words A B C.
            tool_centre: (n,) True where XYZ is the tip in the part frame (G43.4).

        Returns:
            (n, 3) m.
        """
        Rs_machine_part, p_machine_part = self._carried(angle_rad, "table")
        _, shift = self._carried(angle_rad, "head")
        moved = np.einsum("nji,nj->ni", Rs_machine_part, p_program + shift - p_machine_part)
        out: Float = np.where(self._centre(tool_centre)[:, None], p_program, moved)
        return out

    def program_point(self, p_part_tcp: Float, angle_rad: Float, tool_centre: Bool) -> Float:
        """XYZ that puts the tip at a point of the part: the inverse of :meth:`tip`.

        Args:
            p_part_tcp: (n, 3) m.
            angle_rad: (n, 3) words A B C.
            tool_centre: (n,).

        Returns:
            (n, 3) m.
        """
        Rs_machine_part, p_machine_part = self._carried(angle_rad, "table")
        _, shift = self._carried(angle_rad, "head")
        moved = np.einsum("nij,nj->ni", Rs_machine_part, p_part_tcp) + p_machine_part - shift
        out: Float = np.where(self._centre(tool_centre)[:, None], p_part_tcp, moved)
        return out

    def _centre(self, tool_centre: Bool) -> Bool:
        out: Bool = np.asarray(tool_centre, dtype=np.bool_) | self.always_tool_centre
        return out

    def tilting(self, angle_rad: Float) -> Float:
        """Change of the tool axis in the part frame with each angle, ``da/dq``.

        ``da/dq = d x a`` of a head axis and ``-d x a`` of a table axis, d its direction in the part frame.

        Args:
            angle_rad: (n, 3) words A B C.

        Returns:
            (n, 3, k) a column for each axis.
        """
        table, _ = self._carried(angle_rad, "table")
        a = self.tool_axis(angle_rad)
        columns = []
        before = {"table": np.tile(np.eye(3), (len(a), 1, 1)), "head": np.tile(np.eye(3), (len(a), 1, 1))}
        for axis in self.axes:
            d = np.einsum("nji,njk,k->ni", table, before[axis.moves], axis.direction)
            columns.append((1.0 if axis.moves == "head" else -1.0) * np.cross(d, a))
            turn = rotation.exp(angle_rad[:, axis.index, None] * axis.direction)
            before[axis.moves] = before[axis.moves] @ turn
        out: Float = np.stack(columns, axis=-1)
        return out

    def turned_to(self, axis_part: Float, near_rad: Float) -> Float:
        """Angles that give the tool a direction, on the branch of given angles: Newton's method.

        Directions in which the rotary axes hardly tilt the tool (singular values of :meth:`tilting` below
        :data:`SINGULAR`) are left alone: near a singular position, with the tool along the last rotary axis, the angle
        about it stays, and what of the direction is then missing is the caller's to report.

        Args:
            axis_part: (n, 3) unit vectors.
            near_rad: (n, 3) words A B C to start from, a few degrees off at most.

        Returns:
            (n, 3) rad; words that the machine does not have stay as they are.
        """
        angle: Float = as_float("near_rad", near_rad, (len(axis_part), 3)).copy()
        if len(angle) == 0:
            return angle
        columns = [axis.index for axis in self.axes]
        tilts: Bool | None = None
        for _ in range(_STEPS):
            u, s, vt = np.linalg.svd(self.tilting(angle), full_matrices=False)
            tilts = s >= SINGULAR if tilts is None else tilts
            inverse = np.einsum("nki,nk,njk->nij", vt, np.where(tilts, 1.0 / np.where(tilts, s, 1.0), 0.0), u)
            step = np.einsum("nij,nj->ni", inverse, axis_part - self.tool_axis(angle))
            angle[:, columns] += step
            if float(np.abs(step).max()) < 1e-13:
                break
        return angle

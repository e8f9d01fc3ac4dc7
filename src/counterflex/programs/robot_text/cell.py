"""Facts of a cell that a robot program is read with, and the checks of tools and frames against it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import DEG, MM
from counterflex.geometry import rotation
from counterflex.programs.program import Motion
from counterflex.programs.robot_writer.machine_functions import MachineFunctions

SAME_M: Final = 0.01 * MM
"""Frames whose origins are closer are the same: posts write three decimals."""
SAME_RAD: Final = 0.005 * DEG


_SAME_EXTERNAL: Final = 0.01


@dataclass(frozen=True, kw_only=True)
class RobotTextCell:
    """Facts of a cell that every language of robots needs."""

    where: str  # Path of the cell file, for messages
    tools: Sequence[int]  # Numbers of ``[[tools]]``
    # (4, 4) m, tool frame that the cell plans with; of a robot that holds the part the part's frame
    T_flange_tcp: Float
    T_base_part: Float  # (4, 4) m, part frame in the world of the controller
    functions: MachineFunctions  # ``[controller.spindle]`` of the language
    external_axes: Mapping[int, float] = field(default_factory=dict)  # Value of external axes by number, mm or deg
    # Returns (4, 4) m, the TCP frame of the cell in the part frame, where the axes A1 to A6 (J1 to J6) stand as the
    # controller shows them, deg, and external axes at values by number, mm or deg; None where the cell has no robot
    # that tells it
    tip_of_axes: Callable[[Sequence[float], Mapping[int, float]], Float] | None = None

    @property
    def only_tool(self) -> int:
        """Number of the tool where there is one; else 0."""
        return self.tools[0] if len(self.tools) == 1 else 0

    @property
    def T_tcp(self) -> Float:
        """(4, 4) m, what the frame of a tool is held against."""
        return self.T_flange_tcp

    @property
    def T_part(self) -> Float:
        """(4, 4) m, what the frame of the targets is held against."""
        return self.T_base_part

    def R_tcp_tool(self, T_tool: Float, name: str, where: str) -> Float:
        """Orientation (3, 3) of a program's tool frame in the cell's TCP frame; its axes may be named otherwise.

        Args:
            T_tool: (4, 4) m, as the program has it.
            name: Of the tool frame, for messages.
            where: File and line, for messages.

        Raises:
            ProgramError: Its tip is elsewhere.
        """
        T_tcp = self.T_tcp
        off = T_tcp[:3, :3].T @ (T_tool[:3, 3] - T_tcp[:3, 3])
        if len(self.tools) > 1:
            off[2] = 0.0  # lengths differ from tool to tool, the line they lie on does not
        if float(np.linalg.norm(off)) > SAME_M:
            raise ProgramError(
                f"the tip of {name} is not where the cell has it", where=where,
                value=f"{np.linalg.norm(off) / MM:.3f} mm from it", limit=f"{SAME_M / MM:g} mm",
                hint=f"[[end_effector]] and [tcp] in {self.where}, or the tool of the program, are not of this robot",
            )  # fmt: skip
        R: Float = T_tcp[:3, :3].T @ T_tool[:3, :3]
        return np.eye(3) if float(np.linalg.norm(rotation.log(R))) < SAME_RAD else R

    def refuse_other_part_frame(self, T_program: Float, name: str, where: str) -> None:
        """Refuse a frame of targets that is not the part frame of the cell.

        Args:
            T_program: (4, 4) m, as the program has it.
            name: Of the frame, for messages.
            where: File and line, for messages.

        Raises:
            ProgramError: It is another one.
        """
        T_part = self.T_part
        off_m = float(np.linalg.norm(T_program[:3, 3] - T_part[:3, 3]))
        off_rad = float(np.linalg.norm(rotation.log(T_part[:3, :3].T @ T_program[:3, :3])))
        if off_m > SAME_M or off_rad > SAME_RAD:
            raise ProgramError(
                f"{name} is not the part frame of the cell", where=where,
                value=f"{off_m / MM:.3f} mm and {off_rad / DEG:.4f} deg from it",
                limit=f"{SAME_M / MM:g} mm and {SAME_RAD / DEG:g} deg",
                hint=f"Give [part] in {self.where} the frame that the program was posted for, or post it again",
            )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class NumberedCell(RobotTextCell):
    """Of a language that names tools and frames by the numbers of the controller."""

    tool_number: int  # ``controller.tool_number``: the tool frame that the cell plans with
    base_number: int  # ``controller.base_number``: the frame that is the part frame
    tool_of_data: Mapping[int, int]  # Number of the tool by that of its frame (``tools.tool_data``)


@dataclass
class NumberedFrames:
    """Tools and frames that a program names by the numbers of the controller, and what is active."""

    cell: NumberedCell | None  # What they are held against; None takes every frame
    tool_word: str  # What a tool frame is called, with ``{}`` for its number: ``TOOL_DATA[{}]``
    base_word: str  # The same of the frame of the targets
    tool_number: int = 1  # Of the cell, as those that follow see :class:`NumberedCell`
    base_number: int = 1
    tool_of_data: Mapping[int, int] = field(default_factory=dict)
    tool: int = 0  # Number of the tool in the spindle; 0 where nothing says it
    tool_known: bool = False  # The program said which tool frame is active
    base_known: bool = False  # The program said which frame its targets are in
    R_tcp_tool: Float = field(default_factory=lambda: np.eye(3))  # (3, 3) the tool frame in the cell's TCP frame

    def __post_init__(self) -> None:
        if self.cell is not None:
            self.tool_number, self.base_number = self.cell.tool_number, self.cell.base_number
            self.tool_of_data = self.cell.tool_of_data

    def set_tool_data(self, number: int, where: str) -> None:
        """The tool frame with a number is active. Raises ProgramError: the cell plans with another one."""
        self.tool_known, self.R_tcp_tool = True, np.eye(3)
        cell = self.cell
        if cell is None:
            self.tool = self.tool or number
        elif number in self.tool_of_data:
            self.tool = self.tool_of_data[number]
        elif number == self.tool_number:
            self.tool = self.tool or cell.only_tool
        else:
            known = sorted({self.tool_number, *self.tool_of_data})
            raise ProgramError(
                "the program runs with another tool frame than the cell plans with", where=where,
                value=self.tool_word.format(number), limit=" or ".join(self.tool_word.format(n) for n in known),
                hint=f"controller.tool_number, or tools.tool_data of the tool, in {cell.where}",
            )  # fmt: skip

    def set_base_data(self, number: int, where: str) -> None:
        """The targets are in the frame with a number. Raises ProgramError: the cell's part frame is another one."""
        self.base_known = True
        if self.cell is not None and number != self.base_number:
            word = self.base_word.format(self.base_number)
            raise ProgramError(
                "the program is written in another frame than the part frame of the cell", where=where,
                value=self.base_word.format(number), limit=word,
                hint=f"controller.base_number in {self.cell.where} says which {word.split('[')[0]} holds the part "
                "frame",
            )  # fmt: skip


class ExternalAxes:
    """Follows the external axes of a program: it begins where the cell says, and may go on between operations.

    Args:
        cell: Where they stand by it; None: a program is listed or compared, they begin where its first target says.
        made: Returns the number of motions made so far.
    """

    def __init__(self, cell: RobotTextCell | None, made: Callable[[], int]) -> None:
        self._expected = {} if cell is None else cell.external_axes
        self._with_cell = cell is not None
        self._made = made
        self.now: dict[int, float] = {}  # Value by number of the axis, mm or deg, of those that the program has named
        self._changes: dict[int, dict[int, tuple[float, str, str]]] = {}

    def check(self, number: int, value: float, name: str, where: str) -> None:
        """Take an external axis of a target.

        Args:
            number: Of the axis, 1 to 6.
            value: mm or deg.
            name: As the language calls it.
            where: File and line, for messages.

        Raises:
            ProgramError: It begins elsewhere than in the cell file, or moves and the cell file does not describe it.
        """
        motion = self._made()
        now = self.now.setdefault(number, self._expected.get(number, value))
        if abs(value - now) <= _SAME_EXTERNAL:
            return
        if motion == 0 or (self._with_cell and number not in self._expected):
            raise self._moves(value, now, name, where)
        self.now[number] = value
        self._changes.setdefault(motion, {})[number] = (value, name, where)

    def changes(self, motions: Sequence[Motion]) -> dict[int, dict[int, float]]:
        """Values that axes go to, by motion and number of the axis.

        Raises:
            ProgramError: One moves along a circle, which is a cut. Whether a line is one, only the stock tells.
        """
        out: dict[int, dict[int, float]] = {}
        before: dict[int, float] = dict(self._expected)
        for index, values in self._changes.items():
            if index >= len(motions):
                continue
            if motions[index].kind == "arc":
                number = next(iter(values))
                value, name, where = values[number]
                raise self._moves(value, before.get(number, value), name, where)
            out[index] = {number: value for number, (value, _, _) in values.items()}
            before |= out[index]
        return out

    @staticmethod
    def _moves(value: float, limit: float, name: str, where: str) -> ProgramError:
        return ProgramError(
            f"external axis {name} moves, or stands elsewhere than in the cell file", where=where,
            value=f"{value:g}", limit=f"{limit:g}",
            hint="External axes stand still in the cut: [[external_axes]] of the cell file says where. Between two "
            "cuts they may move, the tool clear of the blank",
        )  # fmt: skip

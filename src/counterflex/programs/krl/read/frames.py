"""What the cell says of frames and tools, and the checks of ``$TOOL`` and ``$BASE`` of a program against it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.programs.robot_text.cell import NumberedFrames, RobotTextCell


@dataclass(frozen=True, kw_only=True)
class KrlCell(RobotTextCell):
    """What must be known of a cell to read a KRL program for it.

    Attributes:
        tool_number: ``controller.tool_number``.
        base_number: ``controller.base_number``.
        tool_of_data: Number of the tool by its TOOL_DATA (``tools.tool_data``).
    """

    tool_number: int
    base_number: int
    tool_of_data: Mapping[int, int]


class Frames(NumberedFrames):
    """The frames that are active, as far as the program has said.

    Args:
        cell: What they are checked against; None takes every frame.
    """

    def __init__(self, cell: KrlCell | None) -> None:
        super().__init__(cell, "TOOL_DATA[{}]", "BASE_DATA[{}]")
        if cell is not None:
            self.tool_number, self.base_number = cell.tool_number, cell.base_number
            self.tool_of_data = cell.tool_of_data

    def set_tool(self, T_flange_tool: Float, where: str) -> None:
        """``$TOOL={...}``: the tip must be that of the cell, its axes may be named otherwise.

        Raises:
            ProgramError: The tip is elsewhere.
        """
        self.tool_known = True
        if self.cell is not None:
            self.tool = self.tool or self.cell.only_tool
        self.R_tcp_tool = np.eye(3) if self.cell is None else self.cell.R_tcp_tool(T_flange_tool, "$TOOL", where)

    def set_base(self, T_base_program: Float, where: str) -> None:
        """``$BASE={...}``.

        Raises:
            ProgramError: It is not the part frame of the cell.
        """
        self.base_known = True
        if self.cell is not None:
            self.cell.refuse_other_part_frame(T_base_program, "$BASE", where)

    def require(self, where: str) -> None:
        """Refuse a Cartesian motion before tool and base are known.

        Raises:
            ProgramError: One is not.
        """
        if self.cell is None:
            return
        for known, word, number in (
            (self.tool_known, "TOOL", self.tool_number),
            (self.base_known, "BASE", self.base_number),
        ):
            if not known:
                raise ProgramError(
                    f"the program moves before it says which ${word} it is written for",
                    where=where,
                    limit=f"${word}={word}_DATA[{number}]",
                    hint="Write it before the first motion, as the calling program sets it",
                )

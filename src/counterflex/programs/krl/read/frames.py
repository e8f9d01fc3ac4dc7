"""What the cell says of frames and tools, and the checks of ``$TOOL`` and ``$BASE`` of a program against it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import DEG, MM
from counterflex.geometry import rotation
from counterflex.programs.robot_text.frame_limits import SAME_M, SAME_RAD
from counterflex.programs.robot_writer.machine_functions import MachineFunctions


@dataclass(frozen=True)
class KrlCell:
    """What must be known of a cell to read a KRL program for it.

    Attributes:
        where: Path of the cell file, for messages.
        tool_number: ``controller.tool_number``.
        base_number: ``controller.base_number``.
        tools: Numbers of ``[[tools]]``.
        tool_of_data: Number of the tool by its TOOL_DATA (``tools.tool_data``).
        T_flange_tcp: (4, 4) tool frame that the cell plans with, m.
        T_base_part: (4, 4) part frame that the cell plans with, m.
        functions: ``[controller.spindle.krl]``.
        external_axes: Value of external axes by number, mm or deg.
    """

    where: str
    tool_number: int
    base_number: int
    tools: Sequence[int]
    tool_of_data: Mapping[int, int]
    T_flange_tcp: Float
    T_base_part: Float
    functions: MachineFunctions
    external_axes: Mapping[int, float] = field(default_factory=dict)


@dataclass
class Frames:
    """The frames that are active, as far as the program has said.

    Attributes:
        cell: What they are checked against; None takes every frame.
        tool: Number of the tool in the spindle; 0 where nothing says it.
        tool_known: ``$TOOL`` was set.
        base_known: ``$BASE`` was set.
        R_tcp_tool: (3, 3) ``$TOOL`` in the cell's TCP frame.
    """

    cell: KrlCell | None
    tool: int = 0
    tool_known: bool = False
    base_known: bool = False
    R_tcp_tool: Float = field(default_factory=lambda: np.eye(3))

    def set_tool_data(self, number: int, where: str) -> None:
        """``$TOOL=TOOL_DATA[number]``.

        Raises:
            ProgramError: The cell plans with another tool frame.
        """
        self.tool_known, self.R_tcp_tool = True, np.eye(3)
        cell = self.cell
        if cell is None:
            self.tool = self.tool or number
        elif number in cell.tool_of_data:
            self.tool = cell.tool_of_data[number]
        elif number == cell.tool_number:
            if not self.tool and len(cell.tools) == 1:
                self.tool = cell.tools[0]
        else:
            known = sorted({cell.tool_number, *cell.tool_of_data})
            raise ProgramError(
                "the program runs with another tool frame than the cell plans with",
                where=where,
                value=f"TOOL_DATA[{number}]",
                limit=" or ".join(f"TOOL_DATA[{n}]" for n in known),
                hint=f"controller.tool_number, or tools.tool_data of the tool, in {cell.where}",
            )

    def set_base_data(self, number: int, where: str) -> None:
        """``$BASE=BASE_DATA[number]``.

        Raises:
            ProgramError: The cell's part frame is another one.
        """
        self.base_known = True
        if self.cell is not None and number != self.cell.base_number:
            raise ProgramError(
                "the program is written in another frame than the part frame of the cell",
                where=where,
                value=f"BASE_DATA[{number}]",
                limit=f"BASE_DATA[{self.cell.base_number}]",
                hint=f"controller.base_number in {self.cell.where} says which BASE_DATA holds the part frame",
            )

    def set_tool(self, T_flange_tool: Float, where: str) -> None:
        """``$TOOL={...}``: the tip must be that of the cell, its axes may be named otherwise.

        Raises:
            ProgramError: The tip is elsewhere.
        """
        self.tool_known = True
        cell = self.cell
        if cell is None:
            self.R_tcp_tool = np.eye(3)
            return
        if not self.tool and len(cell.tools) == 1:
            self.tool = cell.tools[0]
        R_flange_tcp = cell.T_flange_tcp[:3, :3]
        off = R_flange_tcp.T @ (T_flange_tool[:3, 3] - cell.T_flange_tcp[:3, 3])
        if len(cell.tools) > 1:
            off[2] = 0.0  # lengths differ from tool to tool, the line they lie on does not
        if float(np.linalg.norm(off)) > SAME_M:
            raise ProgramError(
                "the tip of $TOOL is not where the cell has it",
                where=where,
                value=f"{np.linalg.norm(off) / MM:.3f} mm from it",
                limit=f"{SAME_M / MM:g} mm",
                hint=f"[[end_effector]] and [tcp] in {cell.where}, or the tool of the program, are not of this robot",
            )
        R_tcp_tool = R_flange_tcp.T @ T_flange_tool[:3, :3]
        same = float(np.linalg.norm(rotation.log(R_tcp_tool))) < SAME_RAD
        self.R_tcp_tool = np.eye(3) if same else R_tcp_tool

    def set_base(self, T_base_program: Float, where: str) -> None:
        """``$BASE={...}``.

        Raises:
            ProgramError: It is not the part frame of the cell.
        """
        self.base_known = True
        if self.cell is None:
            return
        off_m = float(np.linalg.norm(T_base_program[:3, 3] - self.cell.T_base_part[:3, 3]))
        R = self.cell.T_base_part[:3, :3].T @ T_base_program[:3, :3]
        off_rad = float(np.linalg.norm(rotation.log(R)))
        if off_m > SAME_M or off_rad > SAME_RAD:
            raise ProgramError(
                "$BASE is not the part frame of the cell",
                where=where,
                value=f"{off_m / MM:.3f} mm and {off_rad / DEG:.4f} deg from it",
                limit=f"{SAME_M / MM:g} mm and {SAME_RAD / DEG:g} deg",
                hint=f"Give [part] in {self.cell.where} the frame that the program was posted for, or post it again",
            )

    def require(self, where: str) -> None:
        """Refuse a Cartesian motion before tool and base are known.

        Raises:
            ProgramError: One is not.
        """
        if self.cell is None:
            return
        for known, word, number in (
            (self.tool_known, "TOOL", self.cell.tool_number),
            (self.base_known, "BASE", self.cell.base_number),
        ):
            if not known:
                raise ProgramError(
                    f"the program moves before it says which ${word} it is written for",
                    where=where,
                    limit=f"${word}={word}_DATA[{number}]",
                    hint="Write it before the first motion, as the calling program sets it",
                )

"""What the cell says of tools and work objects, and the checks of those of a RAPID program against it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.programs.rapid.read.data import Data, frame, truth
from counterflex.programs.robot_text.cell import RobotTextCell

_FORM: Final = {
    "tooldata": "[TRUE,[[x,y,z],[q1,q2,q3,q4]],[...]]",
    "wobjdata": '[FALSE,TRUE,"",[[x,y,z],[q1,q2,q3,q4]],[[0,0,0],[1,0,0,0]]]',
}


@dataclass(frozen=True, kw_only=True)
class RapidCell(RobotTextCell):
    """What must be known of a cell to read a RAPID program for it.

    Attributes:
        tool_of_data: Number of the tool by the name of its tooldata in capitals (``tools.tooldata``).
        work_object: Name of the wobjdata that is the part frame (``controller.work_object``); empty: none.
        T_base_tcp: (4, 4) m, tool frame in the robot base, where the robot holds the part; else None.
    """

    tool_of_data: Mapping[str, int]
    work_object: str
    T_base_tcp: Float | None

    @property
    def T_tcp(self) -> Float:
        """(4, 4) m, of a tool on the robot in the flange, of one that stands in the robot base."""
        return self.T_flange_tcp if self.T_base_tcp is None else self.T_base_tcp

    @property
    def T_part(self) -> Float:
        """(4, 4) m, of a part on the table in the robot base, of one on the robot in the flange."""
        return self.T_base_part if self.T_base_tcp is None else self.T_flange_tcp


class Frames:
    """Checks tool and work object of each instruction.

    Args:
        cell: What they are checked against; None takes every frame.
        data: What the module declares.

    Attributes:
        tool: Number of the tool in the spindle; 0 where nothing says it.
        assigned: Names that the program assigns something to, in capitals.
    """

    def __init__(self, cell: RapidCell | None, data: Data) -> None:
        self.cell, self.data = cell, data
        self.tool = 0
        self.assigned: set[str] = set()
        self._known: dict[tuple[str, str, int], tuple[int, Float]] = {}

    def use(self, tool: str, work_object: str, routine: int, where: str) -> Float:
        """Orientation (3, 3) of a tool frame in the cell's TCP frame; :attr:`tool` is set where the name tells it.

        Args:
            tool: Name of the tooldata.
            work_object: Name of the wobjdata.
            routine: Index of the routine, for names that it declares itself.
            where: File, line and column, for errors.

        Raises:
            ProgramError: The frames are not those of the cell, or not known.
        """
        for name in (tool, work_object):
            if name.upper() in self.assigned:
                raise ProgramError(
                    f"{name} is changed by the program: where it is, is not known", where=where, value=name,
                    limit="a frame that stays as declared", hint="Write the frame into its declaration",
                )  # fmt: skip
        key = (tool.upper(), work_object.upper(), routine)
        if key not in self._known:
            self._check_work_object(work_object, routine, where)
            self._known[key] = self._tool(tool, routine, where)
        number, R_tcp_tool = self._known[key]
        self.tool = number or self.tool
        return R_tcp_tool

    def _tool(self, name: str, routine: int, where: str) -> tuple[int, Float]:
        cell = self.cell
        if cell is None:
            return 0 if self.tool else 1, np.eye(3)
        number = cell.tool_of_data.get(name.upper(), 0)
        only = 0 if number or self.tool else cell.only_tool
        held = cell.T_base_tcp is None
        values = (True, np.eye(4)) if name.upper() == "TOOL0" else self._declared(name, "tooldata", routine, where)
        if values is None:
            if number:
                return number, np.eye(3)
            raise ProgramError(
                "where the tip of the tool is, is not known", where=where, value=name,
                limit=f"a tooldata declared in the module, or tools.tooldata in {cell.where}",
                hint="Name the tooldata of the controller in [[tools]], or declare it in the module",
            )  # fmt: skip
        T = _on_side(values, "tool", name, held, cell, where)
        return number or only, cell.R_tcp_tool(T, name, where)

    def _check_work_object(self, name: str, routine: int, where: str) -> None:
        cell = self.cell
        if cell is None:
            return
        values = (False, np.eye(4)) if name.upper() == "WOBJ0" else self._declared(name, "wobjdata", routine, where)
        if values is None:
            if cell.work_object and name.upper() == cell.work_object.upper():
                return
            raise ProgramError(
                "which frame the targets are written in is not known", where=where, value=name,
                limit=f"a wobjdata declared in the module, or controller.work_object in {cell.where}",
                hint="Name the wobjdata of the controller that holds the part frame, or declare it in the module",
            )  # fmt: skip
        on_robot = cell.T_base_tcp is not None
        T = _on_side(values, "work object", name, on_robot, cell, where)
        cell.refuse_other_part_frame(T, f"the work object {name}", where)

    def _declared(self, name: str, kind: str, routine: int, where: str) -> tuple[bool, Float] | None:
        """Whether the robot holds it, and its frame (4, 4) m; None where the module does not declare it."""
        if self.data.find(name, routine) is None:
            return None
        literal = self.data.literal(name, kind, routine)
        items = () if literal is None else literal[0].items
        robhold = truth(items[0]) if items else None
        T: Float | None = None
        if kind == "tooldata" and len(items) == 3:
            T = frame(items[1])
        elif kind == "wobjdata" and len(items) == 5 and truth(items[1]) and items[2] == '""':
            user, of_object = frame(items[3]), frame(items[4])
            T = None if user is None or of_object is None else user @ of_object
        if robhold is None or T is None:
            raise ProgramError(
                f"{name} is no {kind} that is read", where=where, value=name, limit=_FORM[kind],
                hint="Write its numbers themselves" if kind == "tooldata"
                else "Write its numbers themselves; one that a mechanical unit moves (ufprog FALSE) is not read",
            )  # fmt: skip
        return robhold, T


def _on_side(values: tuple[bool, Float], what: str, name: str, on_robot: bool, cell: RapidCell, where: str) -> Float:
    """Frame (4, 4) of a tool or work object that is on the robot, or not, as the cell has it.

    Raises:
        ProgramError: It is not.
    """
    robhold, T = values
    if robhold != on_robot:
        held = cell.T_base_tcp is not None
        raise ProgramError(
            f"the {what} is {'on the robot' if robhold else 'not on the robot'}, in the cell file it is not so",
            where=where, value=f"{name}: robhold {'TRUE' if robhold else 'FALSE'}",
            limit=f'part_on = "{"flange" if held else "table"}" in {cell.where}',
            hint="Give the cell that the program was posted for",
        )  # fmt: skip
    return T

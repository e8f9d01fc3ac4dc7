"""Tools and work objects of the cell, and the checks of those of a RAPID program against them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM
from counterflex.geometry import pose
from counterflex.integrations.abb.language.read.arithmetic import matrix
from counterflex.integrations.abb.language.read.memory import RapidMemory
from counterflex.programs.expression import is_number
from counterflex.programs.robot_text.cell import RobotTextCell
from counterflex.programs.unknown import known

_UNIT: Final = 1e-3
_KEPT: Final = 1000
_LARGEST_MM: Final = 1e6
_FORM: Final = {
    "tooldata": "[TRUE,[[x,y,z],[q1,q2,q3,q4]],[...]]",
    "wobjdata": '[FALSE,TRUE,"",[[x,y,z],[q1,q2,q3,q4]],[[0,0,0],[1,0,0,0]]]',
}


@dataclass(frozen=True, kw_only=True)
class RapidCell(RobotTextCell):
    """Data of a cell that a RAPID program is held against."""

    tool_of_data: Mapping[str, int]  # Number of the tool by the name of its tooldata in capitals (``tools.tooldata``)
    work_object: str  # Name of the wobjdata that is the part frame (``controller.work_object``); empty: none
    T_base_tcp: Float | None  # (4, 4) m, tool frame in the robot base, where the robot holds the part; else None

    @property
    def T_tcp(self) -> Float:
        """(4, 4) m, of a tool on the robot in the flange, of one that stands in the robot base."""
        return self.T_flange_tcp if self.T_base_tcp is None else self.T_base_tcp

    @property
    def T_part(self) -> Float:
        """(4, 4) m, of a part on the table in the robot base, of one on the robot in the flange."""
        return self.T_base_part if self.T_base_tcp is None else self.T_flange_tcp


class RapidFrames:
    """Checks tool and work object of each instruction.

    Args:
        cell: What they are checked against; None takes every frame.
        memory: Data of the program.
        part_object: Without a cell, the work object that is the part frame, by name in capitals; empty: the first one.
    """

    def __init__(self, cell: RapidCell | None, memory: RapidMemory, part_object: str = "") -> None:
        self.cell, self.memory = cell, memory
        self.tool = 0  # Number of the tool in the spindle; 0 where nothing says it
        self.objects: dict[str, int] = {}  # Motions by work object, without a cell
        self._part_object = part_object
        self._first: tuple[str, tuple[bool, Float] | None] | None = None
        self._known: dict[tuple[str, str, int], tuple[int, Float, Float | None, str]] = {}
        self._stamp = -1

    def use(self, tool: str, work_object: str, at: int) -> tuple[Float, Float | None]:
        """Return the orientation of a tool frame in the cell's TCP frame, and the frame of the targets in the part.

        :attr:`tool` is set where the name tells it.

        Returns:
            (3, 3), and (4, 4) m or None where the targets are in the part frame.

        Raises:
            ProgramError: The frames are not those of the cell, or not known.
        """
        if self._stamp != self.memory.stamp or len(self._known) > _KEPT:
            self._stamp, self._known = self.memory.stamp, {}
        key = (tool, work_object, self.memory.frames[-1].serial)
        known_frames = self._known.get(key)
        if known_frames is None:
            where = self.memory.source.place(at)
            T, name = self._object(work_object, where)
            number, R = self._tool(tool, where)
            known_frames = self._known[key] = (number, R, T, name)
        number, R, T, name = known_frames
        if self.cell is None:
            self.objects[name] = self.objects.get(name, 0) + 1
        self.tool = number or self.tool or (1 if self.cell is None else self.cell.only_tool)
        return R, T

    def _name(self, text: str) -> str:
        """Name of the data that a text stands for, in capitals: of an argument that of the caller."""
        data = self.memory.find(text) if text.isidentifier() else None
        return text.upper() if data is None else data.variable.name.upper()

    def _tool(self, text: str, where: str) -> tuple[int, Float]:
        cell = self.cell
        values = self._declared(text, "tooldata", where)
        if cell is None:
            return 0, np.eye(3)
        name = self._name(text)
        number = cell.tool_of_data.get(name, 0)
        if values is None:
            if number:
                return number, np.eye(3)
            raise ProgramError(
                "where the tip of the tool is, is not known", where=where, value=text,
                limit=f"a tooldata declared in the program, or tools.tooldata in {cell.where}",
                hint="Name the tooldata of the controller in [[tools]], or declare it in the module",
            )  # fmt: skip
        T = _on_side(values, "tool", text, cell.T_base_tcp is None, cell, where)
        return number, cell.R_tcp_tool(T, text, where)

    def _object(self, text: str, where: str) -> tuple[Float | None, str]:
        cell, name = self.cell, self._name(text)
        values = self._declared(text, "wobjdata", where)
        if cell is None:
            return self._beside_part(name, values, where), name
        if values is None:
            if cell.work_object and name == cell.work_object.upper():
                return None, name
            raise ProgramError(
                "which frame the targets are written in is not known", where=where, value=text,
                limit=f"a wobjdata declared in the program, or controller.work_object in {cell.where}",
                hint="Name the wobjdata of the controller that holds the part frame, or declare it in the module",
            )  # fmt: skip
        T = _on_side(values, "work object", text, cell.T_base_tcp is not None, cell, where)
        cell.refuse_other_part_frame(T, f"the work object {text}", where)
        return None, name

    def _beside_part(self, name: str, values: tuple[bool, Float] | None, where: str) -> Float | None:
        """Without a cell: a work object in the one that is the part frame."""
        if self._first is None:
            self._first = (name, values)
            if self._part_object:
                reference = self._part_object
                self._first = (reference, self._declared(reference, "wobjdata", where))
        part, part_values = self._first
        if name == part and (values is None or part_values is None or np.array_equal(values[1], part_values[1])):
            return None
        if values is None or part_values is None or values[0] != part_values[0]:
            raise ProgramError(
                f"the program uses the work objects {part.lower()} and {name.lower()}, and where one lies in the other "
                "is not known", where=where, value=name.lower(), limit="one work object, or two that are declared",
                hint="Give --cell, or the module that declares both",
            )  # fmt: skip
        return pose.inverse(part_values[1]) @ values[1]

    def _declared(self, text: str, kind: str, where: str) -> tuple[bool, Float] | None:
        """Return whether the robot holds it, and its frame (4, 4) m; None where the program does not declare it."""
        node = self.memory.node(text, 0)
        reference = self.memory.reference(node)
        if reference is None:
            return None
        volatile = reference.variable.volatile
        value = reference.value() if volatile is None else volatile
        what = f"the place of the {'tool' if kind == 'tooldata' else 'work object'} {text}"
        items = known(
            value if not isinstance(value, list) else value[: 2 if kind == "tooldata" else 5], what, where, text=text,
            hint="Write the frame into its declaration",
        )  # fmt: skip
        robhold = items[0] if isinstance(items, list) and items and isinstance(items[0], bool) else None
        T = _place(items, kind)
        if robhold is None or T is None:
            raise ProgramError(
                f"{text} is no {kind} that is read", where=where, value=text, limit=_FORM[kind],
                hint="Write its numbers themselves" if kind == "tooldata"
                else "Write its numbers themselves; one that a mechanical unit moves (ufprog FALSE) is not read",
            )  # fmt: skip
        return robhold, T


def _place(items: object, kind: str) -> Float | None:
    """Frame (4, 4) m of a declaration; None where it has another form."""
    if not isinstance(items, list):
        return None
    if kind == "tooldata" and len(items) == 2:
        return _frame(items[1])
    if len(items) == 5 and items[1] is True and items[2] == "":
        user, of_object = _frame(items[3]), _frame(items[4])
        return None if user is None or of_object is None else user @ of_object
    return None


def _frame(value: object) -> Float | None:
    """(4, 4) m of a pose; None where it is none."""
    if not isinstance(value, list) or len(value) != 2 or [len(part) for part in value] != [3, 4]:
        return None
    p, q = value
    if not all(map(is_number, [*p, *q])) or not max(map(abs, p)) <= _LARGEST_MM or abs(math.hypot(*q) - 1.0) > _UNIT:
        return None
    return pose.make(matrix(q), np.array(p, dtype=float) * MM)


def _on_side(values: tuple[bool, Float], what: str, name: str, on_robot: bool, cell: RapidCell, where: str) -> Float:
    """Frame (4, 4) of a tool or work object that is on the robot, or not, as the cell has it."""
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

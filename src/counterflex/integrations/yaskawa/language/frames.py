"""Tools and frames of a job: in what frame a position is, and where that stands in the part frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.geometry import pose
from counterflex.integrations.yaskawa.language.program import USER, WORLD, Header, frame_of
from counterflex.integrations.yaskawa.language.values import PositionValue
from counterflex.programs.robot_text.cell import NumberedCell, NumberedFrames

_APART_M: Final = 1e-6


@dataclass(frozen=True, kw_only=True)
class InformCell(NumberedCell):
    """Data of a cell that a job is read against."""

    pulses_per_deg: tuple[float, ...] = ()  # (6,) of the axes S L U R B T; empty where the cell file does not say them


class InformFrames(NumberedFrames):
    """Frames of the positions of a job.

    Args:
        cell: What they are held against; None takes the first frame for the part frame.
    """

    def __init__(self, cell: InformCell | None) -> None:
        super().__init__(cell, "///TOOL {}", "///USER {}")
        self.made: dict[int, Float] = {}  # (4, 4) m of user frames that the job makes (MFRAME), in the world
        self._first: tuple[int, Float | None] | None = None
        self._last: Header | None = None
        self._T_part_frame: Float = np.eye(4)

    def of(self, header: Header, where: str) -> Float:
        """Return (4, 4) m, the frame of positions under a header in the part frame; its tool is active then.

        Raises:
            ProgramError: Frame or tool are not known, or others than the cell's.
        """
        if header == self._last:
            return self._T_part_frame
        self.use_tool(header.tool, where)
        if header.postype == USER:
            out = self._user(header.user, where)
        elif header.postype in WORLD:
            out = self._world(where)
        else:
            raise ProgramError(
                "positions of this type are not read", where=where, value=f"///POSTYPE {header.postype}",
                limit="USER, BASE, ROBOT", hint="Post the path in the user frame of the part",
            )  # fmt: skip
        self._last, self._T_part_frame = header, out
        return out

    def use_tool(self, number: int, where: str) -> None:
        """Take a tool file as the active one. Raises ProgramError: the cell plans with another one."""
        if number < 0:
            if self.cell is not None:
                raise ProgramError(
                    "nothing says which tool a position is for", where=where, limit=f"///TOOL {self.tool_number}",
                    hint="Write it before the positions: the controller's tool is not known",
                )  # fmt: skip
            return
        self.set_tool_data(number, where)

    def make(self, number: int, corners: tuple[PositionValue, PositionValue, PositionValue], where: str) -> None:
        """Make a user frame from its origin, a point on X and one in the XY plane (MFRAME).

        Raises:
            ProgramError: The points give none, or are not in the frame of the robot.
        """
        points = [frame_of([float(v) for v in one.values])[:3, 3] for one in corners]  # type: ignore[arg-type]
        if any(one.header.postype not in WORLD for one in corners):
            raise ProgramError(
                "a user frame is made from positions that are not in the frame of the robot", where=where,
                limit="///POSTYPE BASE or ROBOT", hint="Give the points in that frame",
            )  # fmt: skip
        x, y = points[1] - points[0], points[2] - points[0]
        z = np.cross(x, y)
        if float(np.linalg.norm(x)) < _APART_M or float(np.linalg.norm(z)) < _APART_M**2:
            raise ProgramError("the points of a user frame lie on a line", where=where, hint="Give three corners")
        x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
        self.made[number] = pose.make(np.stack([x, np.cross(z, x), z], axis=1), points[0])
        self._last = None

    def rotation(self, frame: str, where: str) -> Float:
        """Return (3, 3) of the axes of ``BF``, ``RF`` or ``UF#(n)`` in the part frame.

        Raises:
            ProgramError: Where they stand is not known.
        """
        T = self._world(where) if frame in ("BF", "RF") else self._user(int(frame[4:-1]), where)
        out: Float = T[:3, :3]
        return out

    def _world(self, where: str) -> Float:
        if self.cell is None:
            return self._in_first(-1, np.eye(4), where)
        self.base_known = True
        return pose.inverse(self.cell.T_part)

    def _user(self, number: int, where: str) -> Float:
        T, cell = self.made.get(number), self.cell
        if cell is None:
            return self._in_first(number, T, where)
        if T is None:
            self.set_base_data(number, where)
            return np.eye(4)
        self.base_known = True
        if number == self.base_number:
            cell.refuse_other_part_frame(T, f"UF#({number})", where)
            return np.eye(4)
        out: Float = pose.inverse(cell.T_part) @ T
        return out

    def _in_first(self, number: int, T: Float | None, where: str) -> Float:
        """A frame in the first one of a job that no cell tells the part frame of; -1 is that of the robot."""
        if self._first is None:
            self._first = (number, T)
        first, T_first = self._first
        if number == first and (T is None) == (T_first is None):
            return np.eye(4) if T is None or T_first is None else pose.inverse(T_first) @ T
        if T is None or T_first is None:
            raise ProgramError(
                "the frame of the positions changes, and where the second one stands in the first is not known",
                where=where, value=f"///USER {number}" if number >= 0 else "///POSTYPE BASE",
                limit=f"///USER {first}" if first >= 0 else "///POSTYPE BASE",
                hint="Give the cell, or post a job for each",
            )  # fmt: skip
        out: Float = pose.inverse(T_first) @ T
        return out

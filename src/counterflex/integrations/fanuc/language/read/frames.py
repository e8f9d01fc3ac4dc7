"""User frames and tool frames of a FANUC program: what is active, and where it stands in the part frame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, cast

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM
from counterflex.geometry import pose
from counterflex.integrations.fanuc.language.program import LETTERS, frame_of, wpr_of
from counterflex.integrations.fanuc.language.read.values import TpValues
from counterflex.programs.robot_text.cell import NumberedCell, NumberedFrames
from counterflex.programs.unknown import known

_SET_IT: Final = (
    "Give the position register its numbers in the program, or take the line out where the cell file states the frame"
)


def _set_by(number: int, T: Float | None) -> str:
    """A user frame and who sets it, for a message."""
    return f"UFRAME_NUM={number}, {'as the controller has it' if T is None else f'UFRAME[{number}] set by the program'}"


class TpFrames(NumberedFrames):
    """Active frames of a program.

    Args:
        cell: What they are held against; None takes the first user frame for the part frame.
        values: Frames that the program sets.

    Attributes:
        user_frame: Number of the active one; -1 where nothing says it.
        user_tool: The same of the tool frame.
    """

    def __init__(self, cell: NumberedCell | None, values: TpValues) -> None:
        super().__init__(cell, "UTOOL_NUM={}", "UFRAME_NUM={}")
        self.values = values
        self.user_frame = self.user_tool = -1
        self.T_part_user: Float = np.eye(4)  # (4, 4) m, active user frame in the part frame
        self._part: tuple[int, Float | None] | None = None  # of a program without a cell: its first user frame
        self._settled: tuple[int, int, int] | None = None

    def settle(self, where: str) -> None:
        """Hold the active frames against the cell, before a motion.

        Raises:
            ProgramError: One is not known, or is another than the cell's.
        """
        state = (self.user_frame, self.user_tool, self.values.version)
        if state == self._settled:
            return
        if self.user_tool >= 0:
            self._settle_tool(where)
        if self.user_frame >= 0:
            self._settle_frame(where)
        self._settled = state

    def _settle_tool(self, where: str) -> None:
        number, cell = self.user_tool, self.cell
        T = self._set_by_program("UTOOL", number, where)
        if T is None and number > 0:
            self.set_tool_data(number, where)
            return
        if number > 0 and (cell is None or number in self.tool_of_data or number == self.tool_number):
            self.set_tool_data(number, where)
        self.tool_known = True
        self.tool = self.tool or (0 if cell is None else cell.only_tool)
        name = f"UTOOL_NUM={number}" + (" (the flange)" if number == 0 else "")
        self.R_tcp_tool = np.eye(3) if cell is None else cell.R_tcp_tool(np.eye(4) if T is None else T, name, where)

    def _settle_frame(self, where: str) -> None:
        number, cell = self.user_frame, self.cell
        T = self._set_by_program("UFRAME", number, where)
        self.base_known, self.T_part_user = True, np.eye(4)
        if cell is None:
            self.T_part_user = self._in_first(number, T, where)
        elif T is not None and number != self.base_number:
            self.T_part_user = pose.inverse(cell.T_part) @ T
        elif T is not None or number == 0:
            name = f"UFRAME_NUM={number}" + (" (the world)" if number == 0 else "")
            cell.refuse_other_part_frame(np.eye(4) if T is None else T, name, where)
        else:
            self.set_base_data(number, where)

    def _in_first(self, number: int, T: Float | None, where: str) -> Float:
        """The active user frame in the first one of a program that no cell tells the part frame of."""
        if self._part is None:
            self._part = (number, T)
        first, T_first = self._part
        if T is None and T_first is None and number == first:
            return np.eye(4)
        if T is None or T_first is None:
            raise ProgramError(
                "the user frame changes, and where the second one stands in the first is not known", where=where,
                value=_set_by(number, T), limit=_set_by(first, T_first),
                hint="Set both in the program (UFRAME[n]=PR[m]) before the first motion, or post a program for each",
            )  # fmt: skip
        out: Float = pose.inverse(T_first) @ T
        return out

    def _set_by_program(self, word: str, number: int, where: str) -> Float | None:
        """(4, 4) m of a frame that the program sets; None of one that it leaves as it is."""
        value = self.values.frames.get((word, number))
        if value is None:
            return None
        known(value, f"the frame {word}[{number}]", where, text=f"{word}_NUM={number}", hint=_SET_IT)
        return matrix_of(value, f"{word}[{number}]", where)

    def value_in_world(self, word: str, number: int) -> Float | None:
        """(4, 4) m of a user frame in the world, where program or cell say it."""
        value = self.values.frames.get((word, number))
        if isinstance(value, Mapping):
            return matrix_of(value, f"{word}[{number}]", "")
        if value is None and number == 0:
            return np.eye(4)
        if value is None and self.cell is not None and number == self.base_number:
            return self.cell.T_part
        return None


def matrix_of(value: object, name: str, where: str) -> Float:
    """(4, 4) m of a position. Raises ProgramError: it has no X Y Z W P R."""
    if not isinstance(value, Mapping) or not all(letter in value for letter in LETTERS):
        raise ProgramError(f"{name} is no position by X Y Z W P R", where=where, hint="Write it by X Y Z W P R")
    known(cast("object", dict(value)), name, where, hint="Set all six elements in the program")
    return frame_of({letter: float(value[letter]) for letter in LETTERS})


def position_of(T: Float) -> dict[str, object]:
    """X Y Z W P R of a pose (4, 4) m."""
    return {**dict(zip("XYZ", (T[:3, 3] / MM).tolist(), strict=True)),
            **dict(zip("WPR", wpr_of(T[:3, :3]), strict=True))}  # fmt: skip

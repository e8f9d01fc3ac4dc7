"""$TOOL and $BASE of a program: what the cell says of them, and where the base of the targets lies in the part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.geometry import pose
from counterflex.integrations.kuka.language.read.values import StoredFrame, Value, is_frame, matrix_of
from counterflex.programs.robot_text.cell import NumberedCell, NumberedFrames
from counterflex.programs.unknown import first_unknown, known


@dataclass(frozen=True, kw_only=True)
class KrlCell(NumberedCell):
    """Facts of a cell that the reader of KRL needs."""

    def is_part_frame(self, T_base: Float) -> bool:
        """Return whether a base is the part frame, within the decimals of posts."""
        try:
            self.refuse_other_part_frame(T_base, "", "")
        except ProgramError:
            return False
        return True


@dataclass
class _Taken:
    """Last value that the program gave to $TOOL or $BASE."""

    value: Value = None
    where: str = ""
    fault: ProgramError | None = None


class KrlFrames(NumberedFrames):
    """The frames that are active, as far as the program has said.

    A frame that is not that of the cell is refused where a Cartesian motion uses it.

    Args:
        cell: What they are checked against; None takes every frame.
    """

    def __init__(self, cell: KrlCell | None) -> None:
        super().__init__(cell, "TOOL_DATA[{}]", "BASE_DATA[{}]")
        self.krl_cell = cell
        self._taken = {"TOOL": _Taken(), "BASE": _Taken()}
        self._reference: _Taken | None = None
        self._first_motion = ""
        # (4, 4) m, $BASE in the part of the motion that was required last; None where both are the same
        self.T_part_base: Float | None = None

    def take(self, word: str, value: Value, where: str) -> None:
        """The program gives $TOOL or $BASE a value.

        Args:
            word: ``TOOL`` or ``BASE``.
            value: A frame, or an unknown value.
        """
        taken = self._taken[word] = _Taken(value, where)
        try:
            if word == "TOOL":
                self._check_tool(value, where)
            else:
                self._check_base(value, where)
        except ProgramError as fault:
            taken.fault = fault

    def reset_base(self, where: str) -> None:
        """``BAS(#INITMOV,0)``: the base is the world until the program sets it again."""
        before = self._taken["BASE"]
        self.take("BASE", dict.fromkeys("XYZABC", 0.0), where)
        taken = self._taken["BASE"]
        if taken.fault is not None or (self.cell is None and before.value is not None):
            taken.fault = ProgramError(
                "BAS(#INITMOV,0) sets $BASE to the world, and the program moves before it sets the base again",
                where=where, value="BAS(#INITMOV,0)", limit=f"$BASE=BASE_DATA[{self.base_number}] behind it",
                hint="Set $BASE before the first motion behind BAS(#INITMOV,0)",
            )  # fmt: skip

    def values(self) -> tuple[Value, Value]:
        """Last values given to $TOOL and $BASE; None where none was given."""
        return self._taken["TOOL"].value, self._taken["BASE"].value

    def state(self) -> tuple[object, ...]:
        """State for :meth:`restore`."""
        return dict(self._taken), self.tool, self.R_tcp_tool, self.tool_known, self.base_known

    def restore(self, state: tuple[object, ...]) -> None:
        """Return to an earlier state: a frame held for one motion alone."""
        self._taken, self.tool, self.R_tcp_tool, self.tool_known, self.base_known = state  # type: ignore[assignment]

    def require(self, where: str, code: str) -> None:
        """Refuse a Cartesian motion before tool and base are known, or in others than the cell has.

        Raises:
            ProgramError: One is not.
        """
        for word, number in (("TOOL", self.tool_number), ("BASE", self.base_number)):
            taken = self._taken[word]
            hint = f"Set ${word} from what the text says: {word}_DATA[{number}] as it is, or a frame in braces"
            known(taken.value, f"${word}", where, text=code, hint=hint)
            if taken.fault is not None:
                raise taken.fault
            if taken.value is None and self.cell is not None:
                raise ProgramError(
                    f"the program moves before it says which ${word} it is written for", where=where,
                    limit=f"${word}={word}_DATA[{number}]",
                    hint="Write it before the first motion, as the calling program sets it",
                )  # fmt: skip
        self.T_part_base = self._relative(where)

    # ---- checks ----------------------------------------------------------------------------------------------

    def _check_tool(self, value: Value, where: str) -> None:
        if first_unknown(value) is not None:
            return
        self.tool_known = True
        if isinstance(value, StoredFrame):
            self.set_tool_data(value.number, where)
            if self.cell is not None and (value.shifted or value.T_stored is not None):
                T = value.T
                if T is None:
                    raise self._no_frame(
                        "TOOL", where, f"how long TOOL_DATA[{value.number}] is with the shift is not known"
                    )
                self.R_tcp_tool = self.cell.R_tcp_tool(T, "$TOOL", where)
        elif is_frame(value):
            if self.cell is not None:
                self.tool = self.tool or self.cell.only_tool
                self.R_tcp_tool = self.cell.R_tcp_tool(matrix_of(value), "$TOOL", where)  # type: ignore[arg-type]
        else:
            raise self._no_frame("TOOL", where, "the value that $TOOL gets is no frame")

    def _check_base(self, value: Value, where: str) -> None:
        if first_unknown(value) is not None:
            return
        self.base_known = True
        if isinstance(value, StoredFrame):
            self.set_base_data(value.number, where)
        elif not is_frame(value):
            raise self._no_frame("BASE", where, "the value that $BASE gets is no frame")
        elif self.cell is not None:
            self.cell.refuse_other_part_frame(matrix_of(value), "$BASE", where)  # type: ignore[arg-type]

    def _relative(self, where: str) -> Float | None:
        """(4, 4) m, the base in the part: the part frame of the cell, or without a cell the first base."""
        taken = self._taken["BASE"]
        if self.cell is not None:
            return _shift(taken.value)
        if self._reference is None:
            self._reference, self._first_motion = taken, where
        first, now = self._reference.value, taken.value
        same = isinstance(first, StoredFrame) and isinstance(now, StoredFrame) and first.number == now.number
        if now is first or same:
            return _shift(now)
        T_first, T_now = _matrix(first), _matrix(now)
        if T_first is None or T_now is None:
            raise ProgramError(
                "the program moves in another $BASE than before, and how the two lie to each other is not known",
                where=taken.where or where, value=_title(now), limit=f"{_title(first)}, of {self._first_motion}",
                hint="Give the cell file (--cell), or post the two parts as programs of their own",
            )  # fmt: skip
        T = pose.inverse(T_first) @ T_now
        return None if np.allclose(T, np.eye(4), atol=1e-12) else T

    @staticmethod
    def _no_frame(word: str, where: str, what: str) -> ProgramError:
        return ProgramError(
            what, where=where, limit=f"{word}_DATA[n], or a frame in braces", hint=f"Write the frame of ${word} itself"
        )


def _shift(value: object) -> Float | None:
    """Shift of a numbered frame by the program, (4, 4) m; None where there is none."""
    return value.T_shift if isinstance(value, StoredFrame) and value.shifted else None


def _matrix(value: Value) -> Float | None:
    if isinstance(value, StoredFrame):
        return value.T
    return matrix_of(value) if is_frame(value) else None  # type: ignore[arg-type]


def _title(value: Value) -> str:
    if value is None:
        return "the $BASE of the calling program"
    return f"{value.name}[{value.number}]" if isinstance(value, StoredFrame) else "a frame in numbers"

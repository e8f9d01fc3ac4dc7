"""A RAPID module as read: its motions, and where in the text the numbers of every target and speed stand."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Final

from counterflex.core.arrays import Float
from counterflex.programs.robot_text.program import RobotProgram, Stated, StatedPosture, StatedTurns

_OFF: Final = re.compile(r"^(?:[^!\"]|\"[^\"]*\")*?\bConf([JL])\s*\\\s*Off\b", re.IGNORECASE)
_QUARTER_DEG: Final = 90.0
_LINE_END = re.compile(r"\r\n|\n|\r")
Span = tuple[int, int]
"""Index of the first character, and the one behind the last."""


@dataclass(frozen=True, slots=True)
class RapidTarget:
    """A robtarget in an instruction."""

    start: int  # Index of the argument in the text
    end: int  # Index behind it
    name: str  # Of the declared robtarget; empty for one that is written out in the instruction
    literal: Span  # Where the robtarget itself is written, from bracket to bracket
    numbers: tuple[Span, ...]  # Where its x, y, z, q1, q2, q3, q4 stand
    position_mm: tuple[float, float, float]  # x, y, z as written
    quat_wxyz: tuple[float, float, float, float]  # q1 to q4 as written
    offsets: tuple[Span, ...] = ()  # Where the three numbers of Offs stand; empty where there is none
    offsets_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)  # Their values
    turned: bool = False  # It is computed: no number of the text is a number of the target
    shared: bool = False  # Other places use the declared robtarget too
    # Data and element that it stands in; None of one that is written out or computed
    place: tuple[int, tuple[int, ...]] | None = None
    # Configuration and external axes of a computed one as text; empty where the configuration is not known
    rest: str = ""
    cfx: int | None = None  # Posture of the arm, 0 to 7; None where it is not known
    # cf1, cf4 and cf6, quarters of a turn of axes 1, 4 and 6; None where they are not known
    quarters: tuple[int, int, int] | None = None


@dataclass(frozen=True, slots=True)
class RapidMotion:
    """Text behind a motion of :attr:`RapidProgram.motions`."""

    line: int  # 1-based line of the instruction
    word: str  # ``MoveJ MoveL MoveC``, or ``WaitTime`` of a dwell
    call: int  # Index of its call in :attr:`RapidProgram.calls`
    start: int  # Index of the instruction
    end: int  # Index of its semicolon
    R_tcp_tool: Float  # (3, 3) orientation of the instruction's tool frame in the cell's TCP frame
    target: RapidTarget | None = None  # Its end; None of a dwell
    auxiliary: RapidTarget | None = None  # Point on a circle
    speed: Span = (0, 0)  # Where its speed stands, options left out
    speed_value: Span | None = None  # Where the number of the option V stands; None where there is none
    zone: Span = (0, 0)  # Where its zone stands, options included
    exact: bool = False  # Its zone is ``fine``
    rest: Span = (0, 0)  # Where what is behind the zone stands: the tool, with its options
    # Distance from its end at which the zone begins; NaN where the program leaves it open
    rounding_m: float = float("nan")
    speed_time: Span | None = None  # Where the option T stands; None where there is none
    override: float = 1.0  # What VelSet makes of its speed, as a factor
    # Where the compact IF ends that it stands in, behind its semicolon; None where it stands by itself
    guard: int | None = None
    # (4, 4) m, frame of its targets in the part: a displacement; None where there is none
    T_part_object: Float | None = None

    def posture(self) -> Stated | None:
        """Posture that the configuration of the target states."""
        number = None if self.target is None else self.target.cfx
        if number is None or number not in range(8):
            return None
        front, behind, negative = number < 4, bool(number & 2), bool(number & 1)
        return StatedPosture(front, not behind if front else None, not negative), f"cfx {number}"

    def turns(self) -> StatedTurns | None:
        """Turns that the quarters of the target state, of joint moves."""
        quarters = None if self.target is None or self.word.upper() != "MOVEJ" else self.target.quarters
        if quarters is None:
            return None
        return StatedTurns.of(quarters, _QUARTER_DEG, 0.0, f"cf1, cf4, cf6 {', '.join(map(str, quarters))}")


@dataclass(frozen=True, slots=True)
class RoutineCall:
    """One execution of a routine."""

    routine: str  # Its name as it is declared
    start: int  # Index of ``PROC``, or of what stands before it
    end: int  # Index behind ENDPROC
    name: Span  # Where its name stands in the declaration
    parent: int  # Index of the call within which it is called; -1 of the first
    place: Span  # Where its name stands in the statement that calls it
    repeated: bool = False  # The routine is executed more than once


@dataclass(frozen=True, slots=True)
class RapidProgram(RobotProgram):
    """A program in RAPID."""

    text: str = ""  # The modules as read, that of the program first
    files: tuple[tuple[str, int, int], ...] = ()  # Name of each file, and where it stands in the text
    moves: tuple[RapidMotion, ...] = ()  # One for each of ``motions``
    # Executions of routines, in the order in which they begin; the first is that of the program itself
    calls: tuple[RoutineCall, ...] = ()
    declarations: int = 0  # Index behind the head of the module, where comments are put
    names: frozenset[str] = field(default_factory=frozenset)  # Names that the module declares, in capitals

    def place(self, at: int) -> str:
        """Return ``file:line`` of an index of the text."""
        name, start, _ = next((file for file in reversed(self.files) if file[1] <= at), (self.name, 0, 0))
        return f"{name}:{len(_LINE_END.findall(self.text[start:at])) + 1}"

    def stops(self) -> frozenset[int]:
        """Motions with the zone fine."""
        return frozenset(index for index, move in enumerate(self.moves) if move.exact)

    def roundings_m(self) -> list[float]:
        """Size of the zone (``pzone_tcp``)."""
        return [0.0 if move.exact else move.rounding_m for move in self.moves]

    def supervised_words(self) -> set[str]:
        """Return which of MoveJ (``J``) and MoveL (``L``) hold their configuration all along the program."""
        off = {match[1].upper() for line in self.lines if (match := _OFF.match(line)) is not None}
        return {"J", "L"} - off

    def postures(self) -> dict[int, Stated]:
        """``cfx`` while ConfJ or ConfL is on."""
        on = self.supervised_words()
        stated = {
            index: move.posture()
            for index, move in enumerate(self.moves)
            if ("J" if move.word.upper().startswith("MOVEJ") else "L") in on
        }
        return {index: one for index, one in stated.items() if one is not None}

    def turns(self) -> dict[int, StatedTurns]:
        """``cf1``, ``cf4`` and ``cf6`` while ConfJ is on."""
        if "J" not in self.supervised_words():
            return {}
        return {index: one for index, move in enumerate(self.moves) if (one := move.turns()) is not None}

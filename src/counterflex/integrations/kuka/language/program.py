"""A KRL program as read: its motions, and where in ``.src`` and ``.dat`` the numbers of every target stand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.integrations.kuka.language.with_clause import WithClause
from counterflex.programs.robot_text.program import RobotProgram
from counterflex.programs.robot_text.stated import TURNING, Stated, StatedPosture, StatedTurns

LETTERS: Final = "XYZABC"


@dataclass(frozen=True, slots=True)
class Component:
    """A component of a literal: its number and where that stands in the line.

    Attributes:
        value: As written, mm or deg.
        start: Index of the first character of the number.
        end: Index behind its last one.
    """

    value: float
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class KrlFile:
    """A file of a job.

    Attributes:
        name: With its ending.
        lines: With an empty last one where the text ends in a line end.
        newline: Line end.
    """

    name: str
    lines: tuple[str, ...]
    newline: str

    @property
    def text(self) -> str:
        """The file again, byte for byte."""
        return self.newline.join(self.lines)


@dataclass(frozen=True, slots=True)
class Target:
    """A Cartesian target: the literal of a motion, the one that a name stands for, or a value that was computed.

    Attributes:
        in_data: The literal stands in a data list (``.dat``).
        file: File of the literal; of a computed one that of the motion.
        line: 1-based line of the literal.
        components: By name: X Y Z A B C, S T, E1 to E6; only those that are written.
        close: Index of the closing brace in that line.
        name: Name of the variable; empty for a literal in the motion itself.
        start: In the line of the motion: index of the target.
        end: In the line of the motion: index behind it.
        source: The literal as written, from brace to brace.
        computed: No literal holds its numbers: a corrected one is written out in the motion.
    """

    in_data: bool
    file: str
    line: int
    components: Mapping[str, Component]
    close: int
    name: str
    start: int
    end: int
    source: str
    computed: bool = False


@dataclass(frozen=True, slots=True)
class KrlMotion:
    """What stands behind a motion of :attr:`KrlProgram.motions` in the text.

    Attributes:
        file: Its ``.src`` file.
        line: 1-based line in it.
        word: ``PTP LIN CIRC SPTP SLIN SCIRC``, or ``WAIT`` of a dwell.
        target: Its end; None of a dwell and of a motion by axes.
        auxiliary: Auxiliary point of a circle.
        approximation: ``C_DIS`` and the like as written; empty for an exact stop.
        shared: The name of its target is used elsewhere too.
        circle_angle: The circle is given by a CA.
        start: Index of the word in its line.
        end: Index behind the targets and CA.
        in_spline: It is a segment of a spline block, in which no other statement may stand.
        speed_set: The program sets the path speed between the motion before and this one.
        clause: Its ``WITH``; None where there is none.
        relative: It is a ``LIN_REL`` or the like: a corrected one is written as an absolute motion.
        T_part_base: (4, 4) m, $BASE of its targets in the part; None where it is the part frame.
        override: Share of the programmed speed that the program's $OV_PRO leaves.
        holds_orientation: $ORI_TYPE=#CONSTANT: the orientation of its target is disregarded.
        distance_m: $APO.CDIS, m; NaN where the program does not say it.
    """

    file: str
    line: int
    word: str
    target: Target | None = None
    auxiliary: Target | None = None
    approximation: str = ""
    shared: bool = False
    circle_angle: bool = False
    start: int = 0
    end: int = 0
    in_spline: bool = False
    clause: WithClause | None = None
    speed_set: bool = False
    relative: bool = False
    T_part_base: Float | None = None
    override: float = 1.0
    holds_orientation: bool = False
    distance_m: float = float("nan")

    @property
    def own_speed(self) -> tuple[int, int] | None:
        """Where the number of the speed that it has for itself stands in its line; None where it has none."""
        return None if self.clause is None else self.clause.speed


@dataclass(frozen=True, slots=True)
class KrlProgram(RobotProgram):
    """A program in KRL.

    Attributes:
        files: Files of the job that were read, by name: the main one, and data lists and subprograms that it uses.
        moves: One for each of ``motions``.
        R_tcp_tool: (3, 3) orientation of the controller's $TOOL in the cell's TCP frame.
        extra: External axes as written, for added points: ``,E1 0.0``; empty where none are written, or where they
            move: what a target does not name stays.
        loose_triggers: By file and line of a motion, the first line of the TRIGGER statements before it that count from
            its end; -1 where one that counts from its start stands behind them.
        reads_position: A target counts from where the robot is (``LIN_REL``, ``$POS_ACT``): it is written as numbers
            where anything is corrected.
    """

    files: Mapping[str, KrlFile] = field(default_factory=dict)
    moves: tuple[KrlMotion, ...] = ()
    R_tcp_tool: Float | None = None
    extra: str = ""
    loose_triggers: Mapping[tuple[str, int], int] = field(default_factory=dict)
    reads_position: bool = False

    def stops(self) -> frozenset[int]:
        """Motions without C_DIS and the like; a spline goes through its points."""
        return frozenset(
            index for index, move in enumerate(self.moves) if not move.approximation and not move.in_spline
        )

    def roundings_m(self) -> list[float]:
        """``C_DIS`` with the $APO.CDIS that is active."""
        stops = self.stops()
        return [
            0.0 if index in stops else move.distance_m if "C_DIS" in move.approximation.upper() else float("nan")
            for index, move in enumerate(self.moves)
        ]

    def postures(self) -> dict[int, Stated]:
        """S of a PTP."""
        return {index: one for index, move in enumerate(self.moves) if (one := _posture(move)) is not None}

    def turns(self) -> dict[int, StatedTurns]:
        """T of a PTP."""
        return {index: one for index, move in enumerate(self.moves) if (one := _turns(move)) is not None}


def _posture(move: KrlMotion) -> Stated | None:
    """S of a PTP; in other motions the controller ignores it."""
    status = None if move.target is None else move.target.components.get("S")
    if status is None or move.word not in ("PTP", "SPTP"):
        return None
    bits = round(status.value)
    return StatedPosture(not bits & 1, bool(bits & 2), not bits & 4), f"S {bits}"


def _turns(move: KrlMotion) -> StatedTurns | None:
    """T of a PTP; in other motions the controller ignores it."""
    turn = None if move.target is None else move.target.components.get("T")
    if turn is None or move.word not in ("PTP", "SPTP"):
        return None
    bits = round(turn.value)
    negative = [bool(bits >> axis & 1) for axis in TURNING]
    low, high = ([end if one else other for one in negative] for end, other in ((-np.inf, 0.0), (0.0, np.inf)))
    return StatedTurns(tuple(low), tuple(high), f"T {bits}")

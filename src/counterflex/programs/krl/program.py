"""A KRL program as read: its motions, and where in ``.src`` and ``.dat`` the numbers of every target stand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from counterflex.core.arrays import Float
from counterflex.programs.krl.with_clause import WithClause
from counterflex.programs.robot_text.program import RobotProgram

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
class Target:
    """A Cartesian target: the literal of a motion, or the one that a name stands for.

    Attributes:
        in_data: The literal stands in the ``.dat`` file.
        line: 1-based line of the literal.
        components: By name: X Y Z A B C, S T, E1 to E6; only those that are written.
        close: Index of the closing brace in that line.
        name: Name of the variable; empty for a literal in the motion itself.
        start: In the line of the motion: index of the name, or of the opening brace.
        end: In the line of the motion: index behind the name or the closing brace.
        source: The literal as written, from brace to brace.
    """

    in_data: bool
    line: int
    components: Mapping[str, Component]
    close: int
    name: str
    start: int
    end: int
    source: str


@dataclass(frozen=True, slots=True)
class KrlMotion:
    """What stands behind a motion of :attr:`KrlProgram.motions` in the text.

    Attributes:
        line: 1-based line in the ``.src`` file.
        word: ``PTP LIN CIRC SPTP SLIN SCIRC``, or ``WAIT`` of a dwell.
        target: Its end; None of a dwell.
        auxiliary: Auxiliary point of a circle.
        approximation: ``C_DIS`` and the like as written; empty for an exact stop.
        shared: The name of its target is used elsewhere too.
        circle_angle: The circle is given by a CA.
        start: Index of the word in its line.
        end: Index behind the targets and CA.
        in_spline: It is a segment of a spline block, in which no other statement may stand.
        speed_set: The program sets the path speed between the motion before and this one.
        clause: Its ``WITH``; None where there is none.
    """

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

    @property
    def own_speed(self) -> tuple[int, int] | None:
        """Where the number of the speed that it has for itself stands in its line; None where it has none."""
        return None if self.clause is None else self.clause.speed


@dataclass(frozen=True, slots=True)
class KrlProgram(RobotProgram):
    """A program in KRL.

    Attributes:
        data: Lines of the ``.dat`` file; None where there is none.
        data_name: Its name.
        data_newline: Its line end.
        moves: One for each of ``motions``.
        R_tcp_tool: (3, 3) orientation of the controller's $TOOL in the cell's TCP frame.
        extra: External axes as written, for added points: ``,E1 0.0``; empty where none are written.
        loose_triggers: By line of a motion, the first line of the TRIGGER statements before it that count from its end;
            -1 where one that counts from its start stands behind them.
    """

    data: tuple[str, ...] | None = None
    data_name: str = ""
    data_newline: str = "\n"
    moves: tuple[KrlMotion, ...] = ()
    R_tcp_tool: Float | None = None
    extra: str = ""
    loose_triggers: Mapping[int, int] = field(default_factory=dict)

"""A KRL program as read: its motions, and where in ``.src`` and ``.dat`` the numbers of every target stand.

``WITH`` behind a spline motion: system variables that hold for that motion alone.

``SLIN XP2 WITH $VEL.CP=0.05 C_SPL`` as programs write it, and as the inline forms of KSS 8.3 and later do:
``SLIN XP2 WITH $VEL = SVEL_CP( 0.05, , LCPDAT1), $TOOL = STOOL2( FP2), $BASE = SBASE( FP2.BASE_NO), ... C_SPL``.

Source: KUKA, KSS 8.3 Operating and Programming Instructions for System Integrators, spline motions.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.integrations.kuka.language import LIMITS
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.robot_text.program import TURNING, RobotProgram, Stated, StatedPosture, StatedTurns

_I: Final = re.IGNORECASE
_BEGINS: Final = re.compile(r"\s*(WITH)\b", _I)
_VARIABLE: Final = re.compile(r"\s*\$(\w+)((?:\.\w+)?)(?:\s*\[\s*\d+\s*\])?\s*=\s*", _I)
_ENDS: Final = re.compile(r"\s*(?:C_(?:DIS|PTP|VEL|ORI|SPL)\b|$)", _I)
_SPEED: Final = re.compile(r"(?:SVEL_CP\s*\(\s*([^,()]+?)\s*[,)]|\{(?:[^{}]*,)?\s*CP\s+([^,{}]+?)\s*[,}])", _I)
_EVALUATED: Final = frozenset(("TOOL", "BASE", "IPO_MODE", "ORI_TYPE"))
_CARRIED: Final = frozenset(
    ("LOAD", "ACC", "CIRC_TYPE", "APO", "JERK", "GEAR_JERK", "VEL_AXIS", "ACC_AXIS", "VEL_EXTAX",
     "ACC_EXTAX", "COLLMON_TOL_PRO", "EX_AX_IGNORE", "ECO_LEVEL")
)  # fmt: skip
"""Variables that move no target and set no speed along the path."""


class WithFault(ValueError):
    """A clause that is not understood; ``at`` is where in the line.

    Args:
        at: Index in the line.
        hint: What to do.
    """

    def __init__(self, what: str, at: int, hint: str) -> None:
        super().__init__(what)
        self.what, self.at, self.hint = what, at, hint


@dataclass(frozen=True, slots=True)
class WithClause:
    """A clause as read."""

    start: int  # Index of ``WITH`` in its line
    end: int  # Index behind it
    speed: tuple[int, int] | None = None  # Where the path speed stands, m/s; None where none is given
    # Where the value of TOOL, BASE, IPO_MODE and ORI_TYPE stands, of those that are given
    values: Mapping[str, tuple[int, int]] = field(default_factory=dict)


def with_clause(code: str, at: int) -> WithClause | None:
    """The clause that begins at a place of a line; None where there is none.

    Args:
        code: The line without its comment.
        at: Index behind targets and approximation.

    Raises:
        WithFault: A variable or a value is not understood.
    """
    begins = _BEGINS.match(code, at)
    if begins is None:
        return None
    speed, at = None, begins.end()
    values: dict[str, tuple[int, int]] = {}
    while True:
        variable = _VARIABLE.match(code, at)
        if variable is None:
            raise WithFault("WITH needs a system variable and its value", at, "WITH $VEL.CP=0.02")
        name, part, first = variable[1].upper(), variable[2].upper(), variable.end()
        end = _end_of_value(code, first)
        if name == "VEL" and part in ("", ".CP"):
            speed = _speed(code, first, end, whole=not part)
        elif name in _EVALUATED and not part:
            values[name] = first, first + len(code[first:end].rstrip())
        elif name not in _CARRIED and name != "VEL":
            raise WithFault(f"WITH ${name} is not read", variable.start(1) - 1, "Set it by a statement of its own")
        at = end
        if code[at : at + 1] != ",":
            break
        at += 1
    if _ENDS.match(code, at) is None:
        raise WithFault("this is not understood behind WITH", at, "C_SPL ends the statement")
    last = begins.start(1) + len(code[begins.start(1) : at].rstrip())
    return WithClause(begins.start(1), last, speed, values)


def _end_of_value(code: str, at: int) -> int:
    """Index of the comma behind a value, of the approximation, or of the end of the line."""
    depth = 0
    while at < len(code):
        character = code[at]
        if character in "({[":
            depth += 1
        elif character in ")}]":
            depth -= 1
        elif depth == 0 and (character == "," or (character.isspace() and _ENDS.match(code, at))):
            break
        at += 1
    if depth:
        raise WithFault("a bracket is not closed: the line may be cut off", at, "Post the program again")
    return at


def _speed(code: str, first: int, end: int, *, whole: bool) -> tuple[int, int]:
    if not whole:
        return first, first + len(code[first:end].rstrip())
    match = _SPEED.match(code, first, end)
    if match is None:
        raise WithFault("the path speed is no number", first, "Write $VEL.CP=, in m/s")
    return match.span(1 if match[1] is not None else 2)


LETTERS: Final = "XYZABC"


@dataclass(frozen=True, slots=True)
class Component:
    """A component of a literal: its number and where that stands in the line."""

    value: float  # As written, mm or deg
    start: int  # Index of the first character of the number
    end: int  # Index behind its last one


@dataclass(frozen=True, slots=True)
class KrlFile:
    """A file of a job."""

    name: str  # With its ending
    lines: tuple[str, ...]  # With an empty last one where the text ends in a line end
    newline: str  # Line end

    @property
    def text(self) -> str:
        """The file again, byte for byte."""
        return self.newline.join(self.lines)


@dataclass(frozen=True, slots=True)
class Target:
    """A Cartesian target: the literal of a motion, the one that a name stands for, or a value that was computed."""

    in_data: bool  # The literal stands in a data list (``.dat``)
    file: str  # File of the literal; of a computed one that of the motion
    line: int  # 1-based line of the literal
    components: Mapping[str, Component]  # By name: X Y Z A B C, S T, E1 to E6; only those that are written
    close: int  # Index of the closing brace in that line
    name: str  # Name of the variable; empty for a literal in the motion itself
    start: int  # In the line of the motion: index of the target
    end: int  # In the line of the motion: index behind it
    source: str  # The literal as written, from brace to brace
    computed: bool = False  # No literal holds its numbers: a corrected one is written out in the motion

    def edits(self, values: Values, active: Values, *, turned: bool) -> list[Edit]:
        """Edits that give a target other values; none for components that are the same within the last decimal.

        Args:
            values: To command.
            active: Where the robot is before, which components that are not written keep.
            turned: The orientation is corrected too; else A B C stay.
        """
        out: list[Edit] = []
        missing = ""
        for letter in LETTERS:
            if letter in "ABC" and not turned and letter in self.components:
                continue
            half = 0.5 * 10.0 ** -(LIMITS.position_decimals if letter in "XYZ" else LIMITS.angle_decimals)
            component = self.components.get(letter)
            if component is None:
                if abs(values[letter] - active[letter]) > half:
                    missing += f",{letter} {spelled(letter, values[letter])}"
            elif abs(values[letter] - component.value) > half:
                out.append((component.start, component.end, spelled(letter, values[letter])))
        if missing:
            out.append((self.close, self.close, missing))
        return out

    def text(self, edits: Sequence[Edit]) -> str:
        """The literal of a target with edits, which count in its own line."""
        offset = self.close + 1 - len(self.source)
        moved = [(start - offset, end - offset, text) for start, end, text in edits]
        return Edits((self.source,)).changed(1, moved)


@dataclass(frozen=True, slots=True)
class KrlMotion:
    """Text behind a motion of :attr:`KrlProgram.motions`."""

    file: str  # Its ``.src`` file
    line: int  # 1-based line in it
    word: str  # ``PTP LIN CIRC SPTP SLIN SCIRC``, or ``WAIT`` of a dwell
    target: Target | None = None  # Its end; None of a dwell and of a motion by axes
    auxiliary: Target | None = None  # Auxiliary point of a circle
    approximation: str = ""  # ``C_DIS`` and the like as written; empty for an exact stop
    shared: bool = False  # The name of its target is used elsewhere too
    circle_angle: bool = False  # The circle is given by a CA
    start: int = 0  # Index of the word in its line
    end: int = 0  # Index behind the targets and CA
    in_spline: bool = False  # It is a segment of a spline block, in which no other statement may stand
    clause: WithClause | None = None  # Its ``WITH``; None where there is none
    speed_set: bool = False  # The program sets the path speed between the motion before and this one
    relative: bool = False  # It is a ``LIN_REL`` or the like: a corrected one is written as an absolute motion
    T_part_base: Float | None = None  # (4, 4) m, $BASE of its targets in the part; None where it is the part frame
    override: float = 1.0  # Share of the programmed speed that the program's $OV_PRO leaves
    holds_orientation: bool = False  # $ORI_TYPE=#CONSTANT: the orientation of its target is disregarded
    distance_m: float = float("nan")  # $APO.CDIS, m; NaN where the program does not say it

    @property
    def own_speed(self) -> tuple[int, int] | None:
        """Columns of the number of its own speed in its line; None where it has none."""
        return None if self.clause is None else self.clause.speed


@dataclass(frozen=True, slots=True)
class KrlProgram(RobotProgram):
    """A program in KRL."""

    # Files of the job that were read, by name: the main one, and data lists and subprograms that it uses
    files: Mapping[str, KrlFile] = field(default_factory=dict)
    moves: tuple[KrlMotion, ...] = ()  # One for each of ``motions``
    R_tcp_tool: Float | None = None  # (3, 3) orientation of the controller's $TOOL in the cell's TCP frame
    # External axes as written, for added points: ``,E1 0.0``; empty where none are written, or where they move: what a
    # target does not name stays
    extra: str = ""
    # By file and line of a motion, the first line of the TRIGGER statements before it that count from its end; -1 where
    # one that counts from its start stands behind them
    loose_triggers: Mapping[tuple[str, int], int] = field(default_factory=dict)
    # A target counts from where the robot is (``LIN_REL``, ``$POS_ACT``): it is written as numbers where anything is
    # corrected
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


Values = dict[str, float]
"""X Y Z in mm, A B C in deg."""
Edit = tuple[int, int, str]
"""Start and end in a line, and what stands there instead."""


class Edits:
    """Edits of a file, applied together at the end, so that places stay those of the source."""

    def __init__(self, source: Sequence[str]) -> None:
        self._source = source
        self._changes: dict[int, list[Edit]] = {}
        self._before: dict[int, list[str]] = {}

    def change(self, line: int, edits: Sequence[Edit]) -> None:
        """Replace parts of a line (1-based)."""
        self._changes.setdefault(line, []).extend(edits)

    def insert(self, line: int, texts: Sequence[str]) -> None:
        """Put lines before a line (1-based), behind those put there already."""
        if texts:
            self._before.setdefault(line, []).extend(texts)

    def changed(self, line: int, edits: Sequence[Edit]) -> str:
        """A line with edits."""
        text, out, at = self._source[line - 1], [], 0
        for start, end, replacement in sorted(edits):
            out += [text[at:start], replacement]
            at = end
        return "".join([*out, text[at:]])

    def lines(self) -> Iterator[str]:
        """The lines with all edits."""
        for line, text in enumerate(self._source, start=1):
            yield from self._before.get(line, ())
            yield self.changed(line, self._changes[line]) if line in self._changes else text


def spelled(letter: str, value: float) -> str:
    """A component as it is written."""
    return number(value, LIMITS.position_decimals if letter in "XYZ" else LIMITS.angle_decimals)

"""The same VAL3 program back with only its points and speeds changed: the data file, and added motions."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

import numpy as np

from counterflex import __version__
from counterflex.core.arrays import Float, as_positive
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM, MM_PER_S
from counterflex.programs.compensated import CompensatedPath, mark
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.limits import VAL3
from counterflex.programs.robot_text.circle_fit import FittedCircle
from counterflex.programs.robot_text.in_place import InPlace, InPlaceText
from counterflex.programs.robot_text.spans import Spans
from counterflex.programs.val3.program import (
    LETTERS,
    Key,
    Val3Motion,
    Val3Program,
    Val3Value,
    frame_of,
    rotations_of,
)

_DECIMAL_MM: Final = 10.0**-VAL3.position_decimals
_DECIMAL_DEG: Final = 10.0**-VAL3.angle_decimals
POINTS, SPEEDS = "pCounterflex", "mCounterflex"
"""Variables that added points and changed speeds are put in."""
_BLENDED: Final = {"blend": "cartesian", "leave": "0.1", "reach": "0.1"}
"""Of added points whose mdesc stops: the robot must not stop at them, mm."""


def write_val3_in_place(
    program: Val3Program,
    compensated: CompensatedPath,
    *,
    tolerance_m: float = 5e-6,
    cycle_s: float = 0.004,
    cell: str = "",
    job: str = "",
) -> InPlaceText:
    """Write a program back with its points replaced by the commanded ones.

    Every byte that is no number of a corrected point stays. A point that the program names more than once, added points
    and motions with another speed get elements of variables of their own, ``pCounterflex`` and ``mCounterflex``, at the
    end of the data file. Nothing at all changes when no row is corrected.

    Args:
        program: As read.
        compensated: Commanded rows for the path sampled from ``program``.
        tolerance_m: Largest distance between a commanded row and the written path at the same share of the motion,
            before rounding; > 0, m.
        cycle_s: Time the controller needs per point, s, > 0.
        cell: Name of the cell, for the comment at the head.
        job: Hash of the plan, for the same.

    Returns:
        Files and counts.

    Raises:
        InputError: Path and program do not belong together, or an option is out of range.
        ProgramError: The speed of a motion changes whose mdesc the program changes itself.
    """
    as_positive("tolerance_m", tolerance_m)
    as_positive("cycle_s", cycle_s)
    writer = _InPlace(program, compensated, tolerance_m=tolerance_m, cycle_s=cycle_s, decimal_m=_DECIMAL_MM * MM)
    if not writer.changed:
        return writer.result({program.name: program.text, program.data_name: program.data})
    writer.run()
    return writer.result(writer.files(writer.messages(__version__, cell, mark(job) if job else "")))


class _InPlace(InPlace):
    """Edits of program and data file."""

    def __init__(self, program: Val3Program, compensated: CompensatedPath, **options: float) -> None:
        super().__init__(program, compensated, **options)
        self.program, self.edits, self.data = program, Spans(), Spans()
        self._points: list[str] = []
        self._speeds: dict[str, int] = {}
        taken = {POINTS, SPEEDS} & program.variables.keys()
        if taken:
            raise ProgramError(f"the data file has a variable {min(taken)} already", where=program.data_name,
                               hint="Give the original program and data file")  # fmt: skip

    def files(self, messages: list[str]) -> dict[str, str]:
        """Both files with all edits."""
        program = self.program
        newline = program.newline
        self.edits.insert(program.code, "".join(f"  // {line}{newline}" for line in messages))
        end = program.datas_end
        indent = program.data[program.data.rfind("\n", 0, end) + 1 : end]
        indent = indent if not indent.strip() else ""
        added = ""
        for name, kind, values in ((POINTS, "pointRx", self._points), (SPEEDS, "mdesc", list(self._speeds))):
            if values:
                lines = [f'      <Value key="{key}" {value} />' for key, value in enumerate(values)]
                rows = [f"  {self._head(name, kind, len(values))}", *lines, f"{indent}  </Data>", indent]
                added += newline.join(rows)
        self.data.insert(end, added)
        return {program.name: self.edits.applied(program.text), program.data_name: self.data.applied(program.data)}

    def _head(self, name: str, kind: str, size: int) -> str:
        """Opening tag of a variable, in the form that the file has for its kind."""
        like = next((data.head for data in self.program.variables.values() if data.kind == kind), "")
        head = re.sub(r'\bname\s*=\s*"[^"]*"', f'name="{name}"', like.replace("/>", ">"))
        return re.sub(r'\bsize\s*=\s*"[^"]*"', f'size="{size}"', head)

    # ---- language --------------------------------------------------------------------------------------------

    def rounded(self, p: Float) -> Float:
        """(3,) m, as points are written."""
        out: Float = np.round(p / MM, VAL3.position_decimals) * MM
        return out

    def add(self, index: int, p: Float, R_part_tcp: Float, speed_m_s: float | None, *, exact: bool = False) -> None:
        """``movel`` on a line of its own before the statement."""
        move, like = self.program.moves[index], self._like(index)
        if like.point is None:
            raise ValueError("a motion without a point")
        point = self._own_point(like.point, p, rotations_of(R_part_tcp @ like.R_tcp_tool))
        speed = self.program.text[slice(*like.speed_named)]
        if speed_m_s is not None or (like.exact and not exact):
            self.counts.speeds_changed += speed_m_s is not None
            speed = self._own_speed(like, speed_m_s, blended=not exact)
        line = self.program.text[move.head : self.program.text.find("\n", move.head)]
        indent = line[: len(line) - len(line.lstrip())]
        self.edits.insert(move.head, f"{indent}movel({point},{like.tool},{speed}){self.program.newline}")

    def end(self, index: int, p: Float, R_part_tcp: Float | None, speed_m_s: float | None) -> Float:
        """The point of the statement, and its speed."""
        move = self.program.moves[index]
        if move.point is None:
            return p
        if speed_m_s is not None:
            self.counts.speeds_changed += 1
            self.edits.replace(*move.speed_named, self._own_speed(move, speed_m_s, blended=False))
        turns = None if R_part_tcp is None else rotations_of(R_part_tcp @ move.R_tcp_tool)
        return self._write(move.point, move.named, p, turns)

    def circle(self, index: int, fit: FittedCircle) -> None:
        """Another point on the circle."""
        move = self.program.moves[index]
        if move.auxiliary is not None:
            p = frame_of(self._numbers(move.auxiliary))[:3, 3]
            self._write(move.auxiliary, move.auxiliary_named, fit.at(p), None)

    def straightened(self, index: int) -> None:
        """``movel`` with the end alone."""
        move = self.program.moves[index]
        self.edits.replace(move.start, move.start + len(move.word), "movel")
        self.edits.replace(move.auxiliary_named[0], move.named[0], "")

    # ---- data ------------------------------------------------------------------------------------------------

    def _like(self, index: int) -> Val3Motion:
        """The statement that an added one is like: that of the motion, of a wait the one before."""
        moves = self.program.moves
        return next(moves[i] for i in range(index, -1, -1) if moves[i].point is not None)

    def _value(self, key: Key) -> Val3Value:
        return self.program.variables[key[0]].values[key[1]]

    def _numbers(self, key: Key) -> dict[str, float]:
        attributes = self._value(key).attributes
        return {letter: float(attributes.get(letter, "0")) for letter in LETTERS}

    def _changes(self, key: Key, p: Float, turns: tuple[float, float, float] | None) -> dict[str, str]:
        """Attributes that get other numbers; an angle is written as the turn that lies nearest."""
        old = self._numbers(key)
        values = dict(zip(LETTERS[:3], (p / MM).tolist(), strict=True))
        if turns is not None:
            near = np.array([old[letter] for letter in LETTERS[3:]])
            values |= dict(zip(LETTERS[3:], _near(turns, near), strict=True))
        out = {}
        for letter, value in values.items():
            place = letter in LETTERS[:3]
            if abs(value - old[letter]) > 0.5 * (_DECIMAL_MM if place else _DECIMAL_DEG):
                out[letter] = number(value, VAL3.position_decimals if place else VAL3.angle_decimals)
        return out

    def _write(self, key: Key, named: tuple[int, int], p: Float, turns: tuple[float, float, float] | None) -> Float:
        """Give a point other numbers; returns its place as it is written, (3,) m."""
        changes, value = self._changes(key, p, turns), self._value(key)
        if not changes:
            unchanged: Float = frame_of(self._numbers(key))[:3, 3]
            return unchanged
        names = self.program.mentions.get(key, 0)
        if names > 1:
            self.edits.replace(*named, self._own_point(key, p, turns))
            self.counts.targets_written_out += 1
        else:
            for letter, text in changes.items():
                if letter in value.spans:
                    self.data.replace(*value.spans[letter], text)
                else:
                    self.data.insert(value.end, f' {letter}="{text}"')
            self.counts.targets_declared += 1
        return self.rounded(p)

    def _own_point(self, key: Key, p: Float, turns: tuple[float, float, float] | None) -> str:
        """A new element like a point; returns its name."""
        self._points.append(_attributes({**self._value(key).attributes, **self._changes(key, p, turns)}))
        return f"{POINTS}[{len(self._points) - 1}]"

    def _own_speed(self, move: Val3Motion, speed_m_s: float | None, *, blended: bool) -> str:
        """A new element like an mdesc with another speed, or one that does not stop; returns its name."""
        if move.changed_speed:
            raise ProgramError(
                "the speed of a motion changes whose mdesc the program changes itself",
                where=f"{self.program.name}:{move.line}", value=f"{move.speed[0]}[{move.speed[1]}]",
                hint="Give it its fields in the data file",
            )  # fmt: skip
        data = self.program.variables[move.speed[0]]
        value = data.values.get(move.speed[1])
        attributes = {} if value is None else dict(value.attributes)
        feed = self.program.motions[self.program.moves.index(move)].feed_m_s if speed_m_s is None else speed_m_s
        if feed > 0.0:
            attributes["tmax"] = number(feed / MM_PER_S, 4)
        if blended and move.exact:
            attributes |= _BLENDED
        text = _attributes(attributes)
        return f"{SPEEDS}[{self._speeds.setdefault(text, len(self._speeds))}]"


def _attributes(attributes: Mapping[str, str]) -> str:
    """Attributes of a Value, without its key."""
    return " ".join(f'{name}="{value}"' for name, value in attributes.items() if name != "key")


def _near(turns: tuple[float, float, float], old: Float) -> list[float]:
    """rx, ry, rz of the same orientation, deg, in +-180, near others."""
    rx, ry, rz = turns
    ways = [np.array([rx, ry, rz]), np.array([rx + 180.0, 180.0 - ry, rz + 180.0])]
    ways = [way - 360.0 * np.round((way - old) / 360.0) for way in ways]
    best = min(ways, key=lambda way: float(np.abs(way - old).max()))
    best = np.where(np.abs(best) > 180.0, best - 360.0 * np.sign(best), best)
    out: list[float] = best.tolist()
    return out

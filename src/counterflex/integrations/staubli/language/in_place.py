"""The same VAL3 program back with only its points and speeds changed: the data file, and added motions."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM, MM_PER_S
from counterflex.geometry import pose
from counterflex.integrations.staubli.language import LIMITS
from counterflex.integrations.staubli.language.program import (
    LETTERS,
    Key,
    Val3Motion,
    Val3Program,
    Val3Value,
    frame_of,
    rotations_of,
)
from counterflex.programs.compensated import CompensatedPath
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.limits import Limits
from counterflex.programs.robot_text.circle_fit import FittedCircle, Spans
from counterflex.programs.robot_text.in_place import CONVERT, PointsInPlace, near_angles

_DECIMAL_MM: Final = 10.0**-LIMITS.position_decimals
_DECIMAL_DEG: Final = 10.0**-LIMITS.angle_decimals
POINTS, SPEEDS = "pCounterflex", "mCounterflex"
"""Variables that added points and changed speeds are put in."""
_CONVERT: Final = CONVERT.format("statement")
_FATHER: Final = re.compile(r'fatherId="([^"]*)"')
_ATTRIBUTE: Final = re.compile(r'(\w+)="([^"]*)"')
_BLENDED: Final = {"blend": "cartesian", "leave": "0.1", "reach": "0.1"}
"""Of added points whose mdesc stops: the robot must not stop at them, mm."""


class Val3InPlace(PointsInPlace[Val3Program, Val3Motion]):
    """Edits of program files and data file.

    A point that the program names more than once, added points and motions with another speed get elements of variables
    of their own, ``pCounterflex`` and ``mCounterflex``, at the end of the data file.
    """

    limits: ClassVar[Limits] = LIMITS
    cycle_s: ClassVar[float] = 0.004
    statement: ClassVar[str] = "statement"

    def __init__(self, program: Val3Program, compensated: CompensatedPath, tolerance_m: float, cycle_s: float) -> None:
        super().__init__(program, compensated, tolerance_m, cycle_s)
        self.data, self.edits = Spans(), {name: Spans() for name in program.sources}
        self._points: list[str] = []
        self._speeds: dict[str, int] = {}
        taken = {POINTS, SPEEDS} & program.variables.keys()
        if taken:
            raise ProgramError(f"the data file has a variable {min(taken)} already", where=program.data_name,
                               hint="Give the original program and data file")  # fmt: skip

    def points_of(self, program: Val3Program) -> list[Val3Motion]:
        """The statements."""
        return list(program.moves)

    def files(self, messages: list[str]) -> dict[str, str]:
        """All files with their edits; comments at the head of those that change."""
        program, out = self.program, {}
        for name, source in program.sources.items():
            if self.edits[name].sorted() or (messages and name == program.name):
                self.edits[name].insert(source.code, "".join(f"  // {line}{program.newline}" for line in messages))
            out[name] = self.edits[name].applied(source.text)
        if program.old:
            self._add_old()
        else:
            self._add()
        return out | ({program.data_name: self.data.applied(program.data)} if program.data_name else {})

    def _add(self) -> None:
        """Variables of added points and speeds at the end of the data file."""
        program = self.program
        newline, end = program.newline, program.datas_end
        indent = program.data[program.data.rfind("\n", 0, end) + 1 : end]
        indent = indent if not indent.strip() else ""
        for name, kind, values in ((POINTS, "pointRx", self._points), (SPEEDS, "mdesc", list(self._speeds))):
            if values:
                lines = [f'      <Value key="{key}" {value} />' for key, value in enumerate(values)]
                rows = [f"  {self._head(name, kind, len(values))}", *lines, f"{indent}  </Data>", indent]
                self.data.insert(end, newline.join(rows))

    def _add_old(self) -> None:
        """The same in the form of s6, in the sections of points and speeds."""
        for name, tag, texts in ((POINTS, "point", self._points), (SPEEDS, "mdesc", list(self._speeds))):
            end = self.program.data.find(f"</{tag}Section>")
            if texts and end < 0:
                raise ProgramError(f"the data file has no {tag}Section to put added elements in",
                                   where=self.program.data_name, hint=_CONVERT)  # fmt: skip
            by_father: dict[str, list[tuple[int, str]]] = {}
            for key, text in enumerate(texts):
                father = _FATHER.search(text)
                by_father.setdefault(father[1] if father else "", []).append((key, text))
            if len(by_father) > 1:
                raise ProgramError("added points in several frames are not written in the form of s6",
                                   where=self.program.data_name, hint=_CONVERT)  # fmt: skip
            rows = "".join(_old_variable(name, tag, father, items) for father, items in by_father.items())
            self.data.insert(max(end, 0), rows.replace("\n", self.program.newline))

    def _head(self, name: str, kind: str, size: int) -> str:
        """Opening tag of a variable, in the form that the file has for its kind."""
        like = next((data.head for data in self.program.variables.values() if data.kind == kind), "")
        if not like:
            return f'<Data name="{name}" access="private" xsi:type="array" type="{kind}" size="{size}">'
        head = re.sub(r'\bname\s*=\s*"[^"]*"', f'name="{name}"', like.replace("/>", ">"))
        return re.sub(r'\bsize\s*=\s*"[^"]*"', f'size="{size}"', head)

    # ---- language --------------------------------------------------------------------------------------------

    def add(self, index: int, p: Float, R_part_tcp: Float, speed_m_s: float | None, *, exact: bool = False) -> None:
        """``movel`` on a line of its own before the statement."""
        move, like = self.program.moves[index], self.like(index)
        self.refuse_repeated(move)
        point = self._own_point(like, like.in_frame(p, R_part_tcp))
        text = self.program.sources[move.file].text
        speed = self.program.sources[like.file].text[slice(*like.speed_named)]
        if speed_m_s is not None or (like.exact and not exact):
            self.counts.speeds_changed += speed_m_s is not None
            speed = self._own_speed(like, index, speed_m_s, blended=not exact)
        line = text[move.head : text.find("\n", move.head)]
        indent = line[: len(line) - len(line.lstrip())]
        self.edits[move.file].insert(move.head, f"{indent}movel({point},{like.tool},{speed}){self.program.newline}")

    def end(self, index: int, p: Float, R_part_tcp: Float | None, speed_m_s: float | None) -> Float:
        """The point of the statement, and its speed."""
        move = self.program.moves[index]
        if move.word == "delay" or move.T_frame_tool is None:  # a place by axes stays
            return p if move.word == "delay" else np.asarray(self.program.motions[index].p_end)
        if speed_m_s is not None:
            self.refuse_repeated(move)
            self.counts.speeds_changed += 1
            speed = self._own_speed(move, index, speed_m_s, blended=False)
            self.edits[move.file].replace(*move.speed_named, speed)
        return self.end_at(move, p, R_part_tcp)

    def circle(self, index: int, fit: FittedCircle) -> None:
        """Another point on the circle."""
        move = self.program.moves[index]
        if move.auxiliary is None:
            raise self.refusal(move, "a circle to computed points is corrected, and is not written back")
        numbers = self._numbers(move.auxiliary)
        p = (move.T_part_frame @ frame_of(numbers))[:3, 3]
        T = pose.inverse(move.T_part_frame) @ pose.make(np.eye(3), fit.at(p))
        self._write_literal(move, move.auxiliary, move.auxiliary_named, T[:3, 3], None)

    def straightened(self, index: int) -> None:
        """``movel`` with the end alone."""
        move = self.program.moves[index]
        self.refuse_repeated(move)
        self.edits[move.file].replace(move.start, move.start + len(move.word), "movel")
        self.edits[move.file].replace(move.auxiliary_named[0], move.named[0], "")

    # ---- data ------------------------------------------------------------------------------------------------

    def shown(self, point: Val3Motion) -> str:
        """The line of a statement."""
        return self.program.sources[point.file].text[point.head :].partition("\n")[0]

    def refuse_repeated(self, point: Val3Motion) -> None:
        """Refuse to change a statement that runs more than once, or stands in a library."""
        super().refuse_repeated(point)
        if "/" in point.file:
            raise self.refusal(point, "a motion of a library is corrected, and is not written back")

    def _value(self, key: Key) -> Val3Value:
        return self.program.variables[key[0]].values[key[1]]

    def _numbers(self, key: Key) -> dict[str, float]:
        attributes = self._value(key).attributes
        return {letter: float(attributes.get(letter, "0")) for letter in LETTERS}

    def literal(self, point: Val3Motion, T_frame_tool: Float, *, turned: bool) -> Float | None:
        """Change the point of the data file."""
        if point.point is None:
            return None
        turns = rotations_of(T_frame_tool[:3, :3]) if turned else None
        return self._write_literal(point, point.point, point.named, T_frame_tool[:3, 3], turns)

    def write_out(self, point: Val3Motion, T_frame_tool: Float) -> None:
        """An element of its own."""
        self.edits[point.file].replace(*point.named, self._own_point(point, T_frame_tool))

    def _write_literal(
        self, move: Val3Motion, key: Key, named: tuple[int, int], p_father: Float,
        turns: tuple[float, float, float] | None,
    ) -> Float:  # fmt: skip
        """Give a point other numbers; returns its place in the part as it is written, (3,) m."""
        value, old = self._value(key), self._numbers(key)
        changes = _changes(old, p_father, turns)
        if not changes:
            unchanged: Float = (move.T_part_frame @ frame_of(old))[:3, 3]
            return unchanged
        if self.program.mentions.get(key, 0) > 1:
            self.refuse_repeated(move)
            own = {**value.attributes, **changes}
            self.edits[move.file].replace(*named, self._own_element(own))
            self.counts.targets_written_out += 1
        else:
            for letter, text in changes.items():
                if letter in value.spans:
                    self.data.replace(*value.spans[letter], text)
                else:
                    self.data.insert(value.end, f' {letter}="{text}"')
            self.counts.targets_declared += 1
        out: Float = (move.T_part_frame @ np.append(self.rounded(p_father), 1.0))[:3]
        return out

    def _own_point(self, like: Val3Motion, T_father_tool: Float) -> str:
        """A new element like the end of a statement; returns its name."""
        turns = rotations_of(T_father_tool[:3, :3])
        if like.point is not None:
            attributes, old = dict(self._value(like.point).attributes), self._numbers(like.point)
            return self._own_element({**attributes, **_changes(old, T_father_tool[:3, 3], turns)})
        zero = dict.fromkeys(LETTERS, 0.0)
        return self._own_element({**_changes(zero, T_father_tool[:3, 3], turns), **like.attributes})

    def _own_element(self, attributes: Mapping[str, str]) -> str:
        self._points.append(_attributes(attributes))
        return f"{POINTS}[{len(self._points) - 1}]"

    def _own_speed(self, move: Val3Motion, index: int, speed_m_s: float | None, *, blended: bool) -> str:
        """A new element like an mdesc with another speed, or one that does not stop; returns its name."""
        attributes = dict(move.speed)
        feed = self.program.motions[index].feed_m_s if speed_m_s is None else speed_m_s
        if feed > 0.0:
            attributes["tmax"] = number(feed / MM_PER_S, 4)
        if blended and move.exact:
            attributes |= _BLENDED
        text = _attributes(attributes)
        return f"{SPEEDS}[{self._speeds.setdefault(text, len(self._speeds))}]"


def _changes(old: Mapping[str, float], p: Float, turns: tuple[float, float, float] | None) -> dict[str, str]:
    """Attributes that get other numbers; an angle is written as the turn that lies nearest."""
    values = dict(zip(LETTERS[:3], (p / MM).tolist(), strict=True))
    if turns is not None:
        near = np.array([old[letter] for letter in LETTERS[3:]])
        values |= dict(zip(LETTERS[3:], near_angles(turns, near).tolist(), strict=True))
    out = {}
    for letter, value in values.items():
        place = letter in LETTERS[:3]
        if abs(value - old[letter]) > 0.5 * (_DECIMAL_MM if place else _DECIMAL_DEG):
            out[letter] = number(value, LIMITS.position_decimals if place else LIMITS.angle_decimals)
    return out


def _old_variable(name: str, tag: str, father: str, items: list[tuple[int, str]]) -> str:
    """A variable in the form of s6."""
    rows = [f'    <{tag} name="{name}" public="false">']
    frame, _, index = father.removesuffix("]").partition("[")
    if tag == "point":
        rows.append(f'      <pFather alias="" name="{frame}" fatherIndex="{index or 0}" />')
    for key, text in items:
        attributes = dict(_ATTRIBUTE.findall(text))
        rows.append(f'      <value{tag.capitalize()} index="{key}">')
        if tag == "point":
            place = {letter: attributes.get(letter, "0") for letter in LETTERS}
            config = {one: attributes[one] for one in ("shoulder", "elbow", "wrist") if one in attributes}
            rows.append(f"        <tpValue {_attributes(place)} />")
            rows.append(f"        <cpValue {_attributes(config)} />")
        else:
            rows.append(f"        <mdescValue {_attributes(attributes)} />")
        rows.append(f"      </value{tag.capitalize()}>")
    return "\n".join([*rows, f"    </{tag}>", "  "])


def _attributes(attributes: Mapping[str, str]) -> str:
    """Attributes of a Value, without its key."""
    return " ".join(f'{name}="{value}"' for name, value in attributes.items() if name not in ("key", "index"))


write_val3_in_place = Val3InPlace.write

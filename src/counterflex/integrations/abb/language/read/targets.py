"""Arguments of a motion of RAPID: targets and where their numbers stand, speeds, zones, external axes."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

from counterflex.core.errors import ProgramError
from counterflex.core.units import DEG, MM, MM_PER_S
from counterflex.integrations.abb.language.program import RapidTarget
from counterflex.integrations.abb.language.read import literals
from counterflex.integrations.abb.language.read.memory import RapidMemory, Reference
from counterflex.programs.expression import Name, Value, is_number
from counterflex.programs.robot_text.cell import ExternalAxes, RobotTextCell
from counterflex.programs.robot_text.process_words import NUMBER
from counterflex.programs.unknown import Unknown, first_unknown, known

_OFFS: Final = re.compile(r"Offs\s*\(", re.IGNORECASE)
_NUMBER: Final = re.compile(NUMBER)
_SIZE: Final = re.compile(r"\bDim\s*\(\s*\w+", re.IGNORECASE)
_NONE_FROM: Final = 8e8  # External axes that are not there are 9E9
_LARGEST_MM: Final = 100_000.0
_LARGEST_MM_S: Final = 20_000.0
_UNIT: Final = 1e-3
_KEPT: Final = 1000  # Values of names that are kept: a routine that is called again and again has others each time


@dataclass(frozen=True, slots=True)
class Speed:
    """Speed of an instruction."""

    m_s: float  # Of the tool tip; NaN where the time of the motion is given
    value: tuple[int, int] | None = None  # Where the number of the option V stands; None where there is none
    time: tuple[int, int] | None = None  # Where the option T stands, from its backslash; None where there is none
    time_s: float = 0.0  # Its value
    turning_rad_s: float = math.inf  # v_ori: of the turn about the tool tip


@dataclass(frozen=True, slots=True)
class Zone:
    """Zone of an instruction: whether the robot stops, and how far from its end it leaves the path, m."""

    exact: bool
    rounding_m: float


class RapidTargets:
    """Reads the arguments of motions.

    Args:
        memory: Data of the program.
        cell: What the program is held against.
        made: Returns the number of motions made so far.
    """

    def __init__(self, memory: RapidMemory, cell: RobotTextCell | None, made: Callable[[], int]) -> None:
        self.memory, self.source = memory, memory.source
        self.external = ExternalAxes(cell, made)  # External axes along the program
        self._checked = ""
        self._uses: dict[tuple[int, tuple[int, ...]], int] = {}
        self._spans: dict[int, set[int]] = {}
        self._names: dict[int, str] = {}
        self._arrays: dict[int, literals.AggregateLiteral | None] = {}
        self._speeds: dict[tuple[str, int], Speed] = {}
        self._zones: dict[str, Zone] = {}
        self._stamp = -1

    # ---- targets ---------------------------------------------------------------------------------------------

    def target(self, argument: literals.CallArgument) -> RapidTarget:
        """Return the robtarget of an argument. Raises ProgramError: it is not known."""
        code = self.source.code
        literal = literals.robtarget_literal(code, argument.start) if argument.text.startswith("[") else None
        if literal is not None and literal.end == argument.end:
            return self._written(literal, argument)
        if argument.text == "*":
            raise self._fault(
                "the target is stored in the instruction (*), its numbers are not in the file", argument,
                hint="Store it under a name on the controller, and save the module again",
            )  # fmt: skip
        match = _OFFS.match(argument.text)
        if match is not None and argument.text.endswith(")"):
            parts = literals.arguments(code, argument.start + match.end(), argument.end - 1)
            if len(parts) == 4 and not any(part.options for part in parts):
                return self._displaced(parts, argument)
        node = self.memory.node(argument.text, argument.start)
        if isinstance(node, Name):
            reference = self.memory.reference(node)
            if reference is None:
                raise self._fault(
                    f"where {argument.text} is, is not known", argument,
                    limit="a robtarget declared in a module of the program",
                    hint="Put its module into the folder of the program, or name the modules in a .pgf",
                )  # fmt: skip
            return self._named(reference, argument)
        return self._computed(self.memory.value(node, argument.text, argument.start), argument)

    def _displaced(self, parts: list[literals.CallArgument], argument: literals.CallArgument) -> RapidTarget:
        """``Offs``: its numbers are changed themselves where they are numbers."""
        base = self.target(parts[0])
        shift = [self._number(part, "a displacement of Offs") for part in parts[1:]]
        x, y, z = (float(a + b) for a, b in zip(base.position_mm, shift, strict=True))
        plain = all(_NUMBER.fullmatch(part.text) for part in parts[1:]) and not base.offsets and not base.turned
        return replace(
            base, start=argument.start, end=argument.end, position_mm=(x, y, z), turned=not plain,
            offsets=tuple((part.start, part.end) for part in parts[1:]) if plain else (),
            offsets_mm=(shift[0], shift[1], shift[2]) if plain else (0.0, 0.0, 0.0), place=None,
        )  # fmt: skip

    def _named(self, reference: Reference, argument: literals.CallArgument) -> RapidTarget:
        argument_copy = reference.variable.copied if not reference.variable.assigned else None
        reference = argument_copy or reference
        variable = reference.variable
        declared = variable.declared
        if declared is None or declared.value < 0 or variable.assigned or variable.volatile is not None:
            return self._computed(self._value_of(reference), argument)
        literal = self._literal_of(declared.value, declared.end, reference.path)
        if literal is None:
            return self._computed(self._value_of(reference), argument)
        target = replace(self._written(literal, argument), name=variable.name)
        if argument_copy is not None:
            return replace(target, shared=True)
        key = (declared.value, reference.path)
        self._uses[key] = self._uses.get(key, 0) + 1
        self._spans.setdefault(declared.value, set()).add(argument.start)
        self._names[declared.value] = variable.name.upper()
        return replace(target, place=key)

    def _value_of(self, reference: Reference) -> object:
        variable = reference.variable
        return reference.value() if variable.volatile is None else variable.volatile

    def _literal_of(self, start: int, end: int, path: tuple[int, ...]) -> literals.RobtargetLiteral | None:
        """The literal of data, or of an element of an array."""
        code = self.source.code
        if not path:
            literal = literals.robtarget_literal(code, start)
            return literal if literal is not None and literal.end <= end else None
        if start not in self._arrays:
            self._arrays[start] = literals.aggregate(code, start, end)
        part: object = self._arrays[start]
        for index in path:
            part = (
                part.items[index] if isinstance(part, literals.AggregateLiteral) and index < len(part.items) else None
            )
        return literals.robtarget_literal(code, part.start) if isinstance(part, literals.AggregateLiteral) else None

    def shared(self, target: RapidTarget) -> bool:
        """Return whether other places of the program use the data of a target too."""
        place = target.place
        if place is None:
            return target.shared
        if self._uses[place] > 1:
            return True
        return self._mentioned[self._names[place[0]]] > len(self._spans[place[0]]) + 1

    @cached_property
    def _mentioned(self) -> dict[str, int]:
        """Return the number of mentions of each name in the code, without its size (Dim)."""
        return Counter(word.upper() for word in re.findall(r"[A-Za-z]\w*", _SIZE.sub(" ", self.source.code)))

    def _written(self, literal: literals.RobtargetLiteral, argument: literals.CallArgument) -> RapidTarget:
        x, y, z, *q = literal.values
        if not max(abs(x), abs(y), abs(z)) <= _LARGEST_MM or not abs(math.hypot(*q) - 1.0) <= _UNIT:
            self._refuse([x, y, z], q, argument)
        self.check_external(literal.rest[1], literal.start)
        return RapidTarget(
            argument.start, argument.end, "", (literal.start, literal.end), literal.numbers, (x, y, z),
            (q[0], q[1], q[2], q[3]), **_configuration(literals.numbers_of(literal.rest[0])),
        )  # fmt: skip

    def _computed(self, value: object, argument: literals.CallArgument) -> RapidTarget:
        """A target by its value."""
        place = self.source.place(argument.start)
        if isinstance(value, Unknown) or (isinstance(value, list) and first_unknown(value[:2]) is not None):
            known(value, "the target", place, text=argument.text, hint="Write the target itself")
        parts = value if isinstance(value, list) else []
        if [len(part) if isinstance(part, list) else 0 for part in parts] != [3, 4, 4, 6]:
            raise self._fault(
                "this is no robtarget", argument,
                limit="[[x,y,z],[q1,q2,q3,q4],[cf1,cf4,cf6,cfx],[e1,e2,e3,e4,e5,e6]]", hint="Write the target itself",
            )  # fmt: skip
        p, q, conf, external = parts
        if not all(map(is_number, [*p, *q])) or max(map(abs, p)) > _LARGEST_MM or abs(math.hypot(*q) - 1.0) > _UNIT:
            self._refuse(p, q, argument)
        self.check_external(external, argument.start)
        if not all(is_number(part) or isinstance(part, Unknown) for part in [*conf, *external]):
            raise self._fault("this is no robtarget", argument, limit="numbers", hint="Write the target itself")
        rest = "" if first_unknown(conf) else f"{_text(conf)},{_text(external)}"
        return RapidTarget(
            argument.start, argument.end, "", (0, 0), (), (float(p[0]), float(p[1]), float(p[2])),
            (float(q[0]), float(q[1]), float(q[2]), float(q[3])), turned=True, rest=rest,
            **_configuration(conf),
        )  # fmt: skip

    def _refuse(self, p: list[float], q: list[float], argument: literals.CallArgument) -> None:
        if not all(map(is_number, [*p, *q])):
            raise self._fault("a robtarget has seven numbers and two groups", argument, hint="Write the numbers")
        if not max(map(abs, p)) <= _LARGEST_MM:
            raise self._fault(
                "the target is out of reach of every robot", argument, limit=f"{_LARGEST_MM:g} mm",
                hint="Write it in mm",
            )  # fmt: skip
        raise ProgramError(
            "the orientation of the target is no rotation", where=self.source.place(argument.start),
            value=f"[{','.join(f'{part:g}' for part in q)}] of length {math.hypot(*q):.4f}",
            limit=f"length 1 within {_UNIT:g}", hint="Write q1 to q4 with more decimals, or use NOrient",
        )  # fmt: skip

    def check_external(self, item: object, at: int) -> None:
        """Refuse external axes that move, or stand elsewhere than the cell says."""
        if isinstance(item, str):
            if item == self._checked:
                return
            numbers = literals.numbers_of(item)
            self._checked = item if numbers is not None else ""
            item = numbers or self.memory.evaluated(item, at)
        place = self.source.place(at)
        values = known(item, "the place of the external axes", place, hint="Write their values")
        for index, value in self.external_of(values).items():
            self.external.check(index, value, f"{index}", place)

    @staticmethod
    def external_of(values: object) -> dict[int, float]:
        """Values of external axes by number; those that a target leaves out (9E9) are not in it."""
        numbers = enumerate(values if isinstance(values, list) else [], start=1)
        return {index: float(value) for index, value in numbers if is_number(value) and abs(value) < _NONE_FROM}

    # ---- speeds and zones ------------------------------------------------------------------------------------

    def _forget_old(self) -> None:
        if self._stamp != self.memory.stamp or len(self._speeds) > _KEPT:
            self._stamp = self.memory.stamp
            self._speeds, self._zones = {}, {}

    def speed(self, argument: literals.CallArgument) -> Speed:
        """Return the speed of an argument with its options V and T.

        Raises:
            ProgramError: It is not known, or out of range.
        """
        for option, (text, start, end) in argument.options.items():
            if option not in ("V", "T"):
                continue
            value = known(
                self.memory.evaluated(text, start), "the speed", self.source.place(start), text=argument.text
            )  # fmt: skip
            if not is_number(value) or not value > 0.0:  # type: ignore[operator]
                raise self._fault("the speed is out of range", argument, limit="above 0", hint="Write it in mm/s")
            if option == "T":
                back = self.source.code.rfind("\\", argument.end, start)
                return Speed(math.nan, None, (back, end), float(value))  # type: ignore[arg-type]
            of_data = self.memory.evaluated(argument.text, argument.start)
            return Speed(self._in_range(float(value), argument), (start, end), turning_rad_s=_turning(of_data))  # type: ignore[arg-type]
        self._forget_old()
        key = (argument.text, self.memory.frames[-1].serial)
        speed = self._speeds.get(key)
        if speed is None:
            value = self.memory.evaluated(argument.text, argument.start)
            first = value[0] if isinstance(value, list) and len(value) == 4 else value
            hint = "Write the speed itself, v100 or [100,500,5000,1000]: the force depends on it"
            first = known(first, "the speed", self.source.place(argument.start), text=argument.text, hint=hint)
            if not is_number(first):
                raise self._fault("this is no speeddata", argument, limit="[v_tcp,v_ori,v_leax,v_reax]", hint=hint)
            speed = self._speeds[key] = Speed(self._in_range(float(first), argument), turning_rad_s=_turning(value))
        return speed

    def _in_range(self, value: float, argument: literals.CallArgument) -> float:
        if not 0.0 < value <= _LARGEST_MM_S:
            raise self._fault(
                "the speed is out of range", argument, limit=f"above 0, at most {_LARGEST_MM_S:g} mm/s",
                hint="Write it in mm/s",
            )  # fmt: skip
        return value * MM_PER_S

    def zone(self, argument: literals.CallArgument) -> Zone:
        """Return the zone of an argument. Raises ProgramError: it is not known."""
        if "Z" in argument.options:
            text, start, _ = argument.options["Z"]
            distance = known(
                self.memory.evaluated(text, start), "the zone", self.source.place(start), text=argument.text
            )  # fmt: skip
            exact = self._plain_zone(argument).exact
            return Zone(exact, 0.0 if exact or not is_number(distance) else float(distance) * MM)  # type: ignore[arg-type]
        return self._plain_zone(argument)

    def _plain_zone(self, argument: literals.CallArgument) -> Zone:
        self._forget_old()
        zone = self._zones.get(argument.text)
        if zone is None:
            value = self.memory.evaluated(argument.text, argument.start)
            value = known(
                value, "the zone", self.source.place(argument.start), text=argument.text,
                hint="Write fine, z0 to z200, or declare the zonedata in the module",
            )  # fmt: skip
            if not isinstance(value, list) or len(value) != 7 or not isinstance(value[0], bool):
                raise self._fault(
                    "this is no zonedata", argument, limit="fine, z0 to z200, or [FALSE,1,1,1,0.1,1,0.1]",
                    hint="Write the zone itself",
                )  # fmt: skip
            zone = Zone(value[0], 0.0 if value[0] else float(value[1]) * MM)
            if len(self.memory.frames) == 1 or not self.memory.frames[-1].names:
                self._zones[argument.text] = zone
        return zone

    # ---- numbers, faults -------------------------------------------------------------------------------------

    def _number(self, argument: literals.CallArgument, what: str) -> float:
        place = self.source.place(argument.start)
        value = known(self.memory.evaluated(argument.text, argument.start), what, place, text=argument.text)
        if not is_number(value) or not abs(value) <= _LARGEST_MM:  # type: ignore[arg-type]
            raise self._fault(f"{what} is no number", argument, limit=f"{_LARGEST_MM:g} mm", hint="Write the number")
        return float(value)  # type: ignore[arg-type]

    def _fault(self, what: str, argument: literals.CallArgument, **more: str) -> ProgramError:
        return ProgramError(
            what, where=self.source.place(argument.start), value=" ".join(argument.text.split())[:60], **more
        )


def _turning(speeddata: Value) -> float:
    """v_ori, rad/s; infinite where it is not known."""
    speed = speeddata[1] if isinstance(speeddata, list) and len(speeddata) == 4 else None
    return float(speed) * DEG if is_number(speed) and speed > 0.0 else math.inf  # type: ignore[arg-type, operator]


def _configuration(configuration: list[object] | None) -> dict[str, Any]:
    """Posture and quarters of the axes of a confdata, as :class:`RapidTarget` has them; None where not known."""
    numbers = configuration if configuration is not None and len(configuration) == 4 else [None] * 4
    cf1, cf4, cf6, cfx = (round(one) if isinstance(one, int | float) else None for one in numbers)
    known = None if cf1 is None or cf4 is None or cf6 is None else (cf1, cf4, cf6)
    return {"cfx": cfx, "quarters": known}


def _text(values: list[object]) -> str:
    """Numbers as they are written in a target."""
    texts = ["9E9" if is_number(v) and abs(v) >= _NONE_FROM else f"{float(v):.9g}" for v in values]  # type: ignore[arg-type]
    return f"[{','.join(texts)}]"

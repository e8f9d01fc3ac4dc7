"""Arguments of a motion of RAPID: targets by literal, name, Offs or RelTool; speeds; zones; external axes."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import DEG, MM_PER_S
from counterflex.geometry import rotation
from counterflex.programs.rapid.program import RapidTarget
from counterflex.programs.rapid.read import data as of
from counterflex.programs.rapid.read.data import Data
from counterflex.programs.rapid.read.frames import RapidCell
from counterflex.programs.rapid.read.literals import Aggregate, Argument, aggregate, arguments
from counterflex.programs.robot_text.cell import ExternalAxes

_FUNCTION: Final = re.compile(r"(Offs|RelTool)\s*\(", re.IGNORECASE)
_NAME: Final = re.compile(r"([A-Za-z]\w*)(\s*\{[^}]*\})?")
_NONE_FROM: Final = 8e8
"""External axes that are not there are 9E9."""
_LARGEST_MM_S: Final = 20_000.0


@dataclass(frozen=True, slots=True)
class Speed:
    """Speed of an instruction.

    Attributes:
        m_s: Of the tool tip.
        value: Where the number of the option V stands; None where there is none.
    """

    m_s: float
    value: tuple[int, int] | None


class Targets:
    """Reads the arguments of motions.

    Args:
        data: What the module declares.
        cell: See :class:`RapidCell`.

    Attributes:
        assigned: Names that the program assigns something to, in capitals.
        routine: Index of the routine that is executed, for names that it declares itself.
    """

    def __init__(self, data: Data, cell: RapidCell | None) -> None:
        self.data, self.source = data, data.source
        self.assigned: set[str] = set()
        self.routine = 0
        self._external = ExternalAxes(cell)
        self._mentioned: dict[str, int] | None = None

    # ---- targets ---------------------------------------------------------------------------------------------

    def target(self, argument: Argument) -> RapidTarget:
        """The robtarget of an argument.

        Raises:
            ProgramError: It is computed, or not known.
        """
        match = _FUNCTION.match(argument.text)
        if match is None:
            return self._plain(argument)
        word, at = match[1].upper(), argument.start + match.end()
        if not argument.text.endswith(")"):
            raise self._computed(argument.text, argument.start)
        parts = arguments(self.source.code, at, argument.end - 1)
        if len(parts) != 4:
            raise self._fault(f"{match[1]} has a target and three numbers", argument, limit=f"{match[1]}(p10,0,0,50)")
        base = self.target(parts[0])
        if base.offsets or base.turned:
            raise self._fault(
                "Offs and RelTool within each other are not read", argument, hint="Write the target itself"
            )
        shift = [self._number(part, f"a displacement of {match[1]}") for part in parts[1:]]
        if word == "OFFS":
            if any(part.options for part in parts):
                raise self._fault("Offs has no options", argument, limit="Offs(p10,0,0,50)")
            x, y, z = (float(a + b) for a, b in zip(base.position_mm, shift, strict=True))
            return replace(
                base, start=argument.start, end=argument.end, position_mm=(x, y, z),
                offsets=tuple((part.start, part.end) for part in parts[1:]), offsets_mm=(shift[0], shift[1], shift[2]),
            )  # fmt: skip
        R = of.rotation_of(base.quat_wxyz)
        x, y, z = (float(value) for value in np.array(base.position_mm) + R @ np.array(shift))
        q1, q2, q3, q4 = (float(value) for value in rotation.quat_wxyz(R @ self._turn(parts, argument)))
        return replace(
            base,
            start=argument.start,
            end=argument.end,
            position_mm=(x, y, z),
            quat_wxyz=(q1, q2, q3, q4),
            turned=True,
        )

    def _turn(self, parts: list[Argument], argument: Argument) -> Float:
        """(3, 3) of the options Rx, Ry, Rz: about x, then the new y, then the new z."""
        options = {key: place for part in parts for key, place in part.options.items()}
        unknown = sorted(options.keys() - {"RX", "RY", "RZ"})
        if unknown:
            raise self._fault(f"\\{unknown[0]} is no option of RelTool", argument, limit="\\Rx \\Ry \\Rz")
        R = np.eye(3)
        for key, about in (("RX", rotation.about_x), ("RY", rotation.about_y), ("RZ", rotation.about_z)):
            if key in options:
                text, start, _ = options[key]
                value = self._value(text)
                if value is None:
                    raise self._computed(text, start)
                R = R @ about(value * DEG)
        return R

    def _plain(self, argument: Argument) -> RapidTarget:
        text = argument.text
        if text.startswith("["):
            parts = aggregate(self.source.code, argument.start, argument.end)
            if parts is None or parts.end != argument.end:
                raise self._computed(text, argument.start)
            return self._robtarget(parts, argument, "")
        match = _NAME.fullmatch(text)
        if match is None:
            if text == "*":
                raise self._fault(
                    "the target is stored in the instruction (*), its numbers are not in the file", argument,
                    hint="Store it under a name on the controller, and save the module again",
                )  # fmt: skip
            raise self._computed(text, argument.start)
        if match[1].upper() in self.assigned:
            raise self._fault(
                f"{match[1]} is computed by the program: such targets are not read", argument,
                hint="Write the target itself",
            )  # fmt: skip
        literal = self.data.literal(text, "robtarget", self.routine)
        if literal is None:
            raise self._fault(
                f"where {text} is, is not known", argument,
                limit="a robtarget declared in the module with its numbers",
                hint="Give the module with the declarations, program and targets in one file",
            )  # fmt: skip
        return self._robtarget(literal[0], argument, literal[1].name)

    def _robtarget(self, parts: Aggregate, argument: Argument, name: str) -> RapidTarget:
        items = parts.items
        p = of.position(items[0]) if len(items) == 4 else None
        q = of.quaternion(items[1]) if len(items) == 4 else None
        first, second = items[0] if items else None, items[1] if len(items) > 1 else None
        counted = len(items) == 4 and all(
            isinstance(item, Aggregate) and item.numbers((count,)) is not None
            for item, count in zip(items[2:], (4, 6), strict=True)
        )
        known = isinstance(first, Aggregate) and isinstance(second, Aggregate)
        if p is None or q is None or not counted or not known:
            raise ProgramError(
                "no robtarget that is read: numbers within reach, a quaternion of length 1",
                where=self.source.place(parts.start), value=self.source.text[parts.start : parts.end][:60],
                limit="[[x,y,z],[q1,q2,q3,q4],[cf1,cf4,cf6,cfx],[e1,e2,e3,e4,e5,e6]]",
                hint="Write the numbers themselves",
            )  # fmt: skip
        self._check_external(items[3])
        pair = (item for item in (first, second) if isinstance(item, Aggregate))
        numbers = [number for item in pair for number in item.numbers() or ()]
        return RapidTarget(
            argument.start, argument.end, name, (parts.start, parts.end),
            tuple((number.start, number.end) for number in numbers), p, q,
            shared=bool(name) and self._shared(argument.text),
        )  # fmt: skip

    def _shared(self, text: str) -> bool:
        """Whether a name, or an element of an array, stands elsewhere in the code too."""
        if self._mentioned is None:
            counts: dict[str, int] = {}
            for word in re.findall(r"[A-Za-z]\w*(?:\s*\{\s*\d+\s*\})?", self.source.code):
                key = "".join(word.split()).upper()
                counts[key] = counts.get(key, 0) + 1
            self._mentioned = counts
        key = "".join(text.split()).upper()
        if "{" in key:
            return self._mentioned.get(key, 0) > 1 or self._mentioned.get(key.split("{")[0], 0) > 0
        return self._mentioned.get(key, 0) > 2  # its declaration, and here

    def _check_external(self, item: object) -> None:
        """Refuse external axes that move, or stand elsewhere than the cell says."""
        numbers = item.numbers() if isinstance(item, Aggregate) else None
        for index, number in enumerate(numbers or (), start=1):
            if abs(number.value) >= _NONE_FROM:
                continue
            self._external.check(index, number.value, f"{index}", self.source.place(number.start))

    # ---- speeds and zones ------------------------------------------------------------------------------------

    def speed(self, argument: Argument) -> Speed:
        """Speed of an argument and its the option V.

        Raises:
            ProgramError: It is not known, or out of range.
        """
        for key, (text, start, end) in argument.options.items():
            if key != "V":
                raise self._fault(
                    f"\\{key} is not read: the speed decides about the force", argument, limit="v25, or v25\\V:=24.5",
                    hint="Write the speed itself",
                )  # fmt: skip
            value = self._value(text)
            if value is None:
                raise self._computed(text, start)
            return Speed(self._in_range(value, argument), (start, end))
        text = argument.text
        if text.startswith("["):
            parts = aggregate(self.source.code, argument.start, argument.end)
            numbers = None if parts is None else parts.numbers((4,))
        elif text.upper() in self.assigned:
            numbers = None
        elif text.upper() in of.SPEEDS and self.data.find(text, self.routine) is None:
            return Speed(of.SPEEDS[text.upper()] * MM_PER_S, None)
        else:
            literal = self.data.literal(text, "speeddata", self.routine)
            numbers = None if literal is None else literal[0].numbers((4,))
        if numbers is None:
            raise self._fault(
                f"which speed {text} is, is not known", argument,
                limit="v5 to v7000, a speeddata declared in the module with its numbers, or [v,500,5000,1000]",
                hint="Write the speed itself",
            )  # fmt: skip
        return Speed(self._in_range(numbers[0].value, argument), None)

    def _in_range(self, value: float, argument: Argument) -> float:
        if not 0.0 < value <= _LARGEST_MM_S:
            raise self._fault(
                "the speed is out of range", argument, limit=f"above 0, at most {_LARGEST_MM_S:g} mm/s",
                hint="Write it in mm/s",
            )  # fmt: skip
        return value * MM_PER_S

    def exact(self, argument: Argument) -> bool:
        """Whether a zone is ``fine``.

        Raises:
            ProgramError: It is not known.
        """
        text = argument.text
        name = text.upper()
        if name in of.ZONES and self.data.find(text, self.routine) is None:
            return name == "FINE"
        parts = aggregate(self.source.code, argument.start, argument.end) if text.startswith("[") else None
        if parts is None and name not in self.assigned:
            literal = self.data.literal(text, "zonedata", self.routine)
            parts = None if literal is None else literal[0]
        first = of.truth(parts.items[0]) if parts is not None and len(parts.items) == 7 else None
        if first is None:
            raise self._fault(
                f"which zone {text} is, is not known", argument,
                limit="fine, z0 to z200, or a zonedata declared in the module with its numbers",
            )  # fmt: skip
        return first

    # ---- numbers, faults -------------------------------------------------------------------------------------

    def _value(self, text: str) -> float | None:
        return None if text.strip().upper() in self.assigned else self.data.number(text, self.routine)

    def _number(self, argument: Argument, what: str) -> float:
        value = self._value(argument.text)
        if value is None or not abs(value) <= 1e5:
            raise self._fault(
                f"{what} is no number that is known", argument, limit="a number, or a declared num that stays",
                hint="Write the number itself",
            )  # fmt: skip
        return value

    def _computed(self, text: str, start: int) -> ProgramError:
        return ProgramError(
            "computed targets are not read", where=self.source.place(start), value=" ".join(text.split())[:60],
            limit="a robtarget by its numbers or by name, Offs, RelTool", hint="Write the numbers themselves",
        )  # fmt: skip

    def _fault(self, what: str, argument: Argument, **more: str) -> ProgramError:
        return ProgramError(
            what, where=self.source.place(argument.start), value=" ".join(argument.text.split())[:60], **more
        )

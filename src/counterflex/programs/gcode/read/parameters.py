"""Parameters ``#1`` ... ``#5602`` and ``#<name>``: scopes of subroutines, and those the interpreter itself answers.

Those of the machine (probe, inputs, stored positions, zeros of offsets, tool lengths) are not known where nobody gave
them. Reading one raises :class:`UnknownValue`; an assignment stores it, everything else refuses it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final

from counterflex.core.errors import InputError, ProgramError
from counterflex.core.units import INCH, MM
from counterflex.programs.gcode.read.codes import AXES
from counterflex.programs.gcode.read.state import ModalState
from counterflex.programs.gcode.read.work_offsets import LINUXCNC_OFFSETS, Six
from counterflex.programs.unknown import Unknown

LAST: Final = 5602
ARGUMENTS: Final = 30
# First parameter of each stored position; the axes X Y Z A B C follow it.
HOME_POSITION: Final = {280: 5161, 300: 5181}
_G92: Final = 5211
_G54: Final = 5221
_TOOL_LENGTH: Final = 5401
_CURRENT: Final = 5420
# From here on the machine answers; programs may not write.
_SYSTEM: Final = 5061
_LOCAL: Final = 33  # Last parameter that belongs to a macro; the control keeps the values of the others
_ALARM: Final = 3000
_FANUC_OFFSETS: Final = range(2001, 3000)
"""Tool offsets (#2001 to #2499) and work offsets (#2500 to #2999): an assignment shifts what follows."""
_INPUT: Final = 5399  # Result of M66
_OF_THE_MACHINE: Final = (
    (range(1000, 1200), "an input or output of the control"),
    (range(2000, 2500), "the tool table has it"),
    (range(3000, 3100), "clock, alarms and messages of the control"),
    (range(4000, 4400), "the control's own modal state"),
    (range(5001, 5061), "a position that the control reports"),
    (range(5061, 5071), "the probe found it"),
    (range(5161, 5210), "the machine stores it for G28 and G30"),
    (range(5211, 5220), "an earlier program may have left it (G92)"),
    (range(5221, 5400), "where the offset lies in the machine"),
    (range(5401, 5420), "the tool table has it"),
    (range(5420, 5430), "where the tool stands"),
)
"""Parameters that nothing in a program determines, and what does."""


class UnknownValue(Exception):
    """An expression reads a value that the program does not determine."""

    def __init__(self, value: Unknown) -> None:
        super().__init__(str(value))
        self.value = value


class GcodeParameters:
    """The values of parameters, seen from the line being executed.

    Args:
        given: Parameters known before the program starts, ``{"5161": 0.0, "_speed": 3.0}`` or by number. Stored home
            positions (5161-5166, 5181-5186) are in mm and degrees of the machine.
        state: Read for positions, offsets and modes.
        fault: Makes an error on the line being executed from what, column, value and hint.

    Raises:
        InputError: A given parameter has no valid name or value.
    """

    def __init__(
        self,
        given: Mapping[str | int, float] | None,
        state: ModalState,
        fault: Callable[[str, int, object, str | None], ProgramError],
    ) -> None:
        self._state = state
        self._fault = fault
        self._values: dict[int, float | Unknown] = {}
        self._globals: dict[str, float | Unknown] = {}
        self._scopes: list[tuple[dict[str, float | Unknown], dict[int, float | Unknown]]] = [({}, {})]
        for key, value in (given or {}).items():
            name = str(key).strip().lower().lstrip("#").strip("<>")
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
                raise InputError(f"parameter {key} has no finite value", value=value)
            if name.isdigit() and 1 <= int(name) <= LAST:
                self._values[int(name)] = float(value)
            elif name.startswith("_") and name.isprintable():
                self._globals[name] = float(value)
            else:
                raise InputError("no name of a parameter", value=key, limit=f"1 to {LAST} or a name that starts with _")
        self.line = 0

    def fault(self, what: str, column: int, value: object = None, hint: str | None = None) -> ProgramError:
        """Make an error on the line being executed."""
        return self._fault(what, column, value, hint)

    @property
    def of_fanuc(self) -> bool:
        """Return whether the program was written for Fanuc or Haas."""
        return self._state.of_fanuc

    # Scopes ---------------------------------------------------------------------------------------------------------

    def enter(self, arguments: list[float | Unknown | None]) -> None:
        """Open a subroutine's scope: ``#1`` ... ``#30`` are the arguments; one that is None has no value."""
        selected = {index: self._values[index] for index in range(1, ARGUMENTS + 1) if index in self._values}
        self._scopes.append(({}, selected))
        for index in range(1, ARGUMENTS + 1):
            value = arguments[index - 1] if index <= len(arguments) else 0.0
            if value is None:
                self._values.pop(index, None)
            else:
                self._values[index] = value

    def leave(self) -> None:
        """Close it; the caller's ``#1`` ... ``#30`` come back."""
        _, saved = self._scopes.pop()
        for index in range(1, ARGUMENTS + 1):
            self._values.pop(index, None)
        self._values.update(saved)

    def returned(self, value: float | Unknown | None) -> None:
        """Store what a subroutine returned in ``#<_value>`` and whether it did in ``#<_value_returned>``."""
        self._globals["_value"] = 0.0 if value is None else value
        self._globals["_value_returned"] = 0.0 if value is None else 1.0

    # Reading --------------------------------------------------------------------------------------------------------

    def _index(self, index: float, column: int) -> int:
        number = round(index)
        if abs(index - number) > 1e-4:
            raise self.fault("a parameter's number is not whole", column, f"#{index:g}")
        if not 1 <= number <= LAST:
            raise self.fault("no such parameter", column, f"#{number}", f"Parameters run from #1 to #{LAST}")
        return number

    def numbered(self, index: float, column: int) -> float:
        """Value of ``#index``.

        Raises:
            ProgramError: No such parameter, or nothing ever gave it a value.
            UnknownValue: The program does not determine its value.
        """
        number = self._index(index, column)
        value = self._values[number] if number in self._values else self._system(number)
        if isinstance(value, Unknown):
            raise UnknownValue(value)
        if value is None:
            for numbers, why in _OF_THE_MACHINE:
                if number in numbers:
                    raise UnknownValue(Unknown(f"{why} (#{number})", self.here()))
            raise self.fault(
                "the parameter has never been given a value", column, f"#{number}",
                "Set it in the program, or hand it over with the program's parameters",
            )  # fmt: skip
        return value

    def vacant(self, index: float, column: int) -> bool:
        """Return whether ``#index`` has no value; of the parameters that the control keeps that is not known."""
        number = self._index(index, column)
        if number not in self._values and number > _LOCAL:
            raise UnknownValue(Unknown(f"the control keeps it (#{number})", self.here()))
        return number not in self._values

    def stored_position(self, code: int, axis: int) -> float | None:
        """Stored position of G28 or G30 along an axis in mm or degrees; None where nobody gave one."""
        value = self._values.get(HOME_POSITION[code] + axis)
        return None if isinstance(value, Unknown) else value

    def store_position(self, code: int, machine: Six) -> None:
        """Store the machine position for G28 or G30 (G28.1, G30.1), as far as it is known."""
        for axis in range(6):
            number = HOME_POSITION[code] + axis
            if axis in self._state.unknown:
                self._values.pop(number, None)
            else:
                self._values[number] = machine[axis] / MM if axis < 3 else machine[axis]

    def forget_input(self) -> None:
        """Make the result of M66 unknown: an input signal decides about it."""
        self._values[_INPUT] = Unknown("an input signal decides about it (M66)", self.here())

    def here(self) -> str:
        """Return ``file:line`` of the line being executed."""
        return str(self._fault("", 0, None, None).where).rpartition(":")[0]

    def _system(self, number: int) -> float | None:
        state = self._state
        axis = number - _CURRENT
        if 0 <= axis < 6:
            return None if axis in state.unknown else self._shown(state.to_work(state.position), axis)
        if number == 5400:
            return float(state.tool)
        if _TOOL_LENGTH <= number < _TOOL_LENGTH + 6:
            return self._shown(state.tool_length, number - _TOOL_LENGTH) if state.lengths_known else None
        if number == 5220 and state.work_offset in LINUXCNC_OFFSETS:
            return float(LINUXCNC_OFFSETS.index(state.work_offset) + 1)
        if _G92 <= number < _G92 + 6:
            return self._stored(state.g92_saved[number - _G92], number - _G92) if state.g92_known else None
        offset, axis = divmod(number - _G54, 20)
        if 0 <= offset < 9 and axis < 6:
            zero = state.work_offsets.in_machine(LINUXCNC_OFFSETS[offset], axis)
            return None if zero is None else self._stored(zero, axis)
        return None

    def _shown(self, point: Six, axis: int) -> float:
        return point[axis] / self._state.unit_m if axis < 3 else point[axis]

    @staticmethod
    def _stored(value: float, axis: int) -> float:
        return value / MM if axis < 3 else value

    def named(self, name: str, column: int) -> float:
        """Value of ``#<name>``.

        Raises:
            ProgramError: It has none.
            UnknownValue: The program does not determine it.
        """
        value = self._named(name)
        if isinstance(value, Unknown):
            raise UnknownValue(value)
        if value is None:
            raise self.fault("the parameter has never been given a value", column, f"#<{name}>")
        return value

    def exists(self, name: str) -> bool:
        """Return whether ``#<name>`` has a value."""
        return self._named(name) is not None

    def _named(self, name: str) -> float | Unknown | None:
        if not name.startswith("_"):
            return self._scopes[-1][0].get(name)
        if name in self._globals:
            return self._globals[name]
        axis = AXES.find(name[1:].upper()) if len(name) == 2 else -1
        if axis in self._state.unknown:
            return Unknown(f"where the tool stands (#<{name}>)", self.here())
        answer = self._answers().get(name)
        return None if answer is None else float(answer())

    def _answers(self) -> dict[str, Callable[[], float]]:
        state = self._state
        answers: dict[str, Callable[[], float]] = {
            "_line": lambda: self.line,
            "_call_level": lambda: len(self._scopes) - 1,
            "_motion_mode": lambda: state.motion,
            "_plane": lambda: state.plane * 10,
            "_coord_system": self._coordinate_system,
            "_metric": lambda: state.unit_m == MM,
            "_imperial": lambda: state.unit_m == INCH,
            "_absolute": lambda: state.absolute,
            "_incremental": lambda: not state.absolute,
            "_inverse_time": lambda: state.feed_mode == 93,
            "_units_per_minute": lambda: state.feed_mode == 94,
            "_units_per_rev": lambda: state.feed_mode == 95,
            "_feed": lambda: state.feed or 0.0,
            "_rpm": lambda: state.speed_rpm,
            "_spindle_on": lambda: state.spindle != 0,
            "_spindle_cw": lambda: state.spindle > 0,
            "_current_tool": lambda: state.tool,
            "_selected_tool": lambda: -1 if state.prepared is None else state.prepared,
        }  # fmt: skip
        for axis, letter in enumerate(AXES):
            answers[f"_{letter.lower()}"] = lambda axis=axis: self._shown(  # type: ignore[misc]
                state.to_work(state.position), axis
            )
        return answers

    def _coordinate_system(self) -> float:
        name = self._state.work_offset
        if name not in LINUXCNC_OFFSETS:
            raise UnknownValue(Unknown(f"LinuxCNC has no number for {name}", self.here()))
        index = LINUXCNC_OFFSETS.index(name)
        return 540.0 + 10.0 * min(index, 5) + max(0, index - 5)

    # Writing --------------------------------------------------------------------------------------------------------

    def set_numbered(self, index: float, value: float | Unknown, column: int) -> None:
        """Give ``#index`` a value. Raises ProgramError: no such parameter, or one that belongs to the machine."""
        number = self._index(index, column)
        if number >= _SYSTEM:
            raise self.fault(
                "the parameter belongs to the machine", column, f"#{number}", "Set offsets with G10, G52 or G92"
            )
        if number == _ALARM:
            raise self.fault(
                "the program stops here with an alarm (#3000)", column, f"#{number}", "Look at the condition before it"
            )
        if number in _FANUC_OFFSETS:
            raise self.fault(
                "the parameter is a tool or work offset of Fanuc and Haas", column, f"#{number}",
                "Set offsets with G10 L2, G52 or G92; take another number for a value (#100 to #199, #500 to #999)",
            )  # fmt: skip
        self._values[number] = value

    def set_named(self, name: str, value: float | Unknown, column: int) -> None:
        """Give ``#<name>`` a value. Raises ProgramError: the interpreter itself answers for that name."""
        if not name.startswith("_"):
            self._scopes[-1][0][name] = value
            return
        if name in self._answers() or name in ("_value", "_value_returned"):
            raise self.fault("the parameter belongs to the interpreter", column, f"#<{name}>")
        self._globals[name] = value

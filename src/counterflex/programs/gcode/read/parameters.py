"""Parameters ``#1`` ... ``#5602`` and ``#<name>``: scopes of subroutines, and those the interpreter itself answers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final

from counterflex.core.errors import InputError, ProgramError
from counterflex.core.units import INCH, MM
from counterflex.programs.gcode.read.codes import AXES
from counterflex.programs.gcode.read.state import WORK_OFFSETS, Six, State, minus

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


class Parameters:
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
        state: State,
        fault: Callable[[str, int, object, str | None], ProgramError],
    ) -> None:
        self._state = state
        self._fault = fault
        self._values: dict[int, float] = {}
        self._globals: dict[str, float] = {}
        self._scopes: list[tuple[dict[str, float], dict[int, float]]] = [({}, {})]
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

    # Scopes ---------------------------------------------------------------------------------------------------------

    def enter(self, arguments: list[float]) -> None:
        """Open a subroutine's scope: ``#1`` ... ``#30`` are the arguments, 0 where none is given."""
        selected = {index: self._values[index] for index in range(1, ARGUMENTS + 1) if index in self._values}
        self._scopes.append(({}, selected))
        for index in range(1, ARGUMENTS + 1):
            self._values[index] = arguments[index - 1] if index <= len(arguments) else 0.0

    def leave(self) -> None:
        """Close it; the caller's ``#1`` ... ``#30`` come back."""
        _, saved = self._scopes.pop()
        for index in range(1, ARGUMENTS + 1):
            self._values.pop(index, None)
        self._values.update(saved)

    def returned(self, value: float | None) -> None:
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
        """
        number = self._index(index, column)
        if number in self._values:
            return self._values[number]
        value = self._system(number)
        if value is None:
            raise self.fault(
                "the parameter has never been given a value", column, f"#{number}",
                "Set it in the program, or hand it over with the program's parameters",
            )  # fmt: skip
        return value

    def stored_position(self, code: int, axis: int) -> float | None:
        """Stored position of G28 or G30 along an axis in mm or degrees; None where nobody gave one."""
        return self._values.get(HOME_POSITION[code] + axis)

    def store_position(self, code: int, machine: Six) -> None:
        """Store the machine position for G28 or G30 (G28.1, G30.1)."""
        for axis in range(6):
            self._values[HOME_POSITION[code] + axis] = machine[axis] / MM if axis < 3 else machine[axis]

    def _system(self, number: int) -> float | None:
        state = self._state
        if _CURRENT <= number < _CURRENT + 6:
            return self._shown(minus(state.position, state.origin), number - _CURRENT)
        if number == 5400:
            return float(state.tool)
        if _TOOL_LENGTH <= number < _TOOL_LENGTH + 6:
            return self._shown(state.tool_length, number - _TOOL_LENGTH)
        if number == 5220:
            return float(WORK_OFFSETS.index(state.work_offset) + 1)
        if _G92 <= number < _G92 + 6:
            return self._stored(state.g92_saved, number - _G92)
        offset, axis = divmod(number - _G54, 20)
        if 0 <= offset < 9 and axis < 6:
            return self._stored(state.work_offsets[WORK_OFFSETS[offset]], axis)
        return None

    def _shown(self, point: Six, axis: int) -> float:
        return point[axis] / self._state.unit_m if axis < 3 else point[axis]

    @staticmethod
    def _stored(point: Six, axis: int) -> float:
        return point[axis] / MM if axis < 3 else point[axis]

    def named(self, name: str, column: int) -> float:
        """Value of ``#<name>``.

        Raises:
            ProgramError: It has none.
        """
        value = self._named(name)
        if value is None:
            raise self.fault("the parameter has never been given a value", column, f"#<{name}>")
        return value

    def exists(self, name: str) -> bool:
        """Whether ``#<name>`` has a value."""
        return self._named(name) is not None

    def _named(self, name: str) -> float | None:
        if not name.startswith("_"):
            return self._scopes[-1][0].get(name)
        if name in self._globals:
            return self._globals[name]
        answer = self._answers().get(name)
        return None if answer is None else float(answer())

    def _answers(self) -> dict[str, Callable[[], float]]:
        state = self._state
        answers: dict[str, Callable[[], float]] = {
            "_line": lambda: self.line,
            "_call_level": lambda: len(self._scopes) - 1,
            "_motion_mode": lambda: state.motion,
            "_plane": lambda: state.plane * 10,
            "_coord_system": lambda: 540 + 10 * min(WORK_OFFSETS.index(state.work_offset), 5)
            + max(0, WORK_OFFSETS.index(state.work_offset) - 5),
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
                minus(state.position, state.origin), axis
            )
        return answers

    # Writing --------------------------------------------------------------------------------------------------------

    def set_numbered(self, index: float, value: float, column: int) -> None:
        """Give ``#index`` a value.

        Raises:
            ProgramError: No such parameter, or one that belongs to the machine.
        """
        number = self._index(index, column)
        if number >= _SYSTEM:
            raise self.fault(
                "the parameter belongs to the machine", column, f"#{number}", "Set offsets with G10, G52 or G92"
            )
        self._values[number] = value

    def set_named(self, name: str, value: float, column: int) -> None:
        """Give ``#<name>`` a value.

        Raises:
            ProgramError: The interpreter itself answers for that name.
        """
        if not name.startswith("_"):
            self._scopes[-1][0][name] = value
            return
        if name in self._answers() or name in ("_value", "_value_returned"):
            raise self.fault("the parameter belongs to the interpreter", column, f"#<{name}>")
        self._globals[name] = value

"""Variables of a KRL program while it runs: data lists, locals, parameters, and what the controller holds."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.geometry import pose
from counterflex.integrations.kuka.language.program import LETTERS
from counterflex.integrations.kuka.language.read import job as variables, values
from counterflex.integrations.kuka.language.read.frames import KrlCell
from counterflex.integrations.kuka.language.read.job import KrlJob
from counterflex.integrations.kuka.language.read.literals import DataList, Named, simple_record
from counterflex.programs.expression import ExpressionError, Node, evaluate
from counterflex.programs.unknown import Unknown, first_unknown

STORED: Final = ("BASE_DATA", "TOOL_DATA")
_RECORDS: Final = ("$VEL", "$ACC", "$APO", "$JERK")
_OF_FORMS: Final = {
    "STOOL": ("TOOL_NO", "TOOL_DATA"), "STOOL2": ("TOOL_NO", "TOOL_DATA"), "SBASE": ("BASE_NO", "BASE_DATA"),
    "SBASE2": ("BASE_NO", "BASE_DATA"), "SIPO_MODE": ("IPO_FRAME", None), "SORI_TYP": ("ORI_TYP", None),
}  # fmt: skip
"""Component of the frame or motion data that a function takes, and the frame with its number."""


class KrlMemory:
    """Names and values, as far as the text of the job determines them.

    Args:
        cell: What the stored frames of the controller are, as far as it says it.
        where: Returns file and line of the statement that runs.
    """

    def __init__(self, job: KrlJob, cell: KrlCell | None, where: Callable[[], str]) -> None:
        self.job, self.cell, self.where = job, cell, where
        # Values of system variables that the program has set, by name in capitals
        self.system: dict[str, values.Value] = {}
        # Why it is not known whether the statement that runs is executed; None where it is
        self.doubt: Unknown | None = None
        self.changes = 0  # Number of values that were changed
        # The statements that run are those of an interrupt: what they set is not known from then on
        self.interrupts = False
        self.volatile: dict[str, Unknown] = {}  # Why the value of a name is not known, whatever the program gives it
        # Returns the place of the robot for ``$POS_ACT`` and the like; an unknown value where it is not known
        self.position: Callable[[str], values.Value] = lambda _: Unknown("the place of the robot is not known", where())
        self.kept_from: variables.Kept = {}
        # Variables of data lists by file, which begin with ``kept_from``: what the last run left of them
        self.lists: dict[str, dict[str, variables.Variable]] = {}
        self._stored: dict[tuple[str, int], values.Value] = {}
        self._given: set[tuple[str, int]] = set()
        self._global: dict[str, variables.Variable] = {}
        self.functions: Callable[[str, Sequence[values.Value]], values.Value] = lambda name, _: Unknown(name, where())
        routine = next(iter(job.main.routines.values()), None)
        if routine is None:
            raise ProgramError(
                "the program does not begin with DEF", where=f"{job.main.file.name}:1:1",
                limit="DEF NAME ( )", hint="Give the whole .src file",
            )  # fmt: skip
        self.here = variables.Activation(routine)  # The routine that runs

    # ---- values ----------------------------------------------------------------------------------------------

    def evaluate(self, node: Node) -> values.Value:
        """Return the value of an expression. Raises ExpressionError: an operator does not fit its operands."""
        return evaluate(node, values.GRAMMAR, self)

    def value_of(self, name: str, path: variables.Path) -> values.Value:
        """Return the value of a name; an unknown value where the job does not determine it."""
        return self._value(self.here, name.upper(), path)

    def call(self, name: str, arguments: Sequence[values.Value], options: object) -> values.Value:
        """Return the value of a function: a standard one, one of the inline forms, or one of the job."""
        del options
        key = name.upper()
        if key in values.FUNCTIONS:
            unknown = first_unknown(list(arguments))
            try:
                return values.FUNCTIONS[key](*arguments) if unknown is None else unknown
            except (TypeError, ValueError) as error:
                raise ExpressionError(f"{name} does not fit its arguments") from error
        if key in _OF_FORMS and len(arguments) >= 1:
            return self._of_form(key, arguments[0])
        return self.functions(name, arguments)

    def _of_form(self, name: str, value: values.Value) -> values.Value:
        """A function of the inline forms of KSS 8.3: ``STOOL2( FP2)``, ``SBASE( FP2.BASE_NO)``."""
        component, stored = _OF_FORMS[name]
        value = self._walk(name, value, [component]) if isinstance(value, dict) else value
        if isinstance(value, Unknown) or stored is None:
            return value
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e9:
            raise ExpressionError(f"{name} needs frame data or a number")
        return self.numbered(stored, round(value))

    def numbered(self, stored: str, number: int) -> values.Value:
        """The tool or base with a number, as bas.src sets it: 0 is the flange or the world, below nothing is said."""
        if number < 0:
            return Unknown(f"{stored} of number {number} is no frame", self.where())
        return dict.fromkeys(LETTERS, 0.0) if number == 0 else self.stored_frame(stored, number)

    def _value(self, at: variables.Activation, name: str, path: variables.Path) -> values.Value:
        if name in at.references:
            other, target, before = at.references[name]
            return self._value(other, target, [*before, *path])
        if name.startswith("$") and name not in at.local:
            return self._system(name, path)
        if name in STORED and self._declared(at, name) is None:
            return self._walk(name, self._stored_frame(name, path), path[1:])
        variable = self._declared(at, name)
        if variable is None:
            return Unknown(f"{name} is not declared in the files of the job", self.where())
        if variable.kind == "SIGNAL":
            return Unknown(f"{name} is an input or output", self.where())
        index, rest = variables.split(path)
        if isinstance(index, Unknown):
            return index
        return self._walk(name, self._element(variable, name, index), rest)

    def _element(self, variable: variables.Variable, name: str, index: tuple[int, ...]) -> values.Value:
        if index in variable.values:
            return variable.values[index]
        named = variable.initial.get(index)
        if named is None:
            shown = name + (f"[{','.join(map(str, index))}]" if index else "")
            return Unknown(f"{shown} was given no value", self.where())
        value = variable.values[index] = self.initial(named)
        return value

    def initial(self, named: Named) -> values.Value:
        """Value of an initial value of a data list. Raises ProgramError: it is not understood."""
        simple = simple_record(named.text, named.start)
        if simple is not None:
            return simple
        text = named.text[named.start :].split(";")[0] if '"' not in named.text else named.text[named.start :]
        try:
            return self.evaluate(values.tree(text))
        except ExpressionError as error:
            raise ProgramError(
                f"a value of the data list is not understood: {error}",
                where=f"{named.file}:{named.line}:{named.start + error.at + 1}", value=named.text.strip()[:60],
                hint="The file may be cut off: post the program again",
            ) from error  # fmt: skip

    def _walk(self, name: str, value: values.Value, path: variables.Path) -> values.Value:
        for step in path:
            if isinstance(value, values.StoredFrame):
                value = value.record()
            if isinstance(value, Unknown):
                return value
            key = step.upper() if isinstance(step, str) else step
            if not isinstance(value, dict) or key not in value:
                shown = f".{key}" if isinstance(key, str) else f"[{key}]"
                return Unknown(f"{name}{shown} was given no value", self.where())
            value = value[key]
        return value

    def _system(self, name: str, path: variables.Path) -> values.Value:
        if name in ("$POS_ACT", "$POS_FOR", "$POS_INT", "$AXIS_ACT", "$AXIS_FOR", "$POS_ACT_MES", "$AXIS_ACT_MEAS"):
            return self._walk(name, self.position(name), path)
        if name in self.system:
            return self._walk(name, self.system[name], path)
        variable = self._public(name)
        if variable is not None:
            index, rest = variables.split(path)
            return index if isinstance(index, Unknown) else self._walk(name, self._element(variable, name, index), rest)
        return Unknown(f"{name} is a value of the controller", self.where())

    # ---- frames of the controller ----------------------------------------------------------------------------

    def stored_frame(self, name: str, number: int) -> values.Value:
        """``BASE_DATA[n]`` or ``TOOL_DATA[n]``: as the program or a data list gives it, or as the cell knows it."""
        if (name, number) not in self._stored:
            self._stored[name, number] = self._as_stored(name, number)
        return self._stored[name, number]

    def _stored_frame(self, name: str, path: variables.Path) -> values.Value:
        index, _ = variables.split(path)
        if isinstance(index, Unknown):
            return index
        return self.stored_frame(name, index[0]) if len(index) == 1 else Unknown(f"{name} has one index", self.where())

    def _frame_in_lists(self, name: str, number: int) -> tuple[values.Value, Float | None]:
        """Value of a frame in the lists of data of the job, None where they do not have it, and its matrix (4, 4) m."""
        variable = self._public(name)
        named = None if variable is None else variable.initial.get((number,))
        listed = None if named is None else self.initial(named)
        return listed, values.matrix_of(listed) if values.is_frame(listed) else None  # type: ignore[arg-type]

    def _as_stored(self, name: str, number: int) -> values.Value:
        (listed, T_listed), cell, base = self._frame_in_lists(name, number), self.cell, name == "BASE_DATA"
        if cell is None:
            return values.StoredFrame(name, number) if listed is None else listed
        T_own, own = (cell.T_part, cell.base_number) if base else (cell.T_tcp, cell.tool_number)
        if name == "TOOL_DATA" or listed is None or T_listed is None:
            known = T_own if number == own and (base or len(cell.tools) == 1) else None
            return values.StoredFrame(name, number, known if T_listed is None else T_listed)
        if number == own:
            return values.StoredFrame(name, own, T_own) if cell.is_part_frame(T_listed) else listed
        first, T_first = self.stored_frame(name, own), self._frame_in_lists(name, own)[1]
        if isinstance(first, values.StoredFrame) and T_first is not None:
            return values.StoredFrame(name, own, T_own, pose.inverse(T_first) @ T_listed)
        return values.StoredFrame(name, number)

    # ---- names -----------------------------------------------------------------------------------------------

    def declared(self, name: str) -> bool:
        """Return whether a file of the job declares a name, or the controller has it."""
        key = name.upper()
        return (
            key.startswith("$")
            or key in self.here.references
            or key in STORED
            or self._declared(self.here, key) is not None
        )

    def kind(self, name: str) -> str:
        """Return the type that a name is declared with, in capitals; empty where there is none."""
        variable = None if name in self.here.references else self._declared(self.here, name.upper())
        return "" if variable is None else variable.kind

    def named(self, name: str, index: tuple[int, ...]) -> Named | None:
        """The initial value of a data list that a name still has; None where the program has given it another."""
        key = name.upper()
        if key in self.here.references:
            return None
        variable = self._declared(self.here, key)
        return None if variable is None else variable.initial.get(index)

    def _declared(self, at: variables.Activation, name: str) -> variables.Variable | None:
        if name in at.local:
            return at.local[name]
        data = at.module.data
        if data is not None:
            variable = self._listed(data).get(name)
            if variable is not None:
                return variable
            if name in data.imports:
                return self._imported(data.imports[name])
        if name in self._global:
            return self._global[name]
        return self._public(name)

    def _public(self, name: str) -> variables.Variable | None:
        lists, _ = self.job.public(name)
        if len(lists) > 1:
            raise ProgramError(
                f"several data lists give {name} to every program, so which one is meant is not known",
                where=self.where(), value=", ".join(one.file.name for one in lists[:4]),
                hint="Leave one of them in the folder of the program",
            )  # fmt: skip
        if not lists:
            return None
        self.job.take(lists[0])
        return self._listed(lists[0]).get(name)

    def _imported(self, place: tuple[str, str]) -> variables.Variable | None:
        listed = self.job.data_of(place[0])
        return None if listed is None else self._listed(listed).get(place[1])

    def imports(self, name: str, place: tuple[str, str]) -> None:
        """``IMPORT`` in a routine."""
        variable = self._imported(place)
        if variable is not None:
            self.here.local[name] = variable

    def _listed(self, data: DataList) -> dict[str, variables.Variable]:
        if data.file.name not in self.lists:
            self.lists[data.file.name] = variables.variables_of(data, self.kept_from)
        return self.lists[data.file.name]

    def declare(self, name: str, kind: str) -> None:
        """A declaration in a routine; a parameter keeps its value."""
        key = name.upper()
        if key in self.here.references:
            return
        self.here.local.setdefault(key, variables.Variable(kind)).kind = kind

    # ---- assignments -----------------------------------------------------------------------------------------

    def assign(self, name: str, path: variables.Path, value: values.Value) -> None:
        """Give a variable, a component or an element a value; in doubt it becomes unknown, unless it has it already."""
        self._assign(self.here, name.upper(), path, value)

    def _assign(self, at: variables.Activation, name: str, path: variables.Path, value: values.Value) -> None:
        if name in at.references:
            other, target, before = at.references[name]
            self._assign(other, target, [*before, *path], value)
            return
        if name in self.volatile:
            value = self.volatile[name]
        if self.doubt is not None:
            if self.interrupts:
                self.volatile[name] = self.doubt
            elif variables.same_value(self._value(at, name, path), value):
                return
            value = Unknown(f"whether it is set is not known: {self.doubt}", self.where())
        self.changes += 1
        value = copy.copy(value) if isinstance(value, dict) else value
        if name.startswith("$") and name not in at.local:
            self._assign_system(name, path, value)
            return
        if name in STORED and self._declared(at, name) is None:
            self._assign_stored(name, path, value)
            return
        variable = self._declared(at, name)
        if variable is None:
            variable = self._global[name] = variables.Variable()
        self._put(variable, name, path, value)

    def _put(self, variable: variables.Variable, name: str, path: variables.Path, value: values.Value) -> None:
        """Put a value, whose place may not be known, into a variable."""
        index, rest = variables.split(path)
        if isinstance(index, Unknown):
            variable.initial.clear()
            variable.values = dict.fromkeys(variable.values, index)
            return
        if rest:
            begun = index in variable.values or index in variable.initial
            value = self._with_component(self._element(variable, name, index) if begun else None, rest, value)
        variable.initial.pop(index, None)
        variable.values[index] = values.assigned_number(variable.kind, value)

    def _assign_system(self, name: str, path: variables.Path, value: values.Value) -> None:
        before = self.system.get(name)
        if path:
            value = self._with_component(before, path, value)
        elif name in _RECORDS and isinstance(before, dict) and isinstance(value, dict):
            value = before | value  # components that are not written stay as they are
        self.system[name] = value

    def _assign_stored(self, name: str, path: variables.Path, value: values.Value) -> None:
        index, rest = variables.split(path)
        if isinstance(index, Unknown) or len(index) != 1:
            self._stored = {key: Unknown(f"which {name} is set is not known", self.where()) for key in self._stored}
            return
        if rest:
            before = self.stored_frame(name, index[0])
            if (name, index[0]) not in self._given:
                value = Unknown(
                    f"the program changes {name}[{index[0]}], and the controller keeps such a change from run to run",
                    self.where(),
                )
            else:
                value = self._with_component(before, rest, value)
        else:
            self._given.add((name, index[0]))
        self._stored[name, index[0]] = value

    def _with_component(self, before: values.Value, path: variables.Path, value: values.Value) -> values.Value:
        """A value with another component or element."""
        step, rest = path[0], path[1:]
        if isinstance(before, Unknown):
            return before
        if isinstance(before, values.StoredFrame):
            record = before.record()
            if isinstance(record, Unknown):
                return Unknown(f"the program changes a part of it, and {record}", self.where())
            if isinstance(value, Unknown):
                return value
            return before.with_components({**record, str(step).upper(): value})
        record = dict(before) if isinstance(before, dict) else {}
        key = step.upper() if isinstance(step, str) else step
        record[key] = self._with_component(record.get(key), rest, value) if rest else value  # type: ignore[index,call-overload]
        return record

    def forget(self, name: str, path: variables.Path, unknown: Unknown) -> None:
        """A statement gives a variable a value that the job does not determine."""
        doubt, self.doubt = self.doubt, None
        self.assign(name, path, unknown)
        self.doubt = doubt

"""Calls of RAPID routines and functions: arguments by value and by reference, optional ones, built-in functions."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.integrations.abb.language.read.arithmetic import FUNCTIONS, GRAMMAR, WITH_OPTIONS, pose_product
from counterflex.integrations.abb.language.read.literals import arguments
from counterflex.integrations.abb.language.read.memory import RapidMemory, RapidVariable, Reference
from counterflex.integrations.abb.language.read.routines import Modules, RapidRoutine, RoutineParameter
from counterflex.integrations.abb.language.read.scanner import RapidSource, RapidStatement
from counterflex.integrations.abb.language.read.types import copy_of
from counterflex.integrations.abb.language.table import FUNCTION_OUTPUTS, TABLE
from counterflex.programs.expression import Call, ExpressionError, Name, Node, evaluate
from counterflex.programs.statement_table import Treatment
from counterflex.programs.unknown import Unknown, first_unknown


@dataclass(frozen=True, slots=True)
class Given:
    """Arguments of a call as written: text and place, or the tree of an expression."""

    required: tuple[tuple[str, int] | Node, ...]  # In order
    options: Mapping[str, tuple[str, int] | Node | None]  # By name in capitals; None of a switch

    @staticmethod
    def of_instruction(code: str, start: int, end: int) -> Given:
        """Return the arguments of an instruction, between two indices of the text."""
        required: list[tuple[str, int] | Node] = []
        options: dict[str, tuple[str, int] | Node | None] = {}
        for argument in arguments(code, start, end):
            if argument.text:
                required.append((argument.text, argument.start))
            for key, (text, at, _) in argument.options.items():
                options[key] = (text, at) if text else None
        return Given(tuple(required), options)

    @staticmethod
    def of_function(node: Call) -> Given:
        """Return the arguments of a function in an expression."""
        return Given(node.arguments, node.options)


class Calls:
    """Names and functions of expressions, and calls of routines."""

    memory: RapidMemory
    modules: Modules
    source: RapidSource
    now: RapidStatement
    _running: list[RapidRoutine]

    @abstractmethod
    def execute(
        self, routine: RapidRoutine, names: dict[str, Reference], absent: set[str], place: tuple[int, int]
    ) -> object:
        """Execute a routine."""

    @abstractmethod
    def displacement(self) -> Float | None:
        """Return the displacement of the program, (4, 4) m."""

    @abstractmethod
    def fault(self, what: str, statement: RapidStatement, **more: str) -> ProgramError:
        """Make an error of a statement."""

    # ---- names and functions of expressions ------------------------------------------------------------------

    def value_of(self, name: str, path: Sequence[object]) -> object:
        """Return the value of a name with its indices and components."""
        value = self.memory.value_of(name, path)
        if isinstance(value, Unknown) and not value.where:
            return Unknown(value.why, self._here())
        return value

    def call_routine(self, routine: RapidRoutine, given: Given, place: tuple[int, int]) -> object:
        """Execute a routine with arguments. Raises ProgramError: they do not fit its parameters."""
        names: dict[str, Reference] = {}
        absent: set[str] = set()
        required = list(given.required)
        for parameter in routine.parameters:
            if parameter.optional:
                if parameter.name not in given.options:
                    absent.add(parameter.name)
                    continue
                item = given.options[parameter.name]
                reference = self._switch(parameter) if item is None else self._argument(parameter, item)
                if reference is None:
                    absent.add(parameter.name)
                else:
                    names[parameter.name] = reference
                continue
            if not required:
                raise self.fault(
                    f"{routine.name} needs the argument {parameter.name.lower()}", self.now,
                    hint="The file may be damaged: post it again",
                )  # fmt: skip
            reference = self._argument(parameter, required.pop(0))
            names[parameter.name] = reference or self._lost(parameter)
        left = sorted(set(given.options) - {parameter.name for parameter in routine.parameters})
        if required or left:
            raise self.fault(
                f"{routine.name} has no such argument", self.now, limit=f"{len(routine.parameters)} parameters",
                hint="The file may be damaged: post it again",
            )  # fmt: skip
        for name in absent:
            lost = Unknown(f"the argument {name.lower()} is left out", self._here())
            names[name] = Reference(RapidVariable(name, "", (), lost), (), "")
        return self.execute(routine, names, absent, place)

    def _switch(self, parameter: RoutineParameter) -> Reference:
        return Reference(RapidVariable(parameter.name, "switch", (), True), (), "switch")

    def _lost(self, parameter: RoutineParameter) -> Reference:
        lost = Unknown(f"the argument {parameter.name.lower()} is not known", self._here())
        return Reference(RapidVariable(parameter.name, parameter.kind, (), lost), (), parameter.kind)

    def _argument(self, parameter: RoutineParameter, item: tuple[str, int] | Node) -> Reference | None:
        """Data or value that an argument stands for; None of an optional one that the caller was not given either."""
        memory = self.memory
        text, at = (item[0], item[1]) if isinstance(item, tuple) else ("", self.now.start)
        node = memory.node(text, at) if isinstance(item, tuple) else item
        if isinstance(node, Name) and memory.frames and node.text.upper() in memory.frames[-1].absent:
            return None
        reference = memory.reference(node)
        keeps = parameter.kind in ("tooldata", "wobjdata")
        if reference is not None and (parameter.reference or keeps):
            return reference
        value = memory.value(node, text or self.now.code, at)
        if isinstance(value, Unknown) and isinstance(node, Name) and reference is None and keeps:
            return None
        return _copied(parameter, reference, value)

    def call_node(self, node: Call) -> object:
        """Return the value of a function in an expression."""
        name = node.name.upper()
        routine = self.modules.find(name, self._running[-1].module) if self._running else None
        if routine is not None:
            at = self.now.code.upper().find(name)
            start = self.now.start + max(at, 0)
            return self.call_routine(routine, Given.of_function(node), (start, start + len(name)))
        if name == "PRESENT":
            first = node.arguments[0] if node.arguments else None
            return isinstance(first, Name) and first.text.upper() not in self.memory.frames[-1].absent
        values = [evaluate(item, GRAMMAR, self) for item in node.arguments]
        options = {key: True if item is None else evaluate(item, GRAMMAR, self) for key, item in node.options.items()}
        for position in FUNCTION_OUTPUTS.get(name, ()):
            reference = self.memory.reference(node.arguments[position]) if position < len(values) else None
            if reference is not None:
                self.memory.forget(reference, Unknown(f"{node.name} sets it", self._here()))
        return self.call(node.name, values, options)

    def call(self, name: str, arguments: Sequence[object], options: Mapping[str, object]) -> object:
        """Return the value of a function of the controller. Raises ExpressionError: the arguments do not fit."""
        word, name, values = name, name.upper(), list(arguments)
        unknown = first_unknown([*values, *options.values()])
        computed = FUNCTIONS.get(name) or WITH_OPTIONS.get(name)
        row = TABLE.find(name)
        if computed is None and row is not None and row.treatment is Treatment.REFUSED:
            raise self.fault(f"{row.word}(): {row.reason}", self.now, hint=row.remedy)
        if name == "OROBT" and unknown is None:
            return self._without_displacement(values[0])
        if computed is None and row is None:
            raise self.fault(
                f"the function {word} is not in the files of the program, and may move the robot or change its "
                "arguments", self.now, hint="Put its module into the folder of the program",
            )  # fmt: skip
        if computed is None:
            return Unknown(f"{word}() asks the controller", self._here())
        if unknown is not None:
            return unknown
        try:
            if name in WITH_OPTIONS:
                return computed(options, *values)
            return computed(*values)
        except ExpressionError:
            raise
        except (TypeError, ValueError, IndexError, OverflowError, ZeroDivisionError) as fault:
            raise ExpressionError(f"{word} does not fit its arguments") from fault

    def _without_displacement(self, target: object) -> object:
        """``ORobT``: a robtarget as it lies in the work object, the displacement of the program taken out."""
        D = self.displacement_pose()
        if D is None or not isinstance(target, list):
            return target
        return [*pose_product(D, target[:2]), *target[2:]]

    @abstractmethod
    def displacement_pose(self) -> list[list[float]] | None:
        """Return the displacement of the program as ``[[x,y,z],[q1,q2,q3,q4]]``; None where there is none."""

    def _here(self) -> str:
        return self.source.where(self.now.start)


def _copied(parameter: RoutineParameter, reference: Reference | None, value: object) -> Reference:
    """A value that the routine may change for itself; of a robtarget with the data that it came from."""
    dims = () if reference is None else reference.dims
    copy = RapidVariable(parameter.name, parameter.kind, dims, copy_of(value))
    if reference is not None and not reference.variable.assigned and parameter.kind == "robtarget":
        copy.copied = reference
    return Reference(copy, (), parameter.kind, dims)

"""Data of a RAPID program while it runs: variables by scope, references, components, elements."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.integrations.abb.language.read.arithmetic import GRAMMAR
from counterflex.integrations.abb.language.read.literals import robtarget_literal
from counterflex.integrations.abb.language.read.routines import Declared, Modules, RapidModule, RapidRoutine
from counterflex.integrations.abb.language.read.scanner import RapidSource
from counterflex.integrations.abb.language.read.types import PREDEFINED, Types, copy_of
from counterflex.programs.expression import (
    ExpressionError,
    Name,
    Node,
    ScopeOfReferences,
    evaluate,
    is_number,
    parse_whole,
)
from counterflex.programs.unknown import Unknown

_PENDING: Final = object()
_ASSIGNED: Final = re.compile(r"([A-Za-z]\w*)((?:\s*\{[^}]*\}|\s*\.\s*\w+)*)\s*:=")
_CHANGED_BY: Final = re.compile(r"(?:Incr|Decr|Add|Clear|BitSet|BitClear)\s+([A-Za-z]\w*)", re.IGNORECASE)
_SCALARS: Final = frozenset(("num", "dnum", "bool", "string"))
LAST_RUN: Final = "what the last run left"
_LARGEST_ARRAY: Final = 1_000_000


@dataclass(eq=False)
class RapidVariable:
    """Data with a name."""

    name: str  # As declared
    kind: str  # Data type
    dims: tuple[int, ...]  # Dimensions of an array
    value: object  # A number, truth value, string, list of components or elements, or Unknown
    declared: Declared | None = None  # Where it is declared; None of arguments, loop variables and predefined data
    module: RapidModule | None = None  # The module that it belongs to
    persistent: bool = False  # It keeps its value from run to run (PERS)
    assigned: bool = False  # The program has given it a value
    volatile: Unknown | None = None  # An interrupt may change it at any time
    copied: Reference | None = None  # Of an argument by value, the data that it is a copy of
    # The array of an element whose index is not known; assigned to, the whole array is unknown
    element_of: Reference | None = None


@dataclass(frozen=True, slots=True)
class Reference:
    """Data, or a part of it: indices from 0 into its nested lists, and the type and dimensions of the part."""

    variable: RapidVariable
    path: tuple[int, ...]
    kind: str
    dims: tuple[int, ...] = ()

    def value(self) -> object:
        """Return the value."""
        value = self.variable.value
        for index in self.path:
            if isinstance(value, Unknown):
                break
            value = value[index]  # type: ignore[index]
        return value


@dataclass
class RoutineFrame:
    """Names of a routine that is executed, its optional arguments that are left out, and its number."""

    routine: RapidRoutine
    names: dict[str, Reference] = field(default_factory=dict)
    absent: set[str] = field(default_factory=set)
    serial: int = field(default_factory=itertools.count().__next__)


class RapidMemory:
    """Variables of all modules and of the routines that are executed."""

    def __init__(self, source: RapidSource, modules: Modules) -> None:
        self.source, self.modules = source, modules
        self.types = Types()  # Data types
        self.frames: list[RoutineFrame] = []  # Routines that are executed, the innermost last
        self.stamp = 0  # Number of changes of data so far
        # A condition is evaluated: persistent data that a person or another task may have set is unknown
        self.deciding = False
        # Values with which persistent data begins that the program changes, by the place of its declaration; data
        # without a value there begins as declared. None: all such data is unknown.
        self.kept_from: Mapping[int, object] | None = None
        self.evaluator: ScopeOfReferences | None = None
        self._nodes: dict[str, Node] = {}
        self._own: dict[int, dict[str, RapidVariable]] = {}
        self._global: dict[str, RapidVariable] = {}
        self._predefined: dict[str, RapidVariable] = {}
        for module in modules.modules:
            self.types.records |= module.records
            self.types.aliases |= module.aliases
        for module in modules.modules:
            own = self._own[id(module)] = {}
            for key, declared in module.data.items():
                variable = RapidVariable(
                    declared.name, declared.kind, (), _PENDING, declared, module, declared.storage == "PERS"
                )
                own[key] = variable
                if not declared.local:
                    self._global.setdefault(key, variable)
        self._kept = _assigned_paths(modules)

    # ---- names -----------------------------------------------------------------------------------------------

    def find(self, name: str) -> Reference | None:
        """Return the data that a name stands for, as the routine that is executed sees it."""
        key = name.upper()
        if self.frames:
            data = self.frames[-1].names.get(key)
            if data is not None:
                return data
            module = self.frames[-1].routine.module
        else:
            module = self.modules.modules[0]
        variable = self._own[id(module)].get(key) or self._global.get(key)
        if variable is None:
            return self._of_controller(key)
        if variable.value is _PENDING:
            self._begin(variable)
        return Reference(variable, (), variable.kind, variable.dims)

    def _of_controller(self, key: str) -> Reference | None:
        known = PREDEFINED.get(key)
        if known is None:
            return None
        variable = self._predefined.setdefault(key, RapidVariable(key.lower(), known[0], (), copy_of(known[1])))
        return Reference(variable, (), variable.kind)

    def _begin(self, variable: RapidVariable) -> None:
        """Give data its declared value."""
        declared, module = variable.declared, variable.module
        if declared is None or module is None:
            raise ValueError("a variable without declaration")
        variable.value = Unknown("it is declared by itself", self.source.where(declared.start))
        frame = RoutineFrame(next(iter(module.routines.values()), _NOWHERE(module)))
        self.frames.append(frame)
        try:
            variable.dims = self._dims(declared)
            variable.value = self.declared_value(declared, variable.dims)
        finally:
            self.frames.pop()
        if variable.persistent:
            self._forget_kept(variable, declared)

    def _forget_kept(self, variable: RapidVariable, declared: Declared) -> None:
        """Make the parts of persistent data unknown that the program changes: they keep what the last run left."""
        if self.kept_from is not None:
            variable.value = copy_of(self.kept_from.get(declared.start, variable.value))
            return
        for names in self._kept.get(declared.name.upper(), ()):
            why = Unknown(
                f"{declared.name} is PERS and the program changes it, so it begins with {LAST_RUN}",
                self.source.where(declared.start),
            )
            reference = Reference(variable, (), variable.kind, variable.dims)
            for name in names:
                part = None if reference.dims else self.types.component(reference.kind, name)
                if part is None:
                    break
                reference = Reference(variable, (*reference.path, part[0]), part[1])
            self._put(reference, why)

    def kept(self) -> dict[int, object]:
        """Return the values that persistent data has now which the program changes, by the place of its declaration."""
        data = [variable for own in self._own.values() for variable in own.values() if variable.persistent]
        return {
            variable.declared.start: variable.value
            for variable in data
            if variable.declared is not None and variable.value is not _PENDING and variable.name.upper() in self._kept
        }

    def declared_value(self, declared: Declared, dims: Sequence[int]) -> object:
        """Return the initial value of a declaration."""
        if declared.value < 0:
            return self.types.initial(declared.kind, dims)
        if declared.kind == "robtarget":
            literal = robtarget_literal(self.source.code, declared.value)
            if literal is not None and literal.end == declared.end:
                return literal.value(lambda text: self.evaluated(text, declared.value))
        return copy_of(self.evaluated(self.source.code[declared.value : declared.end], declared.value))

    def _dims(self, declared: Declared) -> tuple[int, ...]:
        if not declared.dims.strip():
            return ()
        out = []
        for text in declared.dims.split(","):
            size = self.evaluated(text, declared.start)
            if not is_number(size) or not 0 < size <= _LARGEST_ARRAY:  # type: ignore[operator]
                raise ProgramError(
                    f"the size of {declared.name} is not known", where=self.source.place(declared.start),
                    value=text.strip()[:40], limit="a number above 0", hint="Write the number itself",
                )  # fmt: skip
            out.append(int(size))  # type: ignore[call-overload]
        return tuple(out)

    def enter(self, routine: RapidRoutine, names: Mapping[str, Reference], absent: set[str]) -> None:
        """Begin a routine with its arguments, and those that are left out."""
        frame = RoutineFrame(routine, dict(names), absent)
        self.frames.append(frame)
        for key, declared in routine.declared.items():
            dims = self._dims(declared)
            variable = RapidVariable(declared.name, declared.kind, dims, None, declared, routine.module)
            variable.value = self.declared_value(declared, dims)
            frame.names[key] = Reference(variable, (), declared.kind, dims)

    def bare(self, routine: RapidRoutine) -> RoutineFrame:
        """Return a frame that sees what the module of a routine sees, and nothing else."""
        return RoutineFrame(routine)

    def leave(self) -> None:
        """End the innermost routine."""
        self.frames.pop()

    # ---- values ----------------------------------------------------------------------------------------------

    def node(self, text: str, at: int) -> Node:
        """Return the tree of an expression. Raises ProgramError: it is none."""
        node = self._nodes.get(text)
        if node is None:
            try:
                node = parse_whole(text, GRAMMAR)
            except ExpressionError as fault:
                raise ProgramError(
                    f"no expression that is read: {fault}", where=self.source.place(at),
                    value=" ".join(text.split())[:60], hint="docs/rapid.md lists what is read",
                ) from fault  # fmt: skip
            if len(text) < 80:
                self._nodes[text] = node
        return node

    def evaluated(self, text: str, at: int) -> object:
        """Return the value of an expression; ``at`` is its place in the text.

        Raises:
            ProgramError: It is none, or an operator does not fit.
        """
        return self.value(self.node(text, at), text, at)

    def value(self, node: Node, text: str, at: int) -> object:
        """Return the value of a tree. Raises ProgramError: an operator does not fit."""
        if self.evaluator is None:
            raise ValueError("no evaluator")
        try:
            return evaluate(node, GRAMMAR, self.evaluator)
        except ExpressionError as fault:
            raise ProgramError(
                f"this cannot be evaluated: {fault}", where=self.source.place(at), value=" ".join(text.split())[:60],
                limit="values that fit together", hint="Check types, indices and sizes",
            ) from fault  # fmt: skip

    def value_of(self, name: str, path: Sequence[object]) -> object:
        """Return the value of a name with its indices and components."""
        reference = self.find(name)
        if reference is None:
            return Unknown(f"{name} is declared nowhere in the files of the program")
        variable = reference.variable
        if variable.volatile is not None:
            return variable.volatile
        if self.deciding and variable.persistent and not variable.assigned and variable.kind in _SCALARS:
            where = "" if variable.declared is None else self.source.where(variable.declared.start)
            return Unknown(f"{name} is PERS, which a person or another task may have changed since", where)
        return self.part(reference, path).value() if path else reference.value()

    def part(self, reference: Reference, path: Sequence[object]) -> Reference:
        """Return a part of data. Raises ExpressionError: there is no such part."""
        for step in path:
            if isinstance(step, str):
                data = None if reference.dims else self.types.component(reference.kind, step)
                if data is None:
                    raise ExpressionError(f"{reference.variable.name} has no component {step}")
                reference = Reference(reference.variable, (*reference.path, data[0]), data[1])
            else:
                reference = self._element(reference, step)
        return reference

    def _element(self, reference: Reference, indices: object) -> Reference:
        name, dims = reference.variable.name, reference.dims
        if not isinstance(indices, tuple) or len(indices) != len(dims):
            raise ExpressionError(f"{name} has {len(dims)} dimensions")
        path = reference.path
        for index, size in zip(indices, dims, strict=True):
            if isinstance(index, Unknown):
                lost = RapidVariable(name, reference.kind, (), index, element_of=reference)
                return Reference(lost, (), reference.kind)
            if not is_number(index) or not 1 <= index <= size or index != int(index):
                raise ExpressionError(f"{name} has elements 1 to {size}, {index} is none of them")
            path = (*path, int(index) - 1)
        return Reference(reference.variable, path, reference.kind)

    def reference(self, node: Node) -> Reference | None:
        """Return the data that a name with indices and components stands for; None where it is declared nowhere."""
        if not isinstance(node, Name) or self.evaluator is None:
            return None
        data = self.find(node.text)
        if data is None:
            return None
        evaluator = self.evaluator
        path = [
            step if isinstance(step, str) else tuple(evaluate(index, GRAMMAR, evaluator) for index in step)
            for step in node.path
        ]
        return self.part(data, path)

    def assign(self, reference: Reference, value: object) -> None:
        """Give data another value."""
        array = reference.variable.element_of
        if array is not None and isinstance(reference.variable.value, Unknown):
            self.forget(array, reference.variable.value)
            return
        self.stamp += 1
        reference.variable.assigned = True
        self._put(reference, copy_of(value))

    def forget(self, reference: Reference, unknown: Unknown) -> None:
        """Make data unknown."""
        reference = reference.variable.element_of or reference
        self.stamp += 1
        self._put(reference, unknown)

    def _put(self, reference: Reference, value: object) -> None:
        variable, path = reference.variable, reference.path
        if not path:
            variable.value = value
            return
        if isinstance(variable.value, Unknown):
            variable.value = self.types.spread(variable.kind, variable.dims, variable.value)
        holder = variable.value
        for index in path[:-1]:
            if not isinstance(holder, list):
                return  # a type that is not evaluated stays unknown
            if isinstance(holder[index], Unknown):
                depth = len(path) - 1
                holder[index] = self._spread_at(variable, path[:depth], holder[index])
            holder = holder[index]
        if isinstance(holder, list):
            holder[path[-1]] = value

    def _spread_at(self, variable: RapidVariable, path: Sequence[int], unknown: Unknown) -> object:
        whole: object = self.types.spread(variable.kind, variable.dims, unknown)
        for index in path:
            whole = whole[index] if isinstance(whole, list) else whole
        return whole


def _assigned_paths(modules: Modules) -> dict[str, set[tuple[str, ...]]]:
    """Components of data of modules that statements assign something to, by name; () is the whole."""
    out: dict[str, set[tuple[str, ...]]] = {}
    for routine in modules.reachable():
        own = {*routine.declared, *(parameter.name for parameter in routine.parameters)}
        for name, path in _assignments(routine):
            if name not in own:
                out.setdefault(name, set()).add(path)
    return out


def _assignments(routine: RapidRoutine) -> Iterator[tuple[str, tuple[str, ...]]]:
    for statement in routine.statements:
        code = statement.code
        for match in _CHANGED_BY.finditer(code):
            yield match[1].upper(), ()
        if ":=" not in code or statement.word.startswith(("MOVE", "TRIGG")):
            continue
        for match in _ASSIGNED.finditer(code):
            before = code[: match.start()].rstrip()
            if before.endswith(("\\", ",")):
                continue
            names = () if "{" in match[2] else tuple(re.findall(r"\w+", match[2]))
            yield match[1].upper(), names


def _NOWHERE(module: RapidModule) -> RapidRoutine:
    """Return an empty routine of a module that has none."""
    return RapidRoutine("", "PROC", 0, 0, (0, 0), module, (), False, RapidSource("", ""))

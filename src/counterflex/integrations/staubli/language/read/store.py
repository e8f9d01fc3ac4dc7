"""Variables of a VAL3 application while its program runs."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, cast

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.integrations.staubli.language.program import Key
from counterflex.integrations.staubli.language.read import values as val3
from counterflex.integrations.staubli.language.read.data_file import DataFile
from counterflex.integrations.staubli.language.read.program_file import Val3Routine, Val3Variable
from counterflex.integrations.staubli.language.read.table import TABLE
from counterflex.programs.expression import ExpressionError, Name, Node, Value, evaluate, is_number, parse_whole
from counterflex.programs.unknown import Unknown, known

_SIZE: Final = re.compile(r"\bsize\s*\(\s*((?:[A-Za-z_]\w*:)?[A-Za-z_]\w*)\s*\)")
_FATHER: Final = re.compile(r"((?:[A-Za-z_]\w*:)?[A-Za-z_]\w*)\s*(?:\[\s*(\d+)\s*\])?")
_PLAIN: Final = re.compile(r"([A-Za-z_]\w*)(?:\[(\d+)\])?")
_DEEPEST: Final = 20
_WHOLE: Final = 1e-6  # Distance of a computed index from a whole number: above the noise of binary fractions
ROOTS: Final = ("world", "flange")
"""Frames that have no father."""


@dataclass
class StoredCells:
    """A variable."""

    name: str  # As the data file has it; empty of local variables
    kind: str  # Its type
    size: int = 1  # Number of elements
    values: dict[int, Value] = field(default_factory=dict)  # Elements that are set
    data: DataFile | None = None  # Where the others stand
    changed: set[int] = field(default_factory=set)  # Elements that the program sets

    def get(self, index: int) -> Value:
        """Return an element."""
        if index not in self.values:
            listed = None if self.data is None else self.data.variables[self.name.rpartition(":")[2]].values.get(index)
            value = val3.default_of(self.kind)
            if listed is not None and self.data is not None:
                value = val3.data_value(self.data, self.kind, listed)
            self.values[index] = value
        return self.values[index]


Bound = tuple[StoredCells, int]
"""A variable, and the element that index 0 stands for."""


@dataclass
class Store:
    """Variables by name, and the expressions over them."""

    where: str = ""  # ``file:line`` of the statement that runs
    # Variables of the data file, and of libraries as ``alias:name``
    globals: dict[str, StoredCells] = field(default_factory=dict)
    # Parameters and local variables of the programs that run, the innermost last
    scopes: list[dict[str, Bound]] = field(default_factory=list)
    prefix: str = ""  # Alias of the library that the program belongs to, with its colon
    # How often each element of the data file was read for something else than a target
    reads: Counter[Key] = field(default_factory=Counter)
    version: int = 0  # Number of changes so far
    _parsed: dict[str, Node] = field(default_factory=dict)

    def load(self, data: DataFile, prefix: str = "") -> None:
        """Take the variables of a data file."""
        for name, variable in data.variables.items():
            self.globals[f"{prefix}{name}"] = StoredCells(f"{prefix}{name}", variable.kind, variable.size, data=data)

    # ---- names ---------------------------------------------------------------------------------------------

    def bound(self, name: str) -> Bound | None:
        """Return the variable of a name; None where there is none."""
        if self.scopes and name in self.scopes[-1]:
            return self.scopes[-1][name]
        cells = self.globals.get(f"{self.prefix}{name}") or self.globals.get(name)
        return None if cells is None else (cells, 0)

    def bound_or_new(self, name: str) -> Bound:
        """Return the variable of a name; one that no file declares has no known value until it is set."""
        variable = self.bound(name)
        if variable is None:
            unknown = Unknown(f"{name} is in no data file of the application")
            self.globals[name] = StoredCells(name, "?", 1, {0: unknown})
            variable = self.globals[name], 0
        return variable

    def is_signal(self, name: str) -> bool:
        """Return whether a name is an input or output."""
        variable = self.bound(name)
        return variable is not None and variable[0].kind in val3.SIGNALS

    # ---- read ----------------------------------------------------------------------------------------------

    def evaluate(self, text: str) -> Value:
        """Return the value of an expression. Raises ExpressionError: it is none."""
        return evaluate(self.parsed(text), val3.GRAMMAR, self)

    def parsed(self, text: str) -> Node:
        """Return the tree of an expression, parsed once."""
        node = self._parsed.get(text)
        if node is None:
            plain = _SIZE.sub(self._size, text) if "size" in text else text
            node = self._parsed[text] = parse_whole(plain, val3.GRAMMAR)
        return node

    def _size(self, match: re.Match[str]) -> str:
        variable = self.bound(match[1])
        return match[0] if variable is None else f"{variable[0].size - variable[1]}"

    def value_of(self, name: str, path: Sequence[object]) -> Value:
        """Return the value of a variable, element or component."""
        if not path and name in val3.WORDS and self.bound(name) is None:
            return name
        variable, index, components = self._resolved(name, path)
        if variable is None:
            return Unknown(f"{name} is in no data file of the application", self.where)
        if isinstance(index, Unknown):
            return index
        cells = variable[0]
        if cells.kind in val3.SIGNALS:
            return Unknown(f"{name} is a signal", self.where)
        self.reads[cells.name, index] += 1
        value = cells.get(index)
        for component in components:
            if isinstance(value, Unknown):
                return value
            if not isinstance(value, Mapping) or component not in value:
                return Unknown(f"{name}.{component} is not read", self.where)
            value = value[component]
        return value

    def call(self, name: str, arguments: Sequence[Value], _: Mapping[str, Value]) -> Value:
        """Return the value of a function. Raises ExpressionError: VAL3 has no such function."""
        row = TABLE.find(name.rpartition(":")[2])
        if row is None or row.word != name.rpartition(":")[2]:
            raise ExpressionError(f"{name}() is no function of VAL3 (docs/statements/val3.md)")
        value = val3.function(name, arguments, self.place)
        return Unknown(value.why, value.where or self.where) if isinstance(value, Unknown) else value

    def _resolved(self, name: str, path: Sequence[object]) -> tuple[Bound | None, int | Unknown, list[str]]:
        variable = self.bound(name)
        index: int | Unknown = 0
        rest = list(path)
        if rest and isinstance(rest[0], tuple):
            indices = cast("tuple[object, ...]", rest.pop(0))
            index = _index(indices, name)
        components = [step for step in rest if isinstance(step, str)]
        if len(components) != len(rest):
            index = Unknown(f"{name}: tables within components are not read", self.where)
        if variable is not None and isinstance(index, int):
            index += variable[1]
        if isinstance(index, Unknown) and not index.where:
            index = Unknown(index.why, self.where)
        return variable, index, components

    def literal(self, text: str) -> tuple[Key, Bound] | None:
        """Return the element that an argument names, where it is nothing but a variable, with its index known.

        Raises:
            ExpressionError: It is no expression.
        """
        plain = _PLAIN.fullmatch(text)
        if plain is not None:  # most points of a program: no parsing
            variable = self.bound(plain[1])
            return None if variable is None else ((variable[0].name, int(plain[2] or 0) + variable[1]), variable)
        node = self.parsed(text)
        if not isinstance(node, Name):
            return None
        path = [
            step if isinstance(step, str) else tuple(evaluate(one, val3.GRAMMAR, self) for one in step)
            for step in node.path
        ]
        variable, index, components = self._resolved(node.text, path)
        if variable is None or components or isinstance(index, Unknown):
            return None
        return (variable[0].name, index), variable

    def place(self, value: Value) -> Float:
        """Return (4, 4) m of a point or frame in the world, of a tool in the flange.

        Raises:
            ProgramError: A frame of it is not known.
            ExpressionError: It is none.
        """
        T = val3.matrix(value)
        for _ in range(_DEEPEST):
            if not isinstance(value, Mapping) or val3.FATHER not in value:
                return T
            father = str(known(value[val3.FATHER], "the frame that a place is in", self.where))
            variable = self.frame(father)
            if variable is None:
                return T
            value = variable
            T = val3.matrix(value) @ T
        raise ProgramError("frames that are each other's fathers", where=self.where, value=str(value)[:60],
                           hint="The data file may be damaged")  # fmt: skip

    def frame(self, father: str) -> Value | None:
        """Return the frame or tool of a name; None of the world and the flange.

        Raises:
            ProgramError: It is not known.
        """
        match = _FATHER.fullmatch(father)
        name, index = (match[1], int(match[2] or 0)) if match else (father, 0)
        if name in ROOTS and index == 0:
            return None
        cells = self.globals.get(name)
        value = Unknown(f"{name} is in no data file of the application") if cells is None else cells.get(index)
        return known(value, f"the place of {name}", self.where, text=father,
                     hint="Write it into the data file: frames of libraries lie in their folders")  # fmt: skip

    # ---- assign --------------------------------------------------------------------------------------------

    def assign(self, target: str, value: Value) -> None:
        """Set a variable, element or component.

        Raises:
            ExpressionError: It is no variable, or the value does not fit it.
        """
        node = self.parsed(target)
        if not isinstance(node, Name):
            raise ExpressionError("a value is put into what is no variable")
        path = [
            step if isinstance(step, str) else tuple(evaluate(one, val3.GRAMMAR, self) for one in step)
            for step in node.path
        ]
        self.bound_or_new(node.text)
        variable, index, components = self._resolved(node.text, path)
        if variable is None:
            return
        cells = variable[0]
        if isinstance(value, Unknown):
            value = Unknown(value.why, value.where or self.where)
        if isinstance(index, Unknown):
            why = Unknown(f"an element of {node.text} is set whose index is not known: {index.why}", self.where)
            for at in range(max(cells.size, max(cells.values, default=0) + 1)):
                cells.values[at] = why
                cells.changed.add(at)
            self.version += 1
            return
        old = cells.get(index)
        if isinstance(old, Unknown) and components:
            return  # the other components of it stay unknown
        new = val3.with_component(old, components, value) if components else val3.as_stored(old, value)
        if new != old:
            self.version += 1
        cells.values[index] = new
        cells.changed.add(index)

    # ---- calls ---------------------------------------------------------------------------------------------

    def enter(self, routine: Val3Routine, given: Sequence[str]) -> dict[str, Bound]:
        """Return the variables of a program that is called. Raises ExpressionError: they do not fit its parameters."""
        if len(given) != len(routine.parameters):
            raise ExpressionError(f"{routine.program}() has {len(routine.parameters)} parameters")
        scope: dict[str, Bound] = {}
        for parameter, text in zip(routine.parameters, given, strict=True):
            literal = self.literal(text) if parameter.reference else None
            if literal is not None:
                (_, index), variable = literal
                scope[parameter.name] = (variable[0], index)
                continue
            scope[parameter.name] = (StoredCells("", parameter.kind, 1, {0: val3.as_stored(
                val3.default_of(parameter.kind), self.evaluate(text)
            )}), 0)  # fmt: skip
        return scope | self.locals_of(routine)

    @staticmethod
    def locals_of(routine: Val3Routine) -> dict[str, Bound]:
        """Return the local variables of a program."""
        return {local.name: (StoredCells("", local.kind, local.size), 0) for local in routine.locals}

    def unknown_parameter(self, parameter: Val3Variable) -> Bound:
        """Return the variable of a parameter of the main program, which nobody calls."""
        why = Unknown(f"{parameter.name} is a parameter, and nothing calls the program")
        return StoredCells("", parameter.kind, 1, {0: why}), 0


def _index(indices: tuple[object, ...], name: str) -> int | Unknown:
    if len(indices) != 1:
        return Unknown(f"{name}: tables of several dimensions are not read")
    index = indices[0]
    if isinstance(index, Unknown):
        return index
    if not is_number(index) or abs(cast("float", index) - round(cast("float", index))) > _WHOLE:
        return Unknown(f"{name}: an index that is no whole number")
    return round(cast("float", index))

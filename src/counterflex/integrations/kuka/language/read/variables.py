"""Variables of a KRL program, the routine that sees them, and paths to their components and elements."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from counterflex.integrations.kuka.language.read.data_list import DataList, Named
from counterflex.integrations.kuka.language.read.job import KrlRoutine, Module
from counterflex.integrations.kuka.language.read.values import (
    StoredFrame,
    Value,
)  # fmt: skip
from counterflex.programs.expression import ExpressionError
from counterflex.programs.unknown import Unknown

Path = Sequence[object]
"""Components as strings, indices as tuples of values."""
Kept = dict[tuple[str, str, tuple[int, ...]], Value]
"""Values by the file of their data list, name in capitals, and index."""


@dataclass
class Variable:
    """A variable."""

    kind: str = ""  # Its type in capitals; empty where it is not declared
    # Initial values of a data list that are still there, by index; ``()`` of one that is no array
    initial: dict[tuple[int, ...], Named] = field(default_factory=dict)
    values: dict[tuple[int, ...], Value] = field(default_factory=dict)  # Values by index


@dataclass
class Activation:
    """A routine that runs."""

    routine: KrlRoutine  # It
    local: dict[str, Variable] = field(default_factory=dict)  # Its variables by name in capitals
    # Parameters by reference: the activation, name and path that they stand for
    references: dict[str, tuple[Activation, str, Path]] = field(default_factory=dict)
    # Number of changed values when a pass of a loop began, by its line; of a GOTO by its negative line
    passes: dict[int, int] = field(default_factory=dict)
    counters: dict[int, tuple[float, float]] = field(default_factory=dict)  # Last value and step of FOR loops, by line

    @property
    def module(self) -> Module:
        """Its file."""
        return self.routine.module


def split(path: Path) -> tuple[tuple[int, ...] | Unknown, Path]:
    """Index of an array at the head of a path, and what follows."""
    if not path or isinstance(path[0], str):
        return (), path
    index: list[int] = []
    for item in path[0] if isinstance(path[0], tuple) else ():
        if isinstance(item, Unknown):
            return item, path[1:]
        if isinstance(item, bool) or not isinstance(item, int | float) or not abs(item) < 1e9:
            raise ExpressionError("an index is no number in range")
        index.append(round(item))
    return tuple(index), path[1:]


def same_value(before: Value, value: Value) -> bool:
    """Return whether two values are known to be the same."""
    if isinstance(before, Unknown) or isinstance(value, Unknown) or isinstance(before, StoredFrame):
        return before is value
    return before == value


def variables_of(data: DataList, kept: Kept) -> dict[str, Variable]:
    """Return the variables of a data list by name in capitals, with what the last run left of them."""
    out: dict[str, Variable] = {name: Variable(kind) for name, kind in data.types.items()}
    for key, named in data.initial.items():
        name, _, index = key.partition("[")
        numbers = tuple(int(part) for part in index.rstrip("]").split(",") if part.strip().isdigit())
        variable = out.setdefault(name, Variable())
        variable.initial[numbers] = named
    for (file, name, numbers), value in kept.items():
        if file == data.file.name and name in out:
            out[name].initial.pop(numbers, None)
            out[name].values[numbers] = copy.deepcopy(value)
    return out


def kept_of(lists: Mapping[str, Mapping[str, Variable]]) -> Kept:
    """Return the values of data lists, by file and name, that are no longer those of the text."""
    return {
        (file, name, index): copy.deepcopy(value)
        for file, variables in lists.items()
        for name, variable in variables.items()
        for index, value in variable.values.items()
        if index not in variable.initial
    }

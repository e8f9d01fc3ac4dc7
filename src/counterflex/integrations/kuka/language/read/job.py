"""The files of a KRL job: the main ``.src``, its ``.dat``, subprograms and public data lists of the same folder."""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import PurePath
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.integrations.kuka.language.program import KrlFile
from counterflex.integrations.kuka.language.read.literals import DataList, Named, code_of, data_list
from counterflex.integrations.kuka.language.read.values import (
    StoredFrame,
    Value,
)  # fmt: skip
from counterflex.programs.expression import ExpressionError
from counterflex.programs.gcode.read.flow import line_end, split_lines
from counterflex.programs.unknown import Unknown

_I: Final = re.IGNORECASE
_HEAD: Final = re.compile(
    r"\s*(?P<global>GLOBAL\s+)?DEF(?P<function>FCT\s+(?P<type>\w+)(?:\s*\[[\d,\s]*\])?)?\s+(?P<name>\w+)\s*"
    r"(?:\((?P<parameters>.*)\))?\s*",
    _I,
)
_END: Final = re.compile(r"\s*END(FCT)?\s*", _I)
_PARAMETER: Final = re.compile(r"\s*(\w+)\s*((?:\[[\s,]*\])?)\s*(?::\s*(IN|OUT)\s*)?", _I)
_GLOBAL_DEF: Final = re.compile(r"^[ \t]*GLOBAL[ \t]+DEF(?:FCT[ \t]+\w+)?[ \t]+(\w+)", _I | re.MULTILINE)
_PUBLIC: Final = re.compile(r"^[ \t]*DEFDAT\s+(?:\$CONFIG|\$?\w+\s+PUBLIC)\b", _I | re.MULTILINE)


@dataclass(frozen=True)
class KrlParameter:
    """A parameter of a routine."""

    name: str  # In capitals
    passing: str  # ``IN`` by value, ``OUT`` by reference, empty where the program does not say it


@dataclass(frozen=True)
class KrlRoutine:
    """A routine of a file: lines ``first`` to ``end``, 1-based, head and END included."""

    module: Module  # Its file
    name: str  # In capitals
    first: int  # Line of DEF
    end: int  # Line of END; one behind the last line where END is missing
    parameters: tuple[KrlParameter, ...]  # In order
    result: str  # Type of a function; empty for a subprogram
    closed: bool  # END is there

    @property
    def key(self) -> tuple[str, int]:
        """File and line: what tells it from every other routine."""
        return self.module.file.name, self.first


class Module:
    """A ``.src`` file, with the data list of the same name.

    Args:
        file: The ``.src`` file.
        data: Its data list; None where there is none.
    """

    def __init__(self, file: KrlFile, data: DataList | None) -> None:
        self.file, self.data = file, data
        ends_in_newline = len(file.lines) > 1 and file.lines[-1] == ""
        self.lines = file.lines[:-1] if ends_in_newline else file.lines

    @cached_property
    def codes(self) -> tuple[str, ...]:
        """Lines without their comments."""
        return tuple(code_of(line) for line in self.lines)

    def fault(self, what: str, line: int, hint: str) -> ProgramError:
        """Return the fault of a line, 1-based."""
        code = self.codes[line - 1]
        column = "" if "not closed" in what else f":{len(code) - len(code.lstrip()) + 1}"
        return ProgramError(what, where=f"{self.file.name}:{line}{column}", value=code.strip()[:60], hint=hint)

    @cached_property
    def routines(self) -> dict[str, KrlRoutine]:
        """Routines by name in capitals, in the order of the file."""
        out: dict[str, KrlRoutine] = {}
        heads = [
            (at, match) for at, code in enumerate(self.codes, start=1)
            if "EF" in code.upper() and (match := _HEAD.fullmatch(code)) is not None
        ]  # fmt: skip
        starts = [*(at for at, _ in heads), len(self.codes) + 1]
        for (at, match), following in zip(heads, starts[1:], strict=True):
            end = next((i for i in range(at + 1, following) if _is_end(self.codes[i - 1])), None)
            name = match["name"].upper()
            if name not in out:
                parameters = tuple(_parameters(match["parameters"] or ""))
                out[name] = KrlRoutine(
                    self, name, at, following if end is None else end, parameters, match["type"] or "", end is not None
                )
        return out


def _is_end(code: str) -> bool:
    return code.lstrip()[:3].upper() == "END" and _END.fullmatch(code) is not None


def _parameters(text: str) -> Iterator[KrlParameter]:
    at = 0
    while at < len(text):
        match = _PARAMETER.match(text, at)
        if match is None:
            return
        yield KrlParameter(match[1].upper(), (match[3] or "").upper())
        at = match.end() + 1


class KrlJob:
    """Finds subprograms and public data of a job."""

    def __init__(self, main: str, text: str, folder: Mapping[str, str]) -> None:
        self.folder = folder
        self.files: dict[str, KrlFile] = {}
        self._modules: dict[str, Module] = {}
        self._by_stem: dict[tuple[str, str], list[str]] = {}
        for name in folder:
            path = PurePath(name)
            self._by_stem.setdefault((path.stem.upper(), path.suffix.lower()), []).append(name)
        self.main = self._module(main, text)

    def routine(self, name: str, caller: Module, where: str) -> KrlRoutine | None:
        """The routine that a call names: of the caller's file, of a file of that name, or a global one.

        Raises:
            ProgramError: Several files have it.
        """
        key = name.upper()
        if key in caller.routines:
            return caller.routines[key]
        module = self._named_module(key, where)
        if module is not None:
            routine = module.routines.get(key)
            if routine is None:
                raise ProgramError(
                    f"{module.file.name} has no routine of its own name", where=where, value=name,
                    limit=f"DEF {name}( )", hint="The file may be damaged: post it again",
                )  # fmt: skip
            return routine
        places = self._global_routines.get(key, [])
        if len(places) > 1:
            raise self._ambiguous(name, places, where)
        return self._module(places[0], self.folder[places[0]]).routines.get(key) if places else None

    def modules(self) -> Iterator[Module]:
        """The ``.src`` files that were read so far."""
        yield from self._modules.values()

    def public(self, name: str) -> tuple[list[DataList], str]:
        """Public data lists of the folder that give a name to every program, and the name as they have it."""
        return self._public_names.get(name.upper(), []), name

    def data_of(self, stem: str) -> DataList | None:
        """The data list with a name, in capitals without ending."""
        names = self._by_stem.get((stem, ".dat"), [])
        return self._data(names[0]) if len(names) == 1 else None

    # ---- files -----------------------------------------------------------------------------------------------

    def _named_module(self, key: str, where: str) -> Module | None:
        names = self._by_stem.get((key, ".src"), [])
        if len(names) > 1:
            raise self._ambiguous(key, names, where)
        return self._module(names[0], self.folder[names[0]]) if names else None

    def _module(self, name: str, text: str) -> Module:
        if name not in self._modules:
            stem = PurePath(name).stem.upper()
            names = self._by_stem.get((stem, ".dat"), [])
            if len(names) > 1:
                raise self._ambiguous(stem, names, f"{name}:1")
            file = self.files[name] = krl_file(name, text)
            data = self._data(names[0]) if names else None
            if data is not None:
                self.take(data)
            self._modules[name] = Module(file, data)
        return self._modules[name]

    def _data(self, name: str) -> DataList:
        if name not in self._lists:
            file = self.files[name] = krl_file(name, self.folder[name])
            self._lists[name] = data_list(file)
        return self._lists[name]

    @cached_property
    def _lists(self) -> dict[str, DataList]:
        return {}

    @cached_property
    def _global_routines(self) -> dict[str, list[str]]:
        out: dict[str, list[str]] = {}
        for name in self.folder:
            if name.lower().endswith(".src"):
                for match in _GLOBAL_DEF.finditer(text_in(self.folder, name)):
                    out.setdefault(match[1].upper(), []).append(name)
        return out

    @cached_property
    def _public_names(self) -> dict[str, list[DataList]]:
        out: dict[str, list[DataList]] = {}
        for name in self.folder:
            text = text_in(self.folder, name) if name.lower().endswith(".dat") else ""
            if _PUBLIC.search(text) is None:
                continue
            known = name in self.files
            try:
                listed = self._data(name)
            except ProgramError:
                if known:
                    raise
                self.files.pop(name, None)
                continue  # a list that is damaged gives no names
            if not known:
                del self.files[name]  # it becomes a file of the job when a name of it is used
            for key in listed.public_names:
                out.setdefault(key, []).append(listed)
        return out

    def take(self, listed: DataList) -> None:
        """A name of a public data list is used: it belongs to the job."""
        self.files.setdefault(listed.file.name, listed.file)

    @staticmethod
    def _ambiguous(name: str, places: list[str], where: str) -> ProgramError:
        return ProgramError(
            f"several files have {name}, so which one is meant is not known", where=where,
            value=", ".join(sorted(places)[:4]), hint="Leave one of them in the folder of the program",
        )  # fmt: skip


def text_in(folder: Mapping[str, str], name: str) -> str:
    """Return the text of a file that may belong to the job; of one that is no text, nothing."""
    try:
        return folder[name]
    except (ProgramError, OSError):
        return ""


def krl_file(name: str, text: str) -> KrlFile:
    """A file that can be put together again byte for byte.

    Raises:
        ProgramError: The file is empty or mixes line ends.
    """
    lines, newline = split_lines(text), line_end(text)
    if not any(line.strip() for line in lines):
        raise ProgramError("the program is empty", where=f"{name}:1:1", hint="Post it again")
    ended = text.endswith(("\n", "\r"))
    if newline.join(lines) + (newline if ended else "") != text:
        whole = newline.join(lines) + (newline if ended else "")
        at = next((i for i, (a, b) in enumerate(zip(whole, text, strict=False)) if a != b), 0)
        raise ProgramError(
            "the file mixes line ends",
            where=f"{name}:{text.count(chr(10), 0, at) + 1}",
            hint="Save it with one kind of line ends (LF or CRLF)",
        )
    return KrlFile(name, (*lines, "") if ended else tuple(lines), newline)


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

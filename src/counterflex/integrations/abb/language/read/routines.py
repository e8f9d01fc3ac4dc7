"""Modules of a RAPID program: their routines, data, records, and which routine is the program."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM
from counterflex.geometry import pose, rotation
from counterflex.integrations.abb.language.read.blocks import Tree, tree_of
from counterflex.integrations.abb.language.read.literals import AggregateLiteral
from counterflex.integrations.abb.language.read.scanner import RapidSource, RapidStatement

DECLARATION: Final = re.compile(
    r"(?:(?:LOCAL|TASK|GLOBAL)\s+)*(CONST|PERS|VAR)\s+(\w+)\s+(\w+)\s*(\{[^}]*\})?\s*(:=)?\s*", re.IGNORECASE
)
"""Groups: storage, data type, name, dimensions, assignment."""
_UNIT: Final = 1e-3
_LARGEST_MM: Final = 100_000.0


def position(item: object) -> tuple[float, float, float] | None:
    """x, y, z of ``[x,y,z]``, mm; None where it is none, or beyond every robot."""
    numbers = item.numbers((3,)) if isinstance(item, AggregateLiteral) else None
    if numbers is None or not all(abs(number.value) <= _LARGEST_MM for number in numbers):
        return None
    x, y, z = (number.value for number in numbers)
    return x, y, z


def quaternion(item: object) -> tuple[float, float, float, float] | None:
    """q1 to q4 of ``[q1,q2,q3,q4]``; None where it is none, or not of length 1."""
    numbers = item.numbers((4,)) if isinstance(item, AggregateLiteral) else None
    if numbers is None:
        return None
    q1, q2, q3, q4 = (number.value for number in numbers)
    length = float(np.sqrt(q1 * q1 + q2 * q2 + q3 * q3 + q4 * q4))
    return (q1, q2, q3, q4) if abs(length - 1.0) <= _UNIT else None


def frame(item: object) -> Float | None:
    """(4, 4) of a pose ``[[x,y,z],[q1,q2,q3,q4]]``, m; None where it is none."""
    if not isinstance(item, AggregateLiteral) or len(item.items) != 2:
        return None
    p, q = position(item.items[0]), quaternion(item.items[1])
    return None if p is None or q is None else pose.make(rotation_of(q), np.array(p) * MM)


def rotation_of(q: tuple[float, float, float, float]) -> Float:
    """(3, 3) of a quaternion, q1 scalar, its length taken out."""
    value = np.array(q)
    return rotation.from_quat_wxyz(value / np.linalg.norm(value))


def truth(item: object) -> bool | None:
    """TRUE or FALSE; None where it is neither."""
    return {"TRUE": True, "FALSE": False}.get(item.upper()) if isinstance(item, str) else None


_I: Final = re.IGNORECASE
_MODULE: Final = re.compile(r"MODULE\s+(\w+)", _I)
_ROUTINE: Final = re.compile(
    r"(?:(LOCAL|TASK|GLOBAL)\s+)?(?:(PROC|TRAP|RECORD)|FUNC\s+(\w+))\s+(\w+)\s*(\(.*\))?", _I | re.DOTALL
)
_PARAMETER: Final = re.compile(r"(?:(INOUT|VAR|PERS|REF)\s+)?(switch|\w+)\s+(\w+)\s*(\{[^}]*\})?|(switch)\s+(\w+)", _I)
_COMPONENT: Final = re.compile(r"(\w+)\s+(\w+)\s*(\{[^}]*\})?", _I)
_END_OF: Final = {"PROC": "ENDPROC", "FUNC": "ENDFUNC", "TRAP": "ENDTRAP", "RECORD": "ENDRECORD"}
_WORDS: Final = re.compile(r"[A-Za-z]\w*")


@dataclass(frozen=True, slots=True)
class RoutineParameter:
    """A parameter of a routine."""

    name: str  # In capitals
    kind: str  # Data type, lower case; ``switch`` of one without a value
    reference: bool  # INOUT, VAR or PERS: it stands for data of the caller
    optional: bool  # It has a backslash


@dataclass(frozen=True, slots=True)
class Declared:
    """A declaration of data."""

    kind: str  # Data type, in lower case
    name: str  # As declared
    storage: str  # CONST, PERS or VAR
    start: int  # Index of the statement
    value: int  # Index of the value; -1 where none is given
    end: int  # Index of the semicolon
    dims: str  # Text of its dimensions; empty where it is no array
    local: bool  # It is seen in its module alone


@dataclass(eq=False)
class RapidRoutine:
    """A PROC, FUNC or TRAP."""

    name: str  # As declared
    kind: str  # ``PROC FUNC TRAP``
    start: int  # Index of its first character
    end: int  # Index behind ENDPROC
    place: tuple[int, int]  # Where its name stands
    module: RapidModule  # The module that it stands in
    parameters: tuple[RoutineParameter, ...]  # In order
    local: bool  # It is seen in its module alone
    source: RapidSource
    statements: list[RapidStatement] = field(
        default_factory=list
    )  # Between its head and ENDPROC, declarations left out
    declared: dict[str, Declared] = field(default_factory=dict)  # Data that it declares

    @cached_property
    def tree(self) -> list[Tree]:
        """Its statements as a tree."""
        return tree_of(self.source, self.statements)

    @cached_property
    def texts(self) -> list[str]:
        """Text of each statement."""
        return [statement.code for statement in self.statements]


@dataclass(eq=False)
class RapidModule:
    """A module."""

    name: str  # As declared
    declarations: int  # Index behind its head
    routines: dict[str, RapidRoutine] = field(default_factory=dict)  # By name in capitals
    data: dict[str, Declared] = field(default_factory=dict)  # The same
    # Components, name and type, of each record by its name in lower case
    records: dict[str, tuple[tuple[str, str], ...]] = field(default_factory=dict)
    aliases: dict[str, str] = field(default_factory=dict)  # Type behind an alias


class Modules:
    """Divides the text of a program into modules and routines.

    Raises:
        ProgramError: A file is no module, or a part of it is not closed.
    """

    def __init__(self, source: RapidSource, *, complete: bool) -> None:
        self.source = source
        self.modules: list[RapidModule] = []
        self._opened: tuple[str, RapidStatement] | None = None
        self._current: RapidRoutine | None = None
        self._record: list[tuple[str, str]] = []
        self._ended = True
        for statement in source.statements():
            if self._ended:
                self._head(statement)
            elif self._opened is None:
                self._ended = self._between(statement)
            else:
                self._within(*self._opened, statement)
        if not self.modules:
            raise ProgramError("the program is empty", where=f"{source.name}:1:1", hint="Post it again")
        if complete and not self._ended:
            self._refuse_cut_off()
        if self._current is not None:
            self._current.end = len(source.text)

    def _refuse_cut_off(self) -> None:
        source = self.source
        word = "ENDMODULE" if self._opened is None else _END_OF[self._opened[0]]
        raise ProgramError(
            f"the module stops without {word}: it may be cut off", where=source.where(max(0, len(source.text) - 1)),
            value=source.text.strip().splitlines()[-1].strip()[:60],
            hint="Post it again, or say --without-end if it is complete",
        )  # fmt: skip

    def _head(self, statement: RapidStatement) -> None:
        match = _MODULE.match(statement.code) if statement.structure else None
        begins = not self.modules or self.source.part(statement.start) != self.source.part(
            self.modules[-1].declarations
        )
        if match is None and begins:
            raise self._fault(
                "the file does not begin with MODULE", statement, limit="MODULE NAME",
                hint="Give the whole module (.mod)",
            )  # fmt: skip
        if match is None or not begins:
            raise self._fault("the module has ended before this", statement, hint="Give one module in a file")
        self.modules.append(RapidModule(match[1], statement.end))
        self._ended = False

    def _between(self, statement: RapidStatement) -> bool:
        """A statement outside of routines; whether the module ends here."""
        module = self.modules[-1]
        head = _ROUTINE.fullmatch(statement.code) if statement.structure else None
        if statement.structure and statement.word == "ENDMODULE":
            return True
        if head is not None:
            word = (head[2] or "FUNC").upper()
            self._opened = (word, statement)
            self._record = []
            self._current = None if word == "RECORD" else self._begun(head, word, statement)
        elif statement.word == "ALIAS":
            words = statement.code.split()
            if len(words) == 3:
                module.aliases[words[2].lower()] = words[1].lower()
        elif not self._declaration(statement, module.data):
            raise self._fault(
                "this stands outside of every routine", statement, limit="declarations and PROC",
                hint="The file may be damaged: post it again",
            )  # fmt: skip
        return False

    def _within(self, word: str, opened: RapidStatement, statement: RapidStatement) -> None:
        """A statement of a routine or record."""
        if statement.structure and statement.word == _END_OF[word]:
            if self._current is not None:
                self._current.end = statement.end
            else:
                self.modules[-1].records[opened.code.split()[-1].lower()] = tuple(self._record)
            self._opened = self._current = None
        elif statement.structure and (statement.word == "ENDMODULE" or _ROUTINE.fullmatch(statement.code)):
            raise self._fault(
                f"{_END_OF[word]} is missing before this", statement,
                limit=f"{word} in line {self.source.where(opened.start).rsplit(':', 1)[1]}",
                hint="The file may be damaged: post it again",
            )  # fmt: skip
        elif self._current is None:
            match = _COMPONENT.fullmatch(statement.code.strip())
            if match is not None:
                self._record.append((match[2].lower(), match[1].lower()))
        elif statement.structure or not self._declaration(statement, self._current.declared):
            self._current.statements.append(statement)

    def _declaration(self, statement: RapidStatement, into: dict[str, Declared]) -> bool:
        """Take a declaration; whether it is one."""
        match = DECLARATION.match(statement.code)
        if match is None:
            return False
        key = match[3].upper()
        if key in into:
            raise ProgramError(
                f"{match[3]} is declared twice", where=self.source.place(statement.start),
                limit=f"once; first in {self.source.where(into[key].start)}",
                hint="The file may be damaged: post it again",
            )  # fmt: skip
        value = statement.start + match.end() if match[5] else -1
        local = statement.code.lstrip()[:5].upper() == "LOCAL"
        into[key] = Declared(
            match[2].lower(), match[3], match[1].upper(), statement.start, value, statement.end, (match[4] or "")[1:-1],
            local,
        )  # fmt: skip
        return True

    def _begun(self, head: re.Match[str], word: str, statement: RapidStatement) -> RapidRoutine:
        name, module = head[4], self.modules[-1]
        if name.upper() in module.routines:
            raise self._fault(f"{name} is there twice", statement, hint="The file may be damaged: post it again")
        place = (statement.start + head.start(4), statement.start + head.end(4))
        routine = RapidRoutine(
            name, word, statement.start, statement.end, place, module,
            tuple(self._parameters((head[5] or "()")[1:-1], statement)), (head[1] or "").upper() == "LOCAL",
            self.source,
        )  # fmt: skip
        module.routines[name.upper()] = routine
        return routine

    def _parameters(self, text: str, statement: RapidStatement) -> list[RoutineParameter]:
        out, optional = [], False
        for piece in re.split(r"([,\\|])", text):
            if piece in (",", "\\", "|"):
                optional = piece == "\\" or (piece == "|" and optional)
                continue
            if not piece.strip():
                continue
            match = _PARAMETER.fullmatch(" ".join(piece.split()))
            if match is None:
                raise self._fault("a parameter that is not read", statement, hint="docs/rapid.md lists what is read")
            kind, name = (match[5] or match[2]).lower(), match[6] or match[3]
            out.append(RoutineParameter(name.upper(), kind, match[1] is not None, optional))
        return out

    # ---- names -----------------------------------------------------------------------------------------------

    @cached_property
    def _global(self) -> dict[str, RapidRoutine]:
        return {
            name: routine for module in self.modules for name, routine in module.routines.items() if not routine.local
        }

    def find(self, name: str, module: RapidModule) -> RapidRoutine | None:
        """A routine by name, as a module sees it."""
        return module.routines.get(name.upper()) or self._global.get(name.upper())

    def reachable(self) -> list[RapidRoutine]:
        """Return the routines that the program may execute: those whose names stand in it, and in those again."""
        by_name: dict[str, list[RapidRoutine]] = {}
        for module in self.modules:
            for name, routine in module.routines.items():
                by_name.setdefault(name, []).append(routine)
        whole = [routine for routines in by_name.values() for routine in routines]
        if any("%" in s.code or s.word == "CALLBYVAR" for routine in whole for s in routine.statements):
            return whole
        reached, waiting = [], [self.first()]
        while waiting:
            routine = waiting.pop()
            if routine in reached:
                continue
            reached.append(routine)
            names = {word.upper() for s in routine.statements for word in _WORDS.findall(s.code)}
            waiting += [other for name in names & by_name.keys() for other in by_name[name]]
        return reached

    def find_late(self, name: str, module: RapidModule) -> RapidRoutine | None:
        """A routine by a name at run time, which may name its module too: ``part_1:main``."""
        where, _, routine = name.rpartition(":")
        if not where:
            return self.find(name, module)
        holder = next((one for one in self.modules if one.name.upper() == where.upper()), None)
        return None if holder is None else holder.routines.get(routine.upper())

    def first(self) -> RapidRoutine:
        """The routine that is the program: ``main``, or the only one of the first module that no other calls.

        Raises:
            ProgramError: There is none, or more than one.
        """
        own = self.modules[0].routines
        if "MAIN" in own:
            return own["MAIN"]
        called = {
            match[0].upper()
            for routine in own.values()
            for statement in routine.statements
            for match in re.finditer(r"[A-Za-z]\w*", statement.code)
        }
        free = [
            routine
            for name, routine in own.items()
            if routine.kind == "PROC" and name not in called and not routine.parameters
        ]
        if len(free) != 1:
            raise ProgramError(
                "which routine is the program is not known", where=self.source.name,
                value=", ".join(routine.name for routine in free)[:60] or "none",
                limit="PROC main(), or one routine that no other calls",
                hint="Add PROC main() that calls them in order",
            )  # fmt: skip
        return free[0]

    def _fault(self, what: str, statement: RapidStatement, **more: str) -> ProgramError:
        value = " ".join(statement.code.split())[:60]
        return ProgramError(what, where=self.source.place(statement.start), value=value, **more)

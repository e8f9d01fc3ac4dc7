"""Routines of a RAPID module, and which of them is the program."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from counterflex.core.errors import ProgramError
from counterflex.programs.rapid.read import statements as form
from counterflex.programs.rapid.read.data import DECLARATION
from counterflex.programs.rapid.read.scanner import Source, Statement


@dataclass
class Routine:
    """A PROC.

    Attributes:
        name: As declared.
        start: Index of its first character.
        end: Index behind ENDPROC.
        place: Where its name stands.
        arguments: It has arguments.
        statements: Between its head and ENDPROC.
    """

    name: str
    start: int
    end: int
    place: tuple[int, int]
    arguments: bool
    statements: list[Statement] = field(default_factory=list)


class Routines:
    """Divides a module into routines.

    Args:
        source: The module.
        statements: Of it.
        complete: Refuse a text without ENDMODULE.

    Attributes:
        declarations: Index behind the head of the module.

    Raises:
        ProgramError: It is no module, or a part of it is not closed.
    """

    def __init__(self, source: Source, statements: Sequence[Statement], *, complete: bool) -> None:
        self.source = source
        self.declarations = 0
        self._proc: dict[str, Routine] = {}
        self._opened: tuple[str, Statement] | None = None
        self._current: Routine | None = None
        ended = False
        for index, statement in enumerate(statements):
            if index == 0:
                self._head(statement)
            elif ended:
                raise self._fault("the module has ended before this", statement, hint="Give one module in a file")
            elif self._opened is None:
                ended = self._between(statement)
            else:
                self._within(*self._opened, statement)
        if not statements:
            raise ProgramError("the program is empty", where=f"{source.name}:1:1", hint="Post it again")
        if complete and (self._opened is not None or not ended):
            word = "ENDMODULE" if self._opened is None else form.END_OF[self._opened[0]]
            raise ProgramError(
                f"the module stops without {word}: it may be cut off",
                where=f"{source.name}:{source.line(max(0, len(source.text) - 1))}",
                value=source.text.strip().splitlines()[-1].strip()[:60],
                hint="Post it again, or say --without-end if it is complete",
            )  # fmt: skip
        if self._current is not None:
            self._current.end = len(source.text)

    def _head(self, statement: Statement) -> None:
        if not statement.structure or not form.MODULE.match(statement.code):
            raise self._fault(
                "the file does not begin with MODULE", statement, limit="MODULE NAME",
                hint="Give the whole module (.mod)",
            )  # fmt: skip
        self.declarations = statement.end

    def _between(self, statement: Statement) -> bool:
        """A statement outside of routines; whether the module ends here."""
        head = form.ROUTINE.fullmatch(statement.code) if statement.structure else None
        if statement.structure and statement.word == "ENDMODULE":
            return True
        if head is not None:
            self._opened = (head[1].upper(), statement)
            self._current = self._begun(head, statement) if self._opened[0] == "PROC" else None
        elif not DECLARATION.match(statement.code) and statement.word != "ALIAS":
            raise self._fault(
                "this stands outside of every routine", statement, limit="declarations and PROC",
                hint="The file may be damaged: post it again",
            )  # fmt: skip
        return False

    def _within(self, word: str, opened: Statement, statement: Statement) -> None:
        """A statement of a routine."""
        if statement.structure and statement.word == form.END_OF[word]:
            if self._current is not None:
                self._current.end = statement.end
            self._opened = self._current = None
        elif statement.structure and (statement.word == "ENDMODULE" or form.ROUTINE.fullmatch(statement.code)):
            raise self._fault(
                f"{form.END_OF[word]} is missing before this", statement, limit=f"{word} in line {opened.line}",
                hint="The file may be damaged: post it again",
            )  # fmt: skip
        elif self._current is not None:
            self._current.statements.append(statement)

    def _begun(self, head: re.Match[str], statement: Statement) -> Routine:
        name = head[2]
        if name.upper() in self._proc:
            raise self._fault(f"{name} is there twice", statement, hint="The file may be damaged: post it again")
        place = (statement.start + head.start(2), statement.start + head.end(2))
        inside = (head[3] or "()")[1:-1].strip()
        self._proc[name.upper()] = Routine(name, statement.start, statement.end, place, bool(inside))
        return self._proc[name.upper()]

    def find(self, name: str) -> Routine | None:
        """A PROC by name."""
        return self._proc.get(name.upper())

    def first(self) -> Routine:
        """The routine that is the program: ``main``, or the only one that no other calls.

        Raises:
            ProgramError: There is none, or more than one.
        """
        if "MAIN" in self._proc:
            return self._proc["MAIN"]
        called = {
            match[1].upper()
            for routine in self._proc.values()
            for statement in routine.statements
            if (match := form.CALL.fullmatch(statement.code)) is not None
        }
        free = [routine for name, routine in self._proc.items() if name not in called and not routine.arguments]
        if len(free) != 1:
            raise ProgramError(
                "which routine is the program is not known", where=self.source.name,
                value=", ".join(routine.name for routine in free)[:60] or "none",
                limit="PROC main(), or one routine that no other calls",
                hint="Add PROC main() that calls them in order",
            )  # fmt: skip
        return free[0]

    def _fault(self, what: str, statement: Statement, **more: str) -> ProgramError:
        value = " ".join(statement.code.split())[:60]
        return ProgramError(what, where=self.source.place(statement.start), value=value, **more)

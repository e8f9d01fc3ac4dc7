"""Statements of a routine as a tree: branches, loops, labels, and what is executed by itself."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.integrations.abb.language.read.arithmetic import GRAMMAR
from counterflex.integrations.abb.language.read.scanner import RapidSource, RapidStatement
from counterflex.programs.expression import ExpressionError, Node, parse, parse_whole

_OPENS: Final = {"IF": "ENDIF", "FOR": "ENDFOR", "WHILE": "ENDWHILE", "TEST": "ENDTEST"}
_HANDLERS: Final = frozenset(("ERROR", "UNDO", "BACKWARD"))
_HEAD: Final = re.compile(r"(?:ELSE)?IF\b(.*)\bTHEN|WHILE\b(.*)\bDO|TEST\b(.*)|CASE\b(.*):", re.IGNORECASE | re.DOTALL)
_FOR: Final = re.compile(
    r"FOR\s+(\w+)\s+FROM\b(.*?)\bTO\b(.*?)(?:\bSTEP\b(.*?))?\bDO", re.IGNORECASE | re.DOTALL
)  # fmt: skip
_LABEL: Final = re.compile(r"(\w+)\s*:")


@dataclass(frozen=True, slots=True)
class Simple:
    """A statement that is executed by itself; ``index`` is its place among the statements of the routine."""

    statement: RapidStatement
    index: int
    guard: RapidStatement | None = None


@dataclass(frozen=True, slots=True)
class Label:
    """The target of GOTO."""

    statement: RapidStatement
    name: str


@dataclass(frozen=True, slots=True)
class Branch:
    """Statements and when they are executed; conditions of CASE are values, none at all is ELSE or DEFAULT."""

    statement: RapidStatement
    conditions: tuple[Node, ...]
    body: list[Tree]


@dataclass(frozen=True, slots=True)
class TestBlock:
    """IF, or TEST with the value that is compared."""

    statement: RapidStatement
    branches: list[Branch]
    value: Node | None = None


@dataclass(frozen=True, slots=True)
class LoopBlock:
    """WHILE with its condition, or FOR with its variable, first, last and step."""

    statement: RapidStatement
    variable: str
    values: tuple[Node, ...]
    body: list[Tree] = field(default_factory=list)


Tree = Simple | Label | TestBlock | LoopBlock


def tree_of(source: RapidSource, statements: Sequence[RapidStatement]) -> list[Tree]:
    """Return the statements of a routine as a tree, without its handlers of errors.

    Raises:
        ProgramError: A part is not closed, or closes nothing.
    """
    builder = _Builder(source, statements)
    return builder.body("")


class _Builder:
    def __init__(self, source: RapidSource, statements: Sequence[RapidStatement]) -> None:
        self.source, self.statements, self.at = source, statements, 0

    def body(self, closing: str, opened: RapidStatement | None = None) -> list[Tree]:
        """Statements up to a word that divides or closes the part, which stays."""
        out: list[Tree] = []
        while self.at < len(self.statements):
            statement = self.statements[self.at]
            if not statement.structure:
                out.append(self._simple(statement))
            elif statement.word in _OPENS:
                self.at += 1
                out.append(self._opened(statement))
                continue
            elif statement.word in _HANDLERS and not closing:
                self.at = len(self.statements)
                break
            elif closing and (statement.word == closing or statement.word in ("ELSE", "ELSEIF", "CASE", "DEFAULT")):
                return out
            elif (match := _LABEL.fullmatch(statement.code)) is not None and statement.word not in ("DEFAULT", "CASE"):
                out.append(Label(statement, match[1].upper()))
            elif statement.word in ("ELSE", "ELSEIF", "CASE", "DEFAULT"):
                raise self._fault("this belongs into IF or TEST", statement, "Post the program again")
            else:
                hint = "The file may be damaged: post it again"
                raise self._fault(f"{statement.word} closes nothing", statement, hint)
            self.at += 1
        if opened is not None:
            raise ProgramError(
                f"{opened.word} is not closed", where=self.source.where(opened.start),
                hint="The file may be cut off",
            )  # fmt: skip
        return out

    def _simple(self, statement: RapidStatement) -> Tree:
        if statement.word != "IF":
            return Simple(statement, self.at)
        try:
            condition, end = parse(statement.code, GRAMMAR, 2)
        except ExpressionError as fault:
            raise self._fault(f"no condition that is read: {fault}", statement, _READ) from fault
        start = end + len(statement.code[end:]) - len(statement.code[end:].lstrip())
        code = statement.code[start:]
        match = re.match(r"[\w%]+", code)
        at = statement.start + start
        inner = replace(
            statement,
            start=at,
            code=code,
            word="" if match is None else match[0].upper(),
            line=self.source.line(at) - self.source.part(at).first_line,
        )
        return TestBlock(statement, [Branch(statement, (condition,), [Simple(inner, self.at, statement)])])

    def _opened(self, statement: RapidStatement) -> Tree:
        word = statement.word
        if word == "FOR":
            match = _FOR.fullmatch(statement.code)
            if match is None:
                raise self._fault("no FOR that is read", statement, "FOR i FROM 1 TO 10 STEP 2 DO")
            values = tuple(self._parsed(text, statement) for text in match.groups()[1:] if text is not None)
            loop = LoopBlock(statement, match[1].upper(), values)
        elif word == "WHILE":
            loop = LoopBlock(statement, "", (self._condition(statement),))
        else:
            return self._choice(statement)
        loop.body.extend(self.body(_OPENS[word], statement))
        self._close(_OPENS[word])
        return loop

    def _choice(self, statement: RapidStatement) -> TestBlock:
        closing = _OPENS[statement.word]
        value = self._condition(statement) if statement.word == "TEST" else None
        branches, head = [], statement
        if value is not None:
            self.body(closing, statement)
            head = self.statements[self.at]
            self.at += head.word in ("CASE", "DEFAULT")
        while head.word != closing:
            conditions: tuple[Node, ...] = ()
            if head.word == "CASE":
                match = _HEAD.fullmatch(head.code)
                inside = "" if match is None else str(match[4])
                node = self._parsed(f"[{inside}]", head)
                conditions = tuple(item for _, item in getattr(node, "items", ()))
            elif head.word in ("IF", "ELSEIF"):
                conditions = (self._condition(head),)
            branches.append(Branch(head, conditions, self.body(closing, statement)))
            head = self.statements[self.at]
            self.at += head.word != closing
        self._close(closing)
        return TestBlock(statement, branches, value)

    def _close(self, closing: str) -> None:
        statement = self.statements[self.at]
        if statement.word != closing:
            raise self._fault(f"{statement.word} stands where {closing} is expected", statement, "Post it again")
        self.at += 1

    def _condition(self, statement: RapidStatement) -> Node:
        match = _HEAD.fullmatch(statement.code)
        text = "" if match is None else next(group for group in match.groups() if group is not None)
        return self._parsed(text, statement)

    def _parsed(self, text: str, statement: RapidStatement) -> Node:
        try:
            return parse_whole(text, GRAMMAR)
        except ExpressionError as fault:
            raise self._fault(f"no expression that is read: {fault}", statement, _READ) from fault

    def _fault(self, what: str, statement: RapidStatement, hint: str) -> ProgramError:
        value = " ".join(statement.code.split())[:60]
        return ProgramError(what, where=self.source.place(statement.start), value=value, hint=hint)


_READ: Final = "docs/rapid.md lists what is read"

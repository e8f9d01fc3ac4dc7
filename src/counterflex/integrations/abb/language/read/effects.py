"""Effects of statements that may or may not be executed: whether they matter to the path, and what they assign."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

from counterflex.integrations.abb.language.read.blocks import Label, LoopBlock, Simple, TestBlock, Tree
from counterflex.integrations.abb.language.read.routines import Modules, RapidRoutine
from counterflex.integrations.abb.language.read.scanner import RapidStatement
from counterflex.integrations.abb.language.table import CYCLIC, OUTPUTS, SETS_MOTION, TABLE
from counterflex.programs.expression import Aggregate, Call, Name, Node, Operator
from counterflex.programs.statement_table import Treatment

_ASSIGNMENT: Final = re.compile(r"([A-Za-z]\w*)\s*(?:\{[^}]*\}|\.\s*\w+)*\s*:=", re.IGNORECASE)
_CALLED: Final = re.compile(r"([A-Za-z]\w*)\s*\(")
_STRING: Final = re.compile(r'"[^"]*"')
_NO_FUNCTION: Final = frozenset(("AND", "OR", "XOR", "NOT", "DIV", "MOD", "RETURN", "CASE"))
"""Words that may stand in front of a parenthesis beside functions."""
_GOTO: Final = re.compile(r"GOTO\s+(\w+)\s*", re.IGNORECASE)
_CONNECT: Final = re.compile(r"CONNECT\s+(\w+)\s+WITH\s+(\w+)\s*", re.IGNORECASE)


@dataclass
class Effects:
    """Effects of statements on the path and on data."""

    # The first one that moves, or changes how later ones move; None where there is none
    matters: RapidStatement | None = None
    # Names that they assign something to, in capitals, each with the module of its routine; a name without module is
    # looked up where the statements stand
    assigned: set[tuple[RapidRoutine | None, str]] = field(default_factory=set)
    returns: bool = False  # A RETURN is among them
    jumps: set[str] = field(default_factory=set)  # Labels that they go to, outside of them
    ends: bool = False  # The program may end in them


class EffectsOf:
    """Finds effects of statements, those of the routines that they call included."""

    def __init__(self, modules: Modules, process: Callable[[RapidRoutine, Simple], bool]) -> None:
        self._modules, self._process = modules, process
        self._whole: dict[int, Effects] = {}

    def of_routine(self, routine: RapidRoutine) -> Effects:
        """Return the effects of a routine on what its caller sees."""
        known = self._whole.get(id(routine))
        if known is not None:
            return known
        self._whole[id(routine)] = Effects()  # a routine that calls itself adds nothing
        inner = self.of(routine.tree, routine)
        own = {*routine.declared, *(parameter.name for parameter in routine.parameters)}
        assigned: set[tuple[RapidRoutine | None, str]] = {
            (where or routine, name) for where, name in inner.assigned if where is not None or name not in own
        }
        out = Effects(inner.matters, assigned, ends=inner.ends)
        self._whole[id(routine)] = out
        return out

    def of(self, trees: Sequence[Tree], routine: RapidRoutine) -> Effects:
        """Return the effects of statements of a routine."""
        out = Effects()
        labels = {tree.name for tree in trees if isinstance(tree, Label)}
        for tree in trees:
            if isinstance(tree, Simple):
                self._simple(tree, routine, out)
            elif isinstance(tree, LoopBlock):
                self._nodes(tree.values, routine, out, tree.statement)
                self._add(out, self.of(tree.body, routine))
            elif isinstance(tree, TestBlock):
                self._nodes([tree.value] if tree.value is not None else [], routine, out, tree.statement)
                for branch in tree.branches:
                    self._nodes(branch.conditions, routine, out, tree.statement)
                    self._add(out, self.of(branch.body, routine))
        out.jumps -= labels
        return out

    def _add(self, out: Effects, inner: Effects) -> None:
        out.matters = out.matters or inner.matters
        out.assigned |= inner.assigned
        out.jumps |= inner.jumps
        out.returns |= inner.returns
        out.ends |= inner.ends

    def _nodes(self, nodes: Iterable[Node], routine: RapidRoutine, out: Effects, statement: RapidStatement) -> None:
        """Functions that expressions call."""
        for name in _calls_in(nodes):
            self._called(name, routine, out, statement)

    def _called(self, name: str, routine: RapidRoutine, out: Effects, statement: RapidStatement) -> None:
        called = self._modules.find(name, routine.module)
        if called is not None:
            inner = self.of_routine(called)
            out.matters = out.matters or (None if inner.matters is None else statement)
            out.assigned |= inner.assigned
            out.ends |= inner.ends
        elif TABLE.find(name) is None and name.upper() not in _NO_FUNCTION:
            out.matters = out.matters or statement  # a function of another module: it may move the robot

    def _simple(self, tree: Simple, routine: RapidRoutine, out: Effects) -> None:
        statement, code, word = tree.statement, tree.statement.code, tree.statement.word
        for match in _CALLED.finditer(_STRING.sub('""', code)):
            self._called(match[1], routine, out, statement)
        if self._process(routine, tree):
            out.matters = out.matters or statement
        elif (assignment := _ASSIGNMENT.match(code)) is not None:
            out.assigned.add((None, assignment[1].upper()))
        elif word in ("EXIT", "EXITCYCLE", "RAISE", "SYSTEMSTOPACTION"):
            out.ends = True
        elif word == "RETURN":
            out.returns = True
        elif (goto := _GOTO.fullmatch(code)) is not None:
            out.jumps.add(goto[1].upper())
        elif (connect := _CONNECT.fullmatch(code)) is not None:
            self._called(connect[2], routine, out, statement)
        else:
            self._instruction(statement, routine, out)

    def _instruction(self, statement: RapidStatement, routine: RapidRoutine, out: Effects) -> None:
        word = statement.word
        called = self._modules.find(word, routine.module)
        names = list(statement.names_given())
        if called is not None:
            self._called(word, routine, out, statement)
            if any(parameter.reference for parameter in called.parameters):
                out.assigned |= {(None, name) for _, _, name in names}
            return
        row = TABLE.find(word)
        if row is None or row.treatment is Treatment.REFUSED or word in SETS_MOTION:
            out.matters = out.matters or statement
            return
        out.assigned |= {(None, name) for position, option, name in names if is_output(word, position, option)}


def is_output(word: str, position: int, option: str) -> bool:
    """Return whether an instruction writes into an argument, by position or option."""
    places = OUTPUTS.get(word, ())
    return position in places or position == CYCLIC.get(word) or (option != "" and option in places)


def _calls_in(nodes: Iterable[Node]) -> Iterator[str]:
    for node in nodes:
        if isinstance(node, Call):
            yield node.name
            yield from _calls_in(node.arguments)
        elif isinstance(node, Operator):
            yield from _calls_in(node.operands)
        elif isinstance(node, Aggregate):
            yield from _calls_in(item for _, item in node.items)
        elif isinstance(node, Name):
            yield from _calls_in(index for step in node.path if not isinstance(step, str) for index in step)

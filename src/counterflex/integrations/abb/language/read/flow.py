"""Flow of a RAPID program: branches, loops and jumps, of which the condition is known or not."""

from __future__ import annotations

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.integrations.abb.language.read.blocks import Label, LoopBlock, Simple, TestBlock, Tree
from counterflex.integrations.abb.language.read.effects import Effects, EffectsOf
from counterflex.integrations.abb.language.read.memory import RapidMemory, RapidVariable, Reference
from counterflex.integrations.abb.language.read.routines import Modules, RapidRoutine
from counterflex.integrations.abb.language.read.scanner import RapidSource, RapidStatement
from counterflex.integrations.abb.language.table import FORMS
from counterflex.programs.expression import Node, is_number
from counterflex.programs.program import Motion
from counterflex.programs.unknown import Unknown

_NEAR: Final = 1e-5  # Share of the step of FOR within which its end may or may not be reached: num has 24 bits
_STILL: Final = 100_000  # Statements without a motion, at most: a second or two of computing time
WITHOUT: Final = "Post the path without this condition, or give its value in the text"


class Jump(Exception):
    """GOTO; ``unknown`` where whether it jumps is not known."""

    def __init__(self, label: str, statement: RapidStatement, unknown: Unknown | None = None) -> None:
        self.label, self.statement, self.unknown = label, statement, unknown


class Return(Exception):
    """RETURN, with the value of a function."""

    def __init__(self, value: object) -> None:
        self.value = value


class MayReturn(Exception):
    """A RETURN behind a condition that is not known."""

    def __init__(self, statement: RapidStatement, unknown: Unknown) -> None:
        self.statement, self.unknown = statement, unknown


class BlockEnd(Exception):
    """The program ends."""


class RapidFlow(ABC):
    """Executes parts of routines; mixed into the interpreter."""

    source: RapidSource
    memory: RapidMemory
    modules: Modules
    effects: EffectsOf
    acting: list[int]
    main_line: int
    now: RapidStatement
    _running: list[RapidRoutine]
    _seen: dict[int, int]
    _count: int
    _most: int
    _still: int
    _made: int
    motions: list[Motion]

    @abstractmethod
    def fault(self, what: str, statement: RapidStatement, **more: str) -> ProgramError:
        """Make an error of a statement."""

    @abstractmethod
    def _executed(self, tree: Simple) -> int:
        """Execute a statement with its block; returns how many statements that were."""

    # ---- parts -----------------------------------------------------------------------------------------------

    def body(self, trees: Sequence[Tree]) -> None:
        """Execute statements in order."""
        at, total = 0, len(trees)
        while at < total:
            tree = trees[at]
            try:
                if isinstance(tree, Simple):
                    skipped = self._executed(tree)
                    while at + 1 < total and skipped > 1 and _index(trees[at + 1]) < tree.index + skipped:
                        at += 1
                elif isinstance(tree, TestBlock):
                    self._choice(tree)
                elif isinstance(tree, LoopBlock):
                    self._loop(tree)
                at += 1
            except Jump as jump:
                target = next(
                    (i for i, other in enumerate(trees) if isinstance(other, Label) and other.name == jump.label), -1
                )
                if target < 0:
                    raise
                at = self._jumped(trees, at, target, jump)

    def _jumped(self, trees: Sequence[Tree], at: int, target: int, jump: Jump) -> int:
        """Index at which a list of statements goes on."""
        if jump.unknown is None:
            if target <= at:
                self._refuse_standstill(jump.statement)
            return target
        region = trees[at + 1 : target] if target > at else trees[target : at + 1]
        effects = self.effects.of(region, self._running[-1])
        if effects.matters is not None:
            self.refuse_unknown(effects.matters, jump.unknown, jump.statement)
        self.forget(effects, jump.unknown)
        return max(at + 1, target)

    def _refuse_standstill(self, statement: RapidStatement) -> None:
        """Refuse a way back to where the program was with the same data: it never ends."""
        if self._seen.get(statement.start) == self.memory.stamp:
            raise self._endless(statement)
        self._seen[statement.start] = self.memory.stamp

    def _endless(self, statement: RapidStatement) -> ProgramError:
        return self.fault(
            "this loop never ends", statement, limit="a program that ends",
            hint="Give the routine that makes one part as a program of its own",
        )  # fmt: skip

    def _choice(self, tree: TestBlock) -> None:
        self.tick(tree.statement)
        value: object = None
        if tree.value is not None:
            value = self._decided(tree.value, tree.statement)
        for number, branch in enumerate(tree.branches):
            verdict: object = True
            if branch.conditions:
                verdict = self._verdict(branch.conditions, tree.value is not None, value, branch.statement)
            if isinstance(verdict, Unknown):
                bodies = [tree for other in tree.branches[number:] for tree in other.body]
                self._undecided(tree.statement, bodies, verdict)
                return
            if verdict:
                self.body(branch.body)
                return

    def _verdict(self, conditions: Sequence[Node], compares: bool, value: object, statement: RapidStatement) -> object:
        """Return whether a branch is executed: True, False or Unknown."""
        unknown: Unknown | None = None
        for condition in conditions:
            given = self._decided(condition, statement)
            if isinstance(given, Unknown) or (compares and isinstance(value, Unknown)):
                unknown = unknown or (given if isinstance(given, Unknown) else value)  # type: ignore[assignment]
            elif (given == value) if compares else self._truth(given, statement):
                return True if unknown is None else unknown
        return False if unknown is None else unknown

    def _truth(self, value: object, statement: RapidStatement) -> bool:
        if not isinstance(value, bool):
            raise self.fault("the condition is no truth value", statement, limit="TRUE or FALSE", hint="Compare it")
        return value

    def _decided(self, node: Node, statement: RapidStatement) -> object:
        self.now = statement
        before, self.memory.deciding = self.memory.deciding, True
        try:
            return self.memory.value(node, statement.code, statement.start)
        finally:
            self.memory.deciding = before

    def _undecided(self, statement: RapidStatement, bodies: Sequence[Tree], unknown: Unknown) -> None:
        """Statements of which nobody knows whether they are executed: passed where they do not matter."""
        effects = self.effects.of(bodies, self._running[-1])
        if effects.matters is not None:
            self.refuse_unknown(effects.matters, unknown, statement)
        self.acting.append(self.main_line)
        self.forget(effects, unknown)
        if effects.jumps:
            if len(effects.jumps) > 1:
                raise self._unknown_condition(statement, statement, unknown)
            raise Jump(next(iter(effects.jumps)), statement, unknown)
        if effects.returns and len(self._running) > 1:
            raise MayReturn(statement, unknown)

    def forget(self, effects: Effects, unknown: Unknown) -> None:
        """Make unknown what statements assign that may be executed."""
        for reference in self.assigned_by(effects):
            self.memory.forget(reference, unknown)

    def assigned_by(self, effects: Effects) -> Iterator[Reference]:
        """Return the data that statements assign something to, as their own routines see them."""
        for routine, name in effects.assigned:
            if routine is None:
                reference = self.memory.find(name)
            else:
                with self._inside(routine):
                    reference = self.memory.find(name)
            if reference is not None:
                yield reference

    @contextlib.contextmanager
    def _inside(self, routine: RapidRoutine) -> Iterator[None]:
        """Names as a routine sees them that has no data of its own."""
        frames = self.memory.frames
        self.memory.frames = [self.memory.bare(routine)]
        try:
            yield
        finally:
            self.memory.frames = frames

    def refuse_unknown(self, matters: RapidStatement, unknown: Unknown, statement: RapidStatement) -> None:
        """Refuse a statement that matters to the path behind a condition that is not known."""
        raise self._unknown_condition(matters, statement, unknown)

    def _unknown_condition(self, matters: RapidStatement, statement: RapidStatement, unknown: Unknown) -> ProgramError:
        called = self.modules.find(matters.word, self._running[-1].module) is not None
        what = "a motion" if matters.word in FORMS else "a routine that moves" if called else "what sets the motions"
        return self.fault(
            f"{what} inside {statement.word} ({self.source.where(statement.start)}): whether and how often it is "
            f"executed is not known: {unknown}", matters, limit="conditions that follow from the text",
            hint=WITHOUT,
        )  # fmt: skip

    # ---- loops -----------------------------------------------------------------------------------------------

    def _loop(self, tree: LoopBlock) -> None:
        self.tick(tree.statement)
        if tree.variable:
            self._counted(tree)
            return
        condition = tree.values[0]
        effects = self.effects.of(tree.body, self._running[-1])
        first = True
        while True:
            verdict = self._decided(condition, tree.statement)
            if isinstance(verdict, Unknown):
                self._undecided(tree.statement, tree.body, verdict)
                return
            if not self._truth(verdict, tree.statement):
                return
            leaves = effects.returns or effects.jumps or effects.ends
            if first and not leaves and getattr(condition, "value", None) is True:
                raise self._endless(tree.statement)
            stamp, first = self.memory.stamp, False
            self.tick(tree.statement)
            self.body(tree.body)
            if stamp == self.memory.stamp:
                raise self._endless(tree.statement)

    def _range_of(self, tree: LoopBlock) -> tuple[float, float, float] | None:
        """First and last value of a FOR and its step; None where they are not known."""
        values = [self._decided(node, tree.statement) for node in tree.values]
        unknown = next((value for value in values if isinstance(value, Unknown)), None)
        if unknown is not None:
            self._undecided(tree.statement, tree.body, unknown)
            return None
        if not all(is_number(value) for value in values):
            raise self.fault("FOR counts by numbers", tree.statement, hint="FOR i FROM 1 TO 10 STEP 2 DO")
        first, last, *steps = (value for value in values if isinstance(value, int | float))
        step = steps[0] if steps else 1 if last >= first else -1
        if step == 0:
            raise self._endless(tree.statement)
        return first, last, step

    def _counted(self, tree: LoopBlock) -> None:
        counting = self._range_of(tree)
        if counting is None:
            return
        first, last, step = counting
        names = self.memory.frames[-1].names
        before = names.get(tree.variable)
        count = 0
        while True:
            value = first + count * step
            if value != last and abs(value - last) < _NEAR * abs(step):
                why = Unknown("the rounding of the controller decides how often it runs")
                self._undecided(tree.statement, tree.body, why)
                break
            if (value > last) if step > 0 else (value < last):
                break
            names[tree.variable] = Reference(RapidVariable(tree.variable, "num", (), value), (), "num")
            self.memory.stamp += 1
            self.tick(tree.statement)
            self.body(tree.body)
            count += 1
        if before is None:
            names.pop(tree.variable, None)
        else:
            names[tree.variable] = before

    def tick(self, statement: RapidStatement) -> None:
        """Count a statement, and refuse a program that does not end."""
        self._count += 1
        if len(self.motions) != self._made:
            self._made, self._still = len(self.motions), 0
        self._still += 1
        if self._count > self._most or self._still > _STILL:
            raise self.fault(
                "the program is too long, or does not end", statement,
                limit=f"{self._most} statements, {_STILL} without a motion",
                hint="Post the path without this loop",
            )  # fmt: skip


def _index(tree: Tree) -> int:
    """Place of the first statement of a tree in the routine, by its text."""
    return tree.index if isinstance(tree, Simple) else 1 << 60

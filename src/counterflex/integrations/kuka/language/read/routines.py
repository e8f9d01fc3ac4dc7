"""Routines of a KRL job: statements in their order, calls with arguments, values of expressions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.integrations.kuka.language.read import statements as form
from counterflex.integrations.kuka.language.read.frames import KrlCell
from counterflex.integrations.kuka.language.read.job import (
    Activation,
    KrlJob,
    KrlParameter,
    KrlRoutine,
    Module,
    Variable,
)
from counterflex.integrations.kuka.language.read.memory import KrlMemory
from counterflex.integrations.kuka.language.read.statements import Blocks, blocks_of
from counterflex.integrations.kuka.language.read.table import WORDS
from counterflex.integrations.kuka.language.read.values import Value, tree
from counterflex.programs.expression import Call, ExpressionError, Literal, Name, Node
from counterflex.programs.program import Block as Executed
from counterflex.programs.robot_text.execution import Execution
from counterflex.programs.unknown import Unknown

_MOST_STATEMENTS: Final = 2_000_000  # A program of 200 000 points executes 0.4 million statements
_LARGEST: Final = 2.0**31  # Limit of an INT
_DEEPEST: Final = 100
"""Calls within each other; KUKA's own limit of nested calls is lower (NEST_MAX of the interpreter)."""
FLOW: Final = {
    "IF": "_if", "ELSE": "_branch_ends", "ENDIF": "_nothing", "SWITCH": "_switch", "CASE": "_branch_ends",
    "DEFAULT": "_branch_ends", "ENDSWITCH": "_nothing", "FOR": "_for", "ENDFOR": "_end_for", "WHILE": "_while",
    "ENDWHILE": "_again", "LOOP": "_loop", "ENDLOOP": "_again", "REPEAT": "_repeat", "UNTIL": "_until", "EXIT": "_exit",
    "GOTO": "_goto", "LABEL:": "_nothing", "RETURN": "_return",
}  # fmt: skip
"""Method of each word of flow."""


class Routines(Execution, ABC):
    """Runs the routines of a job.

    Attributes:
        memory: Values of names.
        module: File of the statement that runs.
        line: Its line, 1-based.
    """

    def start(self, job: KrlJob, cell: KrlCell | None, *, complete: bool) -> None:
        """Set the state of a program that has not run yet."""
        self.job, self.complete = job, complete
        self.memory = KrlMemory(job, cell, lambda: f"{self.module.file.name}:{self.line}")
        self.memory.functions = self._function
        self.module: Module = job.main
        self.line = 0
        self._called: int | None = None  # motions behind the last routine that the statement has called
        self._main_line = 0
        self._executed = 0
        self._running: list[KrlRoutine] = []
        self._words_of: dict[str, list[str]] = {}
        self._blocks_of: dict[tuple[str, int], Blocks] = {}
        self._trees: dict[tuple[str, int, str], Node] = {}
        self._passed = 0
        self._result: Value = None
        self._next = 0

    # ---- routines --------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Execute the main routine."""
        routine = self.memory.here.routine
        self._before(routine)
        self._run(self.memory.here)

    def _before(self, routine: KrlRoutine) -> None:
        """Lines before the first DEF."""
        for line in range(1, routine.first + 1):
            self.line, code = line, self.module.codes[line - 1]
            word = self._word(line)
            if line < routine.first and code.strip() and not form.HEADER.match(code) and word not in (
                form.DECLARES, "EXT", "EXTP", "EXTFCT", "IMPORT", "SIGNAL", "STRUC", "ENUM"
            ):  # fmt: skip
                raise self._fault(
                    "the program does not begin with DEF", code, limit="DEF NAME ( )", hint="Give the whole .src file"
                )
            self._blocks.append(self._executed_line(line, len(self.motions)))
        if routine.result:
            raise self._fault(
                "the program does not begin with DEF", self.module.codes[routine.first - 1], limit="DEF NAME ( )",
                hint="Give the file of the main program: a function (DEFFCT) is called by one",
            )  # fmt: skip

    def _run(self, activation: Activation) -> None:
        """Execute a routine."""
        routine = activation.routine
        if len(self._running) >= _DEEPEST or routine in self._running:
            raise self._fault(
                "a subprogram calls itself", self._code, hint="Post the path without recursion"
            )  # fmt: skip
        self._running.append(routine)
        self.memory.here, self.module = activation, routine.module
        blocks = self._blocks_in(routine)
        self._lines(routine, blocks, routine.first + 1, routine.end)
        self._check_end(routine)
        self._running.pop()

    def _lines(self, routine: KrlRoutine, blocks: Blocks, first: int, end: int) -> None:
        """Execute lines from one on, until the line ``end``."""
        line, words, codes, lines = first, self._words_in(self.module), self.module.codes, self.module.lines
        main = len(self._running) == 1
        while line < end:
            self.line, self._words, self._called, self._next = line, [], None, line + 1
            if main:
                self._main_line = line
            word = words[line - 1]
            before, motions = self.modal("G1"), len(self.motions)
            code = codes[line - 1]
            if code and not code.isspace() and not self._process(code):
                self._count()
                if word in FLOW:
                    getattr(self, FLOW[word])(blocks, code, routine)
                else:
                    self._statement(word, code)
            motions = motions if self._called is None else self._called
            modal = self.modal("G1")
            if self._words or len(self.motions) > motions or modal != before:
                modal = self.modal(self.motion_code(motions))
            name = "" if self.module is self.job.main else self.module.file.name
            self._blocks.append(
                Executed(
                    line, lines[line - 1], tuple(self._words), modal, motions, len(self.motions) - motions, file=name
                )
            )
            line = self._next
        if end == routine.end and line <= len(lines) and routine.closed:
            self.line, self._words = end, []
            self._blocks.append(self._executed_line(end, len(self.motions)))

    def _executed_line(self, line: int, motions: int) -> Executed:
        name = "" if self.module is self.job.main else self.module.file.name
        return Executed(line, self.module.lines[line - 1], (), self.modal("G1"), motions, 0, file=name)

    def _count(self) -> None:
        self._executed += 1
        if self._executed > _MOST_STATEMENTS:
            raise self._fault(
                "the program executes more statements than any part needs: it may never end", self._code,
                limit=f"{_MOST_STATEMENTS}", hint="Post one pass of the path",
            )  # fmt: skip

    def _call(self, routine: KrlRoutine, arguments: Sequence[Node | None]) -> Value:
        """Execute a routine with arguments; returns what its RETURN gives."""
        if len(arguments) > len(routine.parameters):
            raise self._fault(
                f"{routine.name} is called with more arguments than it has parameters", self._code,
                limit=f"{len(routine.parameters)}", hint="Post the program again",
            )  # fmt: skip
        caller, module, line, words, following = self.memory.here, self.module, self.line, self._words, self._next
        activation = Activation(routine)
        given = [
            (parameter, node, self._pass(activation, parameter, node))
            for parameter, node in zip(routine.parameters, arguments, strict=False)
        ]
        for parameter in routine.parameters[len(arguments) :]:
            self._give(activation, parameter, Unknown(f"{routine.name} is called without it", self.memory.where()))
        result, self._result = (
            self._result,
            Unknown(f"{routine.name} gives no value", f"{routine.module.file.name}:{routine.end}"),
        )
        if self.memory.doubt is None:
            self._run(activation)
        else:
            self._sweep_routine(activation)
        value, self._result = self._result, result
        self.memory.here, self.module, self.line, self._words = caller, module, line, words
        self._called, self._next = len(self.motions), following
        for parameter, node, before in given:
            by_value = isinstance(node, Name) and not parameter.passing and parameter.name in activation.local
            if by_value and isinstance(node, Name) and activation.local[parameter.name].values[()] != before:
                cause = f"{routine.name} changes it, and does not say whether {parameter.name} is IN or OUT"
                self.memory.forget(node.text, self._path_of(node), Unknown(cause, self.memory.where()))
        return value

    def _path_of(self, node: Name) -> list[object]:
        steps = [
            step if isinstance(step, str) else tuple(self.value(item, self._code) for item in step)
            for step in node.path
        ]
        return [step for step in steps if step != ()]

    def _pass(self, activation: Activation, parameter: KrlParameter, node: Node | None) -> Value:
        """Give a parameter its argument; returns the value of one by value."""
        whole = isinstance(node, Name) and () in node.path  # an array, which is passed by reference
        if isinstance(node, Name) and (parameter.passing == "OUT" or whole):
            activation.references[parameter.name] = (self.memory.here, node.text.upper(), self._path_of(node))
            return None
        if node is None:
            value: Value = Unknown("an argument is left out", self.memory.where())
        else:
            value = self.value(node, self._code)
        self._give(activation, parameter, value)
        return value

    @staticmethod
    def _give(activation: Activation, parameter: KrlParameter, value: Value) -> None:
        activation.local[parameter.name] = Variable("", {}, {(): value})

    def _function(self, name: str, values: Sequence[Value]) -> Value:
        """A function within an expression, whose arguments are values."""
        routine = self.job.routine(name, self.module, self.memory.where())
        if routine is None:
            return self._library(name, [])
        return self._call(routine, [_constant(value) for value in values])

    # ---- values ----------------------------------------------------------------------------------------------

    def value(self, node: Node, code: str) -> Value:
        """Value of an expression of a statement; a call of a function of the job is executed.

        Raises:
            ProgramError: It is not understood.
        """
        try:
            if isinstance(node, Call):
                routine = self.job.routine(node.name, self.module, self.memory.where())
                if routine is not None:
                    return self._call(routine, node.arguments)
                if self._is_library(node.name):
                    return self._library(node.name, node.arguments)
            return self.memory.evaluate(node)
        except (ExpressionError, OverflowError) as error:
            raise self._fault(f"this is not understood: {error}", code) from error

    def _tree(self, text: str, code: str) -> Node:
        """The tree of an expression; of a line that was executed before it is kept."""
        key = self.module.file.name, self.line, text
        if key not in self._trees:
            try:
                node = tree(text)
            except ExpressionError as error:
                raise self._fault(f"this is not understood: {error}", code) from error
            if len(self._trees) > 100_000:
                self._trees.clear()
            self._trees[key] = node
        return self._trees[key]

    def _condition(self, code: str) -> Value:
        match = form.CONDITION.fullmatch(code)
        text = None if match is None else (match[1] or match[2])
        if not text:
            raise self._fault("a condition is missing", code, limit="IF N>0 THEN", hint="The line may be cut off")
        return self.value(self._tree(text, code), code)

    def _number(self, value: Value, code: str, what: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < _LARGEST:
            raise self._fault(f"{what} is no number in range", code)
        return value

    # ---- text ------------------------------------------------------------------------------------------------

    def _words_in(self, module: Module) -> list[str]:
        name = module.file.name
        if name not in self._words_of:
            self._words_of[name] = [form.word_of(code, WORDS) for code in module.codes]
        return self._words_of[name]

    def _word(self, line: int) -> str:
        return self._words_in(self.module)[line - 1]

    def _blocks_in(self, routine: KrlRoutine) -> Blocks:
        if routine.key not in self._blocks_of:
            words, fault = self._words_in(routine.module), routine.module.fault
            self._blocks_of[routine.key] = blocks_of(words, routine.module.codes, routine.first + 1, routine.end, fault)
        return self._blocks_of[routine.key]

    @property
    def _code(self) -> str:
        return self.module.codes[self.line - 1] if self.line else ""

    def at(self, code: str) -> str:
        """File, line and column of the statement that runs."""
        return f"{self.module.file.name}:{self.line}:{len(code) - len(code.lstrip()) + 1}"

    def _fault(self, what: str, code: str, **more: str) -> ProgramError:
        return ProgramError(what, where=self.at(code), value=code.strip()[:60], **more)

    # ---- statements ------------------------------------------------------------------------------------------

    @abstractmethod
    def _statement(self, word: str, code: str) -> None:
        """Execute a statement that is none of flow."""

    @abstractmethod
    def _check_end(self, routine: KrlRoutine) -> None:
        """Refuse a routine that ends where it should not."""

    @abstractmethod
    def _process(self, code: str) -> bool:
        """Execute a statement of ``[controller.spindle.krl]``; returns whether it is one, or a later line of one."""

    @abstractmethod
    def _is_library(self, name: str) -> bool:
        """Return whether the table has a function of a library with this name."""

    @abstractmethod
    def _library(self, name: str, arguments: Sequence[Node]) -> Value:
        """Value of a function that is not in the files of the job."""

    @abstractmethod
    def _sweep_routine(self, activation: Activation) -> None:
        """Look at each statement of a routine once, in doubt."""


def _constant(value: Value) -> Node:
    return Literal(value, 0, 0)

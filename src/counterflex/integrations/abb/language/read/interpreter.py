"""Executes a RAPID program: branches, loops, routines with arguments, data, and the statements of its table."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.integrations.abb.language.program import RoutineCall
from counterflex.integrations.abb.language.read.blocks import Simple
from counterflex.integrations.abb.language.read.calls import Calls, Given
from counterflex.integrations.abb.language.read.effects import EffectsOf, is_output
from counterflex.integrations.abb.language.read.flow import WITHOUT, BlockEnd, Jump, MayReturn, RapidFlow, Return
from counterflex.integrations.abb.language.read.frames import RapidCell, RapidFrames
from counterflex.integrations.abb.language.read.instructions import HANDLERS, Instructions
from counterflex.integrations.abb.language.read.literals import arguments
from counterflex.integrations.abb.language.read.memory import RapidMemory, Reference
from counterflex.integrations.abb.language.read.routines import Modules, RapidRoutine
from counterflex.integrations.abb.language.read.scanner import RapidSource, RapidStatement, statements_of
from counterflex.integrations.abb.language.read.targets import RapidTargets
from counterflex.integrations.abb.language.table import ACTS, FORMS, TABLE
from counterflex.programs.expression import ExpressionError, is_number
from counterflex.programs.gcode.read.flow import split_lines
from counterflex.programs.program import Block, Word
from counterflex.programs.robot_text.process_words import ProcessWord, ProcessWords
from counterflex.programs.statement_table import Treatment
from counterflex.programs.unknown import Unknown, known

_MOST: Final = 200_000
"""Statements that loops and routines may execute in addition to those of the text: seconds of computing time."""
_DEEPEST: Final = 30
_COMPUTED: Final = re.compile(r"-?\s*([A-Za-z]\w*)(?:\{[\w,]+\}|\.\w+)*(?:\s*[-+*/]\s*[\w.]+)?")
"""An argument that may be a number: a name, and what is added to it."""
_LONGEST: Final = 8  # Statements of a machine function at most, for those whose numbers are computed
_ASSIGNMENT: Final = re.compile(r"([A-Za-z]\w*(?:\s*\{[^}]*\}|\s*\.\s*\w+)*)\s*:=", re.DOTALL)


class RapidInterpreter(RapidFlow, Instructions, Calls):
    """State of the controller while a program runs."""

    def __init__(self, source: RapidSource, modules: Modules, cell: RapidCell | None, part_object: str = "") -> None:
        self.source, self.modules, self.cell, self._lines = source, modules, cell, split_lines(source.text)
        self.memory = RapidMemory(source, modules)
        self.memory.evaluator = self
        self.frames: RapidFrames = RapidFrames(cell, self.memory, part_object)
        super().__init__(self.frames)
        self.targets = RapidTargets(self.memory, cell, lambda: len(self.motions))
        self.process = None if cell is None else ProcessWords(cell.functions, lambda code: code, statements_of)
        self.effects = EffectsOf(modules, self._begins_function)
        self._running: list[RapidRoutine] = []
        self._most = _MOST + sum(len(r.statements) for module in modules.modules for r in module.routines.values())
        self._count, self._still, self._made, self.main_line = 0, 0, 0, 1
        self.here: list[int] | None = None  # Index of the block of the statement that is executed, alone in a list
        self._seen: dict[int, int] = {}

    @classmethod
    def executed(
        cls,
        source: RapidSource,
        modules: Modules,
        cell: RapidCell | None,
        part_object: str,
        kept_from: Mapping[int, object] | None,
    ) -> RapidInterpreter:
        """Return the state after the program has run, with the values that persistent data begins with."""
        interpreter = cls(source, modules, cell, part_object)
        interpreter.memory.kept_from = kept_from
        interpreter.run()
        return interpreter

    def run(self) -> None:
        """Execute the program.

        Raises:
            ProgramError: See :func:`~counterflex.integrations.abb.language.read.reader.read_rapid`.
        """
        with contextlib.suppress(BlockEnd):
            self.execute(self.modules.first(), {}, set(), (0, 0))
        self.finish()

    # ---- routines --------------------------------------------------------------------------------------------

    def execute(
        self, routine: RapidRoutine, names: dict[str, Reference], absent: set[str], place: tuple[int, int]
    ) -> object:
        """Execute a routine with its arguments; returns its value, None of a PROC.

        Raises:
            ProgramError: Something in it is refused.
        """
        if len(self._running) >= _DEEPEST or (routine in self._running and not routine.parameters):
            raise ProgramError(
                f"{routine.name} calls itself", where=self.source.place(place[0]), value=routine.name,
                limit=f"routines {_DEEPEST} deep", hint="Post the path without recursion",
            )  # fmt: skip
        parent, now, guard, words, here = self._call, self.now, self.guard, self._words, self.here
        self.calls.append(RoutineCall(routine.name, routine.start, routine.end, routine.place, parent, place))
        self._call = len(self.calls) - 1
        self._running.append(routine)
        self.memory.enter(routine, names, absent)
        value: object = None
        try:
            self.body(routine.tree)
        except Return as result:
            value = result.value
        except MayReturn as may:
            value = self._left_perhaps(routine, may)
        except Jump as jump:
            raise self.fault(
                f"the label {jump.label.lower()} is not in the same part of the routine", jump.statement,
                hint="The file may be damaged: post it again",
            ) from None  # fmt: skip
        finally:
            self.memory.leave()
            self._running.pop()
        self._call, self.now, self.guard = parent, now, guard
        if here is not None and routine.kind == "FUNC":  # the statement that asks for its value goes on
            block = self._blocks[here[0]]
            here[0], self.here, self._words = len(self._blocks), here, words
            self._blocks.append(replace(block, first_motion=len(self.motions)))
        return value

    def _left_perhaps(self, routine: RapidRoutine, may: MayReturn) -> object:
        """A RETURN of which nobody knows whether it is executed: the rest of the routine is passed."""
        effects = self.effects.of_routine(routine)
        if len(self._running) == 1:
            return None
        if effects.matters is not None:
            self.refuse_unknown(effects.matters, may.unknown, may.statement)
        self.forget(effects, may.unknown)
        return may.unknown

    # ---- statements ------------------------------------------------------------------------------------------

    def _begins_function(self, routine: RapidRoutine, tree: Simple) -> bool:
        """Return whether a machine function begins at a statement."""
        if self.process is None or tree.statement.word in FORMS:
            return False
        texts, at = ([tree.statement.code], 0) if tree.guard is not None else (routine.texts, tree.index)
        return self.process.find(texts, at, self.source.where(tree.statement.start)) is not None

    def _function(self, tree: Simple) -> ProcessWord | None:
        """The machine function that begins at a statement, its numbers written or computed."""
        if self.process is None or tree.statement.word in FORMS:
            return None
        texts, at = self._running[-1].texts, tree.index
        if tree.guard is not None:
            texts, at = [tree.statement.code], 0
        where = self.source.where(tree.statement.start)
        function = self.process.find(texts, at, where)
        if function is not None or ":=" in tree.statement.code:
            return function
        lost: list[Unknown] = []
        valued = [
            *texts[:at],
            *(self._with_values(text, lost) for text in texts[at : at + _LONGEST]),
            *texts[at + _LONGEST :],
        ]
        function = None if valued == texts else self.process.find(valued, at, where)
        if function is not None and lost:
            known(lost[0], "a number of this machine function", where, text=tree.statement.code)
        return function

    def _with_values(self, text: str, lost: list[Unknown]) -> str:
        """A statement with the numbers that its arguments stand for; an unknown one counts as 1, and is noted."""
        head = re.match(r"\s*[A-Za-z]\w*\s+", text)
        if head is None or ":=" in text:
            return text
        parts = []
        for argument in arguments(text, head.end(), len(text)):
            name = _COMPUTED.fullmatch(argument.text)
            declared = name is not None and self.memory.find(name[1]) is not None
            value = self.memory.evaluated(argument.text, self.now.start) if declared else None
            if isinstance(value, Unknown):
                lost.append(value)
                value = 1
            parts.append(f"{float(value):.9g}" if is_number(value) else argument.text)  # type: ignore[arg-type]
        return head[0] + ",".join(parts)

    def _executed(self, tree: Simple) -> int:
        """Execute a statement with its block; returns how many statements that were."""
        statement = self.now = tree.statement
        self.tick(statement)
        self.guard = tree.guard
        self._words = []
        first, count, here = len(self.motions), 1, [len(self._blocks)]
        before, part = self.state("G1"), self.source.part(statement.start)
        text, file = self._lines[part.first_line + statement.line - 1], "" if part.start == 0 else part.name
        self.main_line = self.main_line if file else statement.line
        self._blocks.append(Block(statement.line, text, (), before, first, 0, file=file))
        self.here = here
        try:
            function = self._function(tree)
            if function is not None:
                self.do(function)
                count = function.lines
            else:
                self._statement(statement)
        except ExpressionError as fault:
            raise self.fault(
                f"this cannot be evaluated: {fault}", self.now, limit="values that fit together",
                hint="Check types, indices and sizes",
            ) from fault  # fmt: skip
        finally:
            self.here = None
        if len(self._blocks) == here[0] + 1:  # no call, whose statements have blocks of their own
            made = len(self.motions) - first
            if made or self._words:
                state = self.state(self.motion_code(first))
                self._blocks[here[0]] = Block(statement.line, text, tuple(self._words), state, first, made, file=file)
        return count

    def _statement(self, statement: RapidStatement) -> None:
        word = statement.word
        if word in FORMS:
            self.motion(statement, word)
            return
        match = _ASSIGNMENT.match(statement.code)
        if match is not None:
            self._assign(statement, match)
            return
        if word in LEAVING:
            self._leave(statement, word)
            return
        if word.startswith("%") or word == "CALLBYVAR":
            self._late(statement, word)
            return
        routine = self.modules.find(word, self._running[-1].module)
        if routine is not None:
            length = len(word)
            given = Given.of_instruction(self.source.code, statement.start + length, statement.end)
            self.call_routine(routine, given, (statement.start, statement.start + length))
            return
        self._instruction(statement, word)

    def _instruction(self, statement: RapidStatement, word: str) -> None:
        row = TABLE.find(word)
        if row is None:
            raise self.fault(
                "an instruction or routine that is not known, which may move the robot", statement,
                limit="docs/statements/rapid.md lists what is read; a PROC of the modules of the folder; a statement "
                "of [controller.spindle.rapid] in the cell file",
                hint="Put the module with the routine into the folder of the program, or name the statement in the "
                "table (m_codes) if it moves nothing",
            )  # fmt: skip
        if row.treatment is Treatment.REFUSED:
            raise self.fault(f"{row.word}: {row.reason}", statement, hint=row.remedy)
        if word in ACTS:
            self.acting.append(self.main_line)
        handler = HANDLERS.get(word)
        if handler is not None:
            handler(self, statement, arguments(self.source.code, statement.start + len(word), statement.end))
        for position, option, name in statement.names_given():
            if is_output(word, position, option):
                self._forget_output(name, row.word, statement)

    def _forget_output(self, name: str, word: str, statement: RapidStatement) -> None:
        reference = self.memory.find(name)
        if reference is not None:
            self.memory.forget(reference, Unknown(f"{word} sets {name.lower()}", self.source.where(statement.start)))

    def _assign(self, statement: RapidStatement, match: re.Match[str]) -> None:
        memory = self.memory
        value = memory.evaluated(statement.code[match.end() :], statement.start + match.end())
        target = memory.node(match[1], statement.start)
        try:
            reference = memory.reference(target)
        except ValueError as fault:
            raise self.fault(f"this cannot be assigned: {fault}", statement, hint="Check names and indices") from fault
        if isinstance(value, Unknown) and not value.where:
            value = Unknown(value.why, self.source.where(statement.start))
        if reference is not None and reference.variable.name != "":
            memory.assign(reference, value)

    def _leave(self, statement: RapidStatement, word: str) -> None:
        if word == "RETURN":
            text = statement.code[len("RETURN") :]
            value = self.memory.evaluated(text, statement.start + len("RETURN")) if text.strip() else None
            raise Return(value)
        if word == "GOTO":
            raise Jump(statement.code[len("GOTO") :].strip().upper(), statement)
        if word in ("EXIT", "EXITCYCLE"):
            raise BlockEnd
        if word == "STOP":
            self._words.append(Word("M", 0.0, 0, 0))
        elif word != "BREAK":
            raise self.fault(
                f"{word} stands where it always acts: the handler of errors decides what follows", statement,
                hint="Post the path without it",
            )  # fmt: skip

    def _late(self, statement: RapidStatement, word: str) -> None:
        """A routine whose name is computed: ``%"part" + NumToStr(n,0)%``, ``CallByVar "part",n``."""
        code, start = statement.code, statement.start
        if word == "CALLBYVAR":
            given = arguments(self.source.code, start + len(word), statement.end)
            parts = [self.memory.evaluated(one.text, one.start) for one in given]
            name = known(parts, "the routine", self.source.place(start), text=code, hint=WITHOUT)
            text, behind = "".join(str(part) for part in name), len(code)
        else:
            behind = code.find("%", 1) + 1
            if behind <= 0:
                raise self.fault("an unknown statement", statement, hint="docs/rapid.md lists what is read")
            value = self.memory.evaluated(code[1 : behind - 1], start + 1)
            text = str(known(value, "the routine", self.source.place(start), text=code, hint=WITHOUT))
        routine = self.modules.find_late(text, self._running[-1].module)
        if routine is None:
            raise self.fault(
                f"the routine {text} is not in the files of the program", statement,
                hint="Put its module into the folder of the program, or name the modules in a .pgf",
            )  # fmt: skip
        given_here = Given.of_instruction(self.source.code, start + behind, statement.end)
        self.call_routine(routine, given_here, (start, start + behind))

    def fault(self, what: str, statement: RapidStatement, **more: str) -> ProgramError:
        """Make an error of a statement."""
        value = " ".join(statement.code.split())[:60]
        return ProgramError(what, where=self.source.place(statement.start), value=value, **more)


LEAVING: Final = frozenset(("RETURN", "GOTO", "EXIT", "EXITCYCLE", "STOP", "BREAK", "RAISE", "RETRY", "TRYNEXT"))


def replaced(calls: Sequence[RoutineCall]) -> list[RoutineCall]:
    """Return the calls, with those of routines that are executed more than once marked."""
    times: dict[str, int] = {}
    for call in calls:
        times[call.routine.upper()] = times.get(call.routine.upper(), 0) + 1
    return [replace(call, repeated=times[call.routine.upper()] > 1) for call in calls]

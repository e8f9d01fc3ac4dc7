"""Control flow of a KRL job: routines, branches, loops and jumps.

Where a condition is not known, its branches are swept: every statement in them is looked at once, in doubt. A variable
that is set there becomes unknown; a motion or a machine function there is refused.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.integrations.kuka.language.read import statements as form
from counterflex.integrations.kuka.language.read.job import Activation, KrlRoutine
from counterflex.integrations.kuka.language.read.routines import FLOW, Routines
from counterflex.integrations.kuka.language.read.statements import Blocks, StatementBlock
from counterflex.integrations.kuka.language.read.values import GRAMMAR, Value
from counterflex.programs.expression import ExpressionError, parse
from counterflex.programs.unknown import Unknown, known

_MOST_PASSES: Final = 20_000
"""Passes of WHILE, LOOP, REPEAT and backward GOTO: 100 levels of 200 rows; a loop without end stops within seconds."""
_MOST_COUNTED: Final = 1_000_000  # Passes of one FOR loop: more points than any part has


class KrlFlow(Routines):
    """Executes branches, loops and jumps."""

    # ---- branches --------------------------------------------------------------------------------------------

    def _if(self, blocks: Blocks, code: str, routine: KrlRoutine) -> None:
        block = blocks.of[self.line]
        value = self._condition(code)
        if isinstance(value, Unknown):
            self._branch_in_doubt(blocks, block, value, routine)
        elif not value:
            self._next = (block.branches[0] if block.branches else block.end) + 1

    def _switch(self, blocks: Blocks, code: str, routine: KrlRoutine) -> None:
        block = blocks.of[self.line]
        value = self._condition(code)
        if isinstance(value, Unknown):
            self._branch_in_doubt(blocks, block, value, routine)
            return
        chosen = block.end
        for line in block.branches:
            case = form.CASE.match(self.module.codes[line - 1])
            if case is None:
                chosen = line
                break
            choices = self._choices(case[1], line)
            unknown = next((choice for choice in choices if isinstance(choice, Unknown)), None)
            if unknown is not None:
                self._branch_in_doubt(blocks, block, unknown, routine)
                return
            if value in choices:
                chosen = line
                break
        self._next = chosen + 1

    def _choices(self, text: str, line: int) -> list[Value]:
        out, at = [], 0
        while text[at:].strip():
            try:
                node, at = parse(text, GRAMMAR, at)
            except ExpressionError as error:
                raise self._fault(f"a case is not understood: {error}", self.module.codes[line - 1]) from error
            out.append(self.value(node, text))
            at = at + 1 if text[at:].lstrip()[:1] == "," and text[at : at + 1] == "," else at + len(text[at:]) - len(
                text[at:].lstrip(" ,"))  # fmt: skip
        return out

    def _branch_ends(self, blocks: Blocks, code: str, routine: KrlRoutine) -> None:
        """ELSE, CASE or DEFAULT reached from the branch before it."""
        del code, routine
        self._next = blocks.of[self.line].end + 1

    def _nothing(self, blocks: Blocks, code: str, routine: KrlRoutine) -> None:
        del blocks, code, routine

    # ---- loops -----------------------------------------------------------------------------------------------

    def _for(self, blocks: Blocks, code: str, routine: KrlRoutine) -> None:
        block, match = blocks.of[self.line], form.FOR.fullmatch(code)
        if match is None:
            raise self._fault("this loop is not understood", code, limit="FOR I=1 TO 10 STEP 1")
        texts = (match[2], match[3], match[4] or "1")
        values = [self.value(self._tree(text, code), code) for text in texts]
        unknown = next((value for value in values if isinstance(value, Unknown)), None)
        if unknown is not None:
            self._loop_in_doubt(blocks, block, unknown, routine)
            return
        first, last, step = (self._number(value, code, "a limit of the loop") for value in values)
        if step == 0:
            raise self._fault("a loop with steps of 0 never ends", code)
        if (last - first) / step > _MOST_COUNTED:
            raise self._fault(
                "a loop makes more passes than any part has points", code, limit=f"{_MOST_COUNTED}",
                hint="Post one pass of the path",
            )  # fmt: skip
        self.memory.assign(match[1], (), round(first))
        self.memory.here.counters[block.start] = last, step
        if (first > last) if step > 0 else (first < last):
            self._next = block.end + 1

    def _end_for(self, blocks: Blocks, code: str, routine: KrlRoutine) -> None:
        del code, routine
        block = blocks.of[self.line]
        head = form.FOR.fullmatch(self.module.codes[block.start - 1])
        if head is None:
            raise ValueError("a loop without its head")
        counter = self.memory.value_of(head[1], ())
        last, step = self.memory.here.counters[block.start]
        value = known(counter, "the counter of the loop", self.memory.where(), text=head[0])
        if not isinstance(value, int | float):
            raise self._fault("the counter of a loop is no number", head[0])
        self.memory.assign(head[1], (), value + round(step))
        again = value + step <= last if step > 0 else value + step >= last
        self._next = block.start + 1 if again else block.end + 1

    def _while(self, blocks: Blocks, code: str, routine: KrlRoutine) -> None:
        block, value = blocks.of[self.line], self._condition(code)
        if isinstance(value, Unknown):
            self._loop_in_doubt(blocks, block, value, routine)
        elif value:
            self._passes(blocks, block)
        else:
            self.memory.here.passes.pop(block.start, None)
            self._next = block.end + 1

    def _loop(self, blocks: Blocks, code: str, routine: KrlRoutine) -> None:
        del code, routine
        self._passes(blocks, blocks.of[self.line])

    def _passes(self, blocks: Blocks, block: StatementBlock) -> None:
        """Begin a pass; refuse a loop that nothing leaves, or whose last pass changed no value."""
        constant = (
            block.word == "LOOP"
            or self.module.codes[block.start - 1].upper().split("WHILE", 1)[-1].strip(" ()") == "TRUE"
        )
        never = constant and block.start not in blocks.leaves
        if never or self.memory.here.passes.get(block.start) == self.memory.changes:
            raise ProgramError(
                f"{block.word} never ends: " + ("nothing leaves it" if never else "a pass changes no value"),
                where=f"{self.module.file.name}:{block.start}",
                value=self.module.codes[block.start - 1].strip()[:60],
                limit="a loop with an end that follows from the program", hint="Post one pass of the path",
            )  # fmt: skip
        self._pass_of(block.start)

    def _pass_of(self, line: int) -> None:
        self.memory.here.passes[line] = self.memory.changes
        self._passed += 1
        if self._passed > _MOST_PASSES:
            raise self._fault(
                "loops of the program are passed more often than any part needs: they may never end", self._code,
                limit=f"{_MOST_PASSES}", hint="Post one pass of the path",
            )  # fmt: skip

    def _repeat(self, blocks: Blocks, code: str, routine: KrlRoutine) -> None:
        del blocks, code, routine
        self._pass_of(self.line)

    def _until(self, blocks: Blocks, code: str, routine: KrlRoutine) -> None:
        block, value = blocks.of[self.line], self._condition(code)
        if isinstance(value, Unknown):
            self.acting.append(self._main_line)
            end = self.line
            self._sweep(blocks, block.start + 1, end, self._doubt(value, block), routine)
            self._next = end + 1
        elif not value:
            if self.memory.here.passes.get(block.start) == self.memory.changes:
                raise self._fault("REPEAT never ends: a pass changes no value", code, hint="Post one pass of the path")
            self._pass_of(block.start)
            self._next = block.start + 1

    def _again(self, blocks: Blocks, code: str, routine: KrlRoutine) -> None:
        """ENDWHILE or ENDLOOP."""
        del code, routine
        self._next = blocks.of[self.line].start

    def _exit(self, blocks: Blocks, code: str, routine: KrlRoutine) -> None:
        del code, routine
        block = blocks.of[self.line]
        self.memory.here.passes.pop(block.start, None)
        self._next = block.end + 1

    # ---- jumps -----------------------------------------------------------------------------------------------

    def _goto(self, blocks: Blocks, code: str, routine: KrlRoutine) -> None:
        del routine
        match = form.JUMP.fullmatch(code)
        target = None if match is None else blocks.labels.get(match[1].upper())
        if match is None or target is None:
            raise self._fault("a jump to a label that the routine does not have", code, hint="Post the program again")
        if target < self.line:
            if self.memory.here.passes.get(-self.line) == self.memory.changes:
                raise self._fault(
                    "this jump never ends: a pass changes no value", code, hint="Post one pass of the path"
                )
            self._pass_of(-self.line)
        self._next = target

    def _return(self, blocks: Blocks, code: str, routine: KrlRoutine) -> None:
        del blocks
        match = form.RETURN.fullmatch(code)
        if match is not None and match[1]:
            self._result = self.value(self._tree(match[1], code), code)
        self._next = routine.end

    # ---- doubt -----------------------------------------------------------------------------------------------

    def _branch_in_doubt(self, blocks: Blocks, block: StatementBlock, cause: Unknown, routine: KrlRoutine) -> None:
        left = self._sweep(blocks, block.start + 1, block.end, self._doubt(cause, block), routine)
        self.acting += [self._main_line] if left else []
        self._next = block.end + 1
        self._left(blocks, left, block.end, self._doubt(cause, block), routine)

    def _loop_in_doubt(self, blocks: Blocks, block: StatementBlock, cause: Unknown, routine: KrlRoutine) -> None:
        self.acting.append(self._main_line)
        if block.word == "FOR" and (head := form.FOR.fullmatch(self._code)) is not None:
            self.memory.forget(head[1], (), cause)
        left = self._sweep(blocks, block.start + 1, block.end, self._doubt(cause, block), routine)
        self._next = block.end + 1
        self._left(blocks, {line for line in left if self._word(line) != "EXIT"}, block.end, cause, routine)

    @staticmethod
    def _doubt(cause: Unknown, block: StatementBlock) -> Unknown:
        return replace(
            cause, why=f"{block.word} in line {block.start} depends on a value that is not known: {cause.why}"
        )

    def _left(self, blocks: Blocks, left: set[int], behind: int, cause: Unknown, routine: KrlRoutine) -> None:
        """Put in doubt what follows where a branch in doubt may have left a loop or the routine."""
        after = self._next
        for line in sorted(left):
            word = self._word(line)
            if word == "GOTO":
                match = form.JUMP.fullmatch(self.module.codes[line - 1])
                target = None if match is None else blocks.labels.get(match[1].upper())
                if target is None:
                    continue
                self._sweep(blocks, min(target, behind + 1), max(target, behind + 1), cause, routine)
                after = max(after, target)
            elif word == "EXIT":
                loop = blocks.of[line]
                if loop.start >= behind or loop.end <= behind:
                    continue
                self._sweep(blocks, behind + 1, loop.end, cause, routine)
                self._sweep(blocks, loop.start + 1, loop.end, cause, routine)
                after = loop.end + 1
            elif len(self._running) > 1:  # RETURN of a subprogram; where the main program returns, it has ended
                self._sweep(blocks, behind + 1, routine.end, cause, routine)
                if routine.result:
                    self._result = cause
                after = routine.end
        self._next = max(after, self._next)

    def _sweep(self, blocks: Blocks, first: int, end: int, cause: Unknown, routine: KrlRoutine) -> set[int]:
        """Look at each statement of lines ``first`` to ``end - 1`` once, in doubt; returns the lines that jump."""
        line_before, doubt, following = self.line, self.memory.doubt, self._next
        self.memory.doubt = cause if doubt is None else doubt
        jumps: set[int] = set()
        for line in range(first, end):
            self.line = line
            word, code = self._word(line), self.module.codes[line - 1]
            if not code.strip() or self._process(code):
                continue
            self._count()
            if word == "FOR" and (head := form.FOR.fullmatch(code)) is not None:
                self.memory.assign(head[1], (), Unknown("a loop counts it", self.memory.where()))
            elif word in ("EXIT", "GOTO", "RETURN"):
                inner = blocks.of.get(line)
                if word != "EXIT" or inner is None or inner.start < first:
                    jumps.add(line)
                if word == "RETURN" and routine.result and len(self._running) > 1:
                    self._result = cause
            elif word not in FLOW:
                self._statement(word, code)
        self.line, self.memory.doubt, self._next = line_before, doubt, following
        return jumps

    def _sweep_routine(self, activation: Activation) -> None:
        routine = activation.routine
        if routine in self._running:
            return
        self._running.append(routine)
        self.memory.here, self.module = activation, routine.module
        assert self.memory.doubt is not None
        self._sweep(self._blocks_in(routine), routine.first + 1, routine.end, self.memory.doubt, routine)
        self._running.pop()

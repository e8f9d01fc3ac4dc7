"""Statements of a FANUC program whose execution depends on what is not known: passed where nothing in them matters."""

from __future__ import annotations

import re
from typing import Final, NamedTuple

from counterflex.core.errors import ProgramError
from counterflex.integrations.fanuc.language.read.listing import TpStatement
from counterflex.integrations.fanuc.language.read.motion_form import MOTION
from counterflex.integrations.fanuc.language.read.motions import TpMotionExecution
from counterflex.integrations.fanuc.language.read.routine import TpFolder, TpRoutine, fault
from counterflex.integrations.fanuc.language.read.table import row_of
from counterflex.integrations.fanuc.language.read.values import plain_code
from counterflex.programs.expression import ExpressionError, Value
from counterflex.programs.program import Block
from counterflex.programs.robot_text.process_words import ProcessWords
from counterflex.programs.statement_table import Treatment
from counterflex.programs.unknown import Unknown, known

ASSIGNED: Final = ("R[]", "PR[]", "P[]", "SR[]", "F[]", "M[]")
_HARMLESS: Final = frozenset(("ENDIF", "ENDFOR", "ELSE", "LBL[]", "PAUSE", "ABORT", "WAIT"))
_LABEL: Final = re.compile(r"\bJMP\s+LBL\s*\[\s*(\d+)\s*(?::[^\]]*)?\]", re.IGNORECASE)
_CALL: Final = re.compile(r"(?:CALL|RUN)\s+([A-Za-z_][\w-]*)", re.IGNORECASE)
_FOR: Final = re.compile(r"FOR\s+(R\s*\[[^=]*\])\s*=", re.IGNORECASE)
_HINT: Final = "Post the path without loops, conditions and jumps, or set what they depend on in the program"
_DEEPEST: Final = 20


class TpStep(NamedTuple):
    """A statement that runs."""

    routine: TpRoutine  # Its listing
    at: int  # Its index there
    statement: TpStatement  # Itself
    text: str  # Its code, or what stands behind the condition

    @property
    def where(self) -> str:
        """Its file, line and column."""
        return self.routine.listing.place(self.statement.start)

    @property
    def line(self) -> str:
        """Its file and line."""
        return f"{self.routine.name}:{self.statement.line}"

    def fault(self, what: str, *, limit: str | None = None, hint: str | None = None) -> ProgramError:
        """Return its error."""
        return fault(self.routine.listing, self.statement, what, limit=limit, hint=hint)

    def known(self, value: Value, use: str, *, text: str = "", hint: str = "Write the value itself") -> Value:
        """Return a value that must be known; ``text``, or the statement, is shown where it is not."""
        return known(value, use, self.where, text=text or self.statement.code, hint=hint)

    def other(self, at: int) -> TpStep:
        """Return another statement of its listing."""
        return TpStep(self.routine, at, self.routine.statements[at], self.routine.texts[at])


class TpBranches(TpMotionExecution):
    """Passes statements that may run or not."""

    folder: TpFolder  # Programs that can be called
    process: ProcessWords | None
    depth: int  # Number of programs that run, one calling the other
    call_line: int = 1  # Line of the main program that runs

    def pass_over(
        self, routine: TpRoutine, begin: int, end: int, condition: Unknown, opening: tuple[str, int], level: int = 0
    ) -> None:
        """Pass statements that run where an unknown condition holds.

        Args:
            condition: Why it is not known.
            opening: Word and line of the statement that the condition stands in.
            level: Calls on the way there.

        Raises:
            ProgramError: One of them moves the robot, or sets what motions depend on.
        """
        for at in range(begin, end):
            step = TpStep(routine, at, routine.statements[at], routine.texts[at])
            process = self.process if step.text else None
            if process is not None and process.find(routine.texts, at, step.where) is not None:
                raise self._refusal(step, condition, opening)
            if level == 0:
                self.block(step)
            self._pass(step, step.text, condition, opening, level)

    def _pass(self, step: TpStep, text: str, condition: Unknown, opening: tuple[str, int], level: int) -> None:
        if not text:
            return
        self.act(step)
        row, action = row_of(text), _action_of(text)
        if MOTION.match(text) or row is None:
            raise self._refusal(step, condition, opening)
        if row.word in ASSIGNED:
            self._forget_assigned(step, text, condition)
        elif action is not None:
            self._pass_action(step, action, condition, opening, level)
        elif row.word == "FOR":
            match = _FOR.match(text)
            if match is not None:
                self._forget_assigned(step, f"{match[1]}=0", condition)
        elif row.treatment is not Treatment.NEUTRAL and row.word not in ("IF", *_HARMLESS):
            raise self._refusal(step, condition, opening)

    def _pass_action(self, step: TpStep, action: str, condition: Unknown, opening: tuple[str, int], level: int) -> None:
        jump = _LABEL.match(action)
        if jump is not None:
            if not self.gives_up(step.routine, int(jump[1])):
                raise self._refusal(step, condition, opening)
            return
        call = _CALL.match(action)
        if call is not None and level < _DEEPEST:
            called = self._listing(step, call[1])
            if called is None:
                raise self._refusal(step, condition, opening)
            self.pass_over(called, 0, len(called.statements), condition, opening, level + 1)
            return
        if action.upper() in ("END", "RETURN"):
            if level == 0:
                raise self._refusal(step, condition, opening)
            return
        if call is not None:
            raise self._refusal(step, condition, opening)
        self._pass(step, action, condition, opening, level)

    def _listing(self, step: TpStep, name: str) -> TpRoutine | None:
        """The listing of a program that is called; None where the folder has none."""
        return self.folder.find(name, lambda what, hint: step.fault(what, hint=hint))

    def jump_perhaps(self, step: TpStep, number: int, condition: Unknown) -> int:
        """Return the index of the statement behind a jump that is made where an unknown condition holds.

        A jump to an end behind an alarm is passed: the program runs on, or stops. A jump over statements, or back over
        them, that change nothing is passed too.

        Raises:
            ProgramError: What would be left out or done again matters to motion.
        """
        routine, at = step.routine, step.at
        target = routine.labels.get(number)
        opening = (routine.texts[at].split()[0], step.statement.line)
        if target is None:
            raise step.fault(f"there is no LBL[{number}]", hint="The file may be damaged")
        self.act(step)
        if self.gives_up(routine, number) or self._waits_on(step, number, condition):
            return at + 1
        if target > at:
            self.pass_over(routine, at + 1, target, condition, opening)
            return target
        for index in range(target, at):
            self._pass(step.other(index), routine.texts[index], condition, opening, 0)
        return at + 1

    def gives_up(self, routine: TpRoutine, number: int) -> bool:
        """Return whether a label leads to an alarm and the end of the job, over signals and waits only."""
        at, seen, alarm, count = routine.labels.get(number, -1), set[int](), False, len(routine.texts)
        while 0 <= at < count and at not in seen:
            seen.add(at)
            text = routine.texts[at]
            at += 1
            if not text:
                continue
            row = row_of(text)
            if row is None or MOTION.match(text):
                return False
            alarm |= row.word == "UALM[]"
            if row.word in ("ABORT", "END", "RETURN"):
                return row.word == "ABORT" or (alarm and self.depth == 1)
            if row.word == "JMP":
                jumped = _jumped(routine, text)
                at = -1 if jumped is None else jumped
            elif row.treatment is not Treatment.NEUTRAL and row.word not in (*ASSIGNED, *_HARMLESS):
                return False
        return alarm and at >= count and self.depth == 1

    def _waits_on(self, step: TpStep, number: int, condition: Unknown) -> bool:
        """Return whether a label leads back to a statement with nothing but signals, waits and registers on the way."""
        routine, back = step.routine, step.at
        at, seen, jumps = routine.labels.get(number), list[int](), 0
        while at is not None and at != back and at < len(routine.texts) and jumps < _DEEPEST:
            text = routine.texts[at]
            row = row_of(text) if text else None
            if row is not None and row.word == "JMP":
                at, jumps = _jumped(routine, text), jumps + 1
                continue
            if text and not _only_waits(text):
                return False
            seen.append(at)
            at += 1
        if at != back:
            return False
        for index in seen:
            text = routine.texts[index]
            row = row_of(text) if text else None
            if row is not None and row.word in ASSIGNED:
                self._forget_assigned(step.other(index), text, condition)
        return True

    def act(self, step: TpStep) -> None:
        """Remember a statement that acts on the cell: its line in the main program, or that of the call."""
        self.acting.append(step.statement.line if step.routine.name == self.file else self.call_line)

    # ---- parts ---------------------------------------------------------------------------------------------

    def block(self, step: TpStep) -> None:
        """Begin the block of a statement."""
        file = "" if step.routine.name == self.file else step.routine.name
        line = step.statement.line
        text = step.routine.lines[line - 1]
        self._blocks.append(Block(line, text, (), self.modal("G1"), len(self.motions), 0, file=file))

    def value(self, step: TpStep, text: str) -> Value:
        """Return the value of an expression of a statement. Raises ProgramError: it is none."""
        self.values.where = step.line
        if "LPOS" in text.upper():
            self.values.here = self.here(at_rest=True)
        try:
            return self.values.evaluate(plain_code(text))
        except ExpressionError as error:
            raise step.fault(str(error), limit="an expression of TP",
                        hint="Post the program again, or write the value itself") from error  # fmt: skip

    def target_of(self, step: TpStep, text: str) -> tuple[str, list[Value], str]:
        """Return register, indices and text of the value of an assignment."""
        code = plain_code(text)
        end = code.index("]") + 1 if "]" in code else 0
        while code.count("[", 0, end) > code.count("]", 0, end) and "]" in code[end:]:
            end = code.index("]", end) + 1
        left, _, right = code[end:].partition("=")
        left = code[:end] + left
        word, _, inside = left.partition("[")
        indices = [self.value(step, part) for part in divided(inside.rstrip().removesuffix("]"))]
        return word.strip(), indices, right.strip()

    def _forget_assigned(self, step: TpStep, text: str, condition: Unknown) -> None:
        word, indices, _ = self.target_of(step, text)
        why = condition.why if condition.why.startswith("set under") else f"set under a condition: {condition.why}"
        where = condition.where or step.line
        self.values.assign(word, indices, Unknown(why, where))

    def _refusal(self, step: TpStep, condition: Unknown, opening: tuple[str, int]) -> ProgramError:
        word, line = opening
        try:
            known(
                condition, f"whether a statement that matters to motion runs inside {word} (line {line})",
                step.where, text=" ".join(step.statement.code.split()), hint=_HINT,
            )  # fmt: skip
        except ProgramError as error:
            return error
        raise AssertionError


def _action(text: str) -> str:
    parts = divided(text, most=2)
    return parts[1].strip() if len(parts) == 2 else ""


def divided(text: str, most: int = 99) -> list[str]:
    """Return the parts of a text between commas outside of brackets."""
    parts: list[str] = []
    depth = begin = 0
    for at, character in enumerate(text):
        depth += (character in "[(") - (character in "])")
        if character == "," and depth == 0 and len(parts) < most - 1:
            parts.append(text[begin:at])
            begin = at + 1
    return [*parts, text[begin:]]


def _action_of(text: str) -> str | None:
    """Action of a statement that acts under a condition, or jumps, calls or ends; None of others."""
    row = row_of(text)
    word = "" if row is None else row.word
    if word == "IF" and not text.upper().endswith("THEN"):
        return _action(text)
    if word in ("SELECT", "=") or (word == "ELSE" and "," in text):
        return text.partition(",")[2].strip()
    return text if word in ("JMP", "CALL", "END", "RETURN") else None


def _jumped(routine: TpRoutine, text: str) -> int | None:
    """Index of the label that a JMP leads to; None where it is not known."""
    jump = _LABEL.match(text)
    return None if jump is None else routine.labels.get(int(jump[1]))


def _only_waits(text: str) -> bool:
    """Return whether a statement is a signal, a wait or a register."""
    row = row_of(text)
    if row is None or MOTION.match(text):
        return False
    return row.treatment is Treatment.NEUTRAL or row.word in (*ASSIGNED, "LBL[]", "PAUSE", "WAIT")

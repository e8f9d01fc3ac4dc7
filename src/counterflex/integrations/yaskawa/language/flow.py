"""Branches, loops and jumps of a job, and instructions whose execution depends on what is not known."""

from __future__ import annotations

import re
from abc import abstractmethod
from typing import Final, NamedTuple, cast

from counterflex.core.errors import ProgramError
from counterflex.integrations.yaskawa.language.form import MOTION
from counterflex.integrations.yaskawa.language.motions import InformMotions
from counterflex.integrations.yaskawa.language.source import InformFolder, InformJob, InformStatement
from counterflex.integrations.yaskawa.language.table import ACTING, ASSIGNING, OPENS, row_of
from counterflex.integrations.yaskawa.language.values import VARIABLE
from counterflex.programs.expression import ExpressionError, Value, is_number
from counterflex.programs.program import Block
from counterflex.programs.robot_text.process_words import ProcessWords
from counterflex.programs.statement_table import Treatment
from counterflex.programs.unknown import Unknown, known

_I: Final = re.IGNORECASE
_IF: Final = re.compile(r"(.*?)\s+IF(?:EXPRESS)?\b\s*(.*)", _I)
_FOR: Final = re.compile(rf"FOR\s+({VARIABLE})\s*=\s*(.*?)\s+TO\s+(.*?)(?:\s+STEP\s+(.*))?", _I)
_LABEL: Final = re.compile(r"JUMP\s+(\*\S+)", _I)
JOB: Final = re.compile(r"(JUMP|CALL)\s+JOB:([^\s(]+)\s*(.*)", _I)
_TARGET: Final = re.compile(rf"[A-Z]+\s+({VARIABLE})", _I)
_HARMLESS: Final = frozenset(
    {"PAUSE", "ABORT", "WAIT", "TIMER", "*", *OPENS, *OPENS.values(), "ELSEIFEXP", "ELSE", "CASE", "DEFAULT", "RET"}
)
_HINT: Final = "Post the path without loops, conditions and jumps, or set what they depend on in the job"
_DEEPEST: Final = 20


class InformStep(NamedTuple):
    """An instruction that runs: its job, its index there, itself, and its code without the condition behind it."""

    job: InformJob
    at: int
    statement: InformStatement
    code: str


class InformFlow(InformMotions):
    """Decides which instruction follows."""

    folder: InformFolder  # Jobs that can be called
    process: ProcessWords | None  # Finds machine functions of the cell file
    depth: int = 0  # Number of jobs that run, one calling the other
    call_line: int = 1  # Line of the main job that runs
    file: str = ""  # Name of the main job

    @abstractmethod
    def statement(self, step: InformStep) -> int:
        """Execute an instruction; returns the index of the next one."""

    # ---- values --------------------------------------------------------------------------------------------

    def value(self, step: InformStep, text: str) -> Value:
        """Return the value of an expression of an instruction. Raises ProgramError: it is none."""
        self.values.where = f"{step.job.name}:{step.statement.line}"
        try:
            return self.values.evaluate(text)
        except ExpressionError as error:
            raise self.mistake(step, error) from error

    def mistake(self, step: InformStep, error: ExpressionError) -> ProgramError:
        """Return the error of an expression."""
        return step.job.fault(step.statement.start, str(error), "an expression of INFORM",
                              "Post the job again, or write the value itself")  # fmt: skip

    def decision(self, step: InformStep, text: str) -> bool | Unknown:
        """Return whether a condition holds, or why that is not known."""
        text = text.strip()
        while text.startswith("(") and text.endswith(")") and text.count("(") == 1:
            text = text[1:-1]
        value = self.value(step, text)
        if isinstance(value, Unknown):
            return Unknown(value.why, value.where or f"{step.job.name}:{step.statement.line}")
        if not isinstance(value, bool):
            raise step.job.fault(step.statement.start, "this is no condition", "IF B000=1")
        return value

    def number(self, step: InformStep, text: str, use: str) -> float:
        """Return a number that an instruction needs."""
        value = known(self.value(step, text), use, step.job.place(step.statement.start), text=step.code)
        if not is_number(value):
            raise step.job.fault(step.statement.start, f"{use} is no number", "a number", "Write it itself")
        return cast("float", value)

    # ---- flow ----------------------------------------------------------------------------------------------

    def under_condition(self, step: InformStep) -> int:
        """Execute JUMP, CALL, RET, PAUSE or ABORT, with what stands behind IF."""
        match = _IF.fullmatch(step.code)
        if match is None:
            return self.action(step)
        decision = self.decision(step, match[2])
        step = step._replace(code=match[1].strip())
        if decision is False:
            return step.at + 1
        if decision is True:
            return self.action(step)
        return self._perhaps(step, decision)

    @abstractmethod
    def action(self, step: InformStep) -> int:
        """Execute JUMP, CALL, RET, PAUSE or ABORT without a condition; returns the index of the next one."""

    def label(self, step: InformStep) -> int:
        """Return the index of the label that a jump names."""
        match = _LABEL.fullmatch(step.code)
        if match is None:
            raise step.job.fault(step.statement.start, "the jump is not understood", "JUMP *A, JUMP JOB:NAME",
                                 "Jumps to what a variable or input says are not read")  # fmt: skip
        at = step.job.labels.get(match[1].upper())
        if at is None:
            raise step.job.fault(step.statement.start, f"there is no label {match[1]}", "a label of the job")
        return at

    def _perhaps(self, step: InformStep, condition: Unknown) -> int:
        """An instruction that runs or not."""
        word = step.code.split()[0].upper()
        opening = (word, step.statement.line)
        self.act(step)
        count = len(step.job.codes)
        if word == "JUMP" and JOB.fullmatch(step.code) is None:
            target = self.label(step)
            if self._gives_up(step.job, target):
                return step.at + 1
            first, last = sorted((step.at + 1 if target > step.at else step.at, target))
            self.pass_over(step.job, first, last, condition, opening)
            return max(target, step.at + 1)
        if word in ("RET", "JUMP"):
            if word == "JUMP":
                self._pass_call(step, condition, opening, 0)
            self.pass_over(step.job, step.at + 1, count, condition, opening)
            return count
        if word == "CALL":
            self._pass_call(step, condition, opening, 0)
        return step.at + 1

    def do_if(self, step: InformStep) -> int:
        """IFTHENEXP: the first branch whose condition holds."""
        job, end = step.job, step.job.partner[step.at]
        for at in [step.at, *job.branches[step.at]]:
            code = job.codes[at]
            word, _, text = code.partition(" ") if " " in code else code.partition("(")
            text = text if " " in code or not text else f"({text}"
            here = step._replace(at=at, statement=job.statements[at], code=code)
            decision = word.upper() == "ELSE" or self.decision(here, text)
            if isinstance(decision, Unknown):
                self.act(here)
                self.pass_over(job, at + 1, end, decision, ("IFTHENEXP", step.statement.line))
                return end + 1
            if decision:
                return at + 1
        return end + 1

    def leave_branch(self, step: InformStep) -> int:
        """ELSE, ELSEIFEXP, CASE or DEFAULT behind a branch that ran: go on behind the end of the block."""
        begin = next(begin for begin, branches in step.job.branches.items() if step.at in branches)
        return step.job.partner[begin] + 1

    def do_while(self, step: InformStep) -> int:
        """WHILEEXP: the loop, or what is behind it."""
        end = step.job.partner[step.at]
        decision = self.decision(step, step.code[len("WHILEEXP") :])
        if isinstance(decision, Unknown):
            self.act(step)
            self.pass_over(step.job, step.at + 1, end, decision, ("WHILEEXP", step.statement.line))
            return end + 1
        return step.at + 1 if decision else end + 1

    def back(self, step: InformStep) -> int:
        """ENDWHILE: the condition again."""
        return step.job.partner[step.at]

    def _for(self, step: InformStep) -> tuple[str, str, float, float]:
        """Counter, first value, last value and step of FOR."""
        match = _FOR.fullmatch(step.code)
        if match is None:
            raise step.job.fault(step.statement.start, "FOR is not understood", "FOR I000=1 TO 5")
        by = 1.0 if match[4] is None else self.number(step, match[4], "the step of FOR")
        if by == 0.0:
            raise step.job.fault(step.statement.start, "FOR counts by 0", "another step")
        return match[1], match[2], self.number(step, match[3], "how often FOR repeats"), by

    def do_for(self, step: InformStep) -> int:
        """FOR: set the counter; leave out the loop where it is beyond its end."""
        name, first, last, by = self._for(step)
        value = self.number(step, first, "where FOR begins")
        self.values.assign(name, value)
        return step.at + 1 if (last - value) * by >= 0.0 else step.job.partner[step.at] + 1

    def do_next(self, step: InformStep) -> int:
        """NEXT: count on, and go back while the last value is not passed."""
        begin = step.job.partner[step.at]
        opening = InformStep(step.job, begin, step.job.statements[begin], step.job.codes[begin])
        name, _, last, by = self._for(opening)
        value = self.number(opening, name, "how often FOR repeats") + by
        self.values.assign(name, value)
        return begin + 1 if (last - value) * by >= 0.0 else step.at + 1

    def do_switch(self, step: InformStep) -> int:
        """SWITCH: the branch whose value fits."""
        job, end = step.job, step.job.partner[step.at]
        value = self.value(step, step.code[len("SWITCH") :])
        if isinstance(value, Unknown):
            self.act(step)
            condition = Unknown(value.why, value.where or f"{job.name}:{step.statement.line}")
            self.pass_over(job, step.at + 1, end, condition, ("SWITCH", step.statement.line))
            return end + 1
        for at in job.branches[step.at]:
            here = step._replace(at=at, statement=job.statements[at], code=job.codes[at])
            if (
                here.code.upper() == "DEFAULT"
                or self.number(here, here.code[len("CASE") :], "a value of CASE") == value
            ):
                return at + 1
        return end + 1

    # ---- what may run or not -------------------------------------------------------------------------------

    def act(self, step: InformStep) -> None:
        """Remember an instruction that acts on the cell: its line in the main job, or that of the call."""
        self.acting.append(step.statement.line if step.job.name == self.file else self.call_line)

    def block(self, step: InformStep) -> None:
        """Begin the block of an instruction."""
        file = "" if step.job.name == self.file else step.job.name
        text = step.statement.code
        self._blocks.append(Block(step.statement.line, text, (), self.modal("G1"), len(self.motions), 0, file=file))

    def pass_over(
        self, job: InformJob, begin: int, end: int, condition: Unknown, opening: tuple[str, int], level: int = 0
    ) -> None:
        """Pass instructions that run where an unknown condition holds.

        Args:
            job: Where they stand.
            condition: Why it is not known.
            opening: Word and line of the instruction that the condition stands in.
            level: Calls on the way there.

        Raises:
            ProgramError: One of them moves the robot, or sets what motions depend on.
        """
        for at in range(begin, end):
            step = InformStep(job, at, job.statements[at], job.codes[at])
            if not step.code:
                continue
            if (
                self.process is not None
                and self.process.find(job.codes, at, job.place(step.statement.start)) is not None
            ):
                raise self._refusal(step, condition, opening)
            if level == 0:
                self.block(step)
            self._pass(step, condition, opening, (begin, end), level)

    def _pass(
        self, step: InformStep, condition: Unknown, opening: tuple[str, int], span: tuple[int, int], level: int
    ) -> None:
        row = row_of(step.code)
        if row is None or MOTION.match(step.code):
            raise self._refusal(step, condition, opening)
        if row.word in ASSIGNING or row.word == "FOR":
            self._forget(step, condition)
        elif row.word in ("JUMP", "CALL"):
            match = _IF.fullmatch(step.code)
            step = step if match is None else step._replace(code=match[1].strip())
            if JOB.fullmatch(step.code) is not None:
                self._pass_call(step, condition, opening, level)
            elif not (span[0] <= (target := self.label(step)) <= span[1] or self._gives_up(step.job, target)):
                raise self._refusal(step, condition, opening)
        elif row.treatment is not Treatment.NEUTRAL and row.word not in _HARMLESS:
            raise self._refusal(step, condition, opening)
        if row.word in ACTING:
            self.act(step)

    def _pass_call(self, step: InformStep, condition: Unknown, opening: tuple[str, int], level: int) -> None:
        called = self.called(step)
        if called is None or level >= _DEEPEST:
            raise self._refusal(step, condition, opening)
        self.pass_over(called, 0, len(called.codes), condition, opening, level + 1)

    def called(self, step: InformStep) -> InformJob | None:
        """Return the job that CALL or JUMP names; None where the folder has none."""
        match = JOB.fullmatch(step.code)
        if match is None:
            return None
        start = step.statement.start
        return self.folder.find(match[2], lambda what, hint: step.job.fault(start, what, None, hint))

    def _forget(self, step: InformStep, condition: Unknown) -> None:
        match = _TARGET.match(step.code)
        if match is None:  # an output, or what only the controller has
            return
        why = condition.why if condition.why.startswith("set under") else f"set under a condition: {condition.why}"
        self.values.where = f"{step.job.name}:{step.statement.line}"
        self.values.assign(match[1], Unknown(why, condition.where or self.values.where))

    def _gives_up(self, job: InformJob, at: int) -> bool:
        """Return whether a label leads to an alarm and the end of the job, with nothing that matters on the way."""
        seen: set[int] = set()
        while at < len(job.codes) and at not in seen:
            seen.add(at)
            code = job.codes[at]
            row = row_of(code) if code else None
            at += 1
            if not code:
                continue
            if row is None or MOTION.match(code):
                return False
            if row.word == "ABORT":
                return True
            if row.word == "JUMP" and (match := _LABEL.fullmatch(code)) is not None:
                at = job.labels.get(match[1].upper(), len(job.codes))
            elif row.treatment is not Treatment.NEUTRAL and row.word not in ("*", "PAUSE", "TIMER", "WAIT", *ASSIGNING):
                return False
        return False

    def _refusal(self, step: InformStep, condition: Unknown, opening: tuple[str, int]) -> ProgramError:
        word, line = opening
        try:
            known(
                condition, f"whether an instruction that matters to motion runs inside {word} (line {line})",
                step.job.place(step.statement.start), text=" ".join(step.code.split()), hint=_HINT,
            )  # fmt: skip
        except ProgramError as error:
            return error
        raise AssertionError

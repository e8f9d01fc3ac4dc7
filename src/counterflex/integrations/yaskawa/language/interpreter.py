"""Executes a job instruction by instruction: values, branches, calls, frames, process words."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.errors import ProgramError
from counterflex.integrations.yaskawa.language.flow import JOB, InformFlow, InformStep
from counterflex.integrations.yaskawa.language.form import FRAME, MOTION, form_of
from counterflex.integrations.yaskawa.language.frames import InformCell
from counterflex.integrations.yaskawa.language.program import InformMotion, Point
from counterflex.integrations.yaskawa.language.source import InformFolder, InformJob
from counterflex.integrations.yaskawa.language.table import ACTING, ASSIGNING, row_of
from counterflex.integrations.yaskawa.language.values import VARIABLE, PositionValue
from counterflex.programs.expression import ExpressionError, Value
from counterflex.programs.program import Word
from counterflex.programs.robot_text.process_words import NUMBER, ProcessWords
from counterflex.programs.statement_table import Treatment
from counterflex.programs.unknown import Unknown, known

_MOST: Final = 100_000
"""Instructions executed beyond ten times those written: a loop that never ends reaches it within seconds."""
_MOST_IDLE: Final = 20_000  # Instructions executed beyond those written without a motion between them
_DEEPEST: Final = 40
_I: Final = re.IGNORECASE
_ASSIGNED: Final = re.compile(rf"(?:SET|((?!SET\b)[A-Z]+))\s+({VARIABLE})\s*(?(1)(?:\(([^)]*)\))?)\s*(.*)", _I)
_GETE: Final = re.compile(rf"GETE\s+({VARIABLE})\s+({VARIABLE})\s*\(([^)]*)\)", _I)
_SPEED: Final = re.compile(rf"(VJ|VR|VE|V)=({NUMBER}|{VARIABLE})", _I)
_SHIFT: Final = re.compile(rf"SFTON\s+({VARIABLE})\s*({FRAME})?", _I)
_MFRAME: Final = re.compile(rf"MFRAME\s+UF#\((\d{{1,3}})\)\s+({VARIABLE})\s+({VARIABLE})\s+({VARIABLE})", _I)
_TIMER: Final = re.compile(rf"TIMER\s+T=({NUMBER}|{VARIABLE})", _I)
_EVALUATED: Final = frozenset(
    {"SET", "SETE", "ADD", "SUB", "MUL", "DIV", "INC", "DEC", "CLEAR", "AND", "OR", "XOR", "NOT", "SIN", "COS", "ATAN",
     "SQRT"}
)  # fmt: skip
_TIMER_UNIT_S: Final = 0.01
_QUIET: Final = ("*", "'", "//", "NOP")


class InformInterpreter(InformFlow):
    """State of the controller while a job runs.

    Args:
        folder: Jobs that it can call.
        cell: What frames and process words are held against; None takes every frame and knows no process words.
    """

    def __init__(self, job: InformJob, folder: InformFolder, cell: InformCell | None) -> None:
        super().__init__(cell)
        self.job, self.folder, self.file = job, folder, job.name
        self.process = None if cell is None else ProcessWords(cell.functions, lambda code: code)
        self._count, self._ended = 0, False
        self._counted_at, self._moved = 0, -1
        self.runs: dict[tuple[str, int], int] = {}
        self.whole_speeds: dict[str, list[int]] = {}
        self.loaded_targets: dict[str, list[int]] = {}

    def run(self) -> None:
        """Execute the job.

        Raises:
            ProgramError: See :func:`~counterflex.integrations.yaskawa.language.reader.read_inform`.
        """
        self._run(self.job)

    def _run(self, job: InformJob) -> None:
        outer, self.values.own = self.values.own, {}
        self.values.take(job.positions, job.name)
        self.depth += 1
        passes: dict[int, int] = {}
        at, count = 0, len(job.codes)
        while at < count and not self._ended:
            then = self._executed(job, at)
            if then <= at:
                moved = self.values.version
                if passes.get(at) == moved:
                    raise job.fault(
                        job.statements[at].start,
                        f"the job repeats from line {job.statements[then].line} on without end", "a job that ends",
                        "Give the job of one part, without the loop around it",
                    )  # fmt: skip
                passes[at] = moved
            at = then
        self.close_arcs()
        self.depth -= 1
        self.values.own = outer

    def _executed(self, job: InformJob, at: int) -> int:
        """Execute an instruction; returns the index of the next one."""
        step = InformStep(job, at, job.statements[at], job.codes[at])
        self._count += 1
        if len(self.motions) != self._moved:
            self._counted_at, self._moved = self._count, len(self.motions)
        written = len(job.codes)
        if self._count > _MOST + 10 * written or self._count - self._counted_at > _MOST_IDLE + written:
            raise job.fault(
                step.statement.start, "the job does not end within the instructions that are executed",
                f"{_MOST} instructions, {_MOST_IDLE} of them without a motion", "Give the job of one part",
            )  # fmt: skip
        self.call_line = step.statement.line if self.depth == 1 else self.call_line
        self.block(step)
        block = len(self._blocks) - 1
        self._words = []
        function = None
        if self.process is not None and step.code:
            function = self.process.find(job.codes, at, job.place(step.statement.start))
        if function is not None:
            self.eventful = True
            self.do(function)
            then = at + function.lines
        elif not step.code:
            return at + 1
        else:
            then = self._guarded(step)
        self._finish(block)
        return then

    def _guarded(self, step: InformStep) -> int:
        try:
            return self.statement(step)
        except ProgramError:
            raise
        except ExpressionError as error:
            raise self.mistake(step, error) from error
        except (ValueError, TypeError, OverflowError, RecursionError) as error:
            raise step.job.fault(step.statement.start, "a value does not fit this instruction", "INFORM III") from error

    def _finish(self, block: int) -> None:
        """Give the block of an instruction its words and motions."""
        first = self._blocks[block].first_motion
        made = len(self._blocks) == block + 1
        count = len(self.motions) - first if made else 0
        if count or self._words:
            self._blocks[block] = replace(
                self._blocks[block], words=tuple(self._words), motion_count=count,
                modal=self.modal(self.motion_code(first) if count else "G1"),
            )  # fmt: skip

    # ---- instructions --------------------------------------------------------------------------------------

    def statement(self, step: InformStep) -> int:
        """Execute an instruction; returns the index of the next one."""
        motion = MOTION.match(step.code)
        start = step.statement.start
        if motion is not None:
            key = (step.job.name, start)
            self.runs[key] = self.runs.get(key, 0) + 1
            form = form_of(step.job, step.statement, motion)
            self.values.where = f"{step.job.name}:{step.statement.line}"
            self.motion(step.job, step.statement, form)
            if form.speed.isdecimal() and form.word != "MOVJ":
                self.whole_speeds.setdefault(form.speed, []).append(step.statement.line)
            if form.target[:1].upper() == "P" and self.values.is_loaded(form.target):
                self.loaded_targets.setdefault(form.target.upper(), []).append(step.statement.line)
            return step.at + 1
        row = row_of(step.code)
        if row is None or row.word.startswith("option"):
            raise step.job.fault(
                start, "an unknown instruction, or a macro", "docs/statements/inform.md",
                "Name it in [controller.spindle.inform] (m_codes) of the cell file if it moves nothing, or post the "
                "path without it",
            )  # fmt: skip
        if row.treatment is Treatment.REFUSED:
            raise step.job.fault(start, f"{row.word}: {row.reason}, which is not read", None, row.remedy)
        self.eventful |= row.word not in _QUIET
        if row.word in ACTING:
            self.act(step)
        if row.word in ASSIGNING:
            return self._assign(step)
        handler = _HANDLERS.get(row.word)
        return step.at + 1 if handler is None else handler(self, step)

    def _assign(self, step: InformStep) -> int:
        self.values.where = f"{step.job.name}:{step.statement.line}"
        match = _ASSIGNED.fullmatch(step.code)
        word = step.code.split()[0].upper()
        if match is None:
            if word == "SET":  # an output or flag
                self.act(step)
                return step.at + 1
            raise step.job.fault(step.statement.start, f"{word} is not understood", "SET B000 1")
        if word == "GETE":
            element = _GETE.fullmatch(step.code)
            if element is None:
                raise step.job.fault(step.statement.start, "GETE is not understood", "GETE D000 P000 (3)")
            self.values.assign(element[1], self.values.element(element[2], element[3]))
        elif word in _EVALUATED:
            text = match[4].strip()
            self.values.operate(word, match[2], [text] if word == "SET" else text.split(), match[3] or "")
        else:
            self.values.assign(match[2], Unknown(f"{word} sets it", self.values.where))
        return step.at + 1

    def _speed(self, step: InformStep) -> int:
        text = step.code[len("SPEED") :].strip()
        speeds = {match[1].upper(): match[2] for match in _SPEED.finditer(text)}
        if not speeds or _SPEED.sub("", text).strip():
            raise step.job.fault(step.statement.start, "SPEED is not understood", "SPEED VJ=50.00 V=25.0")
        if "V" in speeds:
            unit = Unknown("the unit of a speed by a variable is the controller's", self.values.where)
            self.speed = float(speeds["V"]) if speeds["V"][0] in "+-.0123456789" else unit
        return step.at + 1

    def _shift(self, step: InformStep) -> int:
        self.close_arcs()
        match = _SHIFT.fullmatch(step.code)
        if match is None:
            raise step.job.fault(step.statement.start, "SFTON is not understood", "SFTON P000 UF#(1)")
        self.begin_shift(step.job, step.statement, match[1], (match[2] or "").upper())
        return step.at + 1

    def _end_shift(self, step: InformStep) -> int:
        self.close_arcs()
        self.shift = None
        return step.at + 1

    def _frame(self, step: InformStep) -> int:
        where = step.job.place(step.statement.start)
        match = _MFRAME.fullmatch(step.code)
        if match is None:
            raise step.job.fault(step.statement.start, "MFRAME is not understood", "MFRAME UF#(1) P000 P001 P002")
        corners = [self._position(step, text) for text in match.groups()[1:]]
        self.frames.make(int(match[1]), (corners[0], corners[1], corners[2]), where)
        return step.at + 1

    def _position(self, step: InformStep, text: str) -> PositionValue:
        value: Value = known(self.values.get(text), f"the position {text}", step.job.place(step.statement.start),
                             text=step.code, hint="Set the variable in the job")  # fmt: skip
        if not isinstance(value, PositionValue):
            raise step.job.fault(step.statement.start, f"{text} is no position", "P000")
        known(list(value.values), f"the position {text}", step.job.place(step.statement.start))
        return value

    # ---- other jobs ----------------------------------------------------------------------------------------

    def action(self, step: InformStep) -> int:
        """Execute JUMP, CALL, RET, PAUSE or ABORT."""
        word = step.code.split()[0].upper()
        if word == "RET":
            return len(step.job.codes)
        if word == "ABORT":
            self._ended = True
        elif word == "PAUSE":
            self._words.append(Word("M", 0.0, 0, 0))
        elif JOB.fullmatch(step.code) is None:
            if word == "JUMP":
                return self.label(step)
            raise step.job.fault(step.statement.start, "the call is not understood", "CALL JOB:NAME",
                                 "Calls of what a variable or input says are not read")  # fmt: skip
        else:
            self._other_job(step)
            return len(step.job.codes) if word == "JUMP" else step.at + 1
        return step.at + 1

    def _other_job(self, step: InformStep) -> None:
        called = self.called(step)
        name = JOB.fullmatch(step.code)[2]  # type: ignore[index]
        if called is None and name.upper() == self.job.stem:
            called = self.job
        if called is None:
            raise step.job.fault(
                step.statement.start, "another job is called, which may move the robot",
                "a job of the folder, or an instruction of [controller.spindle.inform] in the cell file",
                f"Put {name}.JBI beside the job, or name the call in the table (m_codes) if it moves nothing",
            )  # fmt: skip
        if self.depth >= _DEEPEST:
            raise step.job.fault(step.statement.start, "jobs call each other without end",
                                 f"{_DEEPEST} calls within each other", "Post the path without recursion")  # fmt: skip
        self.close_arcs()
        words, self._words = self._words, []
        self._run(called)
        self._words = words

    # ---- waits ---------------------------------------------------------------------------------------------

    def _timer(self, step: InformStep) -> int:
        match = _TIMER.fullmatch(step.code)
        if match is None:
            raise step.job.fault(step.statement.start, "TIMER is not understood", "TIMER T=0.50")
        literal = match[1][0] in "+-.0123456789"
        value = self.value(step, match[1])
        if isinstance(value, Unknown):
            return step.at + 1
        time_s = float(value) * (1.0 if literal else _TIMER_UNIT_S)  # type: ignore[arg-type]
        self.close_arcs(rest=True)
        one = step.statement
        at = Point(line=one.line, head=one.head, start=one.start, end=one.end, R_tcp_tool=np.eye(3), file=step.job.name)
        self.rest(InformMotion("TIMER", at), time_s)
        return step.at + 1


_Handler = Callable[[InformInterpreter, InformStep], int]
_HANDLERS: Final[Mapping[str, _Handler]] = {
    **dict.fromkeys(("JUMP", "CALL", "RET", "PAUSE", "ABORT"), InformInterpreter.under_condition),
    **dict.fromkeys(("ELSEIFEXP", "ELSE", "CASE", "DEFAULT"), InformInterpreter.leave_branch),
    "IFTHENEXP": InformInterpreter.do_if,
    "WHILEEXP": InformInterpreter.do_while,
    "ENDWHILE": InformInterpreter.back,
    "FOR": InformInterpreter.do_for,
    "NEXT": InformInterpreter.do_next,
    "SWITCH": InformInterpreter.do_switch,
    "SPEED": InformInterpreter._speed,
    "SFTON": InformInterpreter._shift,
    "SFTOF": InformInterpreter._end_shift,
    "MFRAME": InformInterpreter._frame,
    "TIMER": InformInterpreter._timer,
}

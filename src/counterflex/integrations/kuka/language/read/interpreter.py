"""Executes a KRL job: motions, waits, machine functions; see :mod:`.flow` for the order of its statements."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.integrations.kuka.language.program import KrlMotion, WithFault, with_clause
from counterflex.integrations.kuka.language.read import statements as form
from counterflex.integrations.kuka.language.read.frames import KrlCell
from counterflex.integrations.kuka.language.read.job import KrlJob, KrlRoutine
from counterflex.integrations.kuka.language.read.literals import code_of, number_of
from counterflex.integrations.kuka.language.read.motions import MOTIONS, Held, KrlMotions
from counterflex.integrations.kuka.language.read.table import ACTING, TABLE
from counterflex.integrations.kuka.language.read.values import Value
from counterflex.programs.expression import is_number
from counterflex.programs.program import Word
from counterflex.programs.robot_text.process_words import ProcessWords
from counterflex.programs.statement_table import Treatment
from counterflex.programs.unknown import Unknown, known

_MENTION: Final = re.compile(r"([A-Za-z$]\w*)(\s*\[[^\]]*\])?")


def with_shared(moves: Sequence[KrlMotion], job: KrlJob) -> list[KrlMotion]:
    """Return the motions, with those marked whose target's name is used elsewhere in the job too."""
    if not any(move.target is not None and move.target.in_data for move in moves):
        return list(moves)
    counts = _mentions(job)
    return [replace(move, shared=True) if _shared(move, counts) else move for move in moves]


def _shared(move: KrlMotion, counts: Counter[tuple[str, str]]) -> bool:
    target = move.target
    if target is None or not target.in_data:
        return False
    name, _, index = "".join(target.name.split()).upper().partition("[")
    if not index:
        return counts[name, ""] > 1
    if index[:-1].isdigit():
        return counts[name, index] + counts[name, "?"] + counts[name, ""] > 1
    return sum(count for (other, _), count in counts.items() if other == name) > 1


def _mentions(job: KrlJob) -> Counter[tuple[str, str]]:
    """Count each name with its index; ``?`` stands for a computed one."""
    counts: Counter[tuple[str, str]] = Counter()
    for module in job.modules():
        for code in module.codes:
            for name, index in _MENTION.findall(code):
                inside = "".join(index.split())[1:-1]
                known = f"{inside}]" if inside.isdigit() else "?" if inside else ""
                counts[name.upper(), known] += 1
    return counts


class KrlInterpreter(KrlMotions):
    """State of the controller while a job runs."""

    def __init__(self, job: KrlJob, cell: KrlCell | None, *, complete: bool) -> None:
        super().__init__(job, cell, complete=complete)
        self.process = None if cell is None else ProcessWords(cell.functions, code_of)
        self._statements_of: dict[str, tuple[list[str], list[int]]] = {}
        self._swallow = 0
        self._outside: Held | None = None

    def run(self) -> None:
        """Execute the main routine; then the uses of each name are known."""
        super().run()
        self.moves = with_shared(self.moves, self.job)

    # ---- statements ------------------------------------------------------------------------------------------

    def _statement(self, word: str, code: str) -> None:
        if form.HEADER.match(code):
            return
        if self._in_spline and word not in form.IN_SPLINE:
            raise self._fault(
                "this has no place in a spline block", code, limit="SLIN SCIRC TRIGGER ENDSPLINE",
                hint="The file may be damaged: post it again",
            )  # fmt: skip
        if word in MOTIONS:
            self._motion(code)
        elif word == form.ASSIGNS or word[:1] == "$":
            self._assignment(word, code)
        elif word[:4] == "BAS ":
            self._basic(code)
        elif word in (form.DECLARES, "IMPORT", "SIGNAL"):
            self._declaration(code)
        elif word == form.CALLS:
            self._call_statement(code)
        else:
            self._by_row(word, code)

    def _by_row(self, word: str, code: str) -> None:
        """A statement by its row in the table."""
        row = TABLE.find(word) if word else None
        if row is None:
            raise self._fault(
                "an unknown statement", code, hint="docs/statements/krl.md lists what is read; post the path without it"
            )
        if row.treatment is Treatment.REFUSED:
            raise self._fault(row.reason, code, hint=row.remedy)
        if row.treatment is Treatment.NEUTRAL:
            self._note(word, code)
            return
        own = {
            "SPLINE": self._spline_begins, "ENDSPLINE": self._spline_ends, "WAIT SEC": self._wait, "HALT": self._halt,
            "TRIGGER WHEN DISTANCE": self._trigger_statement, "TRIGGER WHEN PATH": self._trigger_statement,
            "INTERRUPT DECL": self._interrupt,
        }.get(word)  # fmt: skip
        if own is None:
            raise self._fault("a routine begins before END", code, hint="The file may be damaged: post it again")
        own(code)

    def _note(self, word: str, code: str) -> None:
        """A statement that acts on the cell, which another language would lose."""
        if word.split(".")[0] in ACTING and not form.STANDARD.match(code):
            self.acting.append(self._main_line)

    def _halt(self, code: str) -> None:
        if self.memory.doubt is None:
            self._words = [*self._words, Word("M", 0.0, 0, 0)]
        else:
            self._note("HALT", code)

    # ---- machine functions -----------------------------------------------------------------------------------

    def _process(self, code: str) -> bool:
        if self._swallow:
            self._swallow -= 1
            return True
        if self.process is None:
            return False
        statements, index = self._statements()
        function = self.process.find(statements, index[self.line - 1], f"{self.module.file.name}:{self.line}")
        if function is None:
            return False
        self._certain(code, "the spindle, coolant or tool is switched")
        self.do(function)
        self._swallow = function.lines - 1
        return True

    def _statements(self) -> tuple[list[str], list[int]]:
        """Lines of the file that are no mere comments, and the index of each line among them."""
        name = self.module.file.name
        if name not in self._statements_of:
            have = [bool(code.strip()) for code in self.module.codes]
            lines = [line for line, has in zip(self.module.lines, have, strict=True) if has]
            self._statements_of[name] = lines, list(itertools.accumulate(have, initial=0))
        return self._statements_of[name]

    def change_tool(self, values: Mapping[str, float]) -> None:
        """A tool change by the number of the tool, or of its TOOL_DATA."""
        super().change_tool(values)
        if "T" not in values and "D" in values:
            self._numbered("TOOL", int(values["D"]), self._code)

    # ---- spline blocks ---------------------------------------------------------------------------------------

    def _spline_begins(self, code: str) -> None:
        begins = form.SPLINE_BEGINS.fullmatch(code)
        if begins is None or self._in_spline or not form.WITH_OTHERS.fullmatch(begins[1]):
            raise self._fault("this beginning of a spline block is not understood", code,
                              limit="SPLINE WITH $VEL.CP=0.02",
                              hint="Set speed and acceleration alone there")  # fmt: skip
        self._certain(code, "a spline block")
        try:
            clause = with_clause(code, begins.start(1))
        except WithFault as fault:
            raise self._fault(
                fault.what.replace("path speed", "path speed of a spline block"), code,
                limit="SPLINE WITH $VEL.CP=0.02", hint=fault.hint,
            ) from fault  # fmt: skip
        self._in_spline, self._spline = True, None
        if clause is not None:
            self._outside = self._held_modes()
            self._with_values(clause, code)
            if clause.speed is not None:
                self._spline = self._expression(code[slice(*clause.speed)], code)
                self.speed(known(self._spline, "the path speed of a spline block", self.at(code), text=code), code)

    def _spline_ends(self, code: str) -> None:
        if not self._in_spline:
            raise self._fault("ENDSPLINE closes nothing", code, hint="The file may be damaged: post it again")
        if form.SPLINE_ENDS.fullmatch(code) is None:
            raise self._fault("this is not understood behind ENDSPLINE", code, limit="C_SPL")
        self._in_spline, self._spline = False, None
        if self._outside is not None:
            self._restore_modes(self._outside)
            self._outside = None

    # ---- waits, triggers, interrupts -------------------------------------------------------------------------

    def _wait(self, code: str) -> None:
        match = form.WAIT_TIME.fullmatch(code)
        if match is None:
            raise self._fault("the time of a wait is missing", code, limit="WAIT SEC 0.5")
        if self.memory.doubt is not None:
            return
        time_s: Value = number_of(match[1])
        if time_s is None:
            value = self._expression(match[1], code)
            time_s = known(value, "the time of a wait", self.at(code), text=code)
        if not is_number(time_s):
            raise self._fault("the time of a wait is no number", code, hint="Write the number itself, in s")
        if self._by_axes or self._away is not None:
            return  # it stands where no cut is
        if self.dwell(len(self._blocks), float(time_s)):  # type: ignore[arg-type]
            self.moves.append(KrlMotion(self.module.file.name, self.line, "WAIT"))

    def _trigger_statement(self, code: str) -> None:
        match = form.TRIGGER.fullmatch(code)
        if match is None:
            raise self._fault(
                "this TRIGGER is not understood", code, limit="TRIGGER WHEN DISTANCE=0 DELAY=0 DO $OUT[1]=TRUE"
            )
        if not form.AT_START.fullmatch(match[1]):
            self._trigger = self._trigger or self.line
        elif self._trigger is not None:
            self._trigger = -1
        if self.process is not None:
            function = self.process.find([match[2]], 0, f"{self.module.file.name}:{self.line}")
            if function is not None:
                self._certain(code, "the spindle, coolant or tool is switched")
                self.do(function)
                return
        self._note("TRIGGER WHEN PATH", code)
        self._later(match[2], Unknown("a TRIGGER does it while the robot moves", self.memory.where()))

    def _interrupt(self, code: str) -> None:
        self._note("INTERRUPT DECL", code)
        match = form.INTERRUPT.fullmatch(code)
        if match is None:
            raise self._fault(
                "this INTERRUPT is not understood", code, limit="INTERRUPT DECL 5 WHEN $IN[1] DO STOP_IT( )"
            )
        if not form.STANDARD.match(code):
            self.memory.interrupts = True
            self._later(match[1], Unknown("an interrupt does it at a time that is not known", self.memory.where()))
            self.memory.interrupts = False

    def _later(self, statement: str, cause: Unknown) -> None:
        """Execute the statement of a TRIGGER or INTERRUPT: output, assignment, or subprogram without motions."""
        call = form.CALL.fullmatch(statement)
        doubt, self.memory.doubt = self.memory.doubt, cause
        in_spline, self._in_spline = self._in_spline, False
        if call is not None:
            routine = self.job.routine(call[1], self.module, self.memory.where())
            if routine is not None:
                self._call(routine, ())
            elif not self._is_library(call[1]):
                raise self._unknown_call(call[1], self._code)
        elif form.ASSIGNMENT.match(statement) is not None and not statement.lstrip().startswith("$OUT"):
            self._statement(form.word_of(statement, frozenset()), statement)
        self.memory.doubt, self._in_spline = doubt, in_spline

    # ---- end -------------------------------------------------------------------------------------------------

    def _check_end(self, routine: KrlRoutine) -> None:
        name = routine.module.file.name
        if self._in_spline:
            raise ProgramError("SPLINE is not closed", where=f"{name}:{self.line}", hint="The file may be cut off")
        if not routine.closed and (self.complete or routine.end <= len(routine.module.lines)):
            raise ProgramError(
                "the program stops without END: it may be cut off", where=f"{name}:{routine.end - 1}",
                value=routine.module.lines[-1].strip()[:60],
                hint="Post it again, or say --without-end if it is complete",
            )  # fmt: skip

"""Executes a RAPID program statement by statement: motions, frames, speeds, process words, calls of routines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.errors import ProgramError
from counterflex.core.units import MM
from counterflex.programs.program import Block, Word
from counterflex.programs.rapid.program import RapidMotion, RoutineCall
from counterflex.programs.rapid.read import statements as form
from counterflex.programs.rapid.read.data import DECLARATION, Data, rotation_of
from counterflex.programs.rapid.read.frames import Frames, RapidCell
from counterflex.programs.rapid.read.literals import Argument, arguments
from counterflex.programs.rapid.read.routines import Routine, Routines
from counterflex.programs.rapid.read.scanner import Source, Statement, statements_of
from counterflex.programs.rapid.read.targets import Targets
from counterflex.programs.robot_text.execution import Execution
from counterflex.programs.robot_text.process_words import ProcessWords

_MOST: Final = 2_000_000
"""Statements that are executed at most."""
_DEEPEST: Final = 30


@dataclass
class _Flow:
    """Conditions and loops that are open."""

    word: str
    line: int


class Interpreter(Execution):
    """State of the controller while a program runs.

    Args:
        source: The module.
        routines: Its routines.
        data: What it declares.
        cell: See :class:`RapidCell`.
        lines: Of the text, for the blocks.

    Attributes:
        moves: What stands behind each motion in the text.
        calls: Executions of routines.
    """

    def __init__(
        self, source: Source, routines: Routines, data: Data, cell: RapidCell | None, lines: Sequence[str]
    ) -> None:
        self.frames: Frames = Frames(cell, data)
        super().__init__(self.frames)
        self.source, self.routines, self._lines = source, routines, lines
        self.targets = Targets(data, cell)
        self.targets.assigned = self.frames.assigned
        self.process = None if cell is None else ProcessWords(cell.functions, lambda code: code, statements_of)
        self.moves: list[RapidMotion] = []
        self.calls: list[RoutineCall] = []
        self._away: int | None = None
        self._running: list[str] = []
        self._flow: list[_Flow] = []
        self._count, self._call, self._ended = 0, -1, False
        self._times: dict[str, int] = {}

    def run(self) -> None:
        """Execute the program.

        Raises:
            ProgramError: See :func:`~counterflex.programs.rapid.read.reader.read_rapid`.
        """
        self._routine(self.routines.first(), (0, 0))
        repeated = {name for name, times in self._times.items() if times > 1}
        self.calls = [replace(call, repeated=call.routine.upper() in repeated) for call in self.calls]

    def _routine(self, routine: Routine, place: tuple[int, int]) -> None:
        key = routine.name.upper()
        if key in self._running or len(self._running) >= _DEEPEST:
            raise ProgramError(
                f"{routine.name} calls itself", where=self.source.place(place[0]), value=routine.name,
                hint="Post the path without recursion",
            )  # fmt: skip
        parent, flow = self._call, self._flow
        self.calls.append(RoutineCall(routine.name, routine.start, routine.end, routine.place, parent, place))
        self._times[key] = self._times.get(key, 0) + 1
        self._call, self._flow = len(self.calls) - 1, []
        self._running.append(key)
        texts = [statement.code for statement in routine.statements]
        at = 0
        while at < len(routine.statements) and not self._ended:
            statement = routine.statements[at]
            if statement.structure and statement.word in form.HANDLERS:
                break
            self.targets.routine = routine.start
            self._count += 1
            if self._count > _MOST:
                raise self._fault("the program is too long", statement, limit=f"{_MOST} statements")
            at += self._executed(statement, texts, at)
        self._running.pop()
        if self._flow and not self._ended:
            raise ProgramError(
                f"{self._flow[-1].word} is not closed", where=f"{self.source.name}:{self._flow[-1].line}",
                hint="The file may be cut off",
            )  # fmt: skip
        self._call, self._flow = parent, flow

    def _executed(self, statement: Statement, texts: Sequence[str], at: int) -> int:
        """Execute a statement with its block; returns how many statements that were."""
        self._words = []
        first, count, index = len(self.motions), 1, len(self._blocks)
        before = self.modal("G1")
        self._blocks.append(Block(statement.line, self._lines[statement.line - 1], (), before, first, 0))
        function = None
        if self.process is not None and not statement.structure:
            function = self.process.find(texts, at, self.source.place(statement.start))
        if function is not None:
            self._refuse_in_flow(statement, "the spindle, coolant or tool is switched")
            self.do(function)
            count = function.lines
        else:
            self._statement(statement)
        if len(self._blocks) == index + 1:  # no call, whose statements have blocks of their own
            made = len(self.motions) - first
            self._blocks[index] = replace(
                self._blocks[index],
                words=tuple(self._words),
                modal=self.modal(self.motion_code(first)),
                motion_count=made,
            )
        return count

    # ---- statements ------------------------------------------------------------------------------------------

    def _statement(self, statement: Statement) -> None:
        word = statement.word
        if statement.structure:
            self._structure(statement, word)
        elif word in form.MOTIONS:
            self._motion(statement, word)
        elif word in form.BY_AXES:
            self._refuse_in_flow(statement, "a motion")
            self._away = statement.line
        elif form.OTHER_MOTION.match(word):
            raise self._fault(
                f"{statement.code.split()[0]} is no motion that is read", statement, limit="MoveL MoveC MoveJ MoveAbsJ",
                hint="Post the path with these, process signals as statements of their own",
            )  # fmt: skip
        elif word == "WAITTIME":
            self._wait(statement)
        elif word == "VELSET":
            self._override(statement)
        elif word in form.ENDS:
            self._end(statement, word)
        elif word in form.DISPLACES:
            raise self._fault(
                f"{word.capitalize()} displaces or softens every motion behind it, which is not read", statement,
                hint="Write the displaced targets themselves",
            )  # fmt: skip
        else:
            self._other(statement, word)

    def _structure(self, statement: Statement, word: str) -> None:
        if word in form.OPENS:
            self._flow.append(_Flow(word, statement.line))
            self.acting.append(statement.line)
        elif word in form.OPENS.values():
            if not self._flow or form.OPENS[self._flow[-1].word] != word:
                raise self._fault(f"{word} closes nothing", statement, hint="The file may be damaged: post it again")
            self._flow.pop()
        elif word in form.BETWEEN:
            if not self._flow:
                raise self._fault("this belongs into IF or TEST", statement, hint="Post the program again")
        else:
            raise self._fault(
                "labels and jumps are not read: what is executed would not be known", statement,
                hint="Post the path without GOTO",
            )  # fmt: skip

    def _end(self, statement: Statement, word: str) -> None:
        if word == "STOP":
            if self._flow:
                self.acting.append(statement.line)
            else:
                self._words.append(Word("M", 0.0, 0, 0))
        elif self._flow and word != "GOTO":
            self.acting.append(statement.line)
        elif word == "EXIT":
            self._ended = True
        else:
            raise self._fault(
                f"{word} stands where it always acts: what is executed is not known", statement,
                hint="Post the path straight through, without GOTO and RETURN",
            )  # fmt: skip

    def _override(self, statement: Statement) -> None:
        match = form.SPEED_OVERRIDE.fullmatch(statement.code)
        if match is None or float(match[1]) != 100.0 or float(match[2]) < 1000.0:
            raise self._fault(
                "VelSet changes the speed of every motion behind it", statement, limit="VelSet 100,5000",
                hint="Write the speeds themselves: the force depends on them",
            )  # fmt: skip

    def _wait(self, statement: Statement) -> None:
        match = form.WAIT_TIME.fullmatch(statement.code)
        time_s = None if match is None else self.targets.data.number(match[1], self.targets.routine)
        if match is None or time_s is None or match[1].strip().upper() in self.frames.assigned or time_s < 0.0:
            if self._flow:
                return
            raise self._fault("the time of a wait is no number", statement, hint="Write the number itself, in s")
        if not self._flow and self.dwell(len(self._blocks) - 1, time_s):
            self.moves.append(
                RapidMotion(statement.line, "WaitTime", self._call, statement.start, statement.end, np.eye(3))
            )

    def _other(self, statement: Statement, word: str) -> None:
        code = statement.code
        if DECLARATION.match(code):
            return
        if (match := form.ASSIGNMENT.match(code)) is not None:
            self.frames.assigned.add(match[1].upper())
        elif form.COMPACT_IF.match(code):
            if form.MOVES.search(code):
                raise self._fault("a motion inside IF: whether it is made is not known", statement, hint=_STRAIGHT)
            self.acting.append(statement.line)
        elif word in form.ACTS:
            self.acting.append(statement.line)
        elif word in form.PASSED:
            return
        elif (match := form.CALL.fullmatch(code)) is not None and (routine := self.routines.find(match[1])) is not None:
            self._refuse_in_flow(statement, "a routine is called")
            if routine.arguments:
                raise self._fault(
                    f"{routine.name} has arguments: its targets are not known", statement, limit="PROC NAME()",
                    hint="Post the path without arguments",
                )  # fmt: skip
            self._routine(routine, (statement.start, statement.start + len(match[1])))
        elif form.CALL.match(code):
            raise self._fault(
                "an instruction or routine that is not known, which may move the robot", statement,
                limit="docs/rapid.md lists what is read; a PROC of this module; a statement of "
                "[controller.spindle.rapid] in the cell file",
                hint="Give one module with all its routines, or name the statement in the table (m_codes) if it moves "
                "nothing",
            )  # fmt: skip
        else:
            raise self._fault("an unknown statement", statement, hint="docs/rapid.md lists what is read")

    # ---- motions ---------------------------------------------------------------------------------------------

    def _motion(self, statement: Statement, word: str) -> None:
        self._refuse_in_flow(statement, "a motion")
        start = statement.start + len(word)
        given = arguments(self.source.code, start, statement.end)
        if not given[0].text and set(given[0].options) <= {"CONC"}:
            given = given[1:]
        if len(given) != form.MOTIONS[word]:
            raise self._fault(
                f"{statement.code[: len(word)]} has {form.MOTIONS[word]} arguments", statement,
                limit="target, speed, zone, tool, separated by commas",
            )  # fmt: skip
        *points, speed, zone, tool = given
        self._check_options((*points, zone, tool))
        if self._away is not None and self.motions:
            raise self._fault(
                f"the robot comes from a place that is not known, by axes (line {self._away})", statement,
                limit="MoveAbsJ before the first target and behind the last one",
                hint="Give that place as a robtarget, or post each part as a program of its own",
            )  # fmt: skip
        frame = tool.options.get("WOBJ", ("wobj0", tool.start, tool.end))[0]
        R_tcp_tool = self.frames.use(tool.text, frame, self.targets.routine, self.source.place(tool.start))
        target = self.targets.target(points[-1])
        auxiliary = self.targets.target(points[0]) if len(points) > 1 else None
        at = self.targets.speed(speed)
        self._away = None
        self.straight(
            len(self._blocks) - 1,
            np.array(target.position_mm) * MM,
            rotation_of(target.quat_wxyz) @ R_tcp_tool.T,
            0.0 if word == "MOVEJ" else at.m_s,
        )
        if auxiliary is not None:
            self.circle(
                np.array(auxiliary.position_mm) * MM, lambda what, hint: self._fault(what, statement, hint=hint)
            )
        self._words += [Word(letter, value, 0, 0) for letter, value in zip("XYZ", target.position_mm, strict=True)]
        exact = self.targets.exact(zone)
        self.moves.append(
            RapidMotion(
                statement.line,
                statement.code[: len(word)],
                self._call,
                statement.start,
                statement.end,
                R_tcp_tool,
                target,
                auxiliary,
                (speed.start, speed.end),
                at.value,
                (zone.start, zone.behind),
                exact,
                (tool.start, statement.end),
            )
        )

    def _check_options(self, given: Sequence[Argument]) -> None:
        """Refuse what options of targets, zone and tool would change."""
        known: Mapping[int, frozenset[str]] = {
            len(given) - 2: frozenset(("Z", "INPOS")), len(given) - 1: frozenset(("WOBJ", "TLOAD")),
        }  # fmt: skip
        for index, argument in enumerate(given):
            for key, (_, start, _) in argument.options.items():
                if key not in known.get(index, frozenset()):
                    raise ProgramError(
                        f"\\{key} is not read", where=self.source.place(start), value=argument.text[:60],
                        limit="\\V of the speed, \\Z and \\Inpos of the zone, \\WObj and \\TLoad of the tool",
                        hint="Post the path without it",
                    )  # fmt: skip

    # ---- faults ----------------------------------------------------------------------------------------------

    def _refuse_in_flow(self, statement: Statement, what: str) -> None:
        if self._flow:
            raise self._fault(
                f"{what} inside {self._flow[-1].word} (line {self._flow[-1].line}): whether and how often is not known",
                statement, limit="straight through", hint=_STRAIGHT,
            )  # fmt: skip

    def _fault(self, what: str, statement: Statement, **more: str) -> ProgramError:
        value = " ".join(statement.code.split())[:60]
        return ProgramError(what, where=self.source.place(statement.start), value=value, **more)


_STRAIGHT: Final = "Post the path without loops and conditions"

"""Executes a KRL program line by line: motions, frames, speeds and process words."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

from counterflex.core.errors import ProgramError
from counterflex.core.units import RPM
from counterflex.programs.krl.program import KrlMotion
from counterflex.programs.krl.read import statements as form
from counterflex.programs.krl.read.data_list import Named, key_of
from counterflex.programs.krl.read.frames import KrlCell
from counterflex.programs.krl.read.literals import code_of, number_of
from counterflex.programs.krl.read.modes import Modes
from counterflex.programs.krl.read.targets import Targets
from counterflex.programs.program import Block, Word
from counterflex.programs.robot_text.execution import Execution
from counterflex.programs.robot_text.process_words import ProcessWords


class Interpreter(Modes, Execution):
    """State of the controller while a program runs.

    Args:
        name: Of the ``.src`` file, for errors.
        lines: Of it.
        named: Literals of the ``.dat`` file.
        data_name: Its name; empty where there is none.
        cell: See :class:`KrlCell`.
        complete: Refuse a text without END.

    Attributes:
        moves: What stands behind each motion in the text.
        frames: The active frames.
        loose: See :class:`~counterflex.programs.krl.program.KrlProgram`.
        extra_text: External axes of the targets, as text.
    """

    def __init__(
        self,
        name: str,
        lines: Sequence[str],
        named: Mapping[str, Named],
        data_name: str,
        cell: KrlCell | None,
        *,
        complete: bool,
    ) -> None:
        Modes.__init__(self, name, lines, named, data_name, cell)
        Execution.__init__(self, self.frames)
        self.complete = complete
        self.targets = Targets(name, lines, named, data_name, cell)
        self.process = None if cell is None else ProcessWords(cell.functions, code_of)
        self.moves: list[KrlMotion] = []
        self.loose: dict[int, int] = {}
        self._statements = [line for line in lines if code_of(line).strip()]
        self._running: list[int] = []
        self._called = False
        self._away: int | None = None
        self._trigger: int | None = None
        self._begun = self._ended = False
        self._swallow = 0

    @property
    def extra_text(self) -> str:
        """``,E1 0.0`` of the targets; empty where they have no external axes."""
        return self.targets.extra_text

    def run(self) -> None:
        """Execute the first routine.

        Raises:
            ProgramError: See :func:`~counterflex.programs.krl.read.reader.read_krl`.
        """
        self._index = list(itertools.accumulate((bool(code_of(line).strip()) for line in self.lines), initial=0))
        self._subprograms = form.subprograms(self.lines)
        self._run_from(1)
        self._check_end()

    def _run_from(self, first_line: int) -> None:
        """Execute lines up to the END of their routine."""
        for number in range(first_line, len(self.lines) + 1):
            line = self.lines[number - 1]
            self.line, self._words, self._called = number, [], False
            code = code_of(line)
            first, before = len(self.motions), self.modal("G1")
            if code.strip():
                self._statement(code)
            first = len(self.motions) if self._called else first  # the lines of a subprogram have blocks of their own
            modal = self.modal("G1")
            if self._words or len(self.motions) > first or modal != before:
                modal = self.modal(self.motion_code(first))
            self._blocks.append(Block(number, line, tuple(self._words), modal, first, len(self.motions) - first))
            if self._ended:
                break

    def _call(self, name: str, code: str) -> bool:
        """A subprogram of the same file, executed where it is called."""
        begin = self._subprograms.get(name.upper())
        if begin is None:
            return False
        self._refuse_in_flow(code, "a subprogram is called")
        if begin in self._running:
            raise self._fault("a subprogram calls itself", code, hint="Post the path without recursion")
        line = self.line
        self._running.append(begin)
        self._run_from(begin + 1)
        self._check_end()
        self._running.pop()
        self.line, self._words, self._called, self._ended = line, [], True, False
        return True

    # ---- statements ------------------------------------------------------------------------------------------

    def _statement(self, code: str) -> None:
        if self._swallow:
            self._swallow -= 1
            return
        if form.HEADER.match(code):
            return
        if not self._begun:
            self._begin(code)
            return
        if form.END.fullmatch(code):
            self._ended = True
            return
        if self._spline is not None and not form.IN_SPLINE.match(code):
            raise self._fault(
                "this has no place in a spline block", code, limit="SLIN SCIRC TRIGGER ENDSPLINE",
                hint="The file may be damaged: post it again",
            )  # fmt: skip
        if self._process(code):
            return
        if form.HALT.fullmatch(code) and not self._flow:
            self._words = [*self._words, Word("M", 0.0, 0, 0)]
            return
        if form.ACTS.match(code) and not form.STANDARD.match(code):
            self.acting.append(self.line)
        if self._flow_statement(code):
            return
        for reads in (self._motion, self._speed, self._frame, self._basic, self._wait, self._trigger_statement):
            if reads(code):
                return
        self._other(code)

    def _begin(self, code: str) -> None:
        if form.ROUTINE.fullmatch(code):
            self._begun = True
        elif not form.PASSED.match(code):
            raise self._fault(
                "the program does not begin with DEF", code, limit="DEF NAME ( )",
                hint="Give the whole .src file; functions (DEFFCT) are not read",
            )  # fmt: skip

    def _process(self, code: str) -> bool:
        """A statement of ``[controller.spindle.krl]``."""
        if self.process is None:
            return False
        function = self.process.find(self._statements, self._index[self.line - 1], f"{self.name}:{self.line}")
        if function is None:
            return False
        self._refuse_in_flow(code, "the spindle, coolant or tool is switched")
        self.do(function)
        self._swallow = function.lines - 1
        return True

    def change_tool(self, values: Mapping[str, float]) -> None:
        """A tool change by the number of the tool, or of its TOOL_DATA."""
        super().change_tool(values)
        if "T" not in values and "D" in values:
            self.frames.set_tool_data(int(values["D"]), f"{self.name}:{self.line}")

    def _flow_statement(self, code: str) -> bool:
        if (match := form.OPENS.match(code)) is not None:
            self._flow.append((match[1].upper(), self.line))
        elif (match := form.CLOSES.match(code)) is not None:
            word = match[1].upper()
            if not self._flow or form.CLOSED_BY[self._flow[-1][0]] != word:
                raise self._fault(f"{word} closes nothing", code, hint="The file may be damaged: post it again")
            self._flow.pop()
        elif form.BETWEEN.match(code):
            if not self._flow:
                raise self._fault("this belongs into IF, SWITCH or a loop", code, hint="Post the program again")
        elif form.JUMP.match(code):
            if not self._flow or not code.strip().upper().startswith("RETURN"):
                raise self._fault(
                    "jumps are not read: what is executed would not be known", code,
                    hint="Post the path as one routine without GOTO, labels, RESUME and RETURN",
                )  # fmt: skip
        else:
            return False
        return True

    def _motion(self, code: str) -> bool:
        if form.SPLINE.match(code):
            raise self._fault(
                "the curve of this word is the controller's own and is not known", code,
                limit="PTP LIN CIRC SPTP SLIN SCIRC, SLIN and SCIRC within SPLINE", hint="Post the path as SLIN",
            )  # fmt: skip
        if self._spline_block(code):
            return True
        match = form.MOTION.match(code)
        if match is None:
            return False
        word = match[1].upper()
        if self._spline is not None and word not in ("SLIN", "SCIRC"):
            raise self._fault(f"{word} has no place in a spline block", code, limit="SLIN SCIRC")
        if match[2]:
            raise self._fault(
                f"{word}_REL counts from where the robot is: relative targets are not read", code,
                hint="Post absolute targets",
            )  # fmt: skip
        self._refuse_in_flow(code, "a motion")
        read = self.targets.motion(code, match.start(1), match.end(), word, self.line)
        if read is None:
            self._away = self.line
            return True
        if self._away is not None and self.motions:
            raise self._fault(
                "the robot comes from a place that is not known, by axes or by a name of the controller "
                f"(line {self._away})", code, limit="such places before the first target and behind the last one",
                hint="Give that place as a Cartesian target, or post each part as a program of its own",
            )  # fmt: skip
        if read.clause is not None and read.clause.frame_data:
            self.frames.tool_known = self.frames.base_known = True
            self._pending_frames = read.clause.frame_data
        self.frames.require(f"{self.name}:{self.line}:{match.start(1) + 1}")
        self._require_frame_data(code)
        if word.endswith("PTP") or not self.motions:
            feed = 0.0
        elif read.own_speed is not None:
            feed = self._in_range(code[slice(*read.own_speed)], code)
        elif self._spline:
            feed = self._spline
        elif self._feed_m_s is None:
            raise self._fault(
                "a motion along the path before $VEL.CP is set", code, limit="$VEL.CP=0.025 (m/s)",
                hint="Set it in the program: the speed decides about the force",
            )  # fmt: skip
        else:
            feed = self._feed_m_s
        made, rotation, words = self.targets.made(
            read, self.motions[-1] if self.motions else None, self.frames.R_tcp_tool
        )
        self._away = None
        self._words = [*self._words, *words]
        kind = "rapid" if feed == 0.0 else made.kind
        self.motions.append(
            replace(
                made,
                block=len(self._blocks),
                kind=kind,
                feed_m_s=feed,
                spindle_rad_s=self._rpm * RPM,
                tool=self.frames.tool,
            )
        )
        self.moves.append(replace(read, in_spline=self._spline is not None, speed_set=self._speed_set))
        self._speed_set = False
        self.rotations.append(rotation)
        if self._trigger is not None:
            self.loose[self.line] = self._trigger
            self._trigger = None
        return True

    def _wait(self, code: str) -> bool:
        match = form.WAIT_TIME.fullmatch(code)
        if match is None:
            return False
        time_s = number_of(match[1])
        if time_s is None:
            if self._flow:
                return True
            raise self._fault("the time of a wait is no number", code, hint="Write the number itself, in s")
        if not self._flow and self.dwell(len(self._blocks), time_s):
            self.moves.append(KrlMotion(self.line, "WAIT"))
        return True

    def _trigger_statement(self, code: str) -> bool:
        match = form.TRIGGER.fullmatch(code)
        if match is None:
            return False
        if not form.AT_START.fullmatch(match[1]):
            self._trigger = self._trigger or self.line
        elif self._trigger is not None:
            self._trigger = -1
        if self.process is not None:
            function = self.process.find([match[2]], 0, f"{self.name}:{self.line}")
            if function is not None:
                self._refuse_in_flow(code, "the spindle, coolant or tool is switched")
                self.do(function)
                self.acting.pop()
        return True

    def _other(self, code: str) -> None:
        if form.PASSED.match(code):
            return
        if (match := form.ASSIGNMENT.fullmatch(code)) is not None:
            self.targets.assign(key_of(match[1]), axes=bool(form.AXES.match(code)) and not self._flow)
            return
        if form.ROUTINE.fullmatch(code) or form.FUNCTION.match(code):
            raise self._fault("a routine begins before END", code, hint="The file may be damaged: post it again")
        match = form.CALL.fullmatch(code)
        if match is not None and form.NO_ARGUMENTS.fullmatch(code) and self._call(match[1], code):
            return
        if match is not None:
            raise self._fault(
                "a subprogram is called, which may move the robot", code,
                limit="DEF NAME( ) in the same file; or a statement of [controller.spindle.krl] in the cell file",
                hint="Post the path as one routine, or name the call in the table (m_codes) if it moves nothing",
            )  # fmt: skip
        raise self._fault("an unknown statement", code, hint="docs/krl.md lists what is read; post the path without it")

    # ---- end -------------------------------------------------------------------------------------------------

    def _check_end(self) -> None:
        if not self._begun:
            raise ProgramError(
                "the program does not begin with DEF", where=f"{self.name}:1:1", hint="Give the whole .src file"
            )
        if self._spline is not None:
            raise ProgramError("SPLINE is not closed", where=f"{self.name}:{self.line}", hint="The file may be cut off")
        if self._flow:
            word, line = self._flow[-1]
            raise ProgramError(f"{word} is not closed", where=f"{self.name}:{line}", hint="The file may be cut off")
        if not self._ended and self.complete:
            raise ProgramError(
                "the program stops without END: it may be cut off", where=f"{self.name}:{self.line}",
                value=self.lines[-1].strip()[:60],
                hint="Post it again, or say --without-end if it is complete",
            )  # fmt: skip

"""Read FANUC TP listings strictly: what cannot be known exactly is refused with its line and what to do."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final, cast

import numpy as np

from counterflex.core.errors import ProgramError
from counterflex.core.units import MM_PER_S
from counterflex.integrations.fanuc.language.program import FanucMotion, FanucProgram
from counterflex.integrations.fanuc.language.read.branches import ASSIGNED, TpStep, divided
from counterflex.integrations.fanuc.language.read.flow import JUMP, TpFlow
from counterflex.integrations.fanuc.language.read.listing import Listing
from counterflex.integrations.fanuc.language.read.motion_form import MOTION
from counterflex.integrations.fanuc.language.read.routine import TpFolder, TpRoutine, fault, listings_beside
from counterflex.integrations.fanuc.language.read.table import ACTING, row_of
from counterflex.programs.expression import ExpressionError, Value, is_number
from counterflex.programs.gcode.read.flow import split_lines
from counterflex.programs.program import Word
from counterflex.programs.robot_text.cell import NumberedCell
from counterflex.programs.robot_text.process_words import NUMBER, ProcessWords
from counterflex.programs.source_text import common_encoding, read_text, refuse_mark
from counterflex.programs.statement_table import Treatment
from counterflex.programs.unknown import Unknown

_MOST: Final = 100_000
"""Statements executed beyond ten times those written: a loop that never ends reaches it within seconds."""
_MOST_IDLE: Final = 20_000  # Statements executed beyond those written without a motion between them
_DEEPEST: Final = 40
_I: Final = re.IGNORECASE
_REGISTER: Final = r"A?R\s*\[.*\]"
_LEAVES: Final = re.compile(r"(?:IF|JMP|SELECT|=|ELSE|END|RETURN|ABORT|CALL)\b|.*\bTIMEOUT\b|=", _I)
_WAIT_TIME: Final = re.compile(rf"WAIT\s+({NUMBER}|{_REGISTER})\s*(?:\(\s*sec\s*\))?", _I)
_TIMEOUT: Final = re.compile(r".*\bTIMEOUT\s*,\s*(LBL\s*\[.*\])", _I | re.DOTALL)
_CALL: Final = re.compile(r"(?:CALL|RUN)\s+([A-Za-z_][\w-]*|(?:SR|PROG)\s*\[.*?\])\s*(?:\((.*)\))?", _I | re.DOTALL)
_OFFSET: Final = re.compile(
    r"(TOOL_)?OFFSET\s+CONDITION\s+(PR\s*\[.*?\])(?:\s*,?\s*(?:UFRAME|UTOOL)\s*\[\s*(.*?)\s*\])?", _I | re.DOTALL
)


class TpInterpreter(TpFlow):
    """State of the controller while a program runs.

    Args:
        folder: Programs that it can call.
        cell: What frames and process words are checked against; None takes every frame and knows no process words.
    """

    def __init__(self, routine: TpRoutine, folder: TpFolder, cell: NumberedCell | None) -> None:
        super().__init__(cell)
        self.routine, self.folder, self.file = routine, folder, routine.name
        self.process = None if cell is None else ProcessWords(cell.functions, lambda code: code)
        self.depth, self._count, self._ended = 0, 0, False
        self._counted_at, self._moved = 0, -1
        self.runs: dict[tuple[str, int], int] = {}

    def run(self) -> None:
        """Execute the program.

        Raises:
            ProgramError: See :func:`~counterflex.integrations.fanuc.language.read.reader.read_fanuc`.
        """
        self._run(self.routine, ())
        self._close_arcs(self.routine)

    def _run(self, routine: TpRoutine, arguments: tuple[Value, ...]) -> None:
        values, outer = self.values, (self.values.arguments, self.values.positions)
        values.arguments, values.positions = arguments, routine.positions
        self.depth += 1
        passes: dict[int, int] = {}
        at, count = 0, len(routine.statements)
        while at < count and not self._ended:
            then = self._executed(routine, at)
            if then <= at:
                if passes.get(at) == values.version or self._never_left(routine, then, at):
                    raise fault(
                        routine.listing, routine.statements[at],
                        f"the program repeats from line {routine.statements[then].line} on without end",
                        limit="a program that ends",
                        hint="Give the program of one part, without the loop around it",
                    )  # fmt: skip
                passes[at] = values.version
            at = then
        self.depth -= 1
        values.arguments, values.positions = outer

    @staticmethod
    def _never_left(routine: TpRoutine, begin: int, at: int) -> bool:
        """Return whether a jump back is made always, and nothing between its label and it leads elsewhere."""
        if not routine.texts[at].upper().startswith("JMP"):
            return False
        return not any(_LEAVES.match(routine.texts[index]) for index in range(begin, at))

    def _executed(self, routine: TpRoutine, at: int) -> int:
        """Execute a statement; returns the index of the next one."""
        step = TpStep(routine, at, routine.statements[at], routine.texts[at])
        self._count += 1
        idle = self._count - self._counted_at if len(self.motions) == self._moved else 0
        if not idle:
            self._counted_at, self._moved = self._count, len(self.motions)
        written = len(routine.statements)
        if self._count > _MOST + 10 * written or idle > _MOST_IDLE + written:
            raise step.fault(
                "the program does not end within the statements that are executed",
                limit=f"{_MOST} statements, {_MOST_IDLE} of them without a motion", hint="Give the program of one part",
            )  # fmt: skip
        self.call_line = step.statement.line if self.depth == 1 else self.call_line
        first = len(self.motions)
        self.block(step)
        block = len(self._blocks) - 1
        self._words = []
        if not step.text:
            return at + 1
        function = None if self.process is None else self.process.find(routine.texts, at, step.where)
        if function is not None:
            self.do(function)
        then = self._stated(step) if function is None else at + function.lines
        if len(self.motions) > first or self._words:
            made = len(self._blocks) == block + 1
            first = self._blocks[block].first_motion
            count = len(self.motions) - first if made else 0
            modal = self.modal(self.motion_code(first) if made else "G1")
            self._blocks[block] = replace(
                self._blocks[block], words=tuple(self._words), motion_count=count, modal=modal
            )
        return then

    def _stated(self, step: TpStep) -> int:
        """Execute a statement that is no machine function; returns the index of the next one."""
        try:
            return self.statement(step)
        except ProgramError:
            raise
        except (ValueError, TypeError, OverflowError, RecursionError) as error:
            what = str(error) if isinstance(error, ExpressionError) else "a value does not fit this statement"
            raise step.fault(what, hint="The file may be damaged: post it again") from error

    # ---- statements ----------------------------------------------------------------------------------------

    def statement(self, step: TpStep) -> int:
        """Execute a statement; returns the index of the next one."""
        motion = MOTION.match(step.text)
        if motion is not None and motion[1].upper() != "S":
            key = (step.routine.name, step.statement.start)
            self.runs[key] = self.runs.get(key, 0) + 1
            self._at_time(step, self.motion(step.routine, step.statement, motion[1].upper()))
            return step.at + 1
        row = row_of(step.text)
        if row is None:
            raise step.fault(
                "an unknown statement, or a macro instruction", limit="docs/statements/fanuc.md",
                hint="Name it in [controller.spindle.fanuc] (m_codes) of the cell file if it moves nothing, or post "
                "the path without it",
            )  # fmt: skip
        if row.treatment is Treatment.REFUSED:
            raise step.fault(f"{row.word}: {row.reason}, which is not read", hint=row.remedy)
        handler = _HANDLERS.get(row.word)
        if row.word in ACTING:
            self.act(step)
        return step.at + 1 if handler is None else handler(self, step)

    def _at_time(self, step: TpStep, text: str) -> None:
        """Make registers unknown that a call before or behind the end of a motion (TA, TB, DB) leaves open."""
        if not text:
            return
        self.act(step)
        row = row_of(text)
        condition = Unknown("it is set while a motion runs", step.line)
        if row is not None and row.word in ASSIGNED:
            self._forget_assigned(step, text, condition)
        elif row is not None and row.word == "CALL":
            call = _CALL.fullmatch(text)
            called = None if call is None else self._listing(step, call[1])
            if called is not None:
                opening = (step.statement.code.split()[0], step.statement.line)
                self.pass_over(called, 0, len(called.statements), condition, opening, 1)

    def _assign(self, step: TpStep) -> int:
        if "=" not in step.text:
            raise step.fault("an assignment without a value", hint="The file may be damaged")
        word, indices, value = self.target_of(step, step.text)
        self.values.assign(word, indices, self.value(step, value))
        return step.at + 1

    def _frame(self, step: TpStep) -> int:
        word, _, right = step.text.partition("=")
        name = word.strip().upper()
        value = step.known(
            self.value(step, right), f"the active frame ({name})", text=step.text, hint="Write the number itself"
        )
        if not is_number(value) or not 0 <= float(cast("float", value)) <= 99:
            raise step.fault("there is no such frame", limit="a number", hint="Write it itself")
        number = int(cast("float", value))
        if name == "UFRAME_NUM":
            self.frames.user_frame = number
        else:
            self.frames.user_tool = number
        return step.at + 1

    def _offset(self, step: TpStep) -> int:
        match = _OFFSET.fullmatch(step.text)
        if match is None:
            raise step.fault("the condition of an offset is not understood", limit="OFFSET CONDITION PR[n]",
                             hint="Name the register at the motion: Offset,PR[n]")  # fmt: skip
        frame = None
        if match[3] is not None:
            number = step.known(self.value(step, match[3]), "the frame of an offset", text=step.text)
            frame = int(cast("float", number))
        self.targets.conditions["tool" if match[1] else "offset"] = (self.value(step, match[2]), frame)
        return step.at + 1

    def _override(self, step: TpStep) -> int:
        value = self.value(step, step.text.partition("=")[2].replace("%", ""))
        if is_number(value) and not 0.0 < float(cast("float", value)) <= 100.0:
            raise step.fault("the override is out of range", limit="1 to 100 %")
        self.targets.override = 0.01 * float(cast("float", value)) if is_number(value) else value
        return step.at + 1

    def _limit(self, step: TpStep) -> int:
        value = self.value(step, step.text.partition("=")[2])
        self.targets.linear_max_m_s = float(cast("float", value)) * MM_PER_S if is_number(value) else value
        return step.at + 1

    # ---- other programs ------------------------------------------------------------------------------------

    def _called(self, step: TpStep, text: str) -> tuple[TpRoutine, tuple[Value, ...]]:
        match = _CALL.fullmatch(text)
        if match is None:
            raise step.fault("the call is not understood", limit="CALL PART(1)")
        name: Value = match[1]
        if match[1].endswith("]"):
            name = step.known(self.value(step, match[1]), "which program is called", text=text, hint="Write its name")
        called = self._listing(step, str(name))
        if called is None and str(name).upper() == self.routine.listing.name.rpartition(".")[0].upper():
            called = self.routine
        if called is None:
            raise step.fault(
                "another program is called, which may move the robot",
                limit="a listing of the folder, or a statement of [controller.spindle.fanuc] in the cell file",
                hint=f"Put {name}.ls beside the program, or name the call in the table (m_codes) if it moves nothing",
            )
        inside = (match[2] or "").strip()
        arguments = tuple(self.value(step, one) for one in divided(inside)) if inside else ()
        return called, arguments

    def _call(self, step: TpStep) -> int:
        called, arguments = self._called(step, step.text)
        if self.depth >= _DEEPEST:
            raise step.fault("programs call each other without end", limit=f"{_DEEPEST} calls within each other",
                             hint="Post the path without recursion")  # fmt: skip
        words, self._words = self._words, []
        self._run(called, arguments)
        self._words = words
        return step.at + 1

    def _run_beside(self, step: TpStep) -> int:
        called, _ = self._called(step, step.text)
        task = Unknown(f"{called.name} runs beside the program", step.line)
        self.pass_over(called, 0, len(called.statements), task, ("RUN", step.statement.line), 1)
        return step.at + 1

    # ---- waits ---------------------------------------------------------------------------------------------

    def _wait(self, step: TpStep) -> int:
        timeout = _TIMEOUT.fullmatch(step.text)
        if timeout is not None:
            label = JUMP.fullmatch(f"JMP {timeout[1]}")
            number = self.number(step, label[1] if label else "", "the label of a jump")
            return self.jump_perhaps(step, number, Unknown("an input comes or not", step.line))
        match = _WAIT_TIME.fullmatch(step.text)
        if match is None:
            self.act(step)
        time_s = None if match is None else self.value(step, match[1])
        if is_number(time_s):
            one = step.statement
            move = FanucMotion(line=one.line, word="WAIT", start=one.start, head=one.head, end=one.end,
                               R_tcp_tool=np.eye(3), file=step.routine.name)  # fmt: skip
            self.rest(move, float(cast("float", time_s)))
        return step.at + 1

    def _pause(self, step: TpStep) -> int:
        self._words.append(Word("M", 0.0, 0, 0))
        return step.at + 1


_Handler = Callable[[TpInterpreter, TpStep], int]
_HANDLERS: Final[Mapping[str, _Handler]] = {
    **dict.fromkeys((*ASSIGNED, "UFRAME[]", "UTOOL[]"), TpInterpreter._assign),
    **dict.fromkeys(("UFRAME_NUM", "UTOOL_NUM"), TpInterpreter._frame),
    **dict.fromkeys(("OFFSET CONDITION", "TOOL_OFFSET CONDITION"), TpInterpreter._offset),
    **dict.fromkeys(("OVERRIDE", "$MCR.$GENOVERRIDE", "$MCR.$PRGOVERRIDE"), TpInterpreter._override),
    "LINEAR_MAX_SPEED": TpInterpreter._limit,
    "IF": TpInterpreter.do_if,
    "ELSE": TpInterpreter.do_else,
    "JMP": TpInterpreter.do_jump,
    "SELECT": TpInterpreter.do_select,
    "=": TpInterpreter.do_case,
    "FOR": TpInterpreter.do_for,
    "ENDFOR": TpInterpreter.do_end_for,
    "END": TpInterpreter._end,
    "RETURN": TpInterpreter._end,
    "ABORT": TpInterpreter._abort,
    "CALL": TpInterpreter._call,
    "RUN": TpInterpreter._run_beside,
    "WAIT": TpInterpreter._wait,
    "PAUSE": TpInterpreter._pause,
}


_GROUP: Final = re.compile(r"\s*GP([2-9])\s*:", re.IGNORECASE)


def read_fanuc(
    text: str,
    *,
    name: str = "program.ls",
    cell: NumberedCell | None = None,
    complete: bool = True,
    folder: TpFolder | None = None,
) -> FanucProgram:
    """Execute a listing and return the statements passed and the motions made.

    Positions are of the tool tip in the user frame, which is the part frame; the tool axis and the rotation about it
    are those of W P R (:func:`~counterflex.integrations.fanuc.language.program.frame_of`).
    The first position is approached from wherever the robot is: it counts as reached by a rapid without length.

    Args:
        cell: What frames and process words are checked against; None takes the first user frame for the part frame and
            knows no process words.
        complete: Refuse a text without /END: it may have been cut off.
        folder: Programs that it can call; None has none.

    Raises:
        ProgramError: With ``name:line:column``, at the first thing that is unknown, contradictory or cannot be read
            exactly.
    """
    listing = Listing(text, name, complete=complete)
    lines = split_lines(text)
    routine, folder = TpRoutine(listing, lines), folder or TpFolder()
    interpreter = TpInterpreter(routine, folder, cell)
    interpreter.run()
    return FanucProgram(
        **interpreter.fields(name, text),
        dialect="fanuc",
        straight=not folder.routines and max(interpreter.runs.values(), default=1) == 1,
        external=interpreter.targets.external.changes(interpreter.motions),
        listings={name: routine.about(), **{key: one.about() for key, one in folder.routines.items()}},
        moves=tuple(interpreter.moves),
    )


def read_fanuc_file(
    path: str | os.PathLike[str], *, cell: NumberedCell | None = None, complete: bool = True
) -> FanucProgram:
    """Read a listing, with those of its folder that it calls.

    Args:
        path: The file, UTF-8 or Latin-1.
        cell: See :func:`read_fanuc`.
        complete: Refuse a file without /END.

    Raises:
        ProgramError: A file cannot be read, is no text, or is no program that can be executed exactly.
    """
    file = Path(path)
    text, encoding = read_text(file)
    folder = TpFolder(listings_beside(file), complete=complete)
    refuse_mark(encoding, file)
    program = read_fanuc(text, name=file.name, cell=cell, complete=complete, folder=folder)
    texts = {file.name: (text, encoding)} | {
        name: (routine.listing.text, routine.encoding) for name, routine in folder.routines.items()
    }
    return replace(program, encoding=common_encoding(texts))


def further_groups(program: FanucProgram) -> list[str]:
    """Return one sentence where positions state motion groups besides that of the arm."""
    group = next(((k, m) for k, text in enumerate(program.lines, start=1) if (m := _GROUP.match(text))), None)
    if group is None:
        return []
    line, match = group
    return [
        f"line {line}: positions state group {match[1]}, too, at one place; whether part or robot stand there was not "
        "compared with the cell file"
    ]

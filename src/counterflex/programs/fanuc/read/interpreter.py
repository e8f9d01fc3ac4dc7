"""Executes a FANUC TP program statement by statement: values, branches, loops, calls, frames, process words."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final, cast

import numpy as np

from counterflex.core.units import MM_PER_S
from counterflex.programs.fanuc.program import FanucMotion
from counterflex.programs.fanuc.read.branches import ASSIGNED, Branches, divided
from counterflex.programs.fanuc.read.frames import FanucCell
from counterflex.programs.fanuc.read.listing import Statement
from counterflex.programs.fanuc.read.motion_form import MOTION
from counterflex.programs.fanuc.read.routine import Folder, Routine, fault
from counterflex.programs.fanuc.read.table import ACTING, row_of
from counterflex.programs.program import Word
from counterflex.programs.robot_text.expression import Value, is_number
from counterflex.programs.robot_text.process_words import NUMBER, ProcessWords
from counterflex.programs.statement_table import Treatment
from counterflex.programs.unknown import Unknown, known

_MOST: Final = 500_000
"""Statements executed beyond ten times those written. A program of 200 000 points in loops stays below; a loop that
never ends reaches it within seconds."""
_DEEPEST: Final = 40
_I: Final = re.IGNORECASE
_REGISTER: Final = r"A?R\s*\[.*\]"
_WAIT_TIME: Final = re.compile(rf"WAIT\s+({NUMBER}|{_REGISTER})\s*(?:\(\s*sec\s*\))?", _I)
_TIMEOUT: Final = re.compile(r".*\bTIMEOUT\s*,\s*(LBL\s*\[.*\])", _I | re.DOTALL)
_BLOCK: Final = re.compile(r"IF\s*(.*)\bTHEN", _I | re.DOTALL)
_FOR: Final = re.compile(r"FOR\s+(R\s*\[.*?\])\s*=\s*(.*?)\s+(TO|DOWNTO)\s+(.*)", _I | re.DOTALL)
_SELECT: Final = re.compile(r"SELECT\s+(.*?\])\s*(=.*)", _I | re.DOTALL)
_JUMP: Final = re.compile(r"JMP\s+LBL\s*\[(.*)\]", _I | re.DOTALL)
_CALL: Final = re.compile(r"(?:CALL|RUN)\s+([A-Za-z_][\w-]*|(?:SR|PROG)\s*\[.*?\])\s*(?:\((.*)\))?", _I | re.DOTALL)
_OFFSET: Final = re.compile(
    r"(TOOL_)?OFFSET\s+CONDITION\s+(PR\s*\[.*?\])(?:\s*,?\s*(?:UFRAME|UTOOL)\s*\[\s*(.*?)\s*\])?", _I | re.DOTALL
)


class Interpreter(Branches):
    """State of the controller while a program runs.

    Args:
        routine: The program.
        folder: Programs that it can call.
        cell: What frames and process words are checked against; None takes every frame and knows no process words.
    """

    def __init__(self, routine: Routine, folder: Folder, cell: FanucCell | None) -> None:
        super().__init__(cell)
        self.routine, self.folder, self.file = routine, folder, routine.name
        self.process = None if cell is None else ProcessWords(cell.functions, lambda code: code)
        self.depth, self._count, self._ended = 0, 0, False
        self.runs: dict[tuple[str, int], int] = {}

    def run(self) -> None:
        """Execute the program.

        Raises:
            ProgramError: See :func:`~counterflex.programs.fanuc.read.reader.read_fanuc`.
        """
        self._run(self.routine, ())
        self._close_arcs(self.routine)

    def _run(self, routine: Routine, arguments: tuple[Value, ...]) -> None:
        values, outer = self.values, (self.values.arguments, self.values.positions)
        values.arguments, values.positions = arguments, routine.positions
        self.depth += 1
        passes: dict[int, int] = {}
        at, count = 0, len(routine.statements)
        while at < count and not self._ended:
            then = self._executed(routine, at)
            if then <= at:
                if passes.get(at) == values.version:
                    raise fault(routine.listing, routine.statements[at],
                                f"the program repeats from line {routine.statements[then].line} on without end",
                                limit="a program that ends", hint="Give the program of one part, without the loop "
                                "around it")  # fmt: skip
                passes[at] = values.version
            at = then
        self.depth -= 1
        values.arguments, values.positions = outer

    def _executed(self, routine: Routine, at: int) -> int:
        """Execute a statement; returns the index of the next one."""
        statement, text = routine.statements[at], routine.texts[at]
        self._count += 1
        if self._count > _MOST + 10 * len(routine.statements):
            raise fault(routine.listing, statement, "the program does not end within the statements that are executed",
                        limit=f"{_MOST} statements", hint="Give the program of one part")  # fmt: skip
        first = len(self.motions)
        self.block(routine, statement)
        block = len(self._blocks) - 1
        self._words = []
        function = None
        if self.process is not None and text:
            function = self.process.find(routine.texts, at, routine.listing.place(statement.start))
        if function is not None:
            self.do(function)
            then = at + function.lines
        elif not text:
            return at + 1
        else:
            then = self._statement(routine, at, statement, text)
        if len(self.motions) > first or self._words:
            made = len(self._blocks) == block + 1
            count = len(self.motions) - first if made else 0
            self._blocks[block] = replace(
                self._blocks[block], words=tuple(self._words), motion_count=count,
                modal=self.modal(self.motion_code(first) if made else "G1"),
            )  # fmt: skip
        return then

    # ---- statements ----------------------------------------------------------------------------------------

    def _statement(self, routine: Routine, at: int, statement: Statement, text: str) -> int:
        motion = MOTION.match(text)
        if motion is not None and motion[1].upper() != "S":
            key = (routine.name, statement.start)
            self.runs[key] = self.runs.get(key, 0) + 1
            self.motion(routine, statement, motion[1].upper())
            return at + 1
        row = row_of(text)
        if row is None:
            raise fault(routine.listing, statement, "an unknown statement, or a macro instruction",
                        limit="docs/statements/fanuc.md", hint="Name it in [controller.spindle.fanuc] (m_codes) of the "
                        "cell file if it moves nothing, or post the path without it")  # fmt: skip
        if row.treatment is Treatment.REFUSED:
            raise fault(routine.listing, statement, f"{row.word}: {row.reason}, which is not read", hint=row.remedy)
        handler = _HANDLERS.get(row.word)
        if row.word in ACTING:
            self.acting.append(statement.line)
        return at + 1 if handler is None else handler(self, routine, at, statement, text)

    def _assign(self, routine: Routine, at: int, statement: Statement, text: str) -> int:
        if "=" not in text:
            raise fault(routine.listing, statement, "an assignment without a value", hint="The file may be damaged")
        word, indices, value = self.target_of(routine, statement, text)
        self.values.assign(word, indices, self.value(routine, statement, value))
        return at + 1

    def _frame(self, routine: Routine, at: int, statement: Statement, text: str) -> int:
        word, _, right = text.partition("=")
        where = routine.listing.place(statement.start)
        name = word.strip().upper()
        value = known(self.value(routine, statement, right), f"the active frame ({name})", where, text=text,
                      hint="Write the number itself")  # fmt: skip
        if not is_number(value) or not 0 <= float(cast("float", value)) <= 99:
            raise fault(routine.listing, statement, "there is no such frame", limit="a number", hint="Write it itself")
        number = int(cast("float", value))
        if name == "UFRAME_NUM":
            self.frames.user_frame = number
        else:
            self.frames.user_tool = number
        return at + 1

    def _offset(self, routine: Routine, at: int, statement: Statement, text: str) -> int:
        match = _OFFSET.fullmatch(text)
        if match is None:
            raise fault(routine.listing, statement, "the condition of an offset is not understood",
                        limit="OFFSET CONDITION PR[n]", hint="Name the register at the motion: Offset,PR[n]")  # fmt: skip
        frame = None
        if match[3] is not None:
            number = known(self.value(routine, statement, match[3]), "the frame of an offset",
                           routine.listing.place(statement.start), text=text)  # fmt: skip
            frame = int(cast("float", number))
        self.targets.conditions["tool" if match[1] else "offset"] = (self.value(routine, statement, match[2]), frame)
        return at + 1

    def _override(self, routine: Routine, at: int, statement: Statement, text: str) -> int:
        value = self.value(routine, statement, text.partition("=")[2].replace("%", ""))
        if is_number(value) and not 0.0 < float(cast("float", value)) <= 100.0:
            raise fault(routine.listing, statement, "the override is out of range", limit="1 to 100 %")
        self.targets.override = 0.01 * float(cast("float", value)) if is_number(value) else value
        return at + 1

    def _limit(self, routine: Routine, at: int, statement: Statement, text: str) -> int:
        value = self.value(routine, statement, text.partition("=")[2])
        self.targets.linear_max_m_s = float(cast("float", value)) * MM_PER_S if is_number(value) else value
        return at + 1

    # ---- flow ----------------------------------------------------------------------------------------------

    def _if(self, routine: Routine, at: int, statement: Statement, text: str) -> int:
        block = _BLOCK.fullmatch(text)
        if block is None:
            condition, action = divided(text[2:], most=2) if "," in text else (text[2:], "")
            decision = self._decision(routine, statement, condition)
            if decision is False:
                return at + 1
            return self._action(routine, at, statement, action.strip(), decision)
        decision = self._decision(routine, statement, block[1])
        end, other = routine.ends[at], routine.elses.get(at)
        if isinstance(decision, Unknown):
            self.acting.append(statement.line)
            self.pass_over(routine, at + 1, end, decision, ("IF", statement.line))
            return end + 1
        return at + 1 if decision else end + 1 if other is None else other + 1

    def _decision(self, routine: Routine, statement: Statement, text: str) -> bool | Unknown:
        value = self.value(routine, statement, text)
        if isinstance(value, Unknown):
            return Unknown(value.why, value.where or f"{routine.name}:{statement.line}")
        if not isinstance(value, bool):
            raise fault(routine.listing, statement, "this is no condition", limit="IF (R[1]=2)",
                        hint="Post the program again")  # fmt: skip
        return value

    def _action(self, routine: Routine, at: int, statement: Statement, action: str, decision: bool | Unknown) -> int:
        """Do what stands behind the comma of IF or SELECT; returns the index of the next statement."""
        if isinstance(decision, Unknown):
            self.acting.append(statement.line)
            jump = _JUMP.fullmatch(action)
            if jump is not None:
                number = self._number(routine, statement, jump[1], "the label of a jump")
                return self.jump_perhaps(routine, at, number, decision)
            self._pass_action(routine, statement, action, decision, (routine.texts[at].split()[0], statement.line), 0)
            return at + 1
        if row_of(action) is None or MOTION.match(action):
            raise fault(routine.listing, statement, "what stands under the condition is not understood",
                        limit="IF R[1]=2,JMP LBL[1]", hint="Post the program again")  # fmt: skip
        then = self._statement(routine, at, statement, action)
        return at + 1 if then is None else then

    def _number(self, routine: Routine, statement: Statement, text: str, use: str) -> int:
        value = known(self.value(routine, statement, f"[{text}"[1:].split(":")[0]), use,
                      routine.listing.place(statement.start), text=statement.code, hint="Write the number itself")  # fmt: skip
        if not is_number(value):
            raise fault(routine.listing, statement, f"{use} is no number", hint="Write the number itself")
        return int(cast("float", value))

    def _jump(self, routine: Routine, at: int, statement: Statement, text: str) -> int:
        match = _JUMP.fullmatch(text)
        if match is None:
            raise fault(routine.listing, statement, "the jump is not understood", limit="JMP LBL[1]")
        number = self._number(routine, statement, match[1], "the label of a jump")
        if number not in routine.labels:
            raise fault(routine.listing, statement, f"there is no LBL[{number}]", hint="The file may be damaged")
        return routine.labels[number]

    def _else(self, routine: Routine, at: int, statement: Statement, text: str) -> int:
        if at not in routine.elses:
            raise fault(routine.listing, statement, "this belongs into IF or SELECT", hint="The file may be damaged")
        return routine.ends[routine.elses[at]] + 1

    def _select(self, routine: Routine, at: int, statement: Statement, text: str) -> int:
        match = _SELECT.fullmatch(text)
        if match is None:
            raise fault(routine.listing, statement, "SELECT is not understood", limit="SELECT R[1]=1,CALL PART")
        value, case, index, chosen = self.value(routine, statement, match[1]), match[2], at, ""
        unknown = value if isinstance(value, Unknown) else None
        end = at + 1
        while end < len(routine.texts) and (
            not routine.texts[end] or routine.texts[end][:1] == "=" or routine.texts[end][:5].upper() == "ELSE,"
        ):
            end += 1
        while end > at + 1 and not routine.texts[end - 1]:
            end -= 1
        for index in range(at, end):
            case = match[2] if index == at else routine.texts[index]
            label, _, action = case.partition(",")
            if unknown is None and label.strip() and not chosen:
                fits = label.strip().upper() == "ELSE" or (
                    self.value(routine, statement, label.strip()[1:]) == value
                )  # fmt: skip
                chosen = action.strip() if fits else ""
            elif unknown is not None and action.strip():
                self._action(routine, index, routine.statements[index], action.strip(),
                             Unknown(unknown.why, unknown.where or f"{routine.name}:{statement.line}"))  # fmt: skip
        if not chosen:
            return end
        then = self._statement(routine, at, statement, chosen)
        return end if then == at + 1 else then

    def _case(self, routine: Routine, at: int, statement: Statement, text: str) -> int:
        raise fault(routine.listing, statement, "this belongs into SELECT", hint="The file may be damaged")

    def _for(self, routine: Routine, at: int, statement: Statement, text: str) -> int:
        match = _FOR.fullmatch(text)
        if match is None:
            raise fault(routine.listing, statement, "FOR is not understood", limit="FOR R[1]=1 TO 5")
        first, last = self.value(routine, statement, match[2]), self.value(routine, statement, match[4])
        end = routine.ends[at]
        unknown = next((one for one in (first, last) if isinstance(one, Unknown)), None)
        if unknown is not None:
            self.acting.append(statement.line)
            condition = Unknown(unknown.why, unknown.where or f"{routine.name}:{statement.line}")
            self.pass_over(routine, at, end, condition, ("FOR", statement.line))
            return end + 1
        word, indices, _ = self.target_of(routine, statement, f"{match[1]}=0")
        self.values.assign(word, indices, first)
        runs = cast("float", first) <= cast("float", last) if match[3].upper() == "TO" else (
            cast("float", first) >= cast("float", last))  # fmt: skip
        return at + 1 if runs else end + 1

    def _end_for(self, routine: Routine, at: int, statement: Statement, text: str) -> int:
        """Count on and go back while the last value is not reached (Operator's manual, FOR/ENDFOR)."""
        begin = routine.ends[at]
        match = _FOR.fullmatch(routine.texts[begin])
        if match is None:
            return at + 1
        opening = routine.statements[begin]
        counter, last = self.value(routine, opening, match[1]), self.value(routine, opening, match[4])
        for one in (counter, last):
            known(one, "how often FOR repeats", routine.listing.place(opening.start), text=opening.code)
        step = 1 if match[3].upper() == "TO" else -1
        if step * cast("float", counter) >= step * cast("float", last):
            return at + 1
        word, indices, _ = self.target_of(routine, opening, f"{match[1]}=0")
        self.values.assign(word, indices, cast("float", counter) + step)
        return begin + 1

    def _end(self, routine: Routine, at: int, statement: Statement, text: str) -> int:
        return len(routine.statements)

    def _abort(self, routine: Routine, at: int, statement: Statement, text: str) -> int:
        self._ended = True
        return at + 1

    # ---- other programs ------------------------------------------------------------------------------------

    def _called(self, routine: Routine, statement: Statement, text: str) -> tuple[Routine, tuple[Value, ...]]:
        match = _CALL.fullmatch(text)
        if match is None:
            raise fault(routine.listing, statement, "the call is not understood", limit="CALL PART(1)")
        name: Value = match[1]
        if match[1].endswith("]"):
            where = routine.listing.place(statement.start)
            name = known(self.value(routine, statement, match[1]), "which program is called", where, text=text,
                         hint="Write its name")  # fmt: skip
        called = self.folder.find(str(name), lambda what, hint: fault(routine.listing, statement, what, hint=hint))
        if called is None and str(name).upper() == self.routine.listing.name.rpartition(".")[0].upper():
            called = self.routine
        if called is None:
            raise fault(
                routine.listing, statement, "another program is called, which may move the robot",
                limit="a listing of the folder, or a statement of [controller.spindle.fanuc] in the cell file",
                hint=f"Put {name}.ls beside the program, or name the call in the table (m_codes) if it moves nothing",
            )  # fmt: skip
        inside = (match[2] or "").strip()
        arguments = tuple(self.value(routine, statement, one) for one in divided(inside)) if inside else ()
        return called, arguments

    def _call(self, routine: Routine, at: int, statement: Statement, text: str) -> int:
        called, arguments = self._called(routine, statement, text)
        if self.depth >= _DEEPEST:
            raise fault(routine.listing, statement, "programs call each other without end",
                        limit=f"{_DEEPEST} calls within each other", hint="Post the path without recursion")  # fmt: skip
        words, self._words = self._words, []
        self._run(called, arguments)
        self._words = words
        return at + 1

    def _run_beside(self, routine: Routine, at: int, statement: Statement, text: str) -> int:
        called, _ = self._called(routine, statement, text)
        task = Unknown(f"{called.name} runs beside the program", f"{routine.name}:{statement.line}")
        self.pass_over(called, 0, len(called.statements), task, ("RUN", statement.line), 1)
        return at + 1

    # ---- waits ---------------------------------------------------------------------------------------------

    def _wait(self, routine: Routine, at: int, statement: Statement, text: str) -> int:
        timeout = _TIMEOUT.fullmatch(text)
        if timeout is not None:
            label = _JUMP.fullmatch(f"JMP {timeout[1]}")
            number = self._number(routine, statement, label[1] if label else "", "the label of a jump")
            return self.jump_perhaps(
                routine, at, number, Unknown("an input comes or not", f"{routine.name}:{statement.line}")
            )
        match = _WAIT_TIME.fullmatch(text)
        time_s = None if match is None else self.value(routine, statement, match[1])
        if is_number(time_s) and self.dwell(len(self._blocks) - 1, float(cast("float", time_s))):
            self.moves.append(FanucMotion(statement.line, "WAIT", statement.start, statement.head, statement.end,
                                          np.eye(3), file=routine.name))  # fmt: skip
        return at + 1

    def _pause(self, routine: Routine, at: int, statement: Statement, text: str) -> int:
        self._words.append(Word("M", 0.0, 0, 0))
        return at + 1


_Handler = Callable[[Interpreter, Routine, int, Statement, str], int]
_HANDLERS: Final[Mapping[str, _Handler]] = {
    **dict.fromkeys((*ASSIGNED, "UFRAME[]", "UTOOL[]"), Interpreter._assign),
    **dict.fromkeys(("UFRAME_NUM", "UTOOL_NUM"), Interpreter._frame),
    **dict.fromkeys(("OFFSET CONDITION", "TOOL_OFFSET CONDITION"), Interpreter._offset),
    **dict.fromkeys(("OVERRIDE", "$MCR.$GENOVERRIDE", "$MCR.$PRGOVERRIDE"), Interpreter._override),
    "LINEAR_MAX_SPEED": Interpreter._limit, "IF": Interpreter._if, "ELSE": Interpreter._else,
    "JMP": Interpreter._jump, "SELECT": Interpreter._select, "=": Interpreter._case, "FOR": Interpreter._for,
    "ENDFOR": Interpreter._end_for, "END": Interpreter._end, "RETURN": Interpreter._end, "ABORT": Interpreter._abort,
    "CALL": Interpreter._call, "RUN": Interpreter._run_beside, "WAIT": Interpreter._wait, "PAUSE": Interpreter._pause,
}  # fmt: skip

"""Executes a VAL3 program line by line: values, branches, loops, calls, frames, speeds, process words."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final, cast

import numpy as np

from counterflex.core.errors import ProgramError
from counterflex.geometry import pose
from counterflex.integrations.staubli.language.read.branches import (
    Val3Folder,
    assignment,
    hidden_effect,
    instruction,
    row_of,
)
from counterflex.integrations.staubli.language.read.flow import Val3Flow
from counterflex.integrations.staubli.language.read.motions import Val3Cell
from counterflex.integrations.staubli.language.read.program_file import Val3Routine, arguments, code_of
from counterflex.integrations.staubli.language.read.store import ROOTS, Store
from counterflex.integrations.staubli.language.read.table import ACTING
from counterflex.integrations.staubli.language.read.values import FATHER, TRSF, trsf_of
from counterflex.programs.expression import ExpressionError, Value, is_number
from counterflex.programs.program import Word
from counterflex.programs.robot_text.process_words import ProcessWords
from counterflex.programs.statement_table import Treatment
from counterflex.programs.unknown import Unknown, first_unknown, known

__all__ = ["Val3Cell", "Val3Interpreter"]

_MOST: Final = 100_000
"""Lines executed beyond ten times those written: a loop that never ends reaches it within seconds."""
_MOST_IDLE: Final = 20_000  # Lines executed beyond those written without a motion between them
_DEEPEST: Final = 40
_LEAST_M: Final = 1e-6
_FOREVER: Final = re.compile(r"(?:while\s*\(?\s*true|until\s*\(?\s*false)\s*\)?")
_MOTION: Final = re.compile(r"(?:[A-Za-z_]\w*(?:\[\w+\])?\s*=\s*)?(movej|movel|movec)\s*\(")


class Val3Interpreter(Val3Flow):
    """State of the controller while a program runs.

    Args:
        folder: Programs that it can call.
        store: Variables of its data file.
        cell: What frames and process words are checked against; None takes the frame of the first point for the part
            frame, and knows no process words.
    """

    def __init__(self, routine: Val3Routine, folder: Val3Folder, store: Store, cell: Val3Cell | None) -> None:
        super().__init__(store, cell)
        self.routine, self.folder, self.main = routine, folder, routine.name
        self.process = None if cell is None else ProcessWords(cell.functions, code_of)
        self.depth, self._count = 0, 0
        self._counted_at, self._moved = 0, -1
        self.runs: Counter[tuple[str, int]] = Counter()  # How often each motion's line runs, by file and line
        self._full: dict[str, tuple[list[str], dict[int, int], list[int]]] = {}

    def run(self) -> None:
        """Execute the program.

        Raises:
            ProgramError: See :func:`~counterflex.integrations.staubli.language.read.reader.read_val3`.
        """
        scope = {}
        for parameter in self.routine.parameters:
            scope[parameter.name] = self.store.unknown_parameter(parameter)
        self.store.scopes.append(scope | self.store.locals_of(self.routine))
        self._run(self.routine)

    def _run(self, routine: Val3Routine) -> None:
        self.depth += 1
        passes: dict[int, tuple[int, int]] = {}
        at = routine.first
        while at < routine.last:
            then = self._executed(routine, at)
            if then <= at:
                state = (self.store.version, then)
                if passes.get(at) == state or self._never_left(routine, at):
                    raise routine.fault(at, f"the program repeats from line {then + 1} on without end",
                                        limit="a program that ends",
                                        hint="Give the program of one part, without the loop around it")  # fmt: skip
                passes[at] = state
            at = then
        self.depth -= 1

    @staticmethod
    def _never_left(routine: Val3Routine, at: int) -> bool:
        """Return whether the condition of a loop is constant, and nothing within it ends the program."""
        begin = routine.ends[at]
        if _FOREVER.fullmatch(routine.codes[begin]) or _FOREVER.fullmatch(routine.codes[at]):
            return not any(routine.codes[index].startswith("return") for index in range(min(begin, at), at))
        return False

    def _executed(self, routine: Val3Routine, at: int) -> int:
        """Execute a line; returns the index of the next one."""
        self._count += 1
        idle = self._count - self._counted_at if len(self.motions) == self._moved else 0
        if not idle:
            self._counted_at, self._moved = self._count, len(self.motions)
        if self._count > _MOST + 10 * len(routine.lines) or idle > _MOST_IDLE + len(routine.lines):
            raise routine.fault(at, "the program does not end within the lines that are executed",
                                limit=f"{_MOST} lines, {_MOST_IDLE} of them without a motion",
                                hint="Give the program of one part")  # fmt: skip
        self.block(routine, at)
        self.call_line = at + 1 if self.depth == 1 else self.call_line
        code = routine.codes[at]
        if not code:
            return at + 1
        block, first = len(self._blocks) - 1, len(self.motions)
        self._words = []
        then = self._machine_function(routine, at)
        if then is None:
            try:
                then = self.statement(routine, at, code)
            except ProgramError:
                raise
            except (ValueError, TypeError, OverflowError, RecursionError) as error:
                what = str(error) if isinstance(error, ExpressionError) else "a value does not fit this statement"
                raise routine.fault(at, what, hint="The file may be damaged: post it again") from error
        if len(self.motions) > first or self._words:
            made = len(self._blocks) == block + 1
            first = self._blocks[block].first_motion
            self._blocks[block] = replace(
                self._blocks[block], words=tuple(self._words), motion_count=len(self.motions) - first if made else 0,
                modal=self.modal(self.motion_code(first) if made else "G1"),
            )  # fmt: skip
        return then

    def _machine_function(self, routine: Val3Routine, at: int) -> int | None:
        """Do what the cell file's table has at a line; returns the index behind it, None where it has nothing."""
        if self.process is None:
            return None
        if routine.name not in self._full:
            full = [index for index in range(routine.first, routine.last) if routine.codes[index]]
            self._full[routine.name] = (
                [routine.lines[index] for index in full], {index: n for n, index in enumerate(full)}, full,
            )  # fmt: skip
        texts, order, full = self._full[routine.name]
        function = self.process.find(texts, order[at], f"{routine.name}:{at + 1}")
        if function is None:
            return None
        self.do(function)
        last = full[order[at] + function.lines - 1]
        for index in range(at + 1, last + 1):
            self.block(routine, index)
        return last + 1

    # ---- statements ----------------------------------------------------------------------------------------

    def statement(self, routine: Val3Routine, at: int, code: str) -> int:
        """Execute a statement; returns the index of the next line."""
        match = _MOTION.match(code)
        if match is not None:
            self.runs[routine.name, at] += 1
            parts = assignment(code)
            self.motion(routine, at, match[1], match.end())
            if parts is not None:
                self.put(routine, at, parts[0], Unknown("the number of a motion is the controller's"))
            return at + 1
        row = row_of(code)
        if row is None:
            raise routine.fault(at, "an unknown statement", limit="docs/statements/val3.md",
                                hint="Name it in [controller.spindle.val3] (m_codes) of the cell file if it moves "
                                "nothing, or post the path without it")  # fmt: skip
        effect = hidden_effect(code) if row.word not in ("call", "taskCreate", "taskCreateSync") else ""
        if effect:
            raise routine.fault(at, f"{effect}() stands within an expression, and is not read there",
                                limit=f"n={effect}(...)", hint="Write it on a line of its own")  # fmt: skip
        if row.treatment is Treatment.REFUSED:
            raise routine.fault(at, f"{row.word}: {row.reason}, which is not read", hint=row.remedy)
        if row.word in ACTING:
            self.act(routine, at)
        handler = _HANDLERS.get(row.word)
        if handler is not None:
            return handler(self, routine, at)
        if row.treatment is Treatment.NEUTRAL or row.word == "=":
            self._assign(routine, at)
        return at + 1

    def _assign(self, routine: Val3Routine, at: int) -> None:
        """Set a variable, or forget what an instruction of the controller gives back."""
        code = routine.codes[at]
        parts = assignment(code)
        if parts is None:
            return
        right = instruction(parts[1])
        if self.is_output(code, parts[0]) or (right is not None and right[0] in ACTING):
            self.act(routine, at)
        if not self.is_output(code, parts[0]):
            self.put(routine, at, parts[0], self.value(routine, at, parts[1]))

    def _given(self, routine: Val3Routine, at: int) -> tuple[str, list[str]]:
        """Variable that takes the result of an instruction, and its arguments."""
        code = routine.codes[at]
        parts = assignment(code)
        right = code if parts is None else parts[1]
        literal = instruction(right)
        if literal is None:
            raise routine.fault(at, "an instruction is not closed", limit="name(...)", hint="Post the program again")
        places = arguments(right, literal[1], right.rfind(")"))
        return "" if parts is None else parts[0], [right[a:b] for a, b in places if right[a:b]]

    def do_wait_end(self, routine: Val3Routine, at: int) -> int:
        """The robot comes to rest."""
        self.wait_end(routine, at)
        return at + 1

    def do_open(self, _: Val3Routine, at: int) -> int:
        """Open and close wait until the robot is at rest (VAL3 Reference manual, open)."""
        self.end_exactly()
        return at + 1

    def do_delay(self, routine: Val3Routine, at: int) -> int:
        """A wait."""
        _, given = self._given(routine, at)
        time_s = self.value(routine, at, given[0]) if given else 0.0
        if is_number(time_s):
            self.wait(routine, at, float(cast("float", time_s)))
        return at + 1

    def do_get(self, routine: Val3Routine, at: int) -> int:
        """A stop until a key is pressed."""
        self._words.append(Word("M", 0.0, 0, 0))
        result, _ = self._given(routine, at)
        if result:
            self.put(routine, at, result, Unknown("a person presses a key (get)"))
        return at + 1

    def do_reset(self, routine: Val3Routine, at: int) -> int:
        """Refuse to cancel motions that are not finished."""
        if self.settled is None:
            raise routine.fault(at, "resetMotion() cancels motions that are not finished", limit="the robot at rest",
                                hint="Put waitEndMove() before it")  # fmt: skip
        return at + 1

    def do_monitor_speed(self, routine: Val3Routine, at: int) -> int:
        """Refuse another factor of all speeds than 100 %."""
        result, given = self._given(routine, at)
        value = known(self.value(routine, at, given[0]) if given else None, "the monitor speed", routine.place(at),
                      text=routine.codes[at], hint="Take setMonitorSpeed() out")  # fmt: skip
        if value != 100.0:
            raise routine.fault(
                at, "setMonitorSpeed() changes the speed of every motion, in some operating modes of the controller "
                "only: the speed is not known", limit="100", hint="Write the speeds themselves (tvel of the mdesc)",
            )  # fmt: skip
        if result:
            self.put(routine, at, result, Unknown("what setMonitorSpeed gives back is the controller's"))
        return at + 1

    # ---- frames --------------------------------------------------------------------------------------------

    def do_set_frame(self, routine: Val3Routine, at: int) -> int:
        """A frame from its origin, a point on x and a point of the xy plane (VAL3 Reference manual, setFrame)."""
        result, given = self._given(routine, at)
        if len(given) != 4:
            raise routine.fault(at, "setFrame has 4 arguments", limit="setFrame(pO,pX,pXY,fFrame)")
        values = [self.value(routine, at, one) for one in given]
        code: Value = 0.0
        unknown = first_unknown(values)
        if unknown is None:
            origin, on_x, in_xy = (self.store.place(one)[:3, 3] for one in values[:3])
            x, y = on_x - origin, in_xy - origin
            z = np.cross(x, y)
            if min(np.linalg.norm(x), np.linalg.norm(z) ** 0.5) < _LEAST_M:
                raise routine.fault(at, "the three points of setFrame lie on a line, or too close together")
            axes = [x / np.linalg.norm(x), np.zeros(3), z / np.linalg.norm(z)]
            axes[1] = np.cross(axes[2], axes[0])
            T_world = pose.make(np.column_stack(axes), origin)
            frame = cast("Mapping[str, Value]", values[3])
            T_world_father = self.store.place({**frame, TRSF: trsf_of(np.eye(4))})
            self.put(routine, at, f"{given[3]}.{TRSF}", trsf_of(pose.inverse(T_world_father) @ T_world))
        else:
            code = unknown
            self.put(routine, at, given[3], Unknown(f"computed by setFrame: {unknown.why}", unknown.where))
        if result:
            self.put(routine, at, result, code)
        return at + 1

    def do_link(self, routine: Val3Routine, at: int) -> int:
        """Another father, the coordinates stay (VAL3 Reference manual, link)."""
        _, given = self._given(routine, at)
        try:
            root = len(given) == 2 and given[1].partition("[")[0].strip() in ROOTS
            father = self.store.literal(given[1]) if len(given) == 2 and not root else None
            if father is None and not root:
                raise routine.fault(at, "link is not understood", limit="link(point,frame)")
            literal = self.store.literal(given[0])
            value = None if literal is None else literal[1][0].get(literal[0][1])
        except ExpressionError as error:
            raise routine.fault(at, str(error), limit="link(point,frame)") from error
        if not isinstance(value, Mapping) or FATHER not in value:
            raise routine.fault(at, "link changes what is no point, frame or tool that is known",
                                limit="link(point,frame)", hint="Write the father into the data file")  # fmt: skip
        name, index = (given[1].partition("[")[0].strip(), 0) if father is None else father[0]
        self.put(routine, at, f"{given[0]}.{FATHER}", f"{name}[{index}]")
        return at + 1

    # ---- other programs ------------------------------------------------------------------------------------

    def do_call(self, routine: Val3Routine, at: int) -> int:
        """Run a program of the application, or of a library."""
        called = self.called(routine, at)
        if called is None:
            raise routine.fault(
                at, "a subprogram is called, which may move the robot",
                limit="a program of the folder, or a statement of [controller.spindle.val3] in the cell file",
                hint="Put its .pgx beside the program, or name the call in the table (m_codes) if it moves nothing",
            )  # fmt: skip
        prefix, program, given = called
        if self.depth >= _DEEPEST:
            raise routine.fault(at, "programs call each other without end", limit=f"{_DEEPEST} calls within each other",
                                hint="Post the path without recursion")  # fmt: skip
        store, words = self.store, self._words
        store.where = f"{routine.name}:{at + 1}"
        try:
            scope = store.enter(program, given)
        except ExpressionError as error:
            raise routine.fault(at, str(error), hint="The program was posted for other files") from error
        outer, store.prefix = store.prefix, prefix
        store.scopes.append(scope)
        self._run(program)
        store.scopes.pop()
        store.prefix, self._words = outer, words
        return at + 1

    def do_task(self, routine: Val3Routine, at: int) -> int:
        """A program that runs beside this one: it must change nothing that matters."""
        called = self.called(routine, at)
        if called is None:
            raise routine.fault(at, "another task is started, which may move the robot",
                                limit="a program of the folder", hint="Put its .pgx beside the program")  # fmt: skip
        task = Unknown(f"{called[1].name} runs beside the program", f"{routine.name}:{at + 1}")
        self.pass_over(called[1], called[1].first, called[1].last, task, ("taskCreate", at + 1), 1)
        return at + 1

    def do_load(self, routine: Val3Routine, at: int) -> int:
        """Let an alias stand for a library."""
        result, given = self._given(routine, at)
        parts = assignment(routine.codes[at])
        alias = (routine.codes[at] if parts is None else parts[1]).partition(":")[0].strip()
        path = self.value(routine, at, given[0]) if given else Unknown("the library is not named")
        path = known(path, "which library is loaded", routine.place(at), text=routine.codes[at],
                     hint="Write its path")  # fmt: skip
        loaded = self.folder.load(alias, str(path), self.store)
        if result:
            done: Value = 0.0 if loaded else Unknown(f"the library {path} does not lie beside the program")
            self.put(routine, at, result, done)
        return at + 1


_Handler = Callable[[Val3Interpreter, Val3Routine, int], int]
_HANDLERS: Final[Mapping[str, _Handler]] = {
    "waitEndMove": Val3Interpreter.do_wait_end, "open": Val3Interpreter.do_open, "close": Val3Interpreter.do_open,
    "delay": Val3Interpreter.do_delay, "get": Val3Interpreter.do_get, "resetMotion": Val3Interpreter.do_reset,
    "setMonitorSpeed": Val3Interpreter.do_monitor_speed, "setFrame": Val3Interpreter.do_set_frame,
    "link": Val3Interpreter.do_link, "call": Val3Interpreter.do_call, "taskCreate": Val3Interpreter.do_task,
    "taskCreateSync": Val3Interpreter.do_task, "libLoad": Val3Interpreter.do_load, "if": Val3Interpreter.do_if,
    "elseIf": Val3Interpreter.do_else, "else": Val3Interpreter.do_else, "endIf": Val3Interpreter.do_next,
    "while": Val3Interpreter.do_while, "endWhile": Val3Interpreter.do_repeat, "do": Val3Interpreter.do_next,
    "until": Val3Interpreter.do_until, "for": Val3Interpreter.do_for, "endFor": Val3Interpreter.do_end_for,
    "switch": Val3Interpreter.do_switch, "case": Val3Interpreter.do_else, "default": Val3Interpreter.do_else,
    "break": Val3Interpreter.do_break, "endSwitch": Val3Interpreter.do_next, "return": Val3Interpreter.do_return,
}  # fmt: skip

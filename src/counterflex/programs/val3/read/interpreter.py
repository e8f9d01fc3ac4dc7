"""Executes a VAL3 program line by line: motions, frames, speeds, process words."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM_PER_S
from counterflex.programs.program import Block, Word
from counterflex.programs.robot_text.cell import RobotTextCell
from counterflex.programs.robot_text.execution import Execution
from counterflex.programs.robot_text.process_words import NUMBER, ProcessWords
from counterflex.programs.val3.program import Key, Span, Val3Motion, frame_of
from counterflex.programs.val3.read import statements as form
from counterflex.programs.val3.read.data_file import DataFile, key_of

_FASTEST_MM_S: Final = 20_000.0
"""A speed limit from here on limits nothing: the robot runs as fast as its axes."""
_STRAIGHT: Final = "Post the path without loops, conditions and subprograms"


@dataclass(frozen=True, kw_only=True)
class Val3Cell(RobotTextCell):
    """What must be known of a cell to read a VAL3 program for it.

    Attributes:
        tool_of_data: Number of the tool by the name of its tool variable (``tools.tooldata``).
    """

    tool_of_data: Mapping[str, int]


@dataclass
class _Spindle:
    tool: int = 0


class Interpreter(Execution):
    """State of the controller while a program runs.

    Args:
        name: Of the program file, for errors.
        lines: Of it.
        first: 1-based number of the line behind ``begin``.
        last: 1-based number of the line ``end``.
        starts: Index of each line in the text.
        data: The data file.
        cell: What frames and process words are checked against; None takes every frame and knows no process words.

    Attributes:
        moves: What stands behind each motion in the text.
        mentions: How often the code names each point.
    """

    def __init__(
        self, name: str, lines: Sequence[str], first: int, last: int, starts: Sequence[int], data: DataFile,
        cell: Val3Cell | None,
    ) -> None:  # fmt: skip
        self._spindle = _Spindle()
        super().__init__(self._spindle)
        self.name, self.lines, self.data, self.cell = name, lines, data, cell
        self._first, self._last, self._starts = first, last, starts
        self.process = None if cell is None else ProcessWords(cell.functions, code_of)
        self.moves: list[Val3Motion] = []
        self.mentions: dict[Key, int] = {}
        self.line = first
        self._changed: set[str] = set()
        self._speeds: dict[Key, float] = {}
        self._settled = -1  # line of the waitEndMove() behind the last motion
        self._away: int | None = None
        self._flow: list[tuple[str, int]] = []
        self._tools: dict[Key, Float] = {}
        self._frames_seen: set[Key] = set()

    def run(self) -> None:
        """Execute the program.

        Raises:
            ProgramError: See :func:`~counterflex.programs.val3.read.reader.read_val3`.
        """
        numbers = range(self._first, self._last)
        codes = {number: code_of(self.lines[number - 1]).strip() for number in numbers}
        full = [number for number in numbers if codes[number]]
        for code in codes.values():
            for match in re.finditer(r"[A-Za-z_]\w*(?:\s*\[\s*\d+\s*\])?", code):
                key = key_of(match[0])
                if key is not None:
                    self.mentions[key] = self.mentions.get(key, 0) + 1
        texts = [self.lines[number - 1] for number in full]
        passed = 0
        for number in numbers:
            self.line, self._words, first = number, [], len(self.motions)
            self._blocks.append(Block(number, self.lines[number - 1], (), self.modal("G1"), first, 0))
            if codes[number] and passed:
                passed -= 1
            elif codes[number]:
                passed = self._executed(codes[number], texts, full.index(number)) - 1
            self._blocks[-1] = replace(
                self._blocks[-1], words=tuple(self._words), modal=self.modal(self.motion_code(first)),
                motion_count=len(self.motions) - first,
            )  # fmt: skip
        if self._flow:
            word, line = self._flow[-1]
            raise ProgramError(f"{word} is not closed", where=f"{self.name}:{line}", hint="The file may be cut off")

    def _executed(self, code: str, texts: Sequence[str], at: int) -> int:
        """Execute a statement; returns how many lines that were."""
        where = f"{self.name}:{self.line}"
        function = None if self.process is None else self.process.find(texts, at, where)
        if function is None:
            self._statement(code)
            return 1
        self._refuse_in_flow(code, "the spindle, coolant or tool is switched")
        self.do(function)
        return function.lines

    # ---- statements ------------------------------------------------------------------------------------------

    def _statement(self, code: str) -> None:
        if (match := form.MOTION.match(code)) is not None:
            self._refuse_in_flow(code, "a motion")
            self._motion(code, match)
        elif form.WAIT_END.fullmatch(code):
            self._settled = self.line
            if self.moves and self.moves[-1].point is not None:
                self.moves[-1] = replace(self.moves[-1], exact=True)
        elif (match := form.DELAY.fullmatch(code)) is not None:
            self._delay(float(match[1]))
        elif (match := form.SPEED.fullmatch(code)) is not None:
            self._refuse_in_flow(code, "a speed is set")
            key = key_of(match[1])
            if key is not None:
                self._speeds[key] = float(match[2])
        elif not self._flow_statement(code) and not self._other(code):
            raise self._fault("an unknown statement", code, hint="docs/val3.md lists what is read")

    def _delay(self, time_s: float) -> None:
        """A wait, where the robot has come to rest before it; else the program waits while the robot runs on."""
        settled = self._settled > 0 and self._settled >= (self.moves[-1].line if self.moves else 0)
        if settled and not self._flow and self.dwell(len(self._blocks) - 1, time_s):
            at = self._settled
            self.moves.append(Val3Motion(self.line, "delay", self._start(at), self._start(at), np.eye(3)))

    def _flow_statement(self, code: str) -> bool:
        if (match := form.CLOSES.match(code)) is not None:
            if not self._flow or form.CLOSED_BY[self._flow[-1][0]] != match[1]:
                raise self._fault(f"{match[1]} closes nothing", code, hint="The file may be damaged")
            self._flow.pop()
        elif (match := form.OPENS.match(code)) is not None:
            self._flow.append((match[1], self.line))
            self.acting.append(self.line)
        elif form.BETWEEN.match(code):
            if not self._flow:
                raise self._fault("this belongs into if, switch or a loop", code, hint="The file may be damaged")
        else:
            return False
        return True

    def _other(self, code: str) -> bool:
        if form.OTHER_MOTION.match(code) or form.SHIFTS.match(code):
            raise self._fault("this changes where the robot goes, and is not read", code, limit="movej movel movec",
                              hint="Post the path without it")  # fmt: skip
        if form.CALL.match(code):
            raise self._fault(
                "a subprogram is called, which may move the robot", code,
                limit="a statement of [controller.spindle.val3] in the cell file",
                hint="Post the path as one program, or name the call in the table (m_codes) if it moves nothing",
            )  # fmt: skip
        if form.RETURN.match(code):
            raise self._fault("return stands before the end: what is executed is not known", code, hint=_STRAIGHT)
        if form.KEY.fullmatch(code) and not self._flow:
            self._words.append(Word("M", 0.0, 0, 0))
            return True
        if form.OUTPUT.match(code) or form.ACTS.match(code):
            self.acting.append(self.line)
            return True
        if (match := form.FIELD.match(code) or form.ASSIGNMENT.match(code)) is not None:
            self._changed.add(match[1])
            return True
        return form.PASSED.match(code) is not None

    # ---- motions ---------------------------------------------------------------------------------------------

    def _motion(self, code: str, match: re.Match[str]) -> None:
        word, line = match[1], self.lines[self.line - 1]
        offset = self._start(self.line) + line.index(code)
        close = code.rfind(")")
        arguments = _arguments(code, match.end(), close)
        if close < 0 or code[close + 1 :].strip() or len(arguments) != form.ARGUMENTS[word]:
            raise self._fault(f"{word} has {form.ARGUMENTS[word]} arguments", code, limit="movel(point,tool,mdesc)")
        *points, tool, speed = ((code[a:b].strip(), (offset + a, offset + b)) for a, b in arguments)
        self._settled = -1
        target = self._point(points[-1][0], code, word)
        R_tcp_tool = self._tool(tool[0], code)
        feed, exact, changed = self._speed(speed[0], code)
        if target is None:
            self._away = self.line
            return
        if self._away is not None and self.motions:
            raise self._fault(
                f"the robot comes from a place that is not known, by axes (line {self._away})", code,
                limit="such places before the first target and behind the last one",
                hint="Give that place as a point, or post each part as a program of its own",
            )  # fmt: skip
        self._away = None
        key, T = target
        self.straight(len(self._blocks) - 1, T[:3, 3], T[:3, :3] @ R_tcp_tool.T, 0.0 if word == "movej" else feed)
        auxiliary = self._point(points[0][0], code, word) if word == "movec" else None
        if auxiliary is not None:
            self.circle(auxiliary[1][:3, 3], lambda what, hint: self._fault(what, code, hint=hint))
            if self.motions[-1].kind == "arc" and self.motions[-1].feed_m_s <= 0.0:
                raise self._fault("a circle without a speed limit of its mdesc", code, limit="tmax in mm/s")
        self._words += [Word(c, float(v) * 1e3, 0, 0) for c, v in zip("XYZ", T[:3, 3], strict=True)]
        speed_key = key_of(speed[0]) or ("", 0)
        self.moves.append(Val3Motion(
            self.line, word, offset + match.start(1), self._start(self.line), R_tcp_tool, key, points[-1][1],
            None if auxiliary is None else auxiliary[0], points[0][1], tool[0], speed_key, speed[1], exact, changed,
        ))  # fmt: skip

    def _point(self, text: str, code: str, word: str) -> tuple[Key, Float] | None:
        """A point of the data file and its pose (4, 4) m; None of one by axes."""
        key = key_of(text)
        if key is None:
            raise self._fault("computed targets are not read", code, limit="a point of the data file, by its index",
                              hint="Write the points themselves: appro and variable indices are computed")  # fmt: skip
        if key[0] in self._changed:
            raise self._fault(f"{key[0]} is computed by the program: such targets are not read", code,
                              hint="Write the target itself")  # fmt: skip
        data = self.data.variables.get(key[0])
        if data is not None and data.kind.startswith("joint"):
            if word != "movej":
                raise self._fault("axis angles are no target of a path", code, limit="a pointRx")
            return None
        value = self.data.value(key, "pointRx")
        if value is None or value.data < 0:
            raise self._fault(
                f"where {text} is, is not known", code, limit="a pointRx of the data file with its numbers",
                hint="Give .pgx and .dtx in one folder" + ("" if self.data.text else "; there is no .dtx beside it"),
            )  # fmt: skip
        father = key_of(value.attributes.get("fatherId", "world[0]"))
        if self.cell is not None and father is not None and father not in self._frames_seen:
            T = self.data.frame(father, "frame", "world", self._changed)
            self.cell.refuse_other_part_frame(T, f"the frame {father[0]}", f"{self.name}:{self.line}")
            self._frames_seen.add(father)
        return key, frame_of(self.data.numbers(value))

    def _tool(self, text: str, code: str) -> Float:
        """Orientation (3, 3) of a tool in the TCP frame of the cell; sets the tool in the spindle by its name."""
        key = key_of(text)
        if key is None:
            raise self._fault("the tool is computed", code, limit="a tool of the data file")
        cell = self.cell
        if cell is None:
            self._spindle.tool = self._spindle.tool or 1
            return np.eye(3)
        number = cell.tool_of_data.get(key[0], cell.tool_of_data.get(f"{key[0]}[{key[1]}]", 0))
        self._spindle.tool = number or self._spindle.tool or cell.only_tool
        if key not in self._tools:
            if number and key[0] not in self.data.variables:
                return np.eye(3)
            T = self.data.frame(key, "tool", "flange", self._changed)
            self._tools[key] = cell.R_tcp_tool(T, text, f"{self.name}:{self.line}")
        return self._tools[key]

    def _speed(self, text: str, code: str) -> tuple[float, bool, bool]:
        """Speed in m/s (0: as fast as the axes), whether it stops, whether the program changes the mdesc otherwise."""
        key = key_of(text)
        value = None if key is None else self.data.value(key, "mdesc")
        if key is None or value is None:
            raise self._fault(f"which speed {text} is, is not known", code, limit="an mdesc of the data file",
                              hint="Write its numbers into the data file")  # fmt: skip
        written = value.attributes.get("tmax", f"{_FASTEST_MM_S}").strip()
        if not re.fullmatch(NUMBER, written):
            raise self._fault("tmax of the mdesc is no number", code, limit="mm/s")
        speed = self._speeds.get(key, float(written))
        if not speed > 0.0:
            raise self._fault("the speed is out of range", code, limit="above 0 mm/s")
        feed = 0.0 if speed >= _FASTEST_MM_S else speed * MM_PER_S
        return feed, value.attributes.get("blend", "off").strip().lower() == "off", key[0] in self._changed

    # ---- text ------------------------------------------------------------------------------------------------

    def _start(self, line: int) -> int:
        return self._starts[line - 1]

    def _refuse_in_flow(self, code: str, what: str) -> None:
        if self._flow:
            word, line = self._flow[-1]
            raise self._fault(
                f"{what} inside {word} (line {line}): whether and how often is not known", code,
                limit="straight through", hint=_STRAIGHT,
            )  # fmt: skip

    def _fault(self, what: str, code: str, **more: str) -> ProgramError:
        column = self.lines[self.line - 1].find(code) + 1
        return ProgramError(what, where=f"{self.name}:{self.line}:{column}", value=code[:60], **more)


def code_of(line: str) -> str:
    """The part of a line before its comment; ``//`` within quotes begins none."""
    quoted = False
    for index, character in enumerate(line):
        if character == '"':
            quoted = not quoted
        elif character == "/" and not quoted and line[index : index + 2] == "//":
            return line[:index]
    return line


def _arguments(code: str, start: int, end: int) -> list[Span]:
    """Places of arguments: divided by commas outside of brackets, without blanks around them."""
    out, depth, begin = [], 0, start
    for at in range(start, max(end, start)):
        depth += (code[at] in "([{") - (code[at] in ")]}")
        if code[at] == "," and depth == 0:
            out.append((begin, at))
            begin = at + 1
    out.append((begin, max(end, start)))
    return [
        (a + len(code[a:b]) - len(code[a:b].lstrip()), b - len(code[a:b]) + len(code[a:b].rstrip())) for a, b in out
    ]

"""Executes a FANUC TP program statement by statement: motions, frames, speeds, process words."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.errors import ProgramError
from counterflex.programs.fanuc.program import FanucMotion, FanucPosition, frame_of
from counterflex.programs.fanuc.read import statements as form
from counterflex.programs.fanuc.read.arcs import arcs_of
from counterflex.programs.fanuc.read.listing import Listing, Statement
from counterflex.programs.program import Block, Word
from counterflex.programs.robot_text.cell import ExternalAxes, NumberedFrames, RobotTextCell
from counterflex.programs.robot_text.execution import Execution
from counterflex.programs.robot_text.process_words import ProcessWords

_LARGEST_M_S: Final = 20.0
_STRAIGHT: Final = "Post the path without loops, conditions and jumps"


@dataclass(frozen=True, kw_only=True)
class FanucCell(RobotTextCell):
    """What must be known of a cell to read a FANUC program for it.

    Attributes:
        tool_number: ``controller.tool_number``: the UTOOL that the cell plans with.
        base_number: ``controller.base_number``: the UFRAME that is the part frame.
        tool_of_data: Number of the tool by its UTOOL (``tools.tool_data``).
    """

    tool_number: int
    base_number: int
    tool_of_data: Mapping[int, int]


class Interpreter(Execution):
    """State of the controller while a program runs.

    Args:
        listing: The program.
        positions: Its positions by number.
        cell: What frames and process words are checked against; None takes every frame and knows no process words.
        lines: Of the text, for the blocks.

    Attributes:
        moves: What stands behind each motion in the text.
        mentions: How often the code names each position.
    """

    def __init__(
        self, listing: Listing, positions: Mapping[int, FanucPosition], cell: FanucCell | None, lines: Sequence[str]
    ) -> None:
        self.frames = NumberedFrames(cell, "UTOOL_NUM={}", "UFRAME_NUM={}")
        if cell is not None:
            self.frames.tool_number, self.frames.base_number = cell.tool_number, cell.base_number
            self.frames.tool_of_data = cell.tool_of_data
        super().__init__(self.frames)
        self.listing, self.positions, self.cell, self._lines = listing, positions, cell, lines
        self.process = None if cell is None else ProcessWords(cell.functions, lambda code: code)
        self.moves: list[FanucMotion] = []
        self.mentions: dict[int, int] = {}
        self._external = ExternalAxes(cell)
        self._user_frame = self._user_tool = -1
        self._away: int | None = None
        self._flow: list[tuple[str, int]] = []
        self._assigned: set[int] = set()
        self._ended = False
        self._arcs: list[int] = []  # motions of the running chain of A

    def run(self) -> None:
        """Execute the program.

        Raises:
            ProgramError: See :func:`~counterflex.programs.fanuc.read.reader.read_fanuc`.
        """
        statements = list(self.listing.statements())
        for statement in statements:
            for match in form.POSITION.finditer(statement.code):
                self.mentions[int(match[1])] = self.mentions.get(int(match[1]), 0) + 1
        texts = [statement.code.strip() for statement in statements]
        at = 0
        while at < len(statements) and not self._ended:
            at += self._executed(statements[at], texts, at)
        self._close_arcs()
        if self._flow and not self._ended:
            word, line = self._flow[-1]
            raise ProgramError(
                f"{word} is not closed", where=f"{self.listing.name}:{line}", hint="The file may be cut off"
            )

    def _executed(self, statement: Statement, texts: Sequence[str], at: int) -> int:
        """Execute a statement; returns how many statements that were."""
        self._words, first, count = [], len(self.motions), 1
        self._blocks.append(Block(statement.line, self._lines[statement.line - 1], (), self.modal("G1"), first, 0))
        function = None if self.process is None else self.process.find(texts, at, self.listing.place(statement.start))
        if function is not None:
            self._refuse_in_flow(statement, "the spindle, coolant or tool is switched")
            self.do(function)
            count = function.lines
        else:
            self._statement(statement, texts[at])
        self._blocks[-1] = replace(
            self._blocks[-1], words=tuple(self._words), modal=self.modal(self.motion_code(first)),
            motion_count=len(self.motions) - first,
        )  # fmt: skip
        return count

    # ---- statements ------------------------------------------------------------------------------------------

    def _statement(self, statement: Statement, code: str) -> None:
        if not code or form.COMMENT.match(code):
            return
        if (match := form.MOTION.match(code)) is not None:
            self._refuse_in_flow(statement, "a motion")
            self._motion(statement, match[1].upper())
        elif (match := form.USER_FRAME.fullmatch(code)) is not None:
            self._refuse_in_flow(statement, "the user frame is set")
            self._set_frame(int(match[1]), self.listing.place(statement.start))
        elif (match := form.USER_TOOL.fullmatch(code)) is not None:
            self._refuse_in_flow(statement, "the tool frame is set")
            self._set_tool(int(match[1]), self.listing.place(statement.start))
        elif (match := form.WAIT_TIME.fullmatch(code)) is not None:
            if not self._flow and self.dwell(len(self._blocks) - 1, float(match[1])):
                self.moves.append(
                    FanucMotion(statement.line, "WAIT", statement.start, statement.head, statement.end, np.eye(3))
                )
        elif not self._other(statement, code):
            raise self._fault("an unknown statement", statement, hint="docs/fanuc.md lists what is read")

    def _other(self, statement: Statement, code: str) -> bool:
        if (match := form.OVERRIDE.fullmatch(code)) is not None:
            if match[1] != "100":
                raise self._fault("OVERRIDE changes the speed of every motion", statement, limit="OVERRIDE=100%",
                                  hint="Write the speeds themselves: the force depends on them")  # fmt: skip
        elif form.PAUSE.fullmatch(code):
            if self._flow:
                self.acting.append(statement.line)
            else:
                self._words.append(Word("M", 0.0, 0, 0))
        elif form.ENDS.fullmatch(code):
            self._ended = not self._flow
        elif (match := form.ASSIGNED.match(code)) is not None:
            self._assigned.add(int(match[1]))
        elif form.REGISTER.match(code):
            pass
        elif form.JUMP.match(code) or (form.CONDITION.match(code) and form.MOVES.search(code)):
            raise self._fault(
                "jumps and calls under a condition are not read: what is executed would not be known", statement,
                hint=_STRAIGHT,
            )  # fmt: skip
        elif form.SHIFTS.match(code):
            raise self._fault("this changes where the robot goes, or how fast, and is not read", statement,
                              hint="Post the path without it")  # fmt: skip
        elif form.CALL.match(code):
            raise self._fault(
                "another program is called, which may move the robot", statement,
                limit="a statement of [controller.spindle.fanuc] in the cell file",
                hint="Post the path as one program, or name the call in the table (m_codes) if it moves nothing",
            )  # fmt: skip
        else:
            return self._flow_statement(statement, code) or self._passed(statement, code)
        return True

    def _flow_statement(self, statement: Statement, code: str) -> bool:
        if form.OPENS.fullmatch(code):
            self._flow.append((code[:2].upper() if code[:2].upper() == "IF" else "FOR", statement.line))
            self.acting.append(statement.line)
        elif (match := form.CLOSES.fullmatch(code)) is not None:
            if not self._flow or form.CLOSED_BY[self._flow[-1][0]] != match[1].upper():
                raise self._fault(f"{match[1]} closes nothing", statement, hint="The file may be damaged")
            self._flow.pop()
        elif form.BETWEEN.fullmatch(code):
            if not self._flow:
                raise self._fault("this belongs into IF", statement, hint="The file may be damaged")
        else:
            return False
        return True

    def _passed(self, statement: Statement, code: str) -> bool:
        if form.ACTS.match(code) or form.CONDITION.match(code):
            self.acting.append(statement.line)
            return True
        return form.PASSED.match(code) is not None

    # ---- frames ----------------------------------------------------------------------------------------------

    def _set_tool(self, number: int, where: str) -> None:
        self._user_tool = number
        if number == 0:
            self.frames.tool_known = True
            self.frames.tool = self.frames.tool or (0 if self.cell is None else self.cell.only_tool)
            self.frames.R_tcp_tool = (
                np.eye(3) if self.cell is None else self.cell.R_tcp_tool(np.eye(4), "UTOOL_NUM=0 (the flange)", where)
            )
        else:
            self.frames.set_tool_data(number, where)

    def _set_frame(self, number: int, where: str) -> None:
        self._user_frame = number
        if number == 0:
            self.frames.base_known = True
            if self.cell is not None:
                self.cell.refuse_other_part_frame(np.eye(4), "UFRAME_NUM=0 (the world)", where)
        else:
            self.frames.set_base_data(number, where)

    def _frames_of(self, position: FanucPosition) -> None:
        """Frames that a position names must be the active ones; one that is not set by a statement is taken from it."""
        where = self.listing.place(position.start)
        for active, own, word, set_to in (
            (self._user_tool, position.user_tool, "UT", self._set_tool),
            (self._user_frame, position.user_frame, "UF", self._set_frame),
        ):
            if own is None and active < 0 and self.cell is not None:
                raise ProgramError(
                    f"neither the program nor its positions say which {word} is meant", where=where,
                    value=f"{word} : F", limit=f"U{'TOOL' if word == 'UT' else 'FRAME'}_NUM before the first motion",
                    hint="Write the number into the program: the controller's is not known",
                )  # fmt: skip
            if own is not None and own != active:
                if active >= 0:
                    raise ProgramError(
                        "a position is taught in another frame than the active one: the controller stops there",
                        where=where, value=f"{word} : {own}", limit=f"{word} : {active}", hint="Post the program again",
                    )  # fmt: skip
                set_to(own, where)

    # ---- motions ---------------------------------------------------------------------------------------------

    def _motion(self, statement: Statement, word: str) -> None:
        if word == "S":
            raise self._fault("the curve of S (spline) is the controller's own and is not known", statement,
                              limit="J L C A", hint="Post the path as L")  # fmt: skip
        auxiliary, auxiliary_span = None, (0, 0)
        base = statement.start
        at = len(statement.code) - len(statement.code.lstrip()) + 1
        position, span, at = self._position(statement, at)
        if word == "C":
            auxiliary, auxiliary_span = position, span
            position, span, at = self._position(statement, at)
        motion = self._rest(statement, word, at)
        if position is None or not position.numbers:
            if word != "J":
                raise self._fault("axis angles are no target of a path", statement, limit="X Y Z W P R")
            self._away = statement.line
            self._close_arcs()
            return
        if self._away is not None and self.motions:
            raise self._fault(
                f"the robot comes from a place that is not known, by axes (line {self._away})", statement,
                limit="such places before the first target and behind the last one",
                hint="Give that place by X Y Z W P R, or post each part as a program of its own",
            )  # fmt: skip
        self._away = None
        for one in (auxiliary, position):
            if one is not None:
                self._check(one)
        if word != "A":
            self._close_arcs()
        T = frame_of(position.values)
        feed = 0.0 if word == "J" else motion.unit_m_s * float(motion.speed_text)
        self.straight(len(self._blocks) - 1, T[:3, 3], T[:3, :3] @ self.frames.R_tcp_tool.T, feed)
        if auxiliary is not None and auxiliary.numbers:
            self.circle(frame_of(auxiliary.values)[:3, 3], lambda what, hint: self._fault(what, statement, hint=hint))
        elif auxiliary is not None:
            raise self._fault("axis angles are no point of a circle", statement, limit="X Y Z W P R")
        if word == "A":
            self._arcs.append(len(self.motions) - 1)
        self._words += [Word(c, position.values[c], 0, 0) for c in "XYZ"]
        self.moves.append(replace(
            motion, R_tcp_tool=self.frames.R_tcp_tool, position=position, auxiliary=auxiliary,
            named=(base + span[0], base + span[1]),
            auxiliary_named=(base + auxiliary_span[0], base + auxiliary_span[1]),
        ))  # fmt: skip

    def _position(self, statement: Statement, at: int) -> tuple[FanucPosition | None, tuple[int, int], int]:
        """A position of an instruction: itself, where ``P[n]`` stands in the statement, and the index behind it."""
        code = statement.code
        at += len(code[at:]) - len(code[at:].lstrip())
        match = form.POSITION.match(code, at)
        if match is None:
            raise self._fault(
                "the target is no position of this program", statement, limit="P[n] with its numbers in /POS",
                hint="Position registers (PR), computed numbers (P[R[1]]) and visual ones stand in the controller: "
                "write the positions themselves",
            )  # fmt: skip
        number = int(match[1])
        if number in self._assigned:
            raise self._fault(f"P[{number}] is computed by the program: such targets are not read", statement,
                              hint="Write the target itself")  # fmt: skip
        if number not in self.positions:
            raise self._fault(f"where P[{number}] is, is not known", statement, limit="an entry of /POS",
                              hint="The listing may be damaged: post it again")  # fmt: skip
        return self.positions[number], match.span(), match.end()

    def _rest(self, statement: Statement, word: str, at: int) -> FanucMotion:
        """Speed, termination and options of a motion."""
        code = statement.code
        speed = form.SPEED.match(code, at)
        if speed is None or (word != "J" and speed[2] == "%"):
            raise self._fault(
                "the speed of a motion is not understood", statement,
                limit="J P[1] 20% FINE, L P[2] 100mm/sec CNT100: numbers",
                hint="Write the speed itself, the force depends on it: registers and max_speed are the controller's",
            )  # fmt: skip
        unit = form.UNITS.get(speed[2].lower(), 0.0)
        value = float(speed[1])
        if word != "J" and not 0.0 < value * unit <= _LARGEST_M_S:
            raise self._fault("the speed is no speed along the path in range", statement,
                              limit=f"above 0, at most {_LARGEST_M_S * 1e3:g} mm/sec; mm/sec, cm/min, inch/min",
                              hint="Write it in mm/sec: deg/sec, sec and msec tell none")  # fmt: skip
        termination = form.TERMINATION.match(code, speed.end())
        if termination is None:
            raise self._fault("how a motion ends is not understood", statement, limit="FINE or CNT0 to CNT100")
        rest = code[termination.end() :]
        left = form.CARRIED.sub("", rest).strip()
        if left and form.AT_TIME.fullmatch(left):
            self.acting.append(statement.line)
        elif left:
            raise self._fault(
                "an option of a motion that is not read", statement, limit="ACC, PTH, TA, TB, DB", hint=
                "Post the path without it: Offset, INC, Skip, Wjnt and their like change where the robot goes",
            )  # fmt: skip
        base = statement.start
        return FanucMotion(
            statement.line, word, base + len(code) - len(code.lstrip()), statement.head, statement.end, np.eye(3),
            speed=(base + speed.start(1), base + speed.end(1)), unit_m_s=unit, speed_text=speed[1],
            termination=termination[1], exact=bool(form.EXACT.fullmatch(termination[1])), rest=rest.rstrip(),
        )  # fmt: skip

    def _check(self, position: FanucPosition) -> None:
        self._frames_of(position)
        where = self.listing.place(position.start)
        for number, value in position.external.items():
            self._external.check(number, value, f"E{number}", where)
        if position.groups > 1:
            raise ProgramError(
                "a position moves more than one group", where=where, value=f"{position.groups} groups", limit="GP1",
                hint="Positioners and second robots are not read: post the path for group 1 alone",
            )  # fmt: skip

    def _close_arcs(self) -> None:
        """Make circles of a chain of A: the controller goes through each three of it.

        Raises:
            ProgramError: The chain is shorter than three, or lies on no single circle.
        """
        chain, self._arcs = self._arcs, []
        if not chain:
            return
        line = self._blocks[self.motions[chain[0]].block].line

        def fault(what: str, hint: str) -> ProgramError:
            return ProgramError(
                what, where=f"{self.listing.name}:{line}", value="A", limit="three points or more", hint=hint
            )

        made = arcs_of([self.motions[index] for index in chain], fault)
        for index, motion in zip(chain, made, strict=True):
            self.motions[index] = motion
            block = self.motions[index].block
            self._blocks[block] = replace(self._blocks[block], modal=self.modal(self.motion_code(index)))

    # ---- faults ----------------------------------------------------------------------------------------------

    def _refuse_in_flow(self, statement: Statement, what: str) -> None:
        if self._flow:
            word, line = self._flow[-1]
            raise self._fault(
                f"{what} inside {word} (line {line}): whether and how often is not known", statement,
                limit="straight through", hint=_STRAIGHT,
            )  # fmt: skip

    def _fault(self, what: str, statement: Statement, **more: str) -> ProgramError:
        value = re.sub(r"\s+", " ", statement.code).strip()[:60]
        return ProgramError(what, where=self.listing.place(statement.start), value=value, **more)

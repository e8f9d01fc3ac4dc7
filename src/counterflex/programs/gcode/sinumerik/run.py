"""Execute a Sinumerik program line by line: blocks, frames, tools, calls of subprograms."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar, Final

import numpy as np

from counterflex.core.similar import close_to
from counterflex.programs.endless import LoopWatch, frozen
from counterflex.programs.gcode.read.flow import line_end
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.scanner import error_at
from counterflex.programs.gcode.sinumerik.block import SinumerikBlock
from counterflex.programs.gcode.sinumerik.cycles import Cycle, cycle_of
from counterflex.programs.gcode.sinumerik.jumps import SinumerikFlow
from counterflex.programs.gcode.sinumerik.moves import SinumerikMoveMaker, frame_of
from counterflex.programs.gcode.sinumerik.scanner import Line, ScannedName, scan
from counterflex.programs.gcode.sinumerik.source import Library, SinumerikHead, SinumerikSource, no_library
from counterflex.programs.gcode.sinumerik.state import SinumerikState
from counterflex.programs.gcode.sinumerik.words import AXES, M_END, ROTARY, SINUMERIK, VECTOR, WordTable
from counterflex.programs.program import Block as ReadBlock, Modal, Program
from counterflex.programs.unknown import known

_HEADER: Final = re.compile(r"\s*(%|;\$PATH=)", re.IGNORECASE)
_VECTOR_WORD: Final = re.compile(r"^[^;]*\b[ABC]3\s*=", re.IGNORECASE)
_MOST: Final = 1e6
_OWN_DATA: Final = ("$AC_MARKER", "$AC_PARAM", "$A_OUT", "$A_OUTA", "$A_DLB", "$A_DLW", "$A_DLR", "$AC_TIMER")
"""System variables that a program may set without an effect on its path."""
_ARC: Final = (*"IJK", "CR", "AR", "TURN")


class SinumerikRun:
    """One run of a program."""

    table: ClassVar[WordTable] = SINUMERIK

    def __init__(self, source: SinumerikSource, machine: MillingMachine, library: Library = no_library) -> None:
        self._main, self._tool_names = source, machine.tool_names
        self._names_open = machine.names_open
        self.flow = SinumerikFlow(source, library)
        vectors = any(_VECTOR_WORD.match(line) for line in source.lines)
        self._state = SinumerikState(
            vectors=vectors,
            start_known=machine.known,
            zeros={offset: np.array(zero[:3]) for offset, zero in machine.part_offsets.items()},
        )
        self._watch = LoopWatch(self._everything)
        self._modals: dict[Modal, Modal] = {}
        self._modal: Cycle | ScannedName | None = None
        self._modal_depth = 0
        self._counts: dict[int, int] = {}
        self.maker = SinumerikMoveMaker(self._state, machine.listed)
        self.blocks: list[ReadBlock] = []

    def run(self) -> bool:
        """Execute to the end; whether a word of the program said that it ends.

        Raises:
            ProgramError: At the first line that cannot be executed exactly.
        """
        flow = self.flow
        while True:
            flow.settle()
            if flow.index >= flow.source.last:
                if not flow.frames:
                    flow.index = flow.source.last - 1
                    return False
                flow.index = flow.source.last - 1
                raise flow.fault("a subprogram stops without M17 or RET", 0, None, "The file may be truncated")
            before = flow.source, flow.index
            if self._step():
                return True
            self._watch_jump(*before)

    def _watch_jump(self, source: SinumerikSource, index: int) -> None:
        """Refuse a jump back that will be made for ever."""
        flow = self.flow
        if flow.source is source and flow.index > index:
            return
        back = index - flow.index + 1 if flow.source is source else 1
        place = (id(flow.source), flow.index, len(flow.frames))
        why = self._watch.jumped_back(place, back, len(self.maker.motions))
        if why:
            flow.index = min(flow.index, flow.source.last - 1)
            raise flow.fault(why, 0, None, "Look at the condition of the loop and for the line that should change it")

    def _everything(self) -> object:
        """All that decides how the program goes on."""
        state = {key: value for key, value in vars(self._state).items() if key != "line"}
        arrays = {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in state.items()}
        return frozen([arrays, self.flow.memory(), str(self._modal)])

    def program(self, dialect: str, text: str) -> Program:
        """Return what was executed."""
        lines, state = self._main.lines, self._state
        for number, block in enumerate(self.blocks):
            if block.single and self._counts.get(block.line, 0) != 1:
                self.blocks[number] = replace(block, single=False)
        return Program(
            name=self._main.name,
            dialect=dialect,
            lines=(*lines, "") if text.endswith(("\n", "\r")) else lines,
            newline=line_end(text),
            blocks=tuple(self.blocks),
            motions=tuple(self.maker.motions),
            straight=all(block.single for block in self.blocks),
            part_zero=None if state.zeros or not state.work_offset else (state.work_offset, state.offset_line),
        )

    def _step(self) -> bool:
        """Execute a line; whether the program ends with it."""
        flow = self.flow
        text, number, source = flow.source.lines[flow.index], flow.index + 1, flow.source
        self._state.line = number
        if _HEADER.match(text):
            self._append(number, text, (), len(self.maker.motions))
            flow.index += 1
            return False
        if flow.source.flow:
            head = SinumerikHead.of(text)
            if head.keyword:
                self._append(number, text, (), len(self.maker.motions))
                flow.control(text, head)
                return False
            text = text[: head.label_start].ljust(head.label_end) + text[head.label_end :]

        line = self.scanned(text, number)
        block = SinumerikBlock(line, partial(error_at, source.name, number), text, self.table)
        first = len(self.maker.motions)
        self._frame(block)
        dwell = "dwell" in block.groups
        self._modes(block, dwell)
        if dwell:
            self.maker.dwell(block, len(self.blocks))
        moves = self._move(block)
        drilled = self._drill(block, moves)
        call = self._called(block, moves)
        block.finish()
        special = drilled or (moves and self._state.motion == "CIP")
        self._append(number, source.lines[flow.index], block.words(dwell, moves), first, cycle=special)
        self._assign(block, line)
        return self._go_on(block, call)

    def _go_on(self, block: SinumerikBlock, call: tuple[ScannedName, int] | None) -> bool:
        """Go to the next line, into a subprogram, or back; whether the program ends."""
        flow = self.flow
        ends = [code for code in block.m if code in M_END]
        if ends and not flow.frames:
            return True
        if ends and ends != [17]:
            raise block.fault("a subprogram ends the program", "", f"M{ends[0]}", "End it with M17 or RET")
        if ends:
            flow.leave()
        elif call is not None:
            self._enter(block, *call)
        else:
            flow.index += 1
        return False

    def _called(self, block: SinumerikBlock, moves: bool) -> tuple[ScannedName, int] | None:
        """The subprogram that a block calls, and how often; MCALL: after each block that moves."""
        if len(block.calls) > 1:
            raise block.fault(
                "two subprograms are called in one block", "", block.calls[1].name, "Put them on two lines"
            )
        repeats = self.maker.whole(block, "P") or 1
        if block.modal_call:
            self._modal_depth = len(self.flow.frames)
            self._modal = block.calls[0] if block.calls else self._modal if block.cycle else None
            return None
        if block.calls:
            return block.calls[0], repeats
        if isinstance(self._modal, ScannedName) and moves and len(self.flow.frames) == self._modal_depth:
            return self._modal, 1
        return None

    def _enter(self, block: SinumerikBlock, call: ScannedName, repeats: int) -> None:
        """Enter a subprogram."""
        name, arguments = call.name, call.arguments
        if name in ("CALL", "PCALL", "EXTCALL"):
            name, arguments = call.text.strip('"() '), ""
        if self.flow.call(name, arguments, repeats):
            return
        close = close_to(name, [*self.table.group, *self.table.carried], 1)
        raise block.named_fault(call, name, f"Did you mean {close[0]}?" if close else "")

    def _assign(self, block: SinumerikBlock, line: Line) -> None:
        """Let variables have their values; frames, offsets and tools of the control are no variables."""
        for item in line.assigned:
            if item.name == "$SC_FRAME_OFFSET_INCR_PROG":
                self._state.shift_travelled = bool(known(item.value, item.name, self.flow.source.name))
            elif item.name.startswith("$") and not item.name.startswith(_OWN_DATA):
                raise block.fault_at("data of the control are set, and what they change is not known", item.start,
                                     item.name, "Take the line out, or set frames with TRANS and ROT")  # fmt: skip
            else:
                self.flow.variables.assign(item.name, item.index, item.value)

    def scanned(self, text: str, number: int) -> Line:
        """Words of a line."""
        return scan(text, self.flow.source.name, number, self.flow.variables)

    def _drill(self, block: SinumerikBlock, moves: bool) -> bool:
        """Drilling cycles: called alone, or behind each block that moves (MCALL); whether one was made."""
        cycle = None
        if block.cycle:
            cycle = cycle_of(block.cycle, self._state.unit_m, lambda what: block.fault(what, block.cycle[:7].upper()))
        if block.modal_call:
            self._modal = cycle
            return False
        if cycle is None and moves and isinstance(self._modal, Cycle):
            cycle = self._modal
        if cycle is not None:
            self.maker.drill(block, len(self.blocks), cycle)
        return cycle is not None

    def _append(self, number: int, text: str, words: tuple[Any, ...], first: int, *, cycle: bool = False) -> None:
        modal = self._state.modal()
        modal = self._modals.setdefault(modal, modal)
        count = len(self.maker.motions) - first
        own = self.flow.source is self._main and not self.flow.frames
        if own:
            self._counts[number] = self._counts.get(number, 0) + 1
        self.blocks.append(ReadBlock(number, text, words, modal, first, count, single=own, cycle=cycle))

    def _frame(self, block: SinumerikBlock) -> None:
        """Plane, TRANS, ATRANS, ROT, AROT, and the settable offset."""
        state = self._state
        if "plane" in block.groups:
            state.plane = int(block.groups["plane"][1:])
        name = block.groups.get("frame")
        if name is not None:
            if set(block.groups) - {"frame", "plane"} or block.m:
                raise block.fault(f"{name} needs a block of its own", name, name)
            if state.traori and not state.vectors:
                raise block.fault(f"{name} with rotary words under TRAORI is not read", name, name, "Post A3= B3= C3=")
            before = state.to_work(state.p_part)
            if name.endswith("MIRROR"):
                axes = {axis for axis, letter in enumerate(AXES) if block.take(letter) is not None}
                if state.traori:
                    raise block.fault(f"{name} under TRAORI is not read", name, name, "Post A3= B3= C3= without it")
                state.set_frame(name, np.zeros(3), np.zeros(3))
                state.mirror(axes)
            else:
                state.set_frame(name, *frame_of(block, name, state))
            state.note_shift(before)
        offset = block.groups.get("work offset")
        if offset == "G500":
            state.machine_axes = True
        elif offset is not None:
            state.machine_axes = False
            self._settable(block, offset)

    def _settable(self, block: SinumerikBlock, offset: str) -> None:
        """Select a settable offset: the first one is that of the part, others as the cell file gives them."""
        state = self._state
        zero = state.zeros.get(offset)
        if not self.maker.motions and not state.zeros:
            state.work_offset = ""  # nothing has moved: the offset in force at the first motion counts
        if (zero is None and state.zeros) or (not state.zeros and state.work_offset not in ("", offset)):
            first = f"{state.work_offset} (line {state.offset_line})" if state.work_offset else "the part"
            raise block.fault(
                f"how far {offset} lies from {first} is not known", offset, offset,
                f"Give the zeros of all offsets in the cell file (--cell): part.work_offsets_mm = {{G54 = [0, 0, 0], "
                f"{offset if offset != 'G54' else 'G55'} = [...]}}; or post with one of them, and TRANS",
            )  # fmt: skip
        if not state.work_offset:
            state.offset_line = state.line
        if zero is not None:
            before = state.to_work(state.p_part)
            state.p_part_origin = state.p_part_origin + zero - state.zero
            state.zero = zero
            if state.work_offset != offset:
                state.note_shift(before)
        state.work_offset = offset

    def _modes(self, block: SinumerikBlock, dwell: bool) -> None:
        """Modes, speeds and tool."""
        state, groups = self._state, block.groups
        before_m, state.unit = state.feed_unit_m, groups.get("unit", state.unit)
        if state.feed and state.feed_mode != 93:  # a feed that is in force stays (828D, Function Manual, G2)
            state.feed *= before_m / state.feed_unit_m
        if "distance" in groups:
            state.absolute = groups["distance"] == "G90"
        if "feed" in groups and int(groups["feed"][1:]) != state.feed_mode:
            state.feed_mode, state.feed = int(groups["feed"][1:]), None
        if not dwell:
            self._rates(block)
        self._tool(block)
        state.motion = groups.get("motion", state.motion)
        transformation = groups.get("transformation")
        if transformation is not None:
            state.traori, state.angles = transformation == "TRAORI", (0.0, 0.0, 0.0)

    def _rates(self, block: SinumerikBlock) -> None:
        state = self._state
        for name in ("F", "S", "S1"):
            value = block.take(name)
            if value is None:
                continue
            if not 0.0 <= value <= _MOST:
                raise block.fault(f"the value of {name} is out of range", name, hint="0 to 1e6")
            if name == "F":
                state.feed = value
            else:
                state.speed_rpm = value

    def _tool_number(self, block: SinumerikBlock, tool: str) -> int:
        number = self._tool_names.get(tool.strip().upper())
        if number is not None or (tool.isdecimal() and int(tool) <= 99_999):
            return int(tool) if number is None else number
        if self._names_open and not tool.isdecimal():
            return 0
        raise block.fault(
            "a tool is called by a name that no tool of the cell has alone", "T",
            hint="Give the tool this name in [[tools]] of the cell file, or write T1",
        )  # fmt: skip

    def _tool(self, block: SinumerikBlock) -> None:
        state = self._state
        tool = block.take_text("T")
        if tool is not None:
            state.prepared = self._tool_number(block, tool)
        for name in ("D", "H"):
            block.take(name)
        for name in ("SPOS", "SPOSA"):
            if block.take(name) is not None:
                state.spindle = 0
        for code in block.m:
            if code == 6:
                if state.prepared is None:
                    raise block.fault("M6 changes to a tool that no T word has chosen", "", "M6", "Write T1 M6")
                state.tool, state.spindle = state.prepared, 0
            elif code in (3, 4, 5, 19):
                state.spindle = {3: 1, 4: -1}.get(code, 0)

    def _leave(self, block: SinumerikBlock, machine: str | None, axes: bool) -> None:
        """Go to a place of the machine."""
        fixed = machine in ("G74", "G75")
        away = [axis for axis, name in enumerate((*AXES, *ROTARY)) if block.take(name) is not None]
        if fixed:
            away += [axis for axis, name in enumerate(AXES) if block.take(f"{name}1") is not None]
            block.take("FP")
        if axes or fixed:
            self.maker.leave(len(self.blocks), machine or "G500", [axis for axis in away if axis < 3])

    def _move(self, block: SinumerikBlock) -> bool:
        """Execute the motion of a block; whether its axis words are targets in the part."""
        state, maker = self._state, self.maker
        machine = block.groups.get("machine")
        axes = block.has(*AXES, *ROTARY, *VECTOR)
        if machine is not None or (state.machine_axes and axes):
            self._leave(block, machine, axes)
            return False
        arc = state.motion in ("G2", "G3")
        if not axes and not (arc and block.has(*_ARC)):
            return False
        if not state.motion:
            first = next(name for name in (*AXES, *ROTARY, *VECTOR) if block.has(name))
            raise block.fault("an axis word, but no motion code is active", first, hint="Write G0, G1, G2 or G3")
        if state.motion == "CIP":
            maker.through(block, len(self.blocks))
        elif arc:
            maker.arc(block, len(self.blocks), clockwise=state.motion == "G2")
        else:
            maker.straight(block, len(self.blocks), rapid=state.motion == "G0")
        return True

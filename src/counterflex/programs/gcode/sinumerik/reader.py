"""Read programs in the Sinumerik dialect: one pass, every line once and in order."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Final

from counterflex.core.errors import ProgramError
from counterflex.programs.gcode.read.flow import line_end, split_lines
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.scanner import error_at
from counterflex.programs.gcode.sinumerik.block import Block
from counterflex.programs.gcode.sinumerik.cycles import Cycle, cycle_of
from counterflex.programs.gcode.sinumerik.moves import MoveMaker, frame_of
from counterflex.programs.gcode.sinumerik.scanner import Line, scan
from counterflex.programs.gcode.sinumerik.state import State
from counterflex.programs.gcode.sinumerik.words import AXES, M_END, ROTARY, SINUMERIK, VECTOR, WordTable
from counterflex.programs.program import Block as ReadBlock
from counterflex.programs.program import Modal, Program
from counterflex.programs.source_text import read_text

_HEADER: Final = re.compile(r"\s*(%|;\$PATH=)", re.IGNORECASE)
_VECTOR_WORD: Final = re.compile(r"^[^;]*\b[ABC]3\s*=", re.IGNORECASE)
_MOST: Final = 1e6
_ARC: Final = (*"IJK", "CR", "AR", "TURN")


def read_sinumerik(
    text: str, *, name: str = "program", complete: bool = False, tool_names: Mapping[str, int] | None = None
) -> Program:
    """Execute a program's text and return the blocks passed and the motions made.

    The zero of the first settable offset (G54 to G57, G505 to G599) is the zero of the part, tool lengths are
    compensated by the control, and the basic system is metric: F is in mm/min under G70 and G71.

    Args:
        text: The program.
        name: Its name, for errors.
        complete: Refuse a text that stops without M2, M17, M30 or RET: it may have been cut off.
        tool_names: Number of a tool by its name in capitals, for ``T="NAME"``.

    Returns:
        The program as executed; A3 B3 C3 appear as the I J K of
        :data:`~counterflex.programs.program.TOOL_VECTOR`, CR as R.

    Raises:
        ProgramError: With ``name:line:column``, at the first thing that is unknown, refused or contradictory.

    Source: SINUMERIK 840D sl, Programming Manual Fundamentals, and Job Planning (TRAORI, frames).
    """
    lines = split_lines(text)
    if not any(line.strip() for line in lines):
        raise ProgramError("the program is empty", where=f"{name}:1:1", hint="Give a file with a Sinumerik program")
    run = Run(name, lines, tool_names or {})
    ended = False
    for index in range(len(lines)):
        if not ended:
            ended = run.line(index)
    if complete and not ended:
        raise error_at(
            name, len(lines), "the program stops without M2, M17, M30 or RET", 0, None,
            "The file may be truncated. If it is complete, add --without-end",
        )  # fmt: skip
    return Program(
        name=name,
        dialect="sinumerik",
        lines=(*lines, "") if text.endswith(("\n", "\r")) else lines,
        newline=line_end(text),
        blocks=tuple(run.blocks),
        motions=tuple(run.maker.motions),
        straight=True,
    )


def read_sinumerik_file(
    file: str | os.PathLike[str], *, machine: MillingMachine | None = None, complete: bool = True
) -> Program:
    """Read a program from a file.

    Args:
        file: UTF-8 or Latin-1.
        machine: A parameter file of LinuxCNC says nothing about this control.
        complete: See :func:`read_sinumerik`.

    Raises:
        ProgramError: The file cannot be read, or is no program that can be executed exactly.
    """
    if machine is not None and machine.part_at_g54:
        raise ProgramError("--parameters is a file of LinuxCNC and has no meaning for Sinumerik", where=str(file))
    text, encoding = read_text(Path(file))
    names = {} if machine is None else machine.tool_names
    program = read_sinumerik(text, name=Path(file).name, complete=complete, tool_names=names)
    return replace(program, encoding=encoding)


class Run:
    """One pass through a program.

    Args:
        name: Of the program, for errors.
        lines: Of it.
        tool_names: Number of a tool by its name in capitals.
    """

    table: ClassVar[WordTable] = SINUMERIK

    def __init__(self, name: str, lines: tuple[str, ...], tool_names: Mapping[str, int]) -> None:
        self._name, self._lines, self._tool_names = name, lines, tool_names
        self._state = State(vectors=any(_VECTOR_WORD.match(line) for line in lines))
        self._constants: dict[int, float] = {}
        self._modals: dict[Modal, Modal] = {}
        self._modal: Cycle | None = None
        self.maker = MoveMaker(self._state)
        self.blocks: list[ReadBlock] = []

    def line(self, index: int) -> bool:
        """Execute a line; True where the program ends with it."""
        text, number = self._lines[index], index + 1
        if _HEADER.match(text):
            self._append(number, text, (), len(self.maker.motions))
            return False

        def fault(what: str, column: int, value: object, hint: str | None) -> ProgramError:
            return error_at(self._name, number, what, column, value, hint)

        block = Block(self.scanned(text, number), fault, text, self.table)
        first = len(self.maker.motions)
        self._constants |= block.parameters
        self._frame(block)
        dwell = "dwell" in block.groups
        self._modes(block, dwell)
        if dwell:
            self.maker.dwell(block, len(self.blocks))
        moves = self._move(block)
        drilled = self._drill(block, moves)
        block.finish()
        special = drilled or (moves and self._state.motion == "CIP")
        self._append(number, text, block.words(dwell, moves), first, cycle=special)
        return any(code in M_END for code in block.m)

    def scanned(self, text: str, number: int) -> Line:
        """Words of a line."""
        return scan(text, self._name, number, self._constants)

    def _drill(self, block: Block, moves: bool) -> bool:
        """Drilling cycles: called alone, or behind each block that moves (MCALL); whether one was made."""
        cycle = None
        if block.cycle:
            cycle = cycle_of(block.cycle, self._state.unit_m, lambda what: block.fault(what, block.cycle[:7].upper()))
        if block.modal_call:
            self._modal = cycle
            return False
        cycle = cycle if cycle is not None else self._modal if moves else None
        if cycle is not None:
            self.maker.drill(block, len(self.blocks), cycle)
        return cycle is not None

    def _append(self, number: int, text: str, words: tuple[Any, ...], first: int, *, cycle: bool = False) -> None:
        modal = self._state.modal()
        modal = self._modals.setdefault(modal, modal)
        count = len(self.maker.motions) - first
        self.blocks.append(ReadBlock(number, text, words, modal, first, count, cycle=cycle))

    def _frame(self, block: Block) -> None:
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
            state.set_frame(name, *frame_of(block, name, state))
        offset = block.groups.get("work offset")
        if offset == "G500":
            state.machine_axes = True
        elif offset is not None:
            state.machine_axes = False
            if state.work_offset not in ("", offset):
                raise block.fault(
                    "a second settable offset: how far it is from the first is not known here", "G",
                    f"{offset} after {state.work_offset}", "Post the program with one of them, and TRANS",
                )  # fmt: skip
            state.work_offset = offset

    def _modes(self, block: Block, dwell: bool) -> None:
        """Modes, speeds and tool."""
        state, groups = self._state, block.groups
        state.unit = groups.get("unit", state.unit)
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

    def _rates(self, block: Block) -> None:
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

    def _tool(self, block: Block) -> None:
        state = self._state
        tool = block.take_text("T")
        if tool is not None:
            number = self._tool_names.get(tool.strip().upper())
            if number is None and (not tool.isdecimal() or int(tool) > 99_999):
                raise block.fault(
                    "a tool is called by a name that no tool of the cell has alone", "T",
                    hint="Give the tool this name in [[tools]] of the cell file, or write T1",
                )  # fmt: skip
            state.prepared = int(tool) if number is None else number
        for name in ("D", "H"):
            block.take(name)
        for code in block.m:
            if code == 6:
                if state.prepared is None:
                    raise block.fault("M6 changes to a tool that no T word has chosen", "", "M6", "Write T1 M6")
                state.tool, state.spindle = state.prepared, 0
            elif code in (3, 4, 5, 19):
                state.spindle = {3: 1, 4: -1}.get(code, 0)

    def _move(self, block: Block) -> bool:
        """Execute the motion of a block; whether its axis words are targets in the part."""
        state, maker = self._state, self.maker
        machine = block.groups.get("machine")
        axes = block.has(*AXES, *ROTARY, *VECTOR)
        if machine is not None or (state.machine_axes and axes):
            for name in (*AXES, *ROTARY):
                block.take(name)
            if axes and maker.motions and not maker.away:
                maker.away = f"{machine or 'G500'} in line {len(self.blocks) + 1}"
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

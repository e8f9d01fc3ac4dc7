"""Read MELFA-BASIC: Mov, Mvs, Mvr, Spd, Cnt, Dly, Hlt, CallP, End, and positions ``P1=(X,Y,Z,A,B,C)(7,0)``.

Positions are in the frame that ``Base`` sets, which is the part frame; ``R = Rz(C) Ry(B) Rx(A)``.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import DEG, MM, MM_PER_S
from counterflex.geometry import pose, rotation
from counterflex.programs.program import TOOL_VECTOR, Block, Word
from counterflex.programs.robot_text.cell import RobotTextCell
from counterflex.programs.robot_text.execution import Execution, tilted, with_axes
from counterflex.programs.robot_text.process_words import ProcessWords
from counterflex.programs.robot_text.program import RobotProgram, Stated, StatedPosture
from counterflex.programs.source_text import read_text

_POSITION: Final = re.compile(r"\s*(P\d+)\s*=\s*\(([^()]*)\)\s*\((\d+)\s*,\s*-?\d+\)\s*", re.IGNORECASE)
_FRAME: Final = re.compile(r"\s*(Base|Tool)\s*\(([^()]*)\)\s*", re.IGNORECASE)
_CALL: Final = re.compile(r'\s*CallP\s*"(\w+)"\s*', re.IGNORECASE)
_WORD: Final = re.compile(r"\s*(\w+)\s*(.*?)\s*")


@dataclass(frozen=True, slots=True)
class MelfaProgram(RobotProgram):
    """A program in MELFA-BASIC: which motions stop, and the first number behind each position."""

    exact: frozenset[int] = frozenset()
    flags: tuple[int | None, ...] = ()

    def stops(self) -> frozenset[int]:
        """Motions under ``Cnt 0``."""
        return self.exact

    def postures(self) -> dict[int, Stated]:
        """Bits of the flag: 1 nonflip, 2 above, 4 right."""
        return {
            index: (StatedPosture(bool(bits & 4), bool(bits & 2) == bool(bits & 4), bool(bits & 1)), f"flag {bits}")
            for index, bits in enumerate(self.flags)
            if bits is not None
        }


class _Reader(Execution):
    """Executes a program line by line."""

    def __init__(self, file: Path, cell: RobotTextCell | None, *, complete: bool) -> None:
        self.tool = 0 if cell is None else cell.only_tool
        super().__init__(self)
        self.file, self.cell, self.complete, self.part = file, cell, complete, ""
        self.words = None if cell is None else ProcessWords(cell.functions, code_of)
        self.speed, self.continuous = 0.0, False
        self.exact: set[int] = set()
        self.flags: list[int | None] = []

    def fault(self, what: str, hint: str = "Write it by hand") -> ProgramError:
        return ProgramError(what, where=f"{self.name}:{self.at + 1}", value=self.lines[self.at].strip(), hint=hint)

    def run(self, lines: list[str], name: str) -> None:
        """Execute a file; a part that it calls is executed by another call."""
        self.lines, self.name, self.at, self.ended = lines, name, 0, False
        self.positions = {m[1].upper(): (frame(m[2]), int(m[3])) for m in map(_POSITION.fullmatch, lines) if m}
        while self.at < len(lines):
            first, taken = len(self.motions), 1
            code = code_of(self.lines[self.at]).strip()
            if called := _CALL.fullmatch(code):  # The motions of a part are those of its own blocks
                self._blocks.append(Block(self.at + 1, lines[self.at], (), self.modal("G1"), first, 0, file=self.part))
                self.call(called[1])
                self.at += 1
                continue
            word = None if self.words is None else self.words.find(self.lines, self.at, f"{self.name}:{self.at + 1}")
            if word is not None:
                self.do(word)
                taken = word.lines
            elif code and not _POSITION.fullmatch(code):
                self.statement(code, len(self._blocks))
            modal = self.modal(self.motion_code(first))
            words, self._words = tuple(self._words), []
            count = len(self.motions) - first
            self._blocks.append(Block(self.at + 1, lines[self.at], words, modal, first, count, file=self.part))
            self.at += taken
        if self.complete and not self.ended:
            raise ProgramError("the program has no End", where=name, hint="It may have been cut off")

    def call(self, name: str) -> None:
        """Execute the part beside the program."""
        file, state = self.file.with_name(f"{name}.prg"), (self.lines, self.name, self.at, self.positions)
        if self.part or not file.is_file():
            raise self.fault("a part that is not beside the program, or of a part")
        self.part = file.name
        self.run(read_text(file)[0].splitlines(), file.name)
        self.lines, self.name, self.at, self.positions = state
        self.part = ""

    def statement(self, code: str, block: int) -> None:
        framed = _FRAME.fullmatch(code)
        if framed:
            self.check_frame(framed[1].upper(), frame(framed[2]))
            return
        match = _WORD.fullmatch(code)
        word, rest = ("", "") if match is None else (match[1].upper(), match[2])
        targets = [self.target(name) for name in rest.split(",")] if word in ("MOV", "MVS", "MVR") else []
        if word == "END":
            self.ended = True
        elif word == "SPD":
            self.speed = float(rest) * MM_PER_S
        elif word == "CNT":
            self.continuous = rest == "1"
        elif word == "DLY":
            self.dwell(block, float(rest))
            self.flags += [None] * (len(self.motions) - len(self.flags))
        elif targets:
            T, flag = targets[-1]
            self.straight(block, T[:3, 3], T[:3, :3], 0.0 if word == "MOV" else self.speed)
            self.flags.append(flag)
            if word == "MVR":
                self.circle(targets[1][0][:3, 3], self.fault)
            if not self.continuous:
                self.exact.add(len(self.motions) - 1)
        elif word == "HLT":
            self._words.append(Word("M", 0.0, 0, 0))
        else:
            self.acting.append(self.at + 1)

    def check_frame(self, name: str, T: Float) -> None:
        if self.cell is not None and name == "BASE":
            self.cell.refuse_other_part_frame(T, "Base", f"{self.name}:{self.at + 1}")
        elif self.cell is not None:
            self.cell.R_tcp_tool(T, "Tool", f"{self.name}:{self.at + 1}")

    def target(self, name: str) -> tuple[Float, int]:
        if name.strip().upper() not in self.positions:
            raise self.fault("a position that the program does not define", "Add its line P..=(X,Y,Z,A,B,C)(7,0)")
        return self.positions[name.strip().upper()]


def frame(text: str) -> Float:
    """(4, 4) m of ``X,Y,Z,A,B,C`` in mm and deg."""
    x, y, z, a, b, c = (float(part) for part in text.split(","))
    return pose.make(rotation.from_zyx(np.array([c, b, a]) * DEG), np.array([x, y, z]) * MM)


def code_of(line: str) -> str:
    """A line without its comment."""
    return line.partition("'")[0]


def read_file(
    path: str | os.PathLike[str], *, cell: RobotTextCell | None = None, complete: bool = True
) -> MelfaProgram:
    """Read a program.

    Raises:
        ProgramError: It has no End, or a position is missing.
    """
    file = Path(path)
    text, encoding = read_text(file)
    lines = text.splitlines()
    reader = _Reader(file, cell, complete=complete)
    reader.run(lines, file.name)
    rotations = np.array(reader.rotations).reshape(-1, 3, 3)
    leans = tilted(rotations)
    blocks = tuple(reader.blocks(TOOL_VECTOR if leans else 0))
    motions = tuple(with_axes(reader.motions, rotations) if leans else reader.motions)
    return MelfaProgram(
        name=file.name, dialect="melfa", lines=tuple(lines), newline="\n", blocks=blocks, motions=motions,
        straight=len({block.file for block in blocks}) == 1, encoding=encoding, Rs_part_tcp=rotations,
        acting=tuple(reader.acting), exact=frozenset(reader.exact), flags=tuple(reader.flags),
    )  # fmt: skip

"""A milling program as read: the executed blocks and the motions they make.

Readers fill these types, writers consume them. Blocks keep their text and the place of every word, so that a writer can
change a target and leave everything else byte for byte as it was.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Final, Literal

import numpy as np

from counterflex.core.arrays import Float

TOOL_CENTRE: Final = 434
"""Tool-centre-point programming with rotary words: G43.4, as Fanuc has it; XYZ is the tool tip in the part."""
TOOL_VECTOR: Final = 435
"""The same with the tool axis in the part as I J K: G43.5."""

MotionKind = Literal["rapid", "feed", "arc", "dwell"]


@dataclass(frozen=True, slots=True)
class Word:
    """A letter and its value in a block."""

    letter: str  # Upper case
    value: float  # As read, in program units
    start: int  # Index of the letter in the block's text
    end: int  # Index just behind the value
    literal: bool = True  # False when the value was an expression or a parameter
    # True or False where the word says so itself (``X=AC(5)``, ``X=IC(5)``); None where the mode of the block decides
    absolute: bool | None = None

    def counts_from_zero(self, modal: Modal) -> bool:
        """Return whether an axis word is absolute, by itself or by the mode of its block."""
        return modal.absolute if self.absolute is None else self.absolute


def has_g(words: Iterable[Word], *codes: float) -> bool:
    """Return whether words name one of some G codes."""
    return any(word.letter == "G" and word.value in codes for word in words)


@dataclass(frozen=True, slots=True)
class Modal:
    """Modal state while a block executes, its own words included."""

    motion: str  # Active motion code: ``G0 G1 G2 G3 G81 ... G80``.
    plane: int  # 17, 18 or 19
    unit_m: float  # Length of one program unit in m (0.001 or 0.0254)
    absolute: bool  # G90 (True) or G91
    arc_absolute: bool  # G90.1 (True) or G91.1
    feed_mode: int  # 93, 94 or 95
    # (3,) m; ``p_part = p_part_origin + value * unit_m`` for absolute words (all offsets together)
    p_part_origin: tuple[float, float, float]
    tool: int  # Number of the tool in the spindle
    spindle_rpm: float  # Signed: M3 positive, M4 negative, 0 when stopped
    tool_centre: int = 0  # :data:`TOOL_CENTRE`, :data:`TOOL_VECTOR`, or 0 for none
    feed_unit_m: float = 0.0  # Length of one unit of F in m; 0 where it is ``unit_m``
    # Rows of the rotation from the programmed axes to those of the part, or None where they are parallel: ``p_part =
    # p_part_origin + R_part_work @ value * unit_m``. A mirror image has determinant -1.
    R_part_work: tuple[tuple[float, float, float], ...] | None = None
    not_written: str = ""  # Why blocks in this state cannot be written back with other targets; empty where they can

    @property
    def unit_of_feed_m(self) -> float:
        """Length of one unit of F, m."""
        return self.feed_unit_m or self.unit_m


@dataclass(frozen=True, slots=True)
class Block:
    """One executed block, in the order of execution."""

    line: int  # 1-based line in the source file
    text: str  # The line without its line end
    words: tuple[Word, ...]  # In order of appearance
    modal: Modal  # State while it executes
    first_motion: int  # Index of the first motion it makes
    motion_count: int  # Number of motions it makes (a canned cycle makes several, a comment none)
    # True when the block is executed exactly once, in file order, so that it can be edited in place
    single: bool = True
    cycle: bool = False  # True for canned cycles and other blocks whose motions are not simply their own target
    file: str = ""  # Name of the file that the line is in, where that is another than the main one

    @property
    def motions(self) -> range:
        """Indices of the motions that it makes."""
        return range(self.first_motion, self.first_motion + self.motion_count)

    def where(self, name: str) -> str:
        """File and line; ``name`` is that of the main file."""
        return f"{self.file or name}:{self.line}"


@dataclass(frozen=True, slots=True)
class Motion:
    """One elementary motion of the tool tip in the part frame."""

    block: int  # Index of its block in :attr:`Program.blocks`
    kind: MotionKind  # ``rapid``, ``feed``, ``arc`` or ``dwell``
    p_start: Float  # (3,) m
    p_end: Float  # (3,) m
    feed_m_s: float  # Programmed speed (0 for rapids and dwells: the machine decides)
    spindle_rad_s: float  # Positive for M3
    tool: int  # Tool number
    duration_s: float = 0.0  # Of a dwell, else 0
    # (3,) rad, rotary axes A B C at the start; part of 5-axis programs, zeros otherwise. Under G43.5 the components I J
    # K of the tool axis instead, from the tip to the spindle, of any length.
    abc_start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    abc_end: tuple[float, float, float] = (0.0, 0.0, 0.0)  # (3,) rad
    p_centre: Float | None = None  # (3,) m of an arc: a point on its axis at the height of the start, else None
    normal: Float | None = None  # (3,) unit normal of the arc's plane; the turn is right-handed about it
    # Signed angle turned about ``normal`` (several turns and helices included), 0 for straight motions
    turn_rad: float = 0.0
    feed_rad_s: float = 0.0  # Programmed speed where only rotary axes turn, else 0
    # Letters of the axes along which the end is not known: numbers of ``p_end`` there mean nothing. Only in programs
    # that were read to be listed.
    unknown: str = ""

    @property
    def length_m(self) -> float:
        """Length of the path of the tool tip, m."""
        p = np.asarray(self.p_end) - np.asarray(self.p_start)
        if self.p_centre is None or self.normal is None:
            return float(np.linalg.norm(p))
        radius = float(np.linalg.norm(np.asarray(self.p_start) - self.p_centre))
        return math.hypot(radius * self.turn_rad, float(p @ self.normal))

    def tangent_at(self, *, end: bool) -> Float:
        """(2,) unit direction at the start or the end of a motion."""
        if self.kind == "arc" and self.p_centre is not None and self.normal is not None:
            arm = (self.p_end if end else self.p_start) - self.p_centre
            v = math.copysign(1.0, self.turn_rad) * np.cross(self.normal, arm)[:2]
        else:
            v = (self.p_end - self.p_start)[:2]
        out: Float = v / np.linalg.norm(v)
        return out


@dataclass(frozen=True, slots=True)
class Program:
    """A program as executed."""

    name: str  # File name
    dialect: str  # Name of its language, see :data:`counterflex.programs.language.LANGUAGES`
    lines: tuple[str, ...]  # The source, without line ends
    newline: str  # Line end of the source
    blocks: tuple[Block, ...]  # Executed blocks in order (comment and empty lines included where they are passed)
    motions: tuple[Motion, ...]  # All motions in order
    straight: bool  # True when every source line is executed at most once and in file order (no loops, no subroutines)
    encoding: str = "utf-8"  # Of the source's bytes; what is written back uses the same
    # Work offset whose zero was taken as that of the part because nothing says where it lies, with its line; None where
    # it is known or the language has none
    part_zero: tuple[str, int] | None = None
    # Number of the only tool of the cell, taken because the program names none; 0: it names its tools
    tool_taken: int = 0

    def place(self, line: int) -> str:
        """Return a line as tables name it: ``line 7``, or ``cut.src:7`` where motions stand in several files."""
        used = {(self.blocks[motion.block].file, self.blocks[motion.block].line) for motion in self.motions}
        if not any(file for file, _ in used):
            return f"line {line}"
        name = PurePath(self.name).name
        files = sorted({file or name for file, at in used if at == line}) or [name]
        return " or ".join(f"{file}:{line}" for file in files)


def same_motions(
    one: Sequence[Motion], other: Sequence[Motion], Rs_one: Iterable[Float], Rs_other: Iterable[Float]
) -> bool:
    """Return whether two runs of a program make the same motions; ``Rs`` are the orientations at their ends."""
    return len(one) == len(other) and all(
        (a.kind, a.feed_m_s, a.turn_rad, a.duration_s, a.tool, a.spindle_rad_s, *a.p_end, *R.flat)
        == (b.kind, b.feed_m_s, b.turn_rad, b.duration_s, b.tool, b.spindle_rad_s, *b.p_end, *S.flat)
        for a, b, R, S in zip(one, other, Rs_one, Rs_other, strict=True)
    )

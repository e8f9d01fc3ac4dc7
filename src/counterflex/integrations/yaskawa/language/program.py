"""An INFORM job as read: its positions with their places in the text, and what stands behind each motion.

Source of the format: Yaskawa, DX100 and NX100 "Instructions for data transmission", chapter "Job data format".
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.units import MM, MM_PER_S
from counterflex.integrations.yaskawa.language import LIMITS
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.robot_text.program import (
    NamedPoint,
    RobotProgram,
    Span,
    Stated,
    StatedPosture,
    angles_zyx,
    frame_zyx,
)

DIALECT: Final = "inform"
AXES: Final = 6
PULSE: Final = "PULSE"
USER: Final = "USER"
WORLD: Final = ("BASE", "ROBOT")
"""Types of positions in the frame of the robot: both are one where the robot stands on no base axis."""


def frame_of(values: Sequence[float]) -> Float:
    """(4, 4) m of X Y Z (mm) and Rx Ry Rz (deg): ``R = Rz(Rz) Ry(Ry) Rx(Rx)``.

    Sources: DX100 instructions for data transmission, 4.3.1.1 (the frame is turned by Rz, then Ry, then Rx, each about
    its own new axes); Roboception, "Yaskawa pose format".
    """
    x, y, z = (float(value) for value in values[3:AXES])
    return frame_zyx(values[:3], x, y, z)


angles_of = angles_zyx
"""Rx, Ry, Rz in deg of an orientation (3, 3); the inverse of :func:`frame_of`."""


def values_of(T_frame_tool: Float) -> list[float]:
    """X Y Z in mm and Rx Ry Rz in deg of a pose (4, 4) m."""
    return [*(T_frame_tool[:3, 3] / MM).tolist(), *angles_of(T_frame_tool[:3, :3])]


@dataclass(frozen=True, slots=True)
class Header:
    """Words before positions, which hold for all that follow."""

    postype: str = ""  # ``PULSE BASE ROBOT USER TOOL MTOOL``
    user: int = -1  # Number of ``///USER``; -1 where none was said
    tool: int = -1  # Number of ``///TOOL``; -1 where none was said
    rconf: str = ""  # Text of ``///RCONF``

    def lines(self) -> list[str]:
        """Return the pseudo instructions that say it."""
        out = [f"///USER {self.user}"] if self.postype == USER else []
        out += [f"///TOOL {self.tool}"] if self.tool >= 0 else []
        out += [f"///POSTYPE {self.postype}", "///PULSE" if self.postype == PULSE else "///RECTAN"]
        return [*out, *([f"///RCONF {self.rconf}"] if self.postype != PULSE and self.rconf else [])]


@dataclass(frozen=True, slots=True)
class Position:
    """An entry of ``//POS``."""

    kind: str  # ``C`` or ``P``; of external axes ``BC EC BP EX``
    number: int  # Behind the kind
    start: int  # Index of its name
    end: int  # Index behind its last number
    numbers: tuple[Span, ...]  # Where each number stands
    # X Y Z in mm and Rx Ry Rz in deg; S L U R B T in pulses where ``header.postype`` is PULSE
    values: tuple[float, ...]
    header: Header  # What it stands under


@dataclass(frozen=True, slots=True, kw_only=True)
class Point(NamedPoint):
    """A position that a motion leads to or through, as it stands in the text; its frame has the shift that is on."""

    end: int  # Index behind the instruction
    position: Position | None = None  # Its entry; None of a computed one
    computed: str = ""  # Why it is no entry, as a clause; empty where it is
    header: Header = field(default_factory=Header)  # What an entry like it stands under
    words: str = ""  # Positions of external axes behind it, as written
    number: Span = (0, 0)  # Where the number of ``V=`` stands; empty span without one
    tail: str = ""  # Options behind the speed, as written

    @property
    def relative(self) -> bool:
        """It is the end of an IMOV."""
        return self.computed == "IMOV"


@dataclass(frozen=True, slots=True)
class InformMotion:
    """Text behind a motion of :attr:`InformProgram.motions`."""

    word: str  # ``MOVJ MOVL MOVC IMOV``, or ``TIMER`` of a dwell
    point: Point  # Its end
    exact: bool = False  # The robot stops there (PL=0)
    rounding_m: float = float("nan")  # Radius of its corner as far as the job says it (CR); NaN: left to the controller
    through: tuple[Point, ...] = ()  # Of a circle the points between start and end
    start: Point | None = None  # Of a circle the MOVC that stands at its start, where it moves nothing
    piece: bool = False  # One of several pieces of a circle that stand in instructions of their own: not edited

    @property
    def line(self) -> int:
        """1-based line of its instruction."""
        return self.point.line


@dataclass(frozen=True, slots=True)
class JobText:
    """A job file, as read."""

    text: str  # As read
    positions: Mapping[tuple[str, int], Position]  # Entries by kind and number
    mentions: Mapping[int, int]  # How often the instructions name each C
    npos: Span  # Where the number of C in ``///NPOS`` stands
    behind: int  # Index behind the last C, where further ones are put; without one behind ``//POS``
    at_behind: Header  # What further positions there stand under
    followed: bool  # Positions stand behind it
    first: int  # Index at which the line behind NOP begins


@dataclass(frozen=True, slots=True)
class InformProgram(RobotProgram):
    """A job with those that it calls."""

    jobs: Mapping[str, JobText] = field(default_factory=dict)  # By name of the file, the main one first
    moves: tuple[InformMotion, ...] = ()  # One for each of ``motions``
    doubts: tuple[str, ...] = ()  # Second readings, one sentence each

    def stops(self) -> frozenset[int]:
        """Motions with PL=0."""
        return frozenset(index for index, move in enumerate(self.moves) if move.exact)

    def roundings_m(self) -> list[float]:
        """CR of each motion; PL has distances of the controller."""
        return [0.0 if move.exact else move.rounding_m for move in self.moves]

    def postures(self) -> dict[int, Stated]:
        """RCONF of the targets: front or rear, upper or lower arm. Flip says where R is, not on which side B is."""
        stated = {index: _posture(move.point) for index, move in enumerate(self.moves)}
        return {index: one for index, one in stated.items() if one is not None}


def _posture(point: Point) -> Stated | None:
    flags = point.header.rconf.split(",")[:3]
    if point.T_frame_tool is None or len(flags) < 3 or any(flag not in ("0", "1") for flag in flags):
        return None
    front = flags[2] == "0"
    return StatedPosture(front, (flags[1] == "0") == front), f"RCONF {','.join(flags)}"


def doubts(program: InformProgram) -> list[str]:
    """Return the second readings of a job, one sentence each."""
    return list(program.doubts)


COMMENT: Final = 32
"""Characters of a comment (INFORM language manual): the mark of a job fits exactly."""
_SPEED_DECIMALS: Final = 4
_HALF_DEG: Final = 180.0
_HALF_RAD: Final = math.pi
_QUARTER_RAD: Final = 0.5 * math.pi
_LINES_OF_A_COMMENT: Final = 6


def comments(messages: Iterable[str]) -> Iterator[str]:
    """Comments, each cut between words."""
    for message in messages:
        yield from textwrap.wrap(message.replace("'", " "), COMMENT)[:_LINES_OF_A_COMMENT] or [""]


def speed_text(speed_m_s: float) -> str:
    """A speed along the path in mm/s with one decimal, as controllers show it, or as many as it needs up to four."""
    text = number(speed_m_s / MM_PER_S, _SPEED_DECIMALS).rstrip("0")
    return f"{text}0" if text.endswith(".") else text


def entry_text(kind: str, index: int, T_frame_tool: Float, digits: int = 5) -> str:
    """An entry of //POS."""
    return f"{kind}{index:0{digits}d}={','.join(numbers_text(values_of(T_frame_tool)))}"


def numbers_text(values: Sequence[float]) -> list[str]:
    """X Y Z and Rx Ry Rz as they are written."""
    decimals = [LIMITS.position_decimals] * 3 + [LIMITS.angle_decimals] * 3
    texts = [number(float(value), places) for value, places in zip(values, decimals, strict=True)]
    return [text.removeprefix("-") if k > 2 and abs(float(text)) == _HALF_DEG else text for k, text in enumerate(texts)]


def job_text(name: str, header: Header, entries: Sequence[tuple[Header, str]], lines: Sequence[str]) -> str:
    """Text of a relative job in a user frame.

    Args:
        header: What the first position stands under.
        entries: What each position stands under, and the text behind its number.
        lines: Instructions.
    """
    head = ["/JOB", f"//NAME {name.upper()}", "//POS", f"///NPOS {len(entries)},0,0,0,0,0"]
    before: Header | None = None
    for index, (own, text) in enumerate(entries):
        if own != before:
            head += own.lines() if before is None else _changed(before, own)
            before = own
        head.append(f"C{index:05d}={text}")
    about = ["//INST", "///DATE 2000/01/01 00:00", "///ATTR SC,RW,RJ", f"////FRAME USER {header.user}", "///GROUP1 RB1"]
    return "\r\n".join([*head, *about, "NOP", *lines, "END", ""])


def _changed(before: Header, own: Header) -> list[str]:
    """Pseudo instructions where only the tool or the configuration differs."""
    return [line for line in own.lines() if line not in before.lines()]


def rconf(branch: str, axes_rad: Sequence[float]) -> str:
    """The six flags of RCONF that mean something in a posture, with commas between.

    Source: DX100, Instructions for data transmission, RCONF; NX100, Operator's manual, "Manipulator types": flip (0)
    where R is within a quarter turn of 0, upper arm (0) or lower arm, front (0) or rear, then R, T and S within half a
    turn (0) or beyond.

    Args:
        branch: Such as ``front up noflip``.
        axes_rad: (6,) axes as the controller shows them.
    """
    arm, elbow, _ = branch.split()
    s, r, t = axes_rad[0], axes_rad[3], axes_rad[5]
    near = r - 2.0 * math.pi * round(r / (2.0 * math.pi))
    flags = (
        not -_QUARTER_RAD < near <= _QUARTER_RAD,
        elbow != "up",
        arm != "front",
        *(not -_HALF_RAD < a <= _HALF_RAD for a in (r, t, s)),
    )
    return ",".join(str(int(flag)) for flag in flags)

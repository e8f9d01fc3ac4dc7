"""A FANUC TP program as read: its motions, and where in the text the numbers of every position stand."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.integrations.fanuc.language import LIMITS
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.robot_text.program import (
    NamedPoint,
    RobotProgram,
    Span,
    Stated,
    StatedPosture,
    StatedTurns,
    angles_zyx,
    frame_zyx,
)

LETTERS: Final = "XYZWPR"
_CONFIG: Final = re.compile(r"\s*([NF])\s*([UD])\s*([TB])\b", re.IGNORECASE)
_CONFIG_TURNS: Final = re.compile(r"[NF]\s*[UD]\s*[TB]\s*,\s*(-?\d)\s*,\s*(-?\d)\s*,\s*(-?\d)", re.IGNORECASE)
_DISTANCE: Final = re.compile(r"C[DR]\s*([0-9]+(?:\.[0-9]*)?|\.[0-9]+)", re.IGNORECASE)


def frame_of(values: Mapping[str, float]) -> Float:
    """(4, 4) m of X Y Z (mm) and W P R (deg): W about x, P about y, R about z, all of them fixed axes, in this order.

    ``R = Rz(R) Ry(P) Rx(W)``, the angles of KUKA's A B C in the other order. Source: FANUC Robot series, Operator's
    manual (R-30iB), "Position data": W, P, R are the rotations about the X, Y and Z axis of the user frame.
    """
    return frame_zyx([values[c] for c in "XYZ"], values["W"], values["P"], values["R"])


wpr_of = angles_zyx
"""W, P, R in deg of an orientation (3, 3); the inverse of :func:`frame_of`."""


@dataclass(frozen=True, slots=True)
class FanucPosition:
    """An entry of ``/POS``."""

    number: int  # Of P[]
    start: int  # Index of its ``P``
    end: int  # Index behind its semicolon
    index: Span  # Where its number and comment stand: between the brackets
    numbers: Mapping[str, Span]  # By letter where the numbers stand; empty of one that is given by axes
    values: Mapping[str, float]  # By letter X Y Z in mm, W P R in deg
    user_frame: int | None  # Number of UF; None where it is ``F``, the active one
    user_tool: int | None  # The same of UT
    external: Mapping[int, float]  # By number of the axis E1 to E3: value in mm or deg
    others: str = ""  # Text of the values of further motion groups, without blanks
    # Of one that is given by axes: J1 to J9 in deg or mm, as the controller shows them
    axes: Mapping[str, float] = field(default_factory=dict)
    config: str = ""  # CONFIG as written, without its quotes


@dataclass(frozen=True, slots=True, kw_only=True)
class FanucMotion(NamedPoint):
    """Text behind a motion of :attr:`FanucProgram.motions`."""

    word: str  # ``J L C A``, or ``WAIT`` of a dwell
    end: int  # Index of its semicolon
    frames: tuple[int, int] = (-1, -1)  # Numbers of the active user frame and tool frame
    computed: str = ""  # Why its end is no literal of /POS: ``Offset``; empty where it is
    config: str = ""  # CONFIG of its end
    options: tuple[Span, ...] = ()  # Where the options that displace its end stand in the instruction
    position: FanucPosition | None = None  # Its end; None of a dwell, and of a computed one
    auxiliary: FanucPosition | None = None  # Point on a circle
    auxiliary_named: Span = (0, 0)  # Where that stands
    speed: Span = (0, 0)  # Where its speed stands, the unit included
    unit: str = "mm/sec"  # Unit to write a speed in
    unit_m_s: float = 0.0  # One of that unit, m/s, with the override; 0 of J
    speed_text: str = ""  # The speed as written, with its unit
    by_time: bool = False  # The speed is the time that it takes
    termination: str = ""  # As written: FINE, CNT100
    exact: bool = False  # It is FINE

    def turns(self) -> StatedTurns | None:
        """Turns that ``CONFIG`` states, of joint moves."""
        match = _CONFIG_TURNS.search(self.config) if self.word == "J" else None
        if match is None:
            return None
        turns = [int(number) for number in match.groups()]
        return StatedTurns.of(turns, 360.0, -180.0, f"CONFIG turns {', '.join(map(str, turns))}")


@dataclass(frozen=True, slots=True)
class FanucListing:
    """A listing of a job, as read."""

    text: str  # As read
    positions: Mapping[int, FanucPosition]  # Entries of ``/POS`` by number
    mentions: Mapping[int, int]  # How often the code names each of them
    main: int  # Index behind the line ``/MN``
    behind: int  # Index behind the last entry of ``/POS``, where further ones are put; without that part before /END
    has_positions: bool = True  # There is a part ``/POS``


@dataclass(frozen=True, slots=True)
class FanucProgram(RobotProgram):
    """A program in the listing form, with the listings that it calls."""

    listings: Mapping[str, FanucListing] = field(default_factory=dict)  # By name of the file, the main one first
    moves: tuple[FanucMotion, ...] = ()  # One for each of ``motions``

    def stops(self) -> frozenset[int]:
        """Motions with FINE."""
        return frozenset(index for index, move in enumerate(self.moves) if move.exact)

    def roundings_m(self) -> list[float]:
        """``CD`` and ``CR``, mm; what ``CNT`` makes depends on speed and acceleration and has no distance."""
        matches = [_DISTANCE.search(move.termination) for move in self.moves]
        return [
            0.0 if move.exact else float("nan") if match is None else float(match[1]) * MM
            for move, match in zip(self.moves, matches, strict=True)
        ]

    def postures(self) -> dict[int, Stated]:
        """CONFIG."""
        return {index: one for index, move in enumerate(self.moves) if (one := _posture(move.config)) is not None}

    def turns(self) -> dict[int, StatedTurns]:
        """The numbers behind CONFIG."""
        return {index: one for index, move in enumerate(self.moves) if (one := move.turns()) is not None}


def _posture(text: str) -> Stated | None:
    match = _CONFIG.match(text)
    if match is None:
        return None
    wrist, elbow, arm = match[1].upper(), match[2].upper(), match[3].upper()
    front = arm == "T"
    return StatedPosture(front, (elbow == "U") == front, wrist == "N"), f"CONFIG '{wrist} {elbow} {arm}'"


REMARK: Final = 32
"""Characters of a remark (FANUC Operator's manual, "Remark"): the mark of a job fits exactly."""


def remarks(messages: Iterable[str]) -> Iterator[str]:
    """Comments as remarks, each cut between words; without the semicolons that end statements."""
    for message in messages:
        yield from textwrap.wrap(message.replace(";", ","), REMARK) or [""]


def short(value: float) -> str:
    """A number with four decimals at most, without trailing zeros."""
    return number(value, 4).rstrip("0").rstrip(".")


def values_text(T_user_tool: Float) -> str:
    """X Y Z in mm and W P R in deg of a pose (4, 4) m, as they stand in an entry of /POS."""
    p = T_user_tool[:3, 3] / MM
    texts = [f"{c} = {number(float(v), LIMITS.position_decimals)} mm" for c, v in zip("XYZ", p, strict=True)]
    angles = np.array(wpr_of(T_user_tool[:3, :3]))
    turns = [f"{c} = {number(float(v), LIMITS.angle_decimals)} deg" for c, v in zip("WPR", angles, strict=True)]
    return f"\t{', '.join(texts)},\n\t{', '.join(turns)}"

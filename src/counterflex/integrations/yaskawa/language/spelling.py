"""Spelling of positions, speeds, comments and whole jobs."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.units import MM_PER_S
from counterflex.integrations.yaskawa.language import LIMITS
from counterflex.integrations.yaskawa.language.program import Header, values_of
from counterflex.programs.gcode.write.written_line import number

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

"""The text of a motion of INFORM: position, speed and options, each with its place."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM, RPM
from counterflex.geometry import rotation
from counterflex.geometry.circle import angle_to, circle
from counterflex.integrations.yaskawa.language.program import InformMotion, Point
from counterflex.integrations.yaskawa.language.source import InformJob, InformStatement
from counterflex.integrations.yaskawa.language.table import OPTION, TABLE
from counterflex.integrations.yaskawa.language.values import VARIABLE
from counterflex.programs.program import Motion
from counterflex.programs.robot_text.cell import SAME_RAD
from counterflex.programs.robot_text.process_words import NUMBER
from counterflex.programs.robot_text.program import Span
from counterflex.programs.statement_table import Treatment

_I: Final = re.IGNORECASE
MOTION: Final = re.compile(r"(MOV[JLC]|IMOV)(?![A-Za-z0-9])\s*", _I)
FRAME: Final = r"BF|RF|TF|UF#\(\d{1,3}\)"
_VALUE: Final = rf"(?:{NUMBER}|{VARIABLE})"
_TOKEN: Final = re.compile(
    rf"(?:(?P<target>C\d{{1,6}}|L?PX?(?:\d{{1,5}}|\s*\[[^\]]*\]))|(?P<other>(?:BC|EC|L?BP|L?EX)(?:\d{{1,6}}|\[[^\]]*\]))"
    rf"|V=(?P<speed>{_VALUE})|VJ=(?P<percent>{_VALUE})|PL=(?P<level>{_VALUE})|CR=(?P<radius>{NUMBER})"
    rf"|(?P<frame>{FRAME})|(?P<fpt>FPT)|(?P<carried>(?:ACC|DEC|COORD|SPDL)={_VALUE}|NWAIT"
    rf"|ENWAIT(?:\s+(?:T|DIS)={_VALUE})?))(?=\s|$)\s*",
    _I,
)
_REFUSED: Final = {
    row.word.removeprefix(OPTION).upper(): row.reason
    for row in TABLE.of(Treatment.REFUSED)
    if row.word.startswith(OPTION)
}


@dataclass(frozen=True, slots=True)
class Form:
    """A motion as written; places are those in the instruction."""

    word: str  # ``MOVJ MOVL MOVC IMOV``
    target: str = ""  # Name of its position; empty where it names none
    named: Span = (0, 0)  # Where that stands
    words: str = ""  # Names of positions of external axes, as written
    speed: str = ""  # Text of ``V=``; empty without one
    number: Span = (0, 0)  # Where that text stands
    level: int = -1  # Of ``PL=``; -1 where it is not said, or by a variable
    rounding_m: float = float("nan")  # Of ``CR=``; NaN without one
    frame: str = ""  # Of an increment: ``BF``, ``RF``, ``TF``, ``UF#(1)``
    fpt: bool = False  # The arc changes here
    tail: str = ""  # Options behind the speed

    @property
    def exact(self) -> bool:
        """The robot stops at its end."""
        return self.level == 0


def form_of(job: InformJob, statement: InformStatement, match: re.Match[str]) -> Form:
    """Divide a motion. Raises ProgramError: it is not understood, or has an option that is not read."""
    code, at = statement.code, match.end()
    parts: dict[str, re.Match[str]] = {}
    others: list[str] = []
    tail: list[str] = []
    while at < len(code):
        token = _TOKEN.match(code, at)
        if token is None or token.lastgroup is None:
            _refuse(job, statement, at)
        elif token.lastgroup == "other":
            others.append(token["other"])
        elif token.lastgroup == "carried":
            tail.append(token[0].strip())
        elif token.lastgroup in parts:
            raise job.fault(statement.start + at, "a part of a motion is there twice", "once")
        else:
            parts[token.lastgroup] = token
            if token.lastgroup in ("level", "radius"):
                tail.append(token[0].strip())
        at = code_end(token)
    texts = {key: token[key] for key, token in parts.items()}
    level = texts.get("level", "")
    if level.isdecimal() and int(level) > 8:
        raise job.fault(statement.start + parts["level"].start(), "there is no such position level", "PL=0 to PL=8")
    return Form(
        match[1].upper(), texts.get("target", ""), _span(parts.get("target"), "target", match.end()), " ".join(others),
        texts.get("speed", ""), _span(parts.get("speed"), "speed", match.end()),
        int(level) if level.isdecimal() else -1, float(texts.get("radius", "nan")) * MM,
        texts.get("frame", "").upper(), "fpt" in parts, " ".join(tail),
    )  # fmt: skip


def code_end(token: re.Match[str] | None) -> int:
    """Return the index behind a token; a missing one has been refused."""
    return 0 if token is None else token.end()


def _span(token: re.Match[str] | None, group: str, otherwise: int) -> Span:
    return (otherwise, otherwise) if token is None else token.span(group)


def _refuse(job: InformJob, statement: InformStatement, at: int) -> None:
    rest = statement.code[at:].upper()
    reason = next((why for word, why in _REFUSED.items() if rest.startswith(word)), "")
    raise job.fault(
        statement.start + at, f"an option of a motion that is not read{': ' if reason else ''}{reason}",
        "V, VJ, PL, CR, ACC, DEC, NWAIT, ENWAIT, FPT, COORD", "Post the path without it",
    )  # fmt: skip


Made = tuple[Motion, Float, InformMotion]
"""A motion, the orientation (3, 3) of the cell's TCP frame at its end, and what stands behind it in the text."""
_SAME_CIRCLE_M: Final = 5e-6
_SAME_M: Final = 1e-9
_SAME_TURN: Final = 1e-9
_WHOLE: Final = 2.0 * np.pi + 1e-6


@dataclass(frozen=True, slots=True)
class ArcPoint:
    """A point of a row of MOVC."""

    block: int  # Index of its block
    point: Point  # Its place in the text
    T: Float  # (4, 4) m, tool frame of the program in the part frame
    R: Float  # (3, 3) of the cell's TCP frame in the part
    feed_m_s: float  # Speed to it
    form: Form  # As written
    rpm: float  # Of the spindle, signed
    tool: int  # Number of the tool
    quiet: bool  # Nothing but comments stands between it and the point before
    where: str  # File, line and column

    @property
    def p(self) -> Float:
        """(3,) m."""
        out: Float = self.T[:3, 3]
        return out

    def arc(self, p_start: Float, p_centre: Float, normal: Float, turn: float) -> Motion:
        """Return the arc to it, about centre and normal of a circle."""
        return Motion(self.block, "arc", p_start, self.p, self.feed_m_s, self.rpm * RPM, self.tool,
                      p_centre=p_centre, normal=normal, turn_rad=turn)  # fmt: skip


def straight_to(node: ArcPoint, before: Motion | None) -> dict[int, Made]:
    """Return the straight motion to the first point of a row; a rapid where it is the first of the program."""
    p_start = node.p if before is None else np.asarray(before.p_end)
    rapid = before is None
    motion = Motion(node.block, "rapid" if rapid else "feed", p_start, node.p, 0.0 if rapid else node.feed_m_s,
                    node.rpm * RPM, node.tool)  # fmt: skip
    return {node.block: (motion, node.R, InformMotion("MOVC", node.point, node.form.exact, node.form.rounding_m))}


def stands_at(before: Motion, R: Float, node: ArcPoint) -> bool:
    """Return whether a motion ends at a point with the orientation ``R`` (3, 3) of that point."""
    near = float(np.abs(np.asarray(before.p_end) - node.p).max()) < _SAME_M
    return near and float(np.abs(R - node.R).max()) < _SAME_TURN


def arcs_of(row: Sequence[ArcPoint], start: Point | None) -> dict[int, Made]:
    """One circle through all points of a row: one motion, or one for each point where they differ in more than place.

    Args:
        row: Its points, the start first.
        start: The MOVC at its start, where it moves nothing.

    Returns:
        By block: motion, orientation (3, 3) at its end, and what stands behind it in the text.

    Raises:
        ProgramError: They are fewer than three, or lie on no single circle.
    """
    points = [node.p for node in row]
    if len(row) < 3:
        raise ProgramError("an arc has fewer than three points", where=row[0].where, value="MOVC",
                           limit="three MOVC in a row", hint="Write MOVL")  # fmt: skip
    closed = float(np.linalg.norm(points[0] - points[-1])) < _SAME_CIRCLE_M
    middle, last = (len(row) // 3, 2 * len(row) // 3) if closed else (len(row) // 2, len(row) - 1)
    parts = circle(points[0], points[middle], points[last])
    if parts is None:
        raise ProgramError("the points of an arc lie on a line", where=row[0].where, value="MOVC", hint="Write MOVL")
    centre, normal = parts
    radius = float(np.linalg.norm(points[0] - centre))
    off = max(max(abs(float(np.linalg.norm(p - centre)) - radius), abs(float((p - centre) @ normal))) for p in points)
    turns = [angle_to(a, b, centre, normal) for a, b in itertools.pairwise(points)]
    if off > _SAME_CIRCLE_M or sum(turns) > _WHOLE:
        raise ProgramError(
            "the points of an arc lie on no single circle: what is between them is the controller's own",
            where=row[0].where, value=f"{len(row)} MOVC", limit="one circle, or FPT where it changes",
            hint="Write FPT at the point at which the arc changes",
        )  # fmt: skip

    end = row[-1]
    if _is_one(row, turns):
        through = tuple(node.point for node in row[1:-1])
        move = InformMotion("MOVC", end.point, end.form.exact, end.form.rounding_m, through, start)
        return {end.block: (end.arc(points[0], *parts, sum(turns)), end.R, move)}
    return {
        node.block: (
            node.arc(before.p, *parts, turn),
            node.R,
            InformMotion("MOVC", node.point, node.form.exact, piece=True),
        )
        for before, node, turn in zip(row[:-1], row[1:], turns, strict=True)
    }


def _is_one(row: Sequence[ArcPoint], turns: Sequence[float]) -> bool:
    """Return whether speed, spindle and tool are the same all along, and the tool turns evenly."""
    first, end = row[0], row[-1]
    same = all(
        (node.quiet or index == 0) and (node.feed_m_s, node.rpm, node.tool) == (end.feed_m_s, end.rpm, end.tool)
        for index, node in enumerate(row[1:])
    )
    total = rotation.log(first.R.T @ end.R)
    shares = np.cumsum(turns) / sum(turns)
    return same and all(
        float(np.linalg.norm(rotation.log(node.R.T @ first.R @ rotation.exp(share * total)))) < SAME_RAD
        for node, share in zip(row[1:-1], shares, strict=False)
    )

"""Arcs of INFORM: rows of MOVC, FPT between them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import RPM
from counterflex.geometry import rotation
from counterflex.geometry.circle import angle_to, circle
from counterflex.integrations.yaskawa.language.form import Form
from counterflex.integrations.yaskawa.language.program import InformMotion, Point
from counterflex.programs.program import Motion
from counterflex.programs.robot_text.cell import SAME_RAD

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

"""Steps as INFORM jobs."""

from __future__ import annotations

import itertools
import math
from typing import ClassVar, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import UM
from counterflex.geometry import pose
from counterflex.geometry.circle import angle_to, circle, turned
from counterflex.integrations.yaskawa.language.spelling import speed_text
from counterflex.integrations.yaskawa.language.writer import (
    InformSettings,
    InformWords,
    inform_motion,
    written_pose,
)
from counterflex.programs.convert.emitter import turn_deg
from counterflex.programs.convert.robot_languages import RobotEmitter
from counterflex.programs.convert.steps import Move
from counterflex.programs.program import Program
from counterflex.programs.robot_writer.machine_functions import MachineFunctions

_FLAT_M: Final = 1e-7
_HALF_DEG: Final = 180.0
_MOST_PIECES: Final = 12
_WITHIN_M: Final = 0.9 * UM
"""Largest distance of a written arc from the programmed one: positions are rounded to 1 um."""


class InformEmitter(InformWords, RobotEmitter[InformSettings]):
    """INFORM: MOVJ, MOVL, MOVC."""

    dwell_decimals: ClassVar[int] = 2

    def __init__(
        self, program: Program, settings: InformSettings, functions: MachineFunctions, tolerance_m: float
    ) -> None:
        super().__init__(program, settings, functions, tolerance_m)
        self._in_arc = False

    def _count(self) -> None:
        """A job begins with no arc to go on with."""
        cuts = len(self._cuts)
        super()._count()
        self._in_arc = self._in_arc and len(self._cuts) == cuts

    def point(self, T_part_tcp: Float, speed_m_s: float, *, free: bool) -> None:
        """MOVJ or MOVL."""
        word, speed = (
            ("MOVJ", f"VJ={self.settings.axis_percent:.2f}") if free else ("MOVL", f"V={speed_text(speed_m_s)}")
        )
        self._append(word, T_part_tcp, speed)
        self._in_arc = False

    def _append(self, word: str, T_part_tcp: Float, speed: str, option: str = "") -> None:
        level = " PL=0" if self.exact or self.first else ""
        self.lines.append(inform_motion(self.settings, self.tool, word, T_part_tcp, f"{speed}{level}{option}"))

    def arc_shares(self, move: Move) -> list[float] | None:
        """Pieces through whose rounded points the circle stays; a helix becomes straight moves."""
        if abs(move.rise_m) > _FLAT_M:
            return None
        least = max(1, math.ceil(turn_deg(move) / _HALF_DEG - 1e-6))
        for count in range(least, least + _MOST_PIECES):
            ends = [k / count for k in range(count + 1)]
            if all(self._keeps(move, a, b) for a, b in itertools.pairwise(ends)):
                return ends[1:]
        return None

    def _keeps(self, move: Move, a: float, b: float) -> bool:
        """Return whether the circle through the rounded points of a piece has its middle where it was."""
        points = [written_pose(pose.make(p=move.at(share)))[:3, 3] for share in (a, 0.5 * (a + b), b)]
        parts = circle(*points)
        if parts is None:
            return False
        angle = angle_to(points[0], points[2], *parts)
        middle = turned(points[0], *parts, 0.5 * angle)
        return float(np.linalg.norm(middle - move.at(0.5 * (a + b)))) < _WITHIN_M

    def circle(self, move: Move, start_share: float, end_share: float) -> None:
        """MOVC: at its start, unless an arc ends there, in the middle, and at its end."""
        speed = f"V={speed_text(self._speed(move))}"
        exact, self.exact = self.exact, False
        middle, end = self.through(move, start_share, end_share)
        if not self._in_arc:
            R = move.R_part_start if start_share == 0.0 else self.orientation(move, start_share)
            self._append("MOVC", pose.make(R, move.at(start_share)), speed)
        self._append("MOVC", middle, speed)
        self.exact = exact
        self._append("MOVC", end, speed, " FPT")
        self._in_arc = True

"""Robots without physics, for a controller that is to be tried alone: they go exactly where they are told."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.geometry import rotation
from counterflex.twin.devices.commanded_motion import CommandedMotion, Report
from counterflex.twin.devices.path_answer import AnswerState, PathAnswer


class ControlledRobot(Protocol):
    """Robot and program as a controller's protocol server needs them."""

    period_s: float  # cycle of the controller

    @property
    def finished(self) -> bool:
        """Return whether the program has come to its end."""

    @property
    def cycles(self) -> int:
        """Cycles that the program takes at full speed."""

    def start(self) -> None:
        """Let the program run."""

    def advance(
        self, cartesian: Float, axes: Float | None = None, override: float = 1.0, T_part_guided: Float | None = None
    ) -> Report:
        """Run one cycle.

        Args:
            cartesian: (6,) correction of the pose, m and rotation vector in part axes.
            axes: (6,) rad, correction of the axes.
            override: Speed of the program, 0 .. 1.
            T_part_guided: (4, 4) where the tool is to be instead of where the program has it; corrections are then
                left out. None follows the program.
        """


class ExactRobot:
    """A rigid robot whose drives follow without lag, running a program.

    Args:
        motion: Program and controller.
    """

    def __init__(self, motion: CommandedMotion) -> None:
        self._motion = motion
        self.period_s = motion.controller.cycle_s
        self._cycle = 0

    @property
    def finished(self) -> bool:
        """Return whether the program has come to its end."""
        return self._motion.finished

    @property
    def cycles(self) -> int:
        """Cycles that the program takes at full speed."""
        return self._motion.cycles

    def start(self) -> None:
        """Let the program run."""
        self._motion.running = True

    def advance(
        self, cartesian: Float, axes: Float | None = None, override: float = 1.0, T_part_guided: Float | None = None
    ) -> Report:
        """See :class:`ControlledRobot`. Raises ReachError: the pose cannot be reached."""
        q_nominal, T_part_nominal, q = self._motion.advance(cartesian, axes, override, T_part_guided)
        self._cycle += 1
        return Report(
            time_s=self._cycle * self.period_s,
            T_part_nominal=T_part_nominal,
            T_part_actual=self._motion.forward(q),
            q_command=q_nominal,
            q_actual=q,
            cutting_program=self._motion.running and not self.finished,
            finished=self.finished,
        )


@dataclass(frozen=True, eq=False)
class Standstill:
    """A program that only waits."""

    T_part_tcp: Float  # (4, 4) m, where the tool is
    q: Float  # (6,) rad, the angles that belong to it
    duration_s: float  # how long it waits

    def __post_init__(self) -> None:
        """Check shapes and ranges."""
        as_float("T_part_tcp", self.T_part_tcp, (4, 4))
        as_float("q", self.q, (6,))
        as_positive("duration_s", self.duration_s)


class StandingRobot:
    """A robot that stands still, but for what it is corrected by. It needs no geometry.

    Corrections of the pose move the pose, those of the axes the axes; without geometry neither shows in the other.

    Args:
        standstill: Where and how long.
        answer: How its path planning answers a correction.
    """

    def __init__(self, standstill: Standstill, period_s: float, answer: PathAnswer | None = None) -> None:
        self.period_s = as_positive("period_s", period_s)
        answer = answer if answer is not None else PathAnswer()
        self._place = standstill
        self._cartesian, self._axes = AnswerState(answer, period_s), AnswerState(answer, period_s)
        self._at, self._running, self._cycle = 0.0, False, 0

    @property
    def finished(self) -> bool:
        """Return whether it has waited long enough."""
        return self._at >= self.cycles

    @property
    def cycles(self) -> int:
        """Cycles that it waits."""
        return max(2, round(self._place.duration_s / self.period_s))

    def start(self) -> None:
        """Begin to wait."""
        self._running = True

    def advance(
        self, cartesian: Float, axes: Float | None = None, override: float = 1.0, T_part_guided: Float | None = None
    ) -> Report:
        """See :class:`ControlledRobot`."""
        self._at += override if self._running else 0.0
        self._cycle += 1
        offset = self._cartesian(cartesian)
        T = (self._place.T_part_tcp if T_part_guided is None else T_part_guided).copy()
        T[:3, 3] += offset[:3]
        T[:3, :3] = rotation.exp(offset[3:]) @ T[:3, :3]
        return Report(
            time_s=self._cycle * self.period_s,
            T_part_nominal=self._place.T_part_tcp,
            T_part_actual=T,
            q_command=self._place.q,
            q_actual=self._place.q + self._axes(np.zeros(6) if axes is None else axes),
            cutting_program=self._running and not self.finished,
            finished=self.finished,
        )

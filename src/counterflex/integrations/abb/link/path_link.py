"""EGM path correction: moves a running RAPID path sideways, y and z of the path frame, every 24 ms or a multiple."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import UM
from counterflex.integrations.abb.link.link import EgmLink, put_pose
from counterflex.integrations.abb.link.telegram import PATH_PERIOD_S, write_path_correction
from counterflex.runtime.state.supervisor import State

_SHORTEST: Final = 2.0 * UM
"""Motion from which a direction is taken."""


class EgmPathLink(EgmLink):
    """Answers with ``EgmSensorPathCorr``.

    The path frame is the controller's: x the tangent of the path, ``y = x cross z_tool``, ``z = x cross y``. The
    component of a correction along the path and its rotation cannot be sent. The tangent is taken from the planned
    poses of the last 24 ms; while the robot stands the last one stays, before the first one nothing is corrected.

    EGM has no word for stop or feed hold here: told to stop, the link says nothing more, and the controller stops by
    its CommTimeout. So it does where a movement is run that is to be corrected and the loop is not armed.

    Args:
        watch_only: The loop will not be armed: nothing is to be corrected.
        settings: As attributes and errors, see :class:`counterflex.integrations.abb.link.link.EgmLink`.
    """

    def __init__(self, *, watch_only: bool = True, **settings: object) -> None:
        super().__init__(**settings)  # type: ignore[arg-type]
        self._watch_only = watch_only
        self.holds_feed = False
        span = max(1, round(PATH_PERIOD_S / self.period_s))
        self._trail: Float = np.zeros((span, 3))
        self._at = -1
        self._R_part_path: Float | None = None

    def fill(self, nominal: Float, q: Float) -> None:
        """Write planned pose (measured, where the controller sends none) and axis angles as commanded."""
        T = self._T_part_actual if self._T_part_planned is None else self._T_part_planned
        put_pose(nominal, T)
        q[:] = self._q
        self._follow(T)

    def _follow(self, T_part_tcp: Float) -> None:
        p = T_part_tcp[:3, 3]
        if self._at < 0 or self.restarted:
            self._trail[:] = p
            self._at = 0
            return
        R = path_frame(p - self._trail[self._at], T_part_tcp[:3, 2])
        if R is not None:
            self._R_part_path = R
        self._trail[self._at] = p
        self._at = (self._at + 1) % len(self._trail)

    def answer(
        self,
        correction: Float,
        axes: Float | None = None,
        *,
        stop: bool = False,
        feed_hold: bool = False,  # noqa: ARG002
        override: float = 1.0,  # noqa: ARG002
        state: State = State.IDLE,
    ) -> bool:
        """Send what of a correction lies square to the path; see :class:`counterflex.protocols.robot.link.RobotLink`.

        Returns:
            Whether an answer was sent: not, where the controller is to stop, a number is not finite, nobody asked, or
            a movement is run that is to be corrected and the loop is not armed.
        """
        if stop or axes is not None or not all(map(math.isfinite, correction)):
            return False
        if self.guided and not self._watch_only and state < State.ARMED:
            return False
        y = z = 0.0
        if self._R_part_path is not None:
            c = self._R_part_path.T @ correction[:3]
            y, z = float(c[1]), float(c[2])
        sequence, clock_ms = self._numbered()
        return self._port.send(write_path_correction(sequence, y, z, 0.0, clock_ms))


def path_frame(step: Float, z_tool: Float) -> Float | None:
    """Axes of the path frame: x along the motion, ``y = x cross z_tool``, ``z = x cross y``.

    Args:
        step: (3,) m, motion of the tool.
        z_tool: (3,) unit vector, z of the tool frame, out of the spindle.

    Returns:
        (3, 3) columns x, y, z in the axes of the arguments; None where the motion is shorter than 2 um or runs along
        the tool, so that there is no such frame.

    Source: ABB 3HAC073318, path correction.
    """
    length = math.sqrt(float(step @ step))
    if not length > _SHORTEST:
        return None
    x = step / length
    y = np.cross(x, z_tool)
    size = math.sqrt(float(y @ y))
    if size < 1e-3:
        return None
    y /= size
    return np.column_stack([x, y, np.cross(x, y)])

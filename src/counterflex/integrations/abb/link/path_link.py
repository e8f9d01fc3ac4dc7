"""EGM path correction: moves a running RAPID path sideways, y and z of the path frame, every 24 ms or a multiple."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, UM
from counterflex.integrations.abb.link.link import EgmLink, put_pose
from counterflex.integrations.abb.link.telegram import PATH_PERIOD_S, RobotState, write_path_correction
from counterflex.runtime.state.supervisor import State

_SHORTEST: Final = 2.0 * UM  # Motion from which a direction is taken
_TURNED: Final = 3.0 * DEG
"""Turn of the path frame from one message to the next that needs a reason: it turns a correction by 0.05 of its size,
for the largest one, 2 mm, a fifth of what the limiter admits in 24 ms. An arc of 15 mm at 25 mm/s turns by 2.3 deg."""
_ZONE_M: Final = 2.0 * MM  # Way along the plan by which a corner is rounded, and the place is off


class EgmPathLink(EgmLink):
    """Answers with ``EgmSensorPathCorr``.

    The path frame is the controller's: x the tangent of the path, ``y = x cross z_tool``, ``z = x cross y``. The
    component of a correction along the path and its rotation cannot be sent. The tangent is taken from the planned
    poses of the last 24 ms; while the robot stands the last one stays, before the first one nothing is corrected.

    One pose that is wrong would turn the frame, and a correction with it, by up to 180 deg, there and back. So a frame
    more than 3 deg from the last one is taken where the plan turns there, or when the next message shows it too, or
    turns on as far again; until then the last one stays. Of a controller that plans its poses, a message of a movement
    without one is malformed: the measured pose trails.

    EGM has no word for stop or feed hold here: told to stop, the link says nothing more, and the controller stops by
    its CommTimeout. So it does where a movement is run that is to be corrected and the loop is not armed.

    Args:
        watch_only: The loop will not be armed: nothing is to be corrected.
        settings: As attributes and errors, see :class:`counterflex.integrations.abb.link.link.EgmLink`.

    Attributes:
        feeds: Feed directions of the plan, (n, 3), up to so many m from the last known place; None: there is no plan.
    """

    feeds: Callable[[float], Float] | None = None

    def __init__(self, *, watch_only: bool = True, **settings: object) -> None:
        super().__init__(**settings)  # type: ignore[arg-type]
        self._watch_only = watch_only
        self.holds_feed = False
        span = max(1, round(PATH_PERIOD_S / self.period_s))
        self._trail: Float = np.zeros((span, 3))
        self._at = -1
        self._R_part_path: Float | None = None
        self._taken: Float | None = None  # (2, 3) tangent and tool axis of that frame
        self._shown: list[Float] = []  # Likewise of the last two messages that show a motion, whether taken or not
        self._plans = False  # The controller has sent a planned pose
        self._way_m = 0.0  # In a message, of the newest motion that was taken

    def _lacks(self, state: RobotState) -> bool:
        """See :meth:`EgmLink._lacks`."""
        unplanned = self._plans and state.guided and state.T_frame_tcp_planned is None
        return super()._lacks(state) or unplanned

    def fill(self, nominal: Float, q: Float) -> None:
        """Write planned pose (measured, where the controller sends none) and axis angles as commanded."""
        self._plans = self._plans or self._T_part_planned is not None
        T = self._T_part_actual if self._T_part_planned is None else self._T_part_planned
        put_pose(nominal, T)
        q[:] = self._q
        self._follow(T)

    def _follow(self, T_part_tcp: Float) -> None:
        p, z_tool = T_part_tcp[:3, 3], T_part_tcp[:3, 2]
        if self._at < 0 or self.restarted:
            self._trail[:] = p
            self._at, self._shown = 0, []
            return
        step = p - self._trail[self._at]
        self._trail[self._at] = p
        self._at = (self._at + 1) % len(self._trail)
        R = path_frame(step, z_tool)
        if R is None:
            return
        course = np.stack([R[:, 0], z_tool])
        if self._believed(course):
            self._R_part_path, self._taken = R, course
            self._way_m = float(np.linalg.norm(step)) / max(1, self.elapsed)
        self._shown = [*self._shown[-1:], course]

    def _believed(self, course: Float) -> bool:
        """Return whether tangent and tool axis follow those before, or the tangent those of the plan about here."""
        taken = self._taken
        if taken is None:
            return True
        expected = [taken, *self._shown[-1:]]
        if len(self._shown) > 1:  # on an arc each message turns as far as the one before: there and back does not
            before, last = self._shown
            expected.append(2.0 * np.sum(before * last, axis=1, keepdims=True) * last - before)
        if any(np.max(_angles(one, course)) <= _TURNED for one in expected):
            return True
        if self.feeds is None or _angles(taken[1], course[1]) > _TURNED:
            return False
        feeds = self.feeds(_ZONE_M + 2.0 * self.elapsed * self._way_m)
        off = _angles(feeds, course[0])
        turn = _angles(feeds[:-1], feeds[1:])  # a corner that is rounded shows what lies between its two directions
        return bool(np.any(off <= _TURNED) or np.any(off[:-1] + off[1:] <= turn + _TURNED))

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
            Whether an answer was sent: not, where the controller is to stop, a number is not finite, nobody asked,
            a movement is run that is to be corrected and the loop is not armed, or a correction is held before a
            path frame is known.
        """
        if stop or axes is not None or not all(map(math.isfinite, correction)):
            return False
        if self.guided and not self._watch_only and state < State.ARMED:
            return False
        R = self._R_part_path
        if R is None and state > State.ACTIVE and correction[:3].any():  # taken over from a killed loop: zero is a step
            return False
        y, z = (0.0, 0.0) if R is None else (R.T @ correction[:3])[1:].tolist()
        sequence, clock_ms = self._numbered()
        return self._port.send(write_path_correction(sequence, y, z, 0.0, clock_ms))


def _angles(a: Float, b: Float) -> Float:
    """(...) rad between unit vectors (..., 3)."""
    out: Float = np.arccos(np.clip(np.sum(a * b, axis=-1), -1.0, 1.0))
    return out


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

"""Robot as the online session needs it, whatever it speaks."""

from __future__ import annotations

from typing import Protocol

from counterflex.core.arrays import Float
from counterflex.protocols.robot.port import Counters
from counterflex.runtime.state.supervisor import State


class RobotLink(Protocol):
    """One session with a controller, from the sensor program's side.

    A link may have ``repeat(*, stop, feed_hold, override, state, silent)`` too, where its protocol has telegrams that
    can be answered although they cannot be read: told after each answer what to say to them beside the correction. One
    that sends a correction in axes that turn with the path has ``feeds``, see
    :class:`counterflex.integrations.abb.link.path_link.EgmPathLink`.
    """

    counters: Counters
    """What came, since the link was opened."""
    elapsed: int
    """Cycles from the telegram before to the newest one, by its counter; 0 when none came."""
    restarted: bool
    """The newest telegram belongs to another session than the one before."""
    enable: bool
    """The robot program wants the correction."""
    clamped: bool
    """The controller limits the correction."""
    holds_feed: bool
    """Whether the link has a word for a feed hold."""
    job: int
    """Number of the job that the robot program says it is of; 0: it says none."""

    commanded_is: int
    """How the commanded pose belongs to the axis angles, see :class:`.axis_check.AxisCheck`."""
    measured_is: int
    """Likewise the pose of :meth:`fill_actual`, or ABSENT: it is not held against them."""

    @property
    def address(self) -> tuple[str, int]:
        """Address at which telegrams are expected."""

    @property
    def counter(self) -> int:
        """Time of the newest telegram by the controller's clock, ms."""

    @property
    def empty(self) -> bool:
        """The newest telegram says nothing of the robot: answer it, do not use it."""

    def wait(self, timeout_s: float) -> bool:
        """Wait for a telegram, then take all that are there and keep the newest good one.

        Returns:
            Whether there is a telegram to be answered. :attr:`elapsed` says how many cycles passed.
        """

    def fill(self, nominal: Float, q: Float, /) -> None:
        """Write commanded pose without correction, (12,) rotation by rows and position, and axis angles, (6,) rad."""

    def fill_actual(self, out: Float, /) -> bool:
        """Write the pose that the motors stand at, (12,); False where it is not sent."""

    def fill_reported(self, out: Float, /) -> bool:
        """Write the pose that the controller reports, correction included, (12,); False where it reports none."""

    def fill_currents(self, current: Float, /) -> bool:
        """Write the motor currents (6,), in the controller's unit; False where it sends none."""

    def answer(
        self,
        correction: Float,
        axes: Float | None = None,
        *,
        stop: bool = False,
        feed_hold: bool = False,
        override: float = 1.0,
        state: State = State.IDLE,
    ) -> bool:
        """Answer the newest telegram.

        Args:
            correction: (6,) m and rotation vector, part axes; ignored where ``axes`` are given.
            axes: (6,) rad, axis corrections instead.
            stop: Tell the controller to stop.
            feed_hold: Ask for the feed to be held.
            override: Speed of the program, 0..1.
            state: What the loop is doing.

        Returns:
            Whether an answer was sent.
        """

    def forget(self) -> None:
        """Take another session of the controller, see :meth:`counterflex.protocols.robot.port.RobotPort.forget`."""

    def close(self) -> None:
        """Free the port."""

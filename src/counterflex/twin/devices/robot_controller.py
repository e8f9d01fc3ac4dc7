"""Simulated controller as a protocol server needs it, whatever it speaks."""

from __future__ import annotations

from typing import Protocol

from counterflex.core.arrays import Float
from counterflex.twin.devices.commanded_motion import Report


class RobotController(Protocol):
    """One session of a controller, cycle by cycle, without a socket."""

    counter: int
    """Of the telegram to be answered."""
    late: int
    """Late or unusable answers so far."""
    stopped: str
    """Why the motion was stopped, or empty."""
    refused: str
    """Why the last answer was refused, or empty."""
    correction: Float
    """(6,) correction in force as the protocol has it, m and rad."""
    axes: Float
    """(6,) correction of the axes in force, rad."""
    stat: int
    """0, 1 correcting, 2 limited."""
    override: float
    """Speed of the program that the answer asks for, 0..1."""
    feed_hold: bool
    """The answer asks for a feed hold."""
    enabled: bool
    """The program is where corrections are wanted."""

    @property
    def cycle_s(self) -> float:
        """Time between telegrams."""

    @property
    def guides(self) -> bool:
        """Poses from outside guide the robot, no program."""

    @property
    def only_sends(self) -> bool:
        """Nothing is expected back."""

    def telegram(self, report: Report) -> bytes:
        """The telegram of the next cycle."""

    def answers(self, data: bytes) -> bool:
        """Return whether a datagram is the answer to the newest telegram, as far as the protocol lets it be seen."""

    def answer(self, data: bytes | None) -> None:
        """Take the answer of the cycle (the last datagram), or None."""

    def pose_correction(self) -> Float:
        """(6,) Cartesian correction in force: m and rotation vector, part axes."""

    def guided_pose(self) -> Float | None:
        """(4, 4) where the tool is to be in the part frame, in place of a program; None with a program."""


class PlayedController(RobotController, Protocol):
    """One that can be played for hours: it hears what the loop says of itself, and begins anew when it was stopped."""

    reported_state: int
    """What the sensor program says it is doing; negative where it does not."""

    def again(self, ahead_ms: int) -> PlayedController:
        """Another session of the same program, its counter so far ahead of this one's."""

"""Command a correction ahead of time, so that the robot's response undoes a deflection in time."""

from __future__ import annotations

from dataclasses import dataclass

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.signals.preview import Mode, Shaping, command_for


@dataclass(frozen=True)
class Ahead:
    """Path of a force and of a correction against it to the tool.

    Raises:
        InputError: No mode, or a share out of range.
    """

    # of the deflection that the arm makes, 0 .. 1: it swings through the first mode, the rest follows at once
    arm_share: float
    modes: tuple[Mode, ...]  # what a correction passes, the arm's first
    shaping: Shaping  # smoothing and dead time

    def __post_init__(self) -> None:
        """Check ranges."""
        if not self.modes:
            raise InputError("a correction passes the arm's mode at least")
        if not 0.0 <= self.arm_share <= 1.0:
            raise InputError("share of the arm in the deflection", value=self.arm_share, limit="0 .. 1")

    def command(self, requested: Float, time_s: Float, moved: Float | float = 0.0) -> Float:
        """Command of the next cycle, see :func:`counterflex.signals.preview.command_for`.

        Args:
            requested: (n, k) deflection, or force, that would be there if nothing swung.
            time_s: (n,) s, not decreasing.
            moved: (n, k) likewise, but as it is there in time: nothing of it swings any further.

        Returns:
            (n, k) likewise.
        """
        at_once = (1.0 - self.arm_share) * requested + moved
        return command_for(at_once, time_s, self.modes, self.shaping, self.arm_share * requested)

"""PID per axis of axis-specific output: arrays and parameters of :mod:`.axis_pid_kernel`."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.records import Records, as_words, records
from counterflex.runtime.axis_gains import AxisGains, six
from counterflex.runtime.step import axis_pid_kernel as kernels


class AxisPid:
    """Constants and memory of the controllers of the axes.

    Args:
        gains: Of the six axes.
        period_s: Cycle.
        dead_s: From sending a correction until the robot begins to move.
        expected: Compare with what the robot should have made of the wanted angles by now, not with these themselves:
            where the plan is read ahead of time.

    Attributes:
        pids: (1,) PID of the kernel.
        memory: (1,) PID_STATE of the kernel.

    Raises:
        InputError: Not six axes, or a dead time that is longer than is remembered.
    """

    def __init__(self, gains: tuple[AxisGains, ...], period_s: float, dead_s: float, *, expected: bool) -> None:
        dead = round(dead_s / period_s)
        if dead >= kernels.ASKED_MOST:
            limit = f"< {kernels.ASKED_MOST} cycles"
            raise InputError("PID per axis: the dead time is longer than is remembered", value=dead, limit=limit)
        self.pids = records(kernels.PID)
        packed = np.array([one.packed(period_s) for one in six(gains)]).T
        for name, values in zip(("proportional", "integral", "rate", "decay", "most"), packed, strict=True):
            self.pids[name] = values
        self.pids["dead"], self.pids["expected"] = dead, int(expected)
        self.memory = records(kernels.PID_STATE)

    def reset(self) -> None:
        """Begin anew."""
        as_words(self.memory)[:] = 0

    @property
    def added(self) -> Float:
        """(6,) rad, view: what the controllers add now."""
        out: Float = self.memory["added"][0]
        return out

    def arrays(self) -> tuple[Records, Records]:
        """Constants and memory, as the kernel of a cycle takes them."""
        return self.pids, self.memory

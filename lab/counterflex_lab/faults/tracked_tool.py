"""A simulated tracker on a real socket, and what it sees: the tool where the robot and the force have moved it."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import NS, UM
from counterflex.protocols.tracker.link import TrackerLink
from counterflex.robot.elasticity.compliance import cartesian_compliance
from counterflex.twin.devices.datagram_sender import TrackerSender
from counterflex_lab.faults.demonstration import Q, demo_cell

_NOISE_M: Final = 5.0 * UM
_BEFORE_S: Final = 100.0
"""The tracker's clock was started so long before the rig's."""


@functools.cache
def tip_compliance() -> Float:
    """(3, 3) m/N: how far a force on the tool moves it, part axes, in the pose in which faults are injected."""
    cell = demo_cell()
    R = cell.T_base_part[:3, :3]
    C: Float = R.T @ cartesian_compliance(cell.chain, Q)[:3, :3] @ R
    return C


class SimulatedTracker:
    """A tracker whose frame is the part's and whose target is the tool.

    Args:
        seed: Of its noise.

    Attributes:
        link: The loop's end.
        silent: It sends nothing.
        frozen: It sends the last pose again and again, with new numbers and times.
        stuck: The same with its noise.
        status: Status bits of what it sends.
        change: What becomes of the pose before it is sent, or None.
        stamp: What becomes of the time stamp in ns, or None.
    """

    def __init__(self, seed: int) -> None:
        self.link = TrackerLink()
        self._sender = TrackerSender(self.link.address)
        self._rng = np.random.default_rng([seed, 3])
        self._last: Float = np.eye(4)
        self._measured: tuple[Float, float] = (np.eye(4), -1.0)
        self.silent = self.frozen = self.stuck = False
        self._stuck_at: Float = np.eye(4)
        self.status = 0
        self.change: Callable[[Float], Float] | None = None
        self.stamp: Callable[[int], int] | None = None

    def arguments(self) -> dict[str, Any]:
        """For :class:`counterflex.protocols.session.session.OnlineSession`."""
        return {"tracker": self.link, "T_part_tracker": np.eye(4), "T_target_tcp": np.eye(4)}

    def measure(self, T_part_robot: Float, force_n: Float, time_s: float) -> None:
        """Measure the tool and send what was measured a cycle ago: so old is a sample when the loop takes it.

        Args:
            T_part_robot: (4, 4) m, the tool where the robot has its motors.
            force_n: (3,) N on the tool, part axes: it moves the tool by the compliance of the tip.
            time_s: Since the start.
        """
        now = T_part_robot.copy()
        now[:3, 3] += tip_compliance() @ force_n + _NOISE_M * self._rng.standard_normal(3)
        (T, time_s), self._measured = self._measured, (now, time_s)
        if self.frozen:
            T = self._last
        elif self.stuck:
            T = self._stuck_at.copy()
            T[:3, 3] += _NOISE_M * self._rng.standard_normal(3)
        else:
            self._stuck_at = T
        self._last = T
        if self.silent or time_s < 0.0:
            return
        if self.change is not None:
            T = self.change(T)
        stamp = round((time_s + _BEFORE_S) / NS)
        self._sender.send(
            T, time_s, time_ns=stamp if self.stamp is None else self.stamp(stamp), status=self.status, sigma_m=_NOISE_M
        )

    def close(self) -> None:
        """Free the sockets."""
        self._sender.close()
        self.link.close()

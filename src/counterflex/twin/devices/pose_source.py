"""Poses that a simulated tracker sees over time, where no simulated cell moves its target."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.geometry import pose, rotation

PoseSource = Callable[[float], Float]
"""(4, 4) m, pose of the target in the tracker's frame at a time in s since the start."""


@dataclass(frozen=True, eq=False)
class StandingTarget:
    """A target that does not move."""

    T_tracker_target: Float  # (4, 4) m

    def __call__(self, time_s: float) -> Float:  # noqa: ARG002
        """The pose."""
        return self.T_tracker_target


@dataclass(frozen=True, eq=False)
class CircleTarget:
    """A target on a circle in its own xy plane, counter-clockwise, at constant speed; it starts at the right."""

    T_tracker_centre: Float  # (4, 4) m, the circle's middle; x and y span its plane
    radius_m: float  # of the circle
    speed_m_s: float  # along it

    def __post_init__(self) -> None:
        """Check ranges."""
        as_float("T_tracker_centre", self.T_tracker_centre, (4, 4))
        as_positive("radius_m", self.radius_m)
        as_positive("speed_m_s", self.speed_m_s)

    def __call__(self, time_s: float) -> Float:
        """The pose at a time."""
        angle = self.speed_m_s / self.radius_m * time_s
        out: Float = self.T_tracker_centre @ pose.make(
            p=self.radius_m * np.array([math.cos(angle), math.sin(angle), 0.0])
        )
        return out


@dataclass(frozen=True, eq=False)
class SquareTarget:
    """A target around a square in its xy plane, counter-clockwise, at constant speed, from the lower left corner."""

    T_tracker_centre: Float  # (4, 4) m, the square's middle; its sides are along x and y
    side_m: float  # length of a side
    speed_m_s: float  # along it

    def __post_init__(self) -> None:
        """Check ranges."""
        as_float("T_tracker_centre", self.T_tracker_centre, (4, 4))
        as_positive("side_m", self.side_m)
        as_positive("speed_m_s", self.speed_m_s)

    def __call__(self, time_s: float) -> Float:
        """The pose at a time."""
        side, along = divmod(self.speed_m_s * time_s / self.side_m, 1.0)
        x, y = ((along, 0.0), (1.0, along), (1.0 - along, 1.0), (0.0, 1.0 - along))[int(side) % 4]
        out: Float = self.T_tracker_centre @ pose.make(p=self.side_m * np.array([x - 0.5, y - 0.5, 0.0]))
        return out


class NoisyPose:
    """A pose as a tracker measures it: white noise of position and orientation.

    Args:
        noise_m: Standard deviation of the position, per axis.
        noise_rad: Standard deviation of the orientation, per axis, as a rotation vector in tracker axes.
    """

    def __init__(self, source: PoseSource, noise_m: float, noise_rad: float, seed: int = 0) -> None:
        self._source = source
        self.noise_m = as_positive("noise_m", noise_m, zero=True)
        self._noise_rad = as_positive("noise_rad", noise_rad, zero=True)
        self._noise = np.random.default_rng(random.Random(f"counterflex-lone-tracker:{seed}").getrandbits(64))

    def __call__(self, time_s: float) -> Float:
        """The measurement at a time."""
        T = self._source(time_s).copy()
        T[:3, 3] += self.noise_m * self._noise.standard_normal(3)
        T[:3, :3] = rotation.exp(self._noise_rad * self._noise.standard_normal(3)) @ T[:3, :3]
        return T


@dataclass(frozen=True, eq=False)
class TrackerLog:
    """Measurements of a tracker."""

    time_ns: tuple[int, ...]  # (n,) of its own clock, increasing
    Ts_tracker_target: Float  # (n, 4, 4) m
    status: tuple[int, ...]  # (n,) status bits of the datagram
    sigma_m: tuple[float, ...]  # (n,) standard deviation of the position, 0 where not known

    def __post_init__(self) -> None:
        """Check that there is something, and that time goes on.

        Raises:
            InputError: It is empty, of unequal lengths, or its times do not increase.
        """
        n = len(self.time_ns)
        as_float("Ts_tracker_target", self.Ts_tracker_target, (n, 4, 4))
        if n == 0 or len(self.status) != n or len(self.sigma_m) != n:
            raise InputError("a tracker's log without rows, or of unequal lengths", value=n)
        back = next((k for k in range(1, n) if self.time_ns[k] <= self.time_ns[k - 1]), None)
        if back is not None:
            raise InputError("the clock of a tracker's log does not go on", where=f"row {back + 1}")

    def __len__(self) -> int:
        """Measurements."""
        return len(self.time_ns)

"""A tool path as one pose per cycle, with the feed held and resumed softly: what is streamed to a robot without a path.

The path is run as :mod:`counterflex.path.path_speed` runs it: programmed feed, limited acceleration, corners rounded
within the blending distance or stopped at.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.geometry import pose, rotation
from counterflex.path.path_speed import build_track
from counterflex.path.toolpath import ToolPath


class PoseStream:
    """Poses along a path, one per cycle.

    Args:
        Ts_part_tcp: (n, 4, 4) poses at the points of the path.
        path: The path; its feeds, rapids and dwells count, its points and axes are replaced by those of the poses.
        period_s: Cycle.
        acceleration_m_s2: Limit along the path.
        blending_m: Largest distance from a corner at which rounding starts; 0 is exact stop.
        rapid_m_s: Speed of rapid moves.
        hold_s: Time from full speed to standstill, and back, when the feed is held.

    Attributes:
        at: Place, cycles since the start at full speed; between two where the feed was changed.
        rate: Present speed as a share of the programmed one, 0 .. 1.

    Raises:
        InputError: Shapes that do not fit, a path that does not move.
    """

    def __init__(
        self,
        Ts_part_tcp: Float,
        path: ToolPath,
        *,
        period_s: float,
        acceleration_m_s2: float = 0.5,
        blending_m: float = 0.2e-3,
        rapid_m_s: float = 0.1,
        hold_s: float = 0.2,
    ) -> None:
        T = as_float("Ts_part_tcp", Ts_part_tcp, (len(path), 4, 4))
        self.period_s = as_positive("period_s", period_s)
        self._slew = self.period_s / as_positive("hold_s", hold_s)
        track = build_track(
            replace(path, p_part_tcp=T[:, :3, 3], axis_part=-T[:, :3, 2]),
            blending_m=as_positive("blending_m", blending_m, zero=True),
            rapid_m_s=as_positive("rapid_m_s", rapid_m_s),
            acceleration_m_s2=as_positive("acceleration_m_s2", acceleration_m_s2),
        )
        if len(path) < 2 or float(track.length_m.sum()) == 0.0:
            raise InputError("a path that does not move cannot be streamed", value=len(path))
        self._segment, self._share = track.places(acceleration_m_s2, period_s)
        self._p = track.p
        self._Rs = T[track.turned, :3, :3]
        self._turn = rotation.log(self._Rs[1:] @ np.swapaxes(self._Rs[:-1], -1, -2))
        self.at = 0.0
        self.rate = 0.0

    def __len__(self) -> int:
        """Samples."""
        return len(self._segment)

    @property
    def duration_s(self) -> float:
        """Time at full speed."""
        return (len(self) - 1) * self.period_s

    @property
    def finished(self) -> bool:
        """Return whether the end has been reached."""
        return self.at >= len(self) - 1

    def advance(self, override: float = 1.0) -> None:
        """Go on by one cycle.

        Args:
            override: Share of the programmed speed that is wanted, 0 .. 1; reached at the limited rate.
        """
        requested = min(1.0, max(0.0, override))
        self.rate += min(self._slew, max(-self._slew, requested - self.rate))
        self.at = min(float(len(self) - 1), self.at + self.rate)

    def pose(self, at: float | None = None) -> Float:
        """(4, 4) pose at a place; None: at the present one."""
        at = self.at if at is None else min(float(len(self) - 1), max(0.0, at))
        k = int(at)
        T: Float = self._sample(k)
        if at > k:
            after = self._sample(k + 1)
            T[:3, 3] += (at - k) * (after[:3, 3] - T[:3, 3])
            T[:3, :3] = rotation.exp((at - k) * rotation.log(after[:3, :3] @ T[:3, :3].T)) @ T[:3, :3]
        return T

    def twist(self) -> Float:
        """(6,) m/s and rad/s of the tool at the present place and rate, part axes; zero at the end."""
        if self.finished:
            return np.zeros(6)
        before, after = self._sample(int(self.at)), self._sample(int(self.at) + 1)
        share = self.rate / self.period_s
        turn = rotation.log(after[:3, :3] @ before[:3, :3].T)
        out: Float = np.r_[(after[:3, 3] - before[:3, 3]) * share, turn * share]
        return out

    def _sample(self, k: int) -> Float:
        i, u = self._segment[k], self._share[k]
        p = (1.0 - u) * self._p[i] + u * self._p[i + 1]
        out: Float = pose.make(rotation.exp(u * self._turn[i]) @ self._Rs[i], p)
        return out

"""Motion of the tool relative to the part from that of the robot's hand, which carries one of the two.

The hand is the last frame of the elastic chain. Where it carries the tool it is the tool frame, and

    d_part = R_part_base d_base.

Where it carries the part, against a spindle that stands still, it is the part frame. Then the part is what moves, at
the tip of the tool, a lever r away from the origin of the part:

    d_part = -R_part_base (t + theta x r),   the rotation -R_part_base theta.

Both are ``d_part = X d_base`` with a matrix X, and power gives the load on the hand, ``w_base = X^T w_part``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.geometry import pose


@dataclass(frozen=True, eq=False)
class RelativeMotion:
    """The matrices X of a path."""

    to_part: Float  # (n, 6, 6) X, from base axes to part axes; (1, 6, 6) where it is the same in every row
    # (4, 4) part frame as the controller knows it, or None where the robot carries the part; where external axes carry
    # one of them along, that of the begin, where it was measured
    T_base_part: Float | None

    def displacement(self, displacement_base: Float) -> Float:
        """(n, 6) m, rad of the tool relative to the part, part axes, from those of the hand, base axes."""
        out: Float = (self.to_part @ displacement_base[..., None])[..., 0]
        return out

    def load(self, w_part: Float) -> Float:
        """(n, 6) N, N m on the hand about its origin, base axes, from a wrench on the tool about its tip, part axes."""
        out: Float = (np.swapaxes(self.to_part, -1, -2) @ w_part[..., None])[..., 0]
        return out

    def compliance(self, C: Float) -> Float:
        """(n, 6, 6) compliance between tool and part, part axes, from that of the hand, base axes."""
        return np.ascontiguousarray(self.to_part @ C @ np.swapaxes(self.to_part, -1, -2))

    def rows(self, rows: Int | slice) -> RelativeMotion:
        """The same for some rows of the path."""
        return self if len(self.to_part) == 1 else replace(self, to_part=self.to_part[rows])


def tool_carried(T_base_part: Float, Ts_base_part: Float | None = None) -> RelativeMotion:
    """The robot carries the tool, the part stands.

    Args:
        T_base_part: (4, 4).
        Ts_base_part: (n, 4, 4) along the path, where external axes carry part or robot to other places; the first is
            ``T_base_part``.
    """
    Rs = T_base_part[None, :3, :3] if Ts_base_part is None else Ts_base_part[:, :3, :3]
    X = np.zeros((len(Rs), 6, 6))
    X[:, :3, :3] = X[:, 3:, 3:] = np.swapaxes(Rs, -1, -2)
    return RelativeMotion(X, T_base_part)


def part_carried(T_base_tcp: Float, Ts_part_tcp: Float) -> RelativeMotion:
    """The robot carries the part, the tool stands.

    Args:
        T_base_tcp: (4, 4) tool frame of the spindle that stands.
        Ts_part_tcp: (n, 4, 4) poses of the tool frame in the part along the path.
    """
    Rs_part_base = Ts_part_tcp[:, :3, :3] @ T_base_tcp[:3, :3].T
    x, y, z = (np.swapaxes(Rs_part_base, -1, -2) @ Ts_part_tcp[:, :3, 3:])[..., 0].T
    zero = np.zeros_like(x)
    lever = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)
    X = np.zeros((len(Ts_part_tcp), 6, 6))
    X[:, :3, :3] = X[:, 3:, 3:] = -Rs_part_base
    X[:, :3, 3:] = Rs_part_base @ lever
    return RelativeMotion(X, None)


def hand_poses(T_base_part: Float, T_base_tcp: Float | None, Ts_part_tcp: Float) -> Float:
    """Poses of the hand that a path asks for.

    Args:
        T_base_part: (4, 4) or (n, 4, 4); not looked at where the robot carries the part.
        T_base_tcp: (4, 4) tool frame of a spindle that stands, or None where the robot carries the tool.
        Ts_part_tcp: (n, 4, 4) poses of the tool frame in the part.

    Returns:
        (n, 4, 4) in the base: of the tool frame, or of the part frame.
    """
    out: Float = T_base_part @ Ts_part_tcp if T_base_tcp is None else T_base_tcp @ pose.inverse(Ts_part_tcp)
    return out

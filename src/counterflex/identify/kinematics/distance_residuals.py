"""Residuals of distances: from the tool to the fixed end of a ball bar, or between the tool's places in two poses."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.identify.geometry.arm_geometry import ArmGeometry


@dataclass(frozen=True, eq=False)
class DistanceResiduals:
    """``L - |p_base_tcp(q) - p_base_anchor|``, or ``L - |p_base_tcp(q) - p_base_tcp(q_second)|``.

    Attributes:
        group: (m,).
        sigma: (m, 1) m.
        arm: The arm in the m poses.
        length: (m,) m, measured.
        second: The arm in the other poses, or None with anchors.
        anchor0: (m, 3) m, first estimate of each row's anchor.
        anchor: (m, 3) places of its displacement among the parameters.
    """

    name: str
    group: Int
    sigma: Float
    arm: ArmGeometry
    length: Float
    second: ArmGeometry | None
    anchor0: Float
    anchor: Int
    components: tuple[str, ...] = ("distance m",)

    def evaluate(self, x: Float) -> Float:
        """(m, 1) measured minus predicted over sigma."""
        there = self.anchor0 + x[self.anchor] if self.second is None else self.second.poses(x)[:, :3, 3]
        span = np.linalg.norm(self.arm.poses(x)[:, :3, 3] - there, axis=1)
        out: Float = (self.length - span)[:, None] / self.sigma
        return out

    def jacobian(self, x: Float) -> Float:
        """(m, 1, p) derivative of :meth:`evaluate`."""
        out = np.zeros((len(self.group), 1, len(x)))
        T, places, columns = self.arm.moved(x)
        if self.second is None:
            there = self.anchor0 + x[self.anchor]
        else:
            T_second, places_second, columns_second = self.second.moved(x)
            there = T_second[:, :3, 3]
        way = T[:, :3, 3] - there
        way = way / np.linalg.norm(way, axis=1, keepdims=True)
        out[:, 0, places] -= np.einsum("mi,mik->mk", way, columns[:, :3])
        if self.second is None:
            rows = np.arange(len(out))
            for c in range(3):
                out[rows, 0, self.anchor[:, c]] += way[:, c]
        else:
            out[:, 0, places_second] += np.einsum("mi,mik->mk", way, columns_second[:, :3])
        out /= self.sigma[:, :, None]
        return out

    def subset(self, rows: Bool) -> DistanceResiduals:
        """The marked rows only."""
        return replace(
            self,
            group=self.group[rows],
            sigma=self.sigma[rows],
            arm=self.arm.subset(rows),
            length=self.length[rows],
            second=None if self.second is None else self.second.subset(rows),
            anchor0=self.anchor0[rows],
            anchor=self.anchor[rows],
        )


def find_anchor(p: Float, length: Float, where: str) -> Float:
    """Where the fixed end of a ball bar is, from the places of the other end.

    ``|p_i - a|^2 = L_i^2`` less its mean over all rows is linear in a; the solution is refined by a few Gauss-Newton
    steps. A first estimate: the errors of the robot are in it.

    ``p``: (m, 3) m. ``length``: (m,) m.

    Returns:
        (3,) m.

    Raises:
        InputError: Fewer than four places, or places in one plane (two anchors would fit).
    """
    centre = p.mean(axis=0)
    spread = np.linalg.svd(p - centre, compute_uv=False) if len(p) >= 4 else np.zeros(3)
    if len(p) < 4 or spread[2] < 0.02 * spread[0]:
        raise InputError(
            "the fixed end of the ball bar cannot be found",
            where=where,
            value=f"{len(p)} places, {spread[2]:.3g} m out of a plane",
            limit="4 or more, not in one plane",
            hint="Measure places in three dimensions around the fixed end",
        )
    squares = np.sum(p**2, axis=1) - length**2
    a, *_ = np.linalg.lstsq(2.0 * (p - centre), squares - squares.mean(), rcond=None)
    for _ in range(10):
        way = p - a
        span = np.linalg.norm(way, axis=1)
        off = length - span
        weight = 1.0 / np.maximum(np.abs(off), 3.0 * np.median(np.abs(off)) + 1e-9)
        J = -way / span[:, None]
        step, *_ = np.linalg.lstsq(J * weight[:, None], off * weight, rcond=None)
        a = a + step
    out: Float = a
    return out

"""Residuals of distances: from the tool to the fixed end of a ball bar, or between the tool's places in two poses."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.identify.geometry.arm_geometry import ArmGeometry


@dataclass(frozen=True, eq=False)
class PlaneResiduals:
    """``(n0 + a u + b v) . (p_base_tcp(q) - c0) - h`` of points touched on planes; n0, u, v orthonormal.

    ``h`` is the offset of the plane along n0 from its first estimate, ``a`` and ``b`` its tilts; the radius of the
    probe is part of h, since each plane is touched from one side.
    """

    name: str
    group: Int
    sigma: Float  # (m, 1) m
    arm: ArmGeometry  # the arm in the m poses
    centre: Float  # (m, 3) m, c0 of each row's plane
    axes: Float  # (m, 3, 3) columns n0, u, v
    place: Int  # (m, 3) places of h, a, b among the parameters
    components: tuple[str, ...] = ("height m",)

    def evaluate(self, x: Float) -> Float:
        """(m, 1) height over the plane, its sign turned, over sigma."""
        h, normal = self._plane(x)
        off = h - np.sum(normal * (self.arm.poses(x)[:, :3, 3] - self.centre), axis=1)
        out: Float = off[:, None] / self.sigma
        return out

    def jacobian(self, x: Float) -> Float:
        """(m, 1, p) derivative of :meth:`evaluate`."""
        out = np.zeros((len(self.group), 1, len(x)))
        T, places, columns = self.arm.moved(x)
        _, normal = self._plane(x)
        way = T[:, :3, 3] - self.centre
        rows = np.arange(len(out))
        out[:, 0, places] = -np.einsum("mi,mik->mk", normal, columns[:, :3])
        out[rows, 0, self.place[:, 0]] = 1.0
        for c in (1, 2):
            out[rows, 0, self.place[:, c]] = -np.sum(self.axes[:, :, c] * way, axis=1)
        out /= self.sigma[:, :, None]
        return out

    def _plane(self, x: Float) -> tuple[Float, Float]:
        v = x[self.place]
        normal: Float = self.axes[:, :, 0] + self.axes[:, :, 1] * v[:, 1:2] + self.axes[:, :, 2] * v[:, 2:3]
        return v[:, 0], normal

    def subset(self, rows: Bool) -> PlaneResiduals:
        """The marked rows only."""
        return replace(
            self,
            group=self.group[rows],
            sigma=self.sigma[rows],
            arm=self.arm.subset(rows),
            centre=self.centre[rows],
            axes=self.axes[rows],
            place=self.place[rows],
        )


def find_plane(p: Float, where: str, *, seed: int = 0) -> tuple[Float, Float]:
    """First estimate of a plane through most of the points: the triple with the least median distance, then refined.

    ``p``: (m, 3) m. Returns centre (3,) m and axes (3, 3), the first column the normal. Raises InputError: fewer than
    four points, or points on one line.
    """
    different = np.unique(np.round(p, 4), axis=0)
    spread = np.linalg.svd(different - different.mean(axis=0), compute_uv=False) if len(different) > 3 else np.zeros(3)
    if len(different) < 4 or spread[1] < 0.03 * spread[0]:
        raise InputError(
            "the points of a touched plane lie on one line or are too few",
            where=where,
            value=len(different),
            limit="4 or more, not on one line",
            hint="Touch the plane at places spread over it",
        )
    rng = np.random.default_rng(seed)
    best, good = np.inf, np.ones(len(p), dtype=np.bool_)
    for _ in range(100):
        a, b, c = p[rng.choice(len(p), 3, replace=False)]
        n = np.cross(b - a, c - a)
        size = float(np.linalg.norm(n))
        if size < 1e-3 * spread[0] ** 2 / len(p):
            continue
        off = np.abs((p - a) @ n / size)
        if np.median(off) < best:
            best, good = float(np.median(off)), off <= 6.0 * max(float(np.median(off)), 1e-6)
    centre = p[good].mean(axis=0)
    _, _, vt = np.linalg.svd(p[good] - centre)
    return centre, np.stack([vt[2], vt[0], vt[1]], axis=-1)


@dataclass(frozen=True, eq=False)
class DistanceResiduals:
    """``L - |p_base_tcp(q) - p_base_anchor|``, or ``L - |p_base_tcp(q) - p_base_tcp(q_second)|``."""

    name: str
    group: Int
    sigma: Float  # (m, 1) m
    arm: ArmGeometry  # the arm in the m poses
    length: Float  # (m,) m, measured
    second: ArmGeometry | None  # the arm in the other poses, or None with anchors
    anchor0: Float  # (m, 3) m, first estimate of each row's anchor
    anchor: Int  # (m, 3) places of its displacement among the parameters
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
    """Place of the fixed end of a ball bar, from the places of the other end.

    ``|p_i - a|^2 = L_i^2`` less its mean over all rows is linear in a; the solution is refined by a few Gauss-Newton
    steps. A first estimate: the errors of the robot are in it.

    ``p``: (m, 3) m. ``length``: (m,) m. Returns (3,) m. Raises InputError: fewer than four places, or places in one
    plane (two anchors would fit).
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
        # Least absolutes beyond three medians: a bar read wrong once must not move the anchor by its share.
        weight = 1.0 / np.maximum(np.abs(off), 3.0 * np.median(np.abs(off)) + 1e-9)
        J = -way / span[:, None]
        step, *_ = np.linalg.lstsq(J * weight[:, None], off * weight, rcond=None)
        a = a + step
    out: Float = a
    return out

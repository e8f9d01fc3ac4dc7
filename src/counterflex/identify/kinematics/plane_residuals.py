"""Residuals of touched planes: the probe's centre lies on a plane of unknown place and direction."""

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

    Attributes:
        group: (m,).
        sigma: (m, 1) m.
        arm: The arm in the m poses.
        centre: (m, 3) m, c0 of each row's plane.
        axes: (m, 3, 3) columns n0, u, v.
        place: (m, 3) places of h, a, b among the parameters.
    """

    name: str
    group: Int
    sigma: Float
    arm: ArmGeometry
    centre: Float
    axes: Float
    place: Int
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

    ``p``: (m, 3) m.

    Returns:
        Centre (3,) m and axes (3, 3), the first column the normal.

    Raises:
        InputError: Fewer than four points, or points on one line.
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

"""Straightness of a measured path by minimum zone and by least squares (ISO 230-1, ISO 1101)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import InputError

_ROUNDS: Final = 60
_CLOSE: Final = 1e-6
_ADDED: Final = 16
"""Directions that a round adds, at most: those of the points farthest out."""


@dataclass(frozen=True)
class Straightness:
    """Straightness deviations of one straight path, m."""

    length_m: float  # of the path
    # distance of two parallel lines that hold the path seen along the up direction, the least possible
    horizontal_m: float
    vertical_m: float  # the same seen from the side
    horizontal_ls_m: float  # range of the path about the least-squares line seen along the up direction
    vertical_ls_m: float  # from the side
    cylinder_m: float  # diameter of the narrowest cylinder that holds the path (ISO 1101)
    cylinder_ls_m: float  # twice the largest distance from the least-squares line in space

    @classmethod
    def of(cls, p: Float) -> Straightness:
        """Straightness of points along a line.

        Args:
            p: (n, 3) m, n >= 3; z is vertical, and x across a path along z.

        Raises:
            InputError: Fewer than three points, or points that are no line.
        """
        points = as_float("p", p, (None, 3))
        if len(points) < 3:
            raise InputError("a straightness needs three points", value=len(points))
        centre = points.mean(axis=0)
        _, s, vt = np.linalg.svd(points - centre, full_matrices=False)
        if s[0] <= 0.0 or s[1] > 0.2 * s[0]:
            raise InputError(
                "the points are no line", value=f"width to length {s[1] / max(s[0], 1e-300):.2g}", limit="< 0.2"
            )
        line = vt[0]
        top = np.array([0.0, 0.0, 1.0])
        top = np.array([1.0, 0.0, 0.0]) if abs(float(top @ line)) > 0.9 else top
        vertical = top - (top @ line) * line
        vertical /= np.linalg.norm(vertical)
        side = np.cross(vertical, line)
        x, h, v = ((points - centre) @ axis for axis in (line, side, vertical))
        lsq = np.hypot(_rest(x, h), _rest(x, v))
        return cls(
            length_m=float(np.ptp(x)),
            horizontal_m=parallel_lines(x, h),
            vertical_m=parallel_lines(x, v),
            horizontal_ls_m=float(np.ptp(_rest(x, h))),
            vertical_ls_m=float(np.ptp(_rest(x, v))),
            cylinder_m=narrowest_cylinder(x, np.column_stack([h, v])),
            cylinder_ls_m=2.0 * float(lsq.max()),
        )


def _rest(x: Float, y: Float) -> Float:
    """Residuals of a least-squares line."""
    a = np.column_stack([np.ones(len(x)), x - x.mean()])
    out: Float = y - a @ np.linalg.lstsq(a, y, rcond=None)[0]
    return out


def parallel_lines(x: Float, y: Float) -> float:
    """Least distance of two parallel lines that hold points: ``min 2 h`` with ``|y_i - a - b x_i| <= h``.

    The distance is taken along y, which differs from that across the lines by b^2/2 of it.

    Args:
        x: (n,) m along.
        y: (n,) m across.
    """
    spread = float(np.ptp(y))
    if spread == 0.0:
        return 0.0
    u, w = x / float(np.ptp(x)), (y - y.min()) / spread  # a place far off would drown the spread in rounding
    chosen = _hull(np.column_stack([u, w]))
    u, w = u[chosen], w[chosen]
    one = np.ones(len(u))
    above = np.column_stack([-one, -u, -one])
    below = np.column_stack([one, u, -one])
    solution = scipy.optimize.linprog(
        [0.0, 0.0, 1.0], A_ub=np.vstack([above, below]), b_ub=np.concatenate([-w, w]), bounds=[(None, None)] * 3,
        method="highs",
    )  # fmt: skip
    return 2.0 * spread * float(solution.x[2])


def narrowest_cylinder(x: Float, across_m: Float) -> float:
    """Diameter of the narrowest cylinder that holds points along x: ``min 2 max_i |yz_i - a - b x_i|``.

    The distance of a point is the largest of its components along all directions: a linear program over some of them,
    with the directions of points that are still too far added until none is. It is exact to 1e-6 of itself.

    Args:
        x: (n,) m along.
        across_m: (n, 2) m across.
    """
    spread = float(np.ptp(across_m, axis=0).max())
    if spread == 0.0:
        return 0.0
    u, w = x / float(np.ptp(x)), (across_m - across_m.min(axis=0)) / spread
    chosen = _hull(np.column_stack([u, w]))
    u, w = u[chosen], w[chosen]
    angle = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    around = np.column_stack([np.cos(angle), np.sin(angle)])
    line = np.column_stack([np.ones(len(u)), u])
    rest = w - line @ np.linalg.lstsq(line, w, rcond=None)[0]
    # Few points touch the cylinder: with all of them the program took a hundred times as long on a perfect line.
    rows, e = np.repeat(np.argmax(rest @ around.T, axis=0), 8), np.tile(around, (8, 1))
    radius = 0.0
    for _ in range(_ROUNDS):
        A = np.column_stack([-e, -e * u[rows, None], -np.ones(len(rows))])
        b = -np.sum(e * w[rows], axis=1)
        solution = scipy.optimize.linprog(
            [0.0, 0.0, 0.0, 0.0, 1.0], A_ub=A, b_ub=b, bounds=[(None, None)] * 5, method="highs"
        )
        rest = w - solution.x[:2] - u[:, None] * solution.x[2:4]
        size = np.linalg.norm(rest, axis=1)
        radius = float(size.max())
        far = np.argsort(-size)[:_ADDED]
        far = far[size[far] > solution.x[4] * (1.0 + _CLOSE) + 1e-15]
        if len(far) == 0:
            break
        rows = np.concatenate([rows, far])
        e = np.vstack([e, rest[far] / size[far, None]])
    return 2.0 * spread * radius


def _hull(points: Float) -> Int:
    """Rows of points that are corners of their hull: a convex distance is largest there. All where they lie flat."""
    try:
        out: Int = np.sort(scipy.spatial.ConvexHull(points).vertices)
    except scipy.spatial.QhullError:
        return np.arange(len(points))
    return out

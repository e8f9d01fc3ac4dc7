"""A force-sensing spindle holder as drawn: two cheeks with pockets, and a gauge bridge in each pocket.

Holder frame: z along the cheeks from the clamped end to the ring that carries the spindle, x through both cheeks, y
across them; y = 0 is their middle. A pocket is cut into the outer or the inner face of a cheek. In a *plain* one the
gauges sit on its floor; in a *bridged* one a rib as high as the face is left standing along z across it, and the gauges
sit on the rib: the pocket shifts the neutral line away from the rib, which is stretched more than the floor would be.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.sensing.holder_design.bricks import Bricks
from counterflex.sensing.strain_holder import HolderBeam

LEAST_WALL_M = 1e-3
"""Least thickness of material behind a pocket, and least width of a rib."""
BRICKS: Final = 4
"""Bricks over the height, the width and the depth of every pocket, and over the wall behind it: with one or two the
strain of a plain notch is wrong by a third."""
GROWTH: Final = 0.6
"""Growth of the bricks by the distance from a pocket."""
LEAST_GAP_M = 1e-3
"""Least distance of a pocket from the ends of the cheek and from another one."""


@dataclass(frozen=True)
class Pocket:
    """One pocket with its bridge of gauges."""

    side: int  # -1 the cheek at -x, +1 the one at +x
    outer: bool  # in the face that looks away from the other cheek, else in the inner one
    y_m: float  # middle across the cheek
    z_m: float  # middle along the cheek
    width_m: float  # along y
    height_m: float  # along z: twice the radius of the cutter for a slot
    depth_m: float  # along x
    rib_m: float = 0.0  # width along y of the rib that is left; 0: none

    @property
    def bridged(self) -> bool:
        """Return whether the gauges sit on a rib."""
        return self.rib_m > 0.0

    def check(self, beam: HolderBeam, name: str = "pocket") -> None:
        """Refuse a pocket that the cheek cannot have.

        Raises InputError: it leaves no wall or rib, or reaches beyond the cheek.
        """
        if self.side not in (-1, 1):
            raise InputError(f"{name}: side", value=self.side, limit="-1 or 1")
        if min(self.width_m, self.height_m, self.depth_m) <= 0.0 or self.rib_m < 0.0:
            least = min(self.width_m, self.height_m, self.depth_m, self.rib_m)
            raise InputError(f"{name}: a dimension is not above 0", value=least)
        wall = beam.thickness_m - self.depth_m
        if wall < LEAST_WALL_M:
            raise InputError(f"{name}: wall behind the pocket, mm", value=round(1e3 * wall, 3), limit=">= 1")
        if self.bridged and not LEAST_WALL_M <= self.rib_m <= self.width_m - 2.0 * LEAST_GAP_M:
            raise InputError(
                f"{name}: width of the rib, mm",
                value=1e3 * self.rib_m,
                limit=f"1 .. {1e3 * self.width_m - 2.0:g}, with an opening on both sides",
            )
        if abs(self.y_m) + 0.5 * self.width_m > 0.5 * beam.width_m + 1e-12:
            raise InputError(f"{name}: reaches beyond the cheek across", value=1e3 * self.y_m, limit="within the width")
        low, high = self.z_m - 0.5 * self.height_m, self.z_m + 0.5 * self.height_m
        if low < LEAST_GAP_M or high > beam.length_m - LEAST_GAP_M:
            raise InputError(
                f"{name}: reaches to the end of the cheek, mm",
                value=f"{1e3 * low:g} .. {1e3 * high:g}",
                limit=f"1 .. {1e3 * beam.length_m - 1.0:g}",
            )


@dataclass(frozen=True)
class Drawing:
    """The whole holder."""

    beam: HolderBeam  # its cheeks without pockets
    pockets: tuple[Pocket, ...]  # in any order; each carries one bridge
    p_holder_tcp: tuple[float, float, float]  # tool tip, m
    gauge_m: float = 3e-3  # length of the gauge's grid, along z

    def __post_init__(self) -> None:
        """Check every pocket, and that none meets another. Raises InputError: they cannot be cut."""
        for k, one in enumerate(self.pockets):
            one.check(self.beam, f"pocket {k + 1}")
            if one.height_m < self.gauge_m:
                raise InputError(
                    f"pocket {k + 1}: shorter along the cheek than the gauge, mm",
                    value=1e3 * one.height_m,
                    limit=f">= {1e3 * self.gauge_m:g}",
                )
            for j, other in enumerate(self.pockets[:k]):
                if one.side != other.side:
                    continue
                distance = max(
                    abs(one.y_m - other.y_m) - 0.5 * (one.width_m + other.width_m),
                    abs(one.z_m - other.z_m) - 0.5 * (one.height_m + other.height_m),
                )
                deep = one.outer == other.outer or one.depth_m + other.depth_m > self.beam.thickness_m - LEAST_WALL_M
                if distance < LEAST_GAP_M - 1e-12 and deep:
                    raise InputError(
                        f"pocket {k + 1} meets pocket {j + 1}", value=round(1e3 * distance, 3), limit=">= 1 mm apart"
                    )

    def cheek(self, side: int, mesh_m: float, *, cut: bool = True, bricks: int = BRICKS) -> Bricks:
        """One cheek as bricks, its own middle plane at x = 0.

        Args:
            side: -1 or +1.
            mesh_m: Largest edge of a brick away from pockets along y and z; at pockets it is finer.
            cut: With its pockets; else the cheek of the original design on the same grid.
            bricks: Fewest over the height, the width and the depth of every pocket, and over the wall behind it.
        """
        beam, own = self.beam, [p for p in self.pockets if p.side == side]
        t, b, length = beam.thickness_m, beam.width_m, beam.length_m
        depths = [p.depth_m for p in own]
        marks_x, marks_y, marks_z = [-0.5 * t, 0.5 * t], [-0.5 * b, 0.5 * b], [0.0, length]
        for p in own:
            sign = _face(p)
            marks_x.append(sign * (0.5 * t - p.depth_m))
            marks_y += [p.y_m - 0.5 * p.width_m, p.y_m + 0.5 * p.width_m]
            marks_z += [p.z_m - 0.5 * p.height_m, p.z_m, p.z_m + 0.5 * p.height_m]
            if p.bridged:
                marks_y += [p.y_m - 0.5 * p.rib_m, p.y_m + 0.5 * p.rib_m]
        fine_x = [*depths, *(t - d for d in depths)]
        x = _planes(marks_x, min([0.5 * t, *(size / bricks for size in fine_x)]), [])
        y = _planes(
            marks_y, mesh_m, [(p.y_m - 0.5 * p.width_m, p.y_m + 0.5 * p.width_m, p.width_m / bricks) for p in own]
        )
        z = _planes(
            marks_z, mesh_m, [(p.z_m - 0.5 * p.height_m, p.z_m + 0.5 * p.height_m, p.height_m / bricks) for p in own]
        )
        mid = [0.5 * (planes[1:] + planes[:-1]) for planes in (x, y, z)]
        filled = np.ones((len(mid[0]), len(mid[1]), len(mid[2])), dtype=np.bool_)
        for p in own if cut else ():
            cut_x = mid[0] * _face(p) > 0.5 * t - p.depth_m
            cut_y = (np.abs(mid[1] - p.y_m) < 0.5 * p.width_m) & (np.abs(mid[1] - p.y_m) > 0.5 * p.rib_m)
            cut_z = np.abs(mid[2] - p.z_m) < 0.5 * p.height_m
            filled &= ~(cut_x[:, None, None] & cut_y[None, :, None] & cut_z[None, None, :])
        return Bricks(x, y, z, filled)

    @property
    def mirrored(self) -> bool:
        """Return whether both cheeks have the same pockets, mirrored at the plane between them."""
        left, right = (
            sorted(
                (p.outer, p.y_m, p.z_m, p.width_m, p.height_m, p.depth_m, p.rib_m)
                for p in self.pockets
                if p.side == side
            )
            for side in (-1, 1)
        )
        return left == right

    def gauge_points(self, pocket: Pocket) -> Float:
        """(k, 3) m in the frame of :meth:`cheek`: points under the grid of the gauges, along z."""
        t = self.beam.thickness_m
        depth = 0.0 if pocket.bridged else pocket.depth_m
        x = _face(pocket) * (0.5 * t - depth)
        shares = np.array([-0.4, -0.2, 0.0, 0.2, 0.4])
        out = np.zeros((len(shares), 3))
        out[:, 0], out[:, 1], out[:, 2] = x, pocket.y_m, pocket.z_m + self.gauge_m * shares
        return out


def _face(pocket: Pocket) -> int:
    """Sign of x, in the cheek's own frame, of the face that the pocket is cut into."""
    return pocket.side if pocket.outer else -pocket.side


def _brick_m(at: float, coarse: float, fine: list[tuple[float, float, float]]) -> float:
    return min([coarse, *(edge + GROWTH * max(a - at, at - b, 0.0) for a, b, edge in fine)])


def _planes(marks: list[float], coarse: float, fine: list[tuple[float, float, float]]) -> Float:
    """Planes through all marks, no farther apart than ``coarse``, graded towards what is fine.

    ``fine``: Intervals (low, high, largest distance in them); away from one the distance grows by :data:`GROWTH` times
    the way to it.
    """
    places = np.unique(np.round(marks, 12))
    out = [float(places[0])]
    for low, high in pairwise(places.tolist()):
        # Planes at equal steps of the number of bricks: the integral of 1 / size.
        at = np.linspace(low, high, 201)
        density = np.array([1.0 / _brick_m(float(v), coarse, fine) for v in at])
        count = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(at))])
        n = max(1, int(np.ceil(count[-1] - 1e-6)))
        out += np.interp(np.arange(1, n + 1) * count[-1] / n, count, at).tolist()
    return np.array(out)

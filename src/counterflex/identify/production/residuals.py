"""Weighted residuals of steady stretches of production, with exact derivatives by the constants of the law.

The expected force of a stretch is that of the planner's maps, and to first order what depth and width are other than
planned::

    F(x) = sum_i [k_i h_ref^m_i B_i(1 - m_i) + e_i B_i(0)] + dF/da (t - g u_z - s_z) + dF/dl (b - g u_y - s_y)

with the height t of the work above the stretch (of the blank, or of the floor of an earlier pass), the factor g on the
elastic model's displacement u, the displacement s that was commanded, and b what a bound of the work is off by.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import MM, UM
from counterflex.cutting.arc_force import ArcCuts
from counterflex.cutting.cutter import Cutter
from counterflex.identify.production.alignment import CHIP_M, weights_at
from counterflex.identify.production.stretches import Stretches, widths_known
from counterflex.identify.solver.parameters import Parameter, Parameters

LAW: Final = 9
"""Number of constants of the law, which come first among the parameters."""
GIVE: Final = "give"
TOP_SIGMA_M: Final = 0.1 * MM
GIVE_SIGMA: Final = 0.2
DEPTH_SIGMA_M: Final = 30.0 * UM
"""What a depth scatters by beside top and give, from stretch to stretch: waviness, play."""


@dataclass(frozen=True, eq=False)
class Geometry:
    """Unknowns of the geometry of each stretch; indices into the parameters behind the law."""

    top: Int  # (n,) place of its top
    left: Int  # (n,) place of its left bound, -1 where the work has none
    right: Int  # (n,) place of its right bound
    parameters: Parameters  # tops, bounds, and the give, which is the last


def geometry_of(stretches: Stretches, run: Int, top_sigma_m: float = TOP_SIGMA_M) -> Geometry:
    """Tops by run and height, bounds by height and width of cut: a bound off by the grid is so in every run.

    ``run``: (n,) number of the run of each.
    """
    items: dict[tuple[object, ...], Parameter] = {}  # in order of places
    n = len(stretches)
    top, left, right = (np.full(n, -1, dtype=np.int64) for _ in range(3))
    known = widths_known(stretches.grid_m)
    for i in range(n):
        height = round(float(stretches.top_m[i]) / MM, 1)
        label = f"top of the work at {height:g} mm in run {int(run[i]) + 1}"
        top[i] = _place(items, ("top", int(run[i]), height), "top", top_sigma_m, label)
        for side, into, by, angle in (
            ("left", left, stretches.by_left, stretches.entry_rad),
            ("right", right, stretches.by_right, stretches.exit_rad),
        ):
            if np.any(by[i] != 0.0):
                key = (side, height, round(float(angle[i]), 2))
                into[i] = _place(items, key, "bound", float(known[i]), f"bound of the work at the {side}")
    give = Parameter(GIVE, "1", 1.0, GIVE_SIGMA, lower=0.0, upper=3.0, label="give of the robot")
    return Geometry(top, left, right, Parameters.of([*items.values(), give]))


def _place(
    items: dict[tuple[object, ...], Parameter], key: tuple[object, ...], kind: str, sigma: float, label: str
) -> int:
    """Place of a parameter by its key; a new one gets the next number of its kind."""
    if key not in items:
        number = sum(item.name.startswith(kind) for item in items.values())
        items[key] = Parameter(f"{kind}.{number}", "m", 0.0, sigma, label=label)
    return list(items).index(key)


class ProductionResiduals:
    """Mean forces of stretches; implements :class:`counterflex.identify.solver.residuals.Residuals`.

    ``group``: (n,) contacts, over all runs. ``growth``: (n,) factor by which the force of each has grown since the tool
    was new.
    """

    components: tuple[str, ...] = ("along N", "left N", "up N")

    def __init__(
        self,
        stretches: Stretches,
        geometry: Geometry,
        cutter: Cutter,
        h_ref_m: float,
        group: Int,
        growth: Float | None = None,
    ) -> None:
        self.name = "production"
        self.pieces, self.geometry, self.cutter, self.h_ref_m, self.group = (
            stretches, geometry, cutter, h_ref_m, group,
        )  # fmt: skip
        self.growth: Float = np.ones(len(stretches)) if growth is None else growth
        self._last: tuple[Float, Float, Float] | None = None
        self.sigma: Float = np.maximum(np.hypot(stretches.sigma, DEPTH_SIGMA_M * np.abs(stretches.by_depth)), 1e-6)

    def subset(self, rows: Bool) -> ProductionResiduals:
        """The marked rows."""
        g = self.geometry
        own = Geometry(g.top[rows], g.left[rows], g.right[rows], g.parameters)
        return ProductionResiduals(
            self.pieces.subset(rows), own, self.cutter, self.h_ref_m, self.group[rows], self.growth[rows]
        )

    def predict(self, x: Float) -> Float:
        """Mean forces (n, 3) N in the feed frame at the values x (p,)."""
        return self._force(x)[0]

    def evaluate(self, x: Float) -> Float:
        """Weighted residuals."""
        out: Float = (self.pieces.force - self._force(x)[0]) / self.sigma
        return out

    def jacobian(self, x: Float) -> Float:
        """Exact derivative of :meth:`evaluate`."""
        out: Float = -self._force(x)[1] / self.sigma[:, :, None]
        return out

    def arcs(self) -> ArcCuts:
        """The stretches as arcs of one depth, as the plan rounds them."""
        s = self.pieces
        return ArcCuts(self.cutter, s.depth_m, s.entry_rad, s.exit_rad, s.feed_tooth_m, np.zeros(len(s)))

    def _force(self, x: Float) -> tuple[Float, Float]:
        """Force (n, 3) and its derivative (n, 3, p)."""
        if self._last is not None and np.array_equal(self._last[0], x):
            return self._last[1], self._last[2]
        s, n = self.pieces, len(self.pieces)
        law, J = np.zeros((n, 3)), np.zeros((n, 3, len(x)))
        ratio, chip = float(np.log(self.h_ref_m)), float(np.log(CHIP_M))
        edge = s.maps_m[..., 0]
        for i in range(3):
            m, k, e = float(x[3 + i]), float(x[i]), float(x[6 + i])
            p = 1.0 - m
            value, slope = weights_at(p)
            size = float(np.exp(m * ratio + p * chip))
            U, dU = s.maps_m[:, :, i] @ value, s.maps_m[:, :, i] @ slope
            law += k * size * U + e * edge[:, :, i]
            J[:, :, i] = size * U
            J[:, :, 3 + i] = k * size * ((ratio - chip) * U - dU)
            J[:, :, 6 + i] = edge[:, :, i]
        law *= self.growth[:, None]
        J *= self.growth[:, None, None]
        moved = self._moved(x, J)
        self._last = (x.copy(), law + moved, J)
        return self._last[1], J

    def _moved(self, x: Float, J: Float) -> Float:
        """(n, 3) N by what depth and width are other than planned; their derivatives are written into J."""
        s, g, n = self.pieces, self.geometry, len(self.pieces)
        own, rows = x[LAW:], np.arange(n)
        give = float(own[-1])
        rise = own[g.top] - give * s.give_m[:, 2] - s.sent_m[:, 2]
        out: Float = s.by_depth * rise[:, None]
        J[rows, :, LAW + g.top] += s.by_depth
        J[:, :, -1] -= s.by_depth * s.give_m[:, 2:3]
        aside = give * s.give_m[:, 1] + s.sent_m[:, 1]
        for place, by in ((g.left, s.by_left), (g.right, s.by_right)):
            there = place >= 0
            shift = np.where(there, own[place], 0.0) - aside
            out += by * shift[:, None]
            J[rows[there], :, LAW + place[there]] += by[there]
            J[:, :, -1] -= by * s.give_m[:, 1:2]
        return out

"""Weighted residuals of the mean forces of test cuts, with exact derivatives by the constants of the law.

The force of a piece is that of its arc (:mod:`counterflex.cutting.arc_force`) with the depth and width that the tool
really cut: commanded, plus how much higher the blank is than stated, less what the tool yielded under the force,
times a factor for what the elastic model gets wrong.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import MM, UM
from counterflex.cutting.arc_force import ArcCuts, TermForce, force_thickness, mean_thickness
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.cutter import Cutter
from counterflex.identify.cutting.cut_rows import Pieces
from counterflex.identify.cutting.force_forms import ForceForm
from counterflex.identify.solver.parameters import Parameter, Parameters

LAW: Final = 9
"""Number of constants of the law, which come first among the parameters."""
GIVE: Final = "give"
THRUST_SHARE: Final = 0.3
"""Relative standard deviation of the thrust of a sinking end face."""
TOP_SIGMA_M: Final = 0.1 * MM
GIVE_SIGMA: Final = 0.15
DEPTH_SIGMA_M: Final = 40.0 * UM
WIDTH_SIGMA_M: Final = 50.0 * UM


def geometry_parameters(pieces: Pieces, top_sigma_m: float = TOP_SIGMA_M) -> Parameters:
    """Parameters of depth and width: height of each blank above nominal, and deflection of the tool.

    ``top_sigma_m``: Standard deviation of the stated top of a blank.

    Returns:
        ``top.0``, ``top.1``, ... (m, positive: higher than stated), and ``give`` (1 is what the elastic model says).
        What no piece depends on is held.
    """
    items = []
    for blank in range(int(np.max(pieces.blank, initial=0)) + 1):
        mine = (pieces.blank == blank) & ~pieces.measured
        least = float(np.min(pieces.depth_m[mine], initial=1.0))
        items.append(
            Parameter(
                f"top.{blank}",
                "m",
                0.0,
                top_sigma_m,
                lower=-0.5 * least,
                upper=max(least, 10.0 * top_sigma_m),
                free=bool(np.any(mine)),
                label=f"top of blank {blank + 1}",
            )
        )
    moved = pieces.elastic & (~pieces.measured | pieces.left_wall | pieces.right_wall)
    items.append(
        Parameter(GIVE, "1", 1.0, GIVE_SIGMA, lower=0.0, upper=3.0, free=bool(np.any(moved)), label="give of the robot")
    )
    return Parameters.of(items)


@dataclass(frozen=True, eq=False)
class ForceShape:
    """Depth and arc of pieces at given parameters, with derivatives."""

    cuts: ArcCuts  # for the force
    depth_by: Float  # (n, g) derivative of the depth by the geometry parameters
    entry_by: Float  # (n,) rad, derivative of the entry angle by `give`
    exit_by: Float  # (n,) of the exit angle
    left_by: Float  # (n,) rad/m derivative of the entry angle by the left bound, 0 where that is the cutter's edge
    right_by: Float  # (n,) of the exit angle by the right bound


class SlotResiduals:
    """Mean forces of pieces of cuts; implements :class:`counterflex.identify.solver.residuals.Residuals`.

    ``law``: A law near the truth, to turn what is not known of depth and width into force. ``depth_sigma_m``: What
    depth scatters beside top and give, from piece to piece.

    The parameters are the nine constants of :data:`counterflex.identify.cutting.force_forms.NAMES`, the tops, and
    ``give``.
    """

    components: tuple[str, ...] = ("along N", "left N", "up N")

    def __init__(
        self,
        pieces: Pieces,
        cutter: Cutter,
        form: ForceForm,
        h_ref_m: float,
        law: ForceLaw,
        blanks: int,
        depth_sigma_m: float = DEPTH_SIGMA_M,
        width_sigma_m: float = WIDTH_SIGMA_M,
    ) -> None:
        self.name = "test cuts"
        self.pieces, self.cutter, self.form, self.h_ref_m, self.law, self.blanks = (
            pieces, cutter, form, h_ref_m, law, blanks,
        )  # fmt: skip
        self.scatter = (depth_sigma_m, width_sigma_m)
        self.group: Int = pieces.cut
        self._last: tuple[Float, Float, Float] | None = None
        self.sigma: Float = self._sigma()

    def _sigma(self) -> Float:
        pieces, (depth_sigma, width_sigma) = self.pieces, self.scatter
        shape = self.shape(np.concatenate([np.zeros(LAW + self.blanks), [1.0]]))
        by_depth, by_entry, by_exit = (np.zeros((len(pieces), 3)) for _ in range(3))
        for p, *k in self.law.terms():
            term = TermForce.of(shape.cuts, float(p))
            by_depth += term.by_depth @ np.array(k)
            by_entry += term.by_entry @ np.array(k)
            by_exit += term.by_exit @ np.array(k)
        depth = np.where(pieces.measured, np.maximum(pieces.depth_sigma_m, 0.0), depth_sigma)
        across = width_sigma * (by_entry * shape.left_by[:, None] + by_exit * shape.right_by[:, None])
        out: Float = np.sqrt(pieces.sigma**2 + (by_depth * depth[:, None]) ** 2 + across**2)
        if self.cutter.is_flat:
            # Only along the axis: a sinking end face rubs with chips of some um, for which no constant was ever
            # measured.
            out[:, 2] = np.hypot(out[:, 2], self._thrust_sigma(shape.cuts))
        return out

    def _thrust_sigma(self, cuts: ArcCuts) -> Float:
        """Standard deviation of the thrust of an end face that sinks a little: chips far thinner than any tested."""
        drop, spread = np.maximum(self.pieces.drop_tooth_m, 0.0), self.pieces.drop_sigma_m
        thrust, more = self._thrust(cuts, drop), self._thrust(cuts, drop + spread)
        out: Float = np.hypot(THRUST_SHARE * thrust, more - thrust)
        return out

    def _thrust(self, cuts: ArcCuts, drop: Float) -> Float:
        out = np.zeros(len(cuts))
        for sinking, sign in ((drop, 1.0), (np.zeros(len(cuts)), -1.0)):
            own = replace(cuts, drop_tooth_m=sinking)
            for p, *k in self.law.terms():
                out += sign * TermForce.of(own, float(p)).value[:, 2] @ np.array(k)
        return out

    def shape(self, x: Float) -> ForceShape:
        """Depth and arc at the values x (p,) of all parameters."""
        pieces, n = self.pieces, len(self.pieces)
        tops, give = x[LAW : LAW + self.blanks], float(x[LAW + self.blanks])
        free = ~pieces.measured
        depth = pieces.depth_m + np.where(free, tops[pieces.blank] - give * pieces.give_m[:, 2], 0.0)
        depth_by = np.zeros((n, self.blanks + 1))
        depth_by[np.arange(n), pieces.blank] = free
        depth_by[:, -1] = np.where(free, -pieces.give_m[:, 2], 0.0)
        radius = self.cutter.radius_m
        side = pieces.give_m[:, 1]
        low_edge = np.where(pieces.left_wall, pieces.left_m - give * side, radius)
        right = np.where(pieces.right_wall, pieces.right_m - give * side, -radius)
        entry, entry_slope = _angle(low_edge / radius)
        leave, leave_slope = _angle(right / radius)
        left_by = np.where(pieces.left_wall, entry_slope / radius, 0.0)
        right_by = np.where(pieces.right_wall, leave_slope / radius, 0.0)
        cuts = ArcCuts(self.cutter, np.maximum(depth, 0.0), entry, leave, pieces.feed_tooth_m, pieces.drop_tooth_m)
        return ForceShape(cuts, depth_by, -left_by * side, -right_by * side, left_by, right_by)

    def predict(self, x: Float) -> Float:
        """Mean forces (n, 3) N in the feed frame at the values x (p,)."""
        return self._force(x)[0]

    def stated(self) -> ArcCuts:
        """Depth and arc of every piece as commanded or measured, nothing given way."""
        return self.shape(np.zeros(LAW + self.blanks + 1)).cuts

    def thickness(self) -> Float:
        """Mean chip thickness (n,) m of every piece as stated."""
        return mean_thickness(self.stated())

    def reference_m(self) -> float:
        """Reference thickness of these pieces: geometric mean of where their force arises."""
        return float(np.exp(np.mean(np.log(force_thickness(self.stated())))))

    def evaluate(self, x: Float) -> Float:
        """Weighted residuals, see :class:`counterflex.identify.solver.residuals.Residuals`."""
        out: Float = (self.pieces.force - self._force(x)[0]) / self.sigma
        return out

    def jacobian(self, x: Float) -> Float:
        """Exact derivative of :meth:`evaluate`."""
        out: Float = -self._force(x)[1] / self.sigma[:, :, None]
        return out

    def subset(self, rows: Bool) -> SlotResiduals:
        """The block with the marked rows only."""
        return SlotResiduals(
            self.pieces.subset(rows), self.cutter, self.form, self.h_ref_m, self.law, self.blanks, *self.scatter
        )

    def _force(self, x: Float) -> tuple[Float, Float]:
        """Force (n, 3) and its derivative (n, 3, p); the last ones are kept, as a solver asks for both at one place."""
        if self._last is not None and np.array_equal(self._last[0], x):
            return self._last[1], self._last[2]
        shape, n = self.shape(x), len(self.pieces)
        force, J = np.zeros((n, 3)), np.zeros((n, 3, len(x)))
        geometry = slice(LAW, LAW + self.blanks + 1)
        logarithm = float(np.log(self.h_ref_m))
        term = cache(partial(TermForce.of, shape.cuts))  # several directions share an exponent, all share that of edges
        for i in range(3):
            place = self.form.exponent_of[i]
            m, k = float(x[place]), float(x[i])
            chip, edge = term(1.0 - m), term(0.0)
            scale = float(np.exp(m * logarithm))
            for t, factor in ((chip, k * scale), (edge, float(x[6 + i]))):
                force += factor * t.value[:, :, i]
                J[:, :, geometry] += factor * t.by_depth[:, :, i, None] * shape.depth_by[:, None, :]
                ends = t.by_entry[:, :, i] * shape.entry_by[:, None]
                ends += t.by_exit[:, :, i] * shape.exit_by[:, None]
                J[:, :, LAW + self.blanks] += factor * ends
            J[:, :, i] += scale * chip.value[:, :, i]
            J[:, :, place] += k * scale * (logarithm * chip.value[:, :, i] - chip.by_exponent[:, :, i])
            J[:, :, 6 + i] += edge.value[:, :, i]
        self._last = (x.copy(), force, J)
        return force, J


def _angle(cosine: Float) -> tuple[Float, Float]:
    """Angle (n,) of a bound at ``cosine`` radii to the left, and its derivative, 0 beyond the cutter."""
    inside = np.abs(cosine) < 1.0
    safe = np.where(inside, cosine, 0.0)
    angle = np.where(inside, np.arccos(safe), np.where(cosine > 0.0, 0.0, np.pi))
    # At the cutter's edge the derivative is infinite, but a bound there moves no chip: zero is its effect.
    slope: Float = np.where(inside, -1.0 / np.sqrt(1.0 - safe**2), 0.0)
    return angle, slope

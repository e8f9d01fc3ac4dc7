"""Figures, sentences and pictures of the cutting recipe."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from counterflex.core.arrays import Float, Int
from counterflex.core.units import MM, N_PER_MM, N_PER_MM2, UM
from counterflex.cutting.arc_force import ArcCuts, TermForce
from counterflex.cutting.coefficients import H_KIENZLE_M, ForceLaw
from counterflex.identify.counted_coverage import COUNTED
from counterflex.identify.cutting import considered
from counterflex.identify.cutting.force_forms import DIRECTIONS, NAMES, ForceForm, constants
from counterflex.identify.cutting.residuals import GIVE, LAW, SlotResiduals
from counterflex.identify.cutting.steady_cuts import SteadyCuts
from counterflex.identify.recipe import Curve, Figure, Picture
from counterflex.identify.solver.fit import Fit

_SAME = 0.01
_LEAST = 3


@dataclass(frozen=True)
class Wear:
    """Trend of the force."""

    per_m: float  # relative growth of the force per metre of cut
    sigma_per_m: float  # its standard deviation
    chance: float  # two-sided probability of a slope as large without any wear
    cuts: int  # number of repeated cuts it rests on
    span_m: float  # length of cut they span


def trend(relative_force: Float, run_m: Float, group: Int) -> Wear | None:
    """Common slope of groups of repeated cuts, each with a level of its own.

    Args:
        relative_force: (n,) measured over expected force of each cut.
        run_m: (n,) m, length the tool had cut before.
        group: (n,) which cuts repeat one another.

    Returns:
        The trend, or None where no group spans any length or nothing is left to judge the scatter by.
    """
    force, run = np.array(relative_force, dtype=np.float64), np.array(run_m, dtype=np.float64)
    groups = np.unique(group)
    for g in groups:
        mine = group == g
        # A level for each group: what the model misses in one condition is no wear.
        force[mine] /= force[mine].mean()
        force[mine] -= 1.0
        run[mine] -= run[mine].mean()
    dof = len(force) - len(groups) - 1
    square = float(run @ run)
    if dof < 1 or square <= 0.0:
        return None
    slope = float(run @ force) / square
    rest = force - slope * run
    sigma = float(np.sqrt(rest @ rest / dof / square))
    chance = float(2.0 * scipy.stats.t.sf(abs(slope) / sigma, dof)) if sigma > 0.0 else float(slope == 0.0)
    return Wear(slope, sigma, chance, len(force), float(np.ptp(run_m)))


def wear_trend(block: SlotResiduals, fit: Fit) -> Wear | None:
    """Wear from the cuts of a block that repeat one another: same feed, depth, width and speed within 1 %.

    ``fit``: Their fit; each measured force is put in relation to its prediction, so that what depth and give explain
    does not count as wear. Returns the trend, or None where no condition was cut three times or more.
    """
    pieces = block.pieces
    if float(np.ptp(pieces.run_m)) <= 0.0:
        return None
    predicted = block.predict(fit.values)
    relative = np.sum(pieces.force * predicted, axis=1) / np.sum(predicted**2, axis=1)
    keys = np.column_stack(
        [
            np.round(np.log(pieces.feed_tooth_m) / _SAME),
            np.round(np.log(np.maximum(pieces.depth_m, 1e-9)) / _SAME),
            np.round(pieces.left_m / (_SAME * block.cutter.radius_m)),
            np.round(pieces.right_m / (_SAME * block.cutter.radius_m)),
            np.round(1e4 * pieces.drop_tooth_m / pieces.feed_tooth_m),
        ]
    )
    _, group, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    group = np.asarray(group, dtype=np.int64).reshape(-1)
    often = count[group] >= _LEAST
    cuts = np.array([len(np.unique(pieces.cut[group == g])) >= _LEAST for g in range(len(count))])
    often &= cuts[group]
    if not np.any(often):
        return None
    return trend(relative[often], pieces.run_m[often], group[often])


LEVEL = 0.02
"""Slope of the floor below which a slot counts as level in the picture."""
NARROW = 4.0
"""Ratio of largest to smallest chip thickness below which exponent and edge force cannot be told apart."""


ONE_WAY = 0.5
"""Length of the mean feed direction above which the cuts went one way."""


@dataclass(frozen=True, eq=False)
class Shared:
    """Effects taken to be the same in all cuts."""

    sensor: considered.SensorAccuracy  # the force sensor
    wear: float  # growth of the force to the last piece, share
    runout_m: float
    is_identified: bool  # whether the runout was identified from the records
    before: Float  # (p,) standard deviations without all this


@dataclass(frozen=True, eq=False)
class ChosenForm:
    """The form that was chosen and its fit."""

    cuts: SteadyCuts
    block: SlotResiduals  # the pieces that were fitted
    form: ForceForm
    fit: Fit
    h_ref_m: float
    range_m: tuple[float, float]  # least and largest mean thickness of the fitted pieces
    shared: Shared | None = None  # what is in its standard deviations because all cuts share it

    def law(self, source: str) -> ForceLaw:
        """The fitted law, good for the thickness met."""
        low, high = self.range_m
        if high <= low * 1.02:
            low, high = low / 1.05, high * 1.05
        return self.form.law(self.fit.values, self.h_ref_m, low, high, source)

    def runout(self) -> considered.Runout | None:
        """Runout, where the records show single teeth."""
        pieces, cuts = self.block.pieces, self.block.shape(self.fit.values).cuts
        turns = [
            considered.TurnForce(
                float(pieces.turn_n[i]),
                float(cuts.depth_m[i]),
                float(cuts.entry_rad[i]),
                float(cuts.exit_rad[i]),
                float(cuts.feed_tooth_m[i]),
            )
            for i in np.flatnonzero(np.isfinite(pieces.turn_n))
        ]
        return considered.runout(turns, self.block.cutter, self.law("fit"))

    def sigma_ln_k(self, h_m: float) -> float:
        """Standard deviation of ln k_c at a thickness: ``k_c(h) = k_c,ref (h / h_ref)^-m``, covariance included."""
        fit = self.fit
        free = fit.free_index.tolist()
        slope = np.zeros(len(free))
        scale = fit.parameters.slope(fit.values)
        if 0 in free:
            slope[free.index(0)] = scale[0] / fit.values[0]
        if 3 in free:
            slope[free.index(3)] = -scale[3] * math.log(h_m / self.h_ref_m)
        return math.sqrt(max(float(slope @ fit.covariance @ slope), 0.0))

    def correlation(self, a: str, b: str) -> float | None:
        """Correlation of two constants, None where one is held."""
        fit = self.fit
        free = [fit.parameters.names[i] for i in fit.free_index]
        if a not in free or b not in free:
            return None
        i, j = free.index(a), free.index(b)
        C = fit.covariance
        return float(C[i, j] / math.sqrt(C[i, i] * C[j, j]))


def figures(chosen: ChosenForm, forms: Mapping[str, float]) -> tuple[Figure, ...]:
    """All numbers beside the headline, each with its standard deviation; ``forms``: hold-out error % by form."""
    fit, form = chosen.fit, chosen.form
    out = [
        Figure(
            "h_ref_um",
            "reference chip thickness, geometric mean of where the force of the cuts arises",
            chosen.h_ref_m / UM,
        ),
        Figure("h_least_um", "least mean chip thickness", chosen.range_m[0] / UM),
        Figure("h_largest_um", "largest mean chip thickness", chosen.range_m[1] / UM),
    ]
    for i, direction in enumerate(DIRECTIONS):
        out += _with_sigma(fit, i, f"k{direction}_ref_n_mm2", f"k{direction} at the reference thickness", N_PER_MM2)
    for i in sorted(set(form.exponent_of)) if form.exponents else ():
        out += _with_sigma(fit, i, NAMES[i], f"exponent {NAMES[i]}", 1.0)
    if form.edge:
        for i, direction in enumerate(DIRECTIONS):
            out += _with_sigma(fit, 6 + i, f"edge_{direction}_n_mm", f"edge force {direction}", N_PER_MM)
    if form.exponents:
        k11 = fit.values[0] * (H_KIENZLE_M / chosen.h_ref_m) ** -fit.values[form.exponent_of[0]]
        out.append(Figure("kc11_n_mm2", "kc1.1, extrapolated to 1 mm for comparison", k11 / N_PER_MM2))
        sigma = k11 * chosen.sigma_ln_k(H_KIENZLE_M)
        out.append(Figure("kc11_sigma_n_mm2", "its standard deviation", sigma / N_PER_MM2))
    correlation = chosen.correlation("kc", "mc")
    if correlation is not None:
        out.append(Figure("kc_mc_correlation", "correlation of kc at the reference thickness with mc", correlation))
    for name, place in ((n, fit.parameters.index(n)) for n in fit.parameters.names[LAW:]):
        if fit.parameters.items[place].free and name != GIVE:
            out += _with_sigma(fit, place, f"{name.replace('.', '_')}_um", "blank higher than stated", UM)
    out += [
        Figure(f"holdout_{name}_percent", f"hold-out error of the form: {name}", value) for name, value in forms.items()
    ]
    eccentric = chosen.runout()
    if eccentric is not None:
        out += [
            Figure("runout_um", "runout, from what repeats once per turn", eccentric.value_m / UM),
            Figure("runout_sigma_um", "its standard deviation", eccentric.sigma_m / UM),
        ]
    wear = wear_trend(chosen.block, fit)
    if wear is not None:
        out += [
            Figure("wear_percent_per_m", "growth of the force per length of cut, repeated cuts", 100.0 * wear.per_m),
            Figure("wear_sigma_percent_per_m", "its standard deviation", 100.0 * wear.sigma_per_m),
            Figure("wear_chance", "probability of such a growth without wear", wear.chance),
        ]
    return tuple(out)


def _with_sigma(fit: Fit, place: int, name: str, text: str, unit: float) -> list[Figure]:
    before = fit.parameters.items[place].nominal / unit
    head, _, tail = name.partition("_ref_") if "_ref_" in name else (name, "", "")
    sigma_name = f"{head}_ref_sigma_{tail}" if tail else f"{name}_sigma"
    return [
        Figure(name, text, float(fit.values[place]) / unit, before),
        Figure(sigma_name, "its standard deviation", float(fit.sigma[place]) / unit),
    ]


def remarks(chosen: ChosenForm, law: ForceLaw) -> tuple[str, ...]:
    """Remarks: what was assumed, what the cuts cannot see, what to measure next."""
    fit, cuts = chosen.fit, chosen.cuts
    low, high = chosen.range_m
    out = [
        f"Form of the law: {chosen.form.text}, the simplest that predicts held-out cuts as well as any",
        f"{len(chosen.block.pieces)} settled pieces of {len(np.unique(chosen.block.pieces.cut))} cuts with "
        f"T{cuts.tool}, mean chip thickness {low / UM:.1f} to {high / UM:.1f} um",
        "k1.1 is an extrapolation to 1 mm; the cell file stores it because tables do, with the range of thickness "
        "that the constants are good for",
        *cuts.remarks,
    ]
    if high < NARROW * low:
        out.append(
            f"The chip thickness spans only a factor of {high / low:.1f}: the exponent and the edge force cannot be "
            f"separated. Cut at feeds that differ by a factor of {NARROW:g} or more"
        )
    out += list(fit.hidden)
    if np.any(np.isfinite(chosen.block.pieces.turn_n)):
        out.append(
            "The runout found is that of the tool as clamped; where the cell states another, its mean effect is in "
            "the constants: write it as runout_um under [[tools]] and identify again"
        )
    else:
        out.append(
            "Runout is not determined: it needs a record of the single teeth (rate well above the tooth passing "
            "frequency) from a sensor with that bandwidth (setting bandwidth_hz); its mean effect is part of the "
            "constants"
        )
    if chosen.shared is not None:
        out += _shared(chosen, chosen.shared)
    k, _, _ = constants(law, chosen.h_ref_m)
    change = fit.values[0] / k[0]
    if not 0.5 < change < 2.0:
        out.append(
            f"The cutting constant is {change:.2f} times the one the cell had: another material, a worn tool, or a "
            "mistake in depth, feed or speed"
        )
    return tuple(out)


def _shared(chosen: ChosenForm, shared: Shared) -> list[str]:
    """Errors that all cuts share, their assumed sizes, and how to get rid of the largest part."""
    out = [
        f"In the standard deviations because all cuts share it: force sensor ({shared.sensor.text}), wear "
        f"({100 * shared.wear:.2g} % more force at the last piece), runout ({shared.runout_m / UM:.2g} um, "
        f"{'found' if shared.is_identified else 'usual'}). "
        f"Your sensor's data sheet goes into the manifest under [settings]: {considered.ACCURACY}, or "
        f"{considered.SCALE_KEY} and {considered.CROSS_KEY}; {considered.ALIGNMENT_KEY.replace('_rad', '_deg')}",
        COUNTED["cutting"].text,
    ]
    fit = chosen.fit
    most = [n for i, n in enumerate(fit.parameters.names[:3]) if fit.sigma[i] > math.sqrt(2.0) * shared.before[i]]
    heading = chosen.block.pieces.axes[:, 0]
    if most and np.linalg.norm(heading.mean(axis=0)) > ONE_WAY:
        out.append(
            f"The standard deviation of {', '.join(most)} is for the most part what all cuts share. Cut half of the "
            "pieces the opposite way: what the sensor shows of one axis in another then takes the other sign"
        )
    return out


def pictures(chosen: ChosenForm, before: ForceLaw) -> tuple[Picture, ...]:
    """Force against thickness with the fit and its interval, and the residual of every cut."""
    block, fit = chosen.block, chosen.fit
    pieces = block.pieces
    h = block.thickness()
    level = np.abs(pieces.drop_tooth_m) < LEVEL * pieces.feed_tooth_m
    slots = ~pieces.left_wall & ~pieces.right_wall & level
    curves: list[Curve] = []
    depth = block.shape(fit.values).cuts.depth_m
    grid = np.geomspace(float(h.min()) / 1.3, float(h.max()) * 1.3, 60)
    law = chosen.law("fit")
    per_edge = _slot_residual(law, grid, block)
    sigma = np.array([chosen.sigma_ln_k(float(x)) for x in grid])
    if np.any(slots):
        curves.append(Curve("slots measured", h[slots] / UM, pieces.force[slots, 1] / depth[slots] * MM))
    curves += [
        Curve("fit", grid / UM, per_edge * MM, line=True),
        Curve("fit + 2 standard deviations", grid / UM, per_edge * (1.0 + 2.0 * sigma) * MM, line=True),
        Curve("fit - 2 standard deviations", grid / UM, per_edge * (1.0 - 2.0 * sigma) * MM, line=True),
        Curve("before", grid / UM, _slot_residual(before, grid, block) * MM, line=True),
    ]
    rest = fit.residuals[0] * block.sigma / np.linalg.norm(pieces.force, axis=1, keepdims=True)
    number = np.arange(1, len(pieces) + 1, dtype=np.float64)
    return (
        Picture(
            "Force across the feed per depth of cut, slots",
            "mean chip thickness, um",
            "force, N/mm",
            tuple(curves),
            "The interval is that of the cutting constant and its exponent.",
        ),
        Picture(
            "What the fit leaves",
            "piece of a cut, in order",
            "measured less predicted, % of the force",
            tuple(Curve(name, number, 100.0 * rest[:, i]) for i, name in enumerate(("along", "left", "up"))),
        ),
    )


def _slot_residual(law: ForceLaw, h_mean: Float, block: SlotResiduals) -> Float:
    """Force to the left of the feed per depth of a slot, N/m, at mean thicknesses (n,)."""
    n = len(h_mean)
    cuts = ArcCuts(block.cutter, np.full(n, MM), np.zeros(n), np.full(n, np.pi), 0.5 * np.pi * h_mean, np.zeros(n))
    out = np.zeros(n)
    for p, *k in law.terms():
        out += TermForce.of(cuts, float(p)).value[:, 1] @ np.array(k) / MM
    return out

"""Constants of the force law from steady stretches of production: prior and data weighed, tested, held out.

Which constants are freed is decided by what the data can tell apart: with the geometry eliminated, the information of
the constants, each scaled to one, has condition indices; above :data:`MOST_INDEX` two of them have one pattern.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError, ModelError
from counterflex.cutting.arc_force import force_thickness, mean_thickness
from counterflex.cutting.coefficients import ForceLaw, LinearEdgeLaw
from counterflex.identify.cutting.considered import RUNOUT_M, SensorAccuracy, runout_of_arcs, shown_by_sensor
from counterflex.identify.cutting.force_forms import FORMS, NAMES, ForceForm, solve_physical
from counterflex.identify.production.residuals import LAW, ProductionResiduals
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import Folds, HeldOut, cross_validate
from counterflex.identify.solver.jackknife import FEWEST_PARTS, added, considered, with_jackknife
from counterflex.identify.solver.parameters import Parameters
from counterflex.identify.solver.residuals import Residuals

MOST_INDEX: Final = 30.0
"""Largest condition index (Belsley, Kuh and Welsch 1980: from 30 on a dependence harms)."""
_NAMED: Final = 0.3
SIGNIFICANT: Final = 0.01
"""Probability of so large a difference by chance, below which the stated constants are called wrong."""
LEVELS: Final = ("directions", "exponents", "all")
"""Which constants are free: the three specific forces, their exponents as well, the edge forces as well."""
_FREE: Final = {"directions": NAMES[:3], "exponents": NAMES[:6], "all": NAMES}


@dataclass(frozen=True)
class CutCondition:
    """Condition of a set of constants in the data."""

    level: str
    index: float  # largest condition index
    alike: tuple[str, ...]  # names of those that have one pattern at it

    @property
    def is_enough(self) -> bool:
        """Return whether all of them can be told apart."""
        return self.index <= MOST_INDEX


@dataclass(frozen=True)
class ConstantDifference:
    """Found constants against the stated ones."""

    chance: float  # probability of a difference as large if the stated values were exactly true
    chance_in_prior: float  # the same if they are as uncertain as stated
    statistic: float  # of the first
    count: int

    @property
    def is_significant(self) -> bool:
        """Return whether the stated values are wrong by more than chance."""
        return self.chance < SIGNIFICANT


@dataclass(frozen=True, eq=False)
class ConstantEstimate:
    """Constants and what they rest on."""

    fit: Fit  # nine constants, then the geometry
    level: str  # which were free
    conditions: tuple[CutCondition, ...]  # of every level
    h_ref_m: float
    range_m: tuple[float, float]  # least and largest mean chip thickness
    held_out: HeldOut
    difference: ConstantDifference  # from the stated ones
    block: ProductionResiduals  # what was fitted

    def law(self, before: ForceLaw, source: str) -> ForceLaw:
        """The law of the fitted constants, good for the thickness met."""
        low, high = self.range_m
        if high <= low * 1.02:
            low, high = low / 1.05, high * 1.05
        return _form(before).law(self.fit.values, self.h_ref_m, low, high, source)


def _form(law: ForceLaw) -> ForceForm:
    return next(f for f in FORMS if f.exponents == (0 if isinstance(law, LinearEdgeLaw) else 3) and f.edge)


def levels_of(law: ForceLaw) -> tuple[str, ...]:
    """Levels that a law has: a linear one has no exponents."""
    return ("directions", "all") if isinstance(law, LinearEdgeLaw) else LEVELS


def reference_m(block: ProductionResiduals) -> tuple[float, tuple[float, float]]:
    """Reference thickness, and least and largest mean chip thickness, m."""
    arcs = block.arcs()
    thickness = mean_thickness(arcs)
    at = float(np.exp(np.mean(np.log(force_thickness(arcs)))))
    return at, (float(np.min(thickness)), float(np.max(thickness)))


def constants_of(law: ForceLaw, h_ref_m: float, known: Mapping[str, float], level: str) -> Parameters:
    """The nine constants around the stated law, those of a level free.

    ``known``: Standard deviation by name where one is identified: of k relative, of m and e in SI. ``level``: Of
    :data:`LEVELS`.
    """
    items = []
    for item in _form(law).parameters(law, h_ref_m):
        sigma = item.prior_sigma
        if item.name in known:
            sigma = known[item.name] * (abs(item.nominal) if item.name in NAMES[:3] else 1.0)
        free = item.free and item.name in _FREE[level]
        items.append(replace(item, prior_sigma=max(sigma, 1e-12), free=free))
    return Parameters.of(items)


def condition_of(parameters: Parameters, block: ProductionResiduals, level: str) -> CutCondition:
    """Condition index of the free constants, the geometry eliminated with its priors."""
    x = parameters.nominal
    slope = parameters.slope(x)
    free = np.flatnonzero(parameters.free)
    J = (block.jacobian(x)[:, :, free] * slope[free]).reshape(-1, len(free))
    law = free < LAW
    info = J.T @ J
    inner = info[np.ix_(~law, ~law)] + np.eye(int(np.sum(~law)))
    cross = info[np.ix_(law, ~law)]
    left = info[np.ix_(law, law)] - cross @ np.linalg.solve(inner, cross.T)
    size = np.sqrt(np.maximum(np.diag(left), 1e-30))
    value, vector = np.linalg.eigh(left / np.outer(size, size))
    index = math.sqrt(max(float(value[-1]), 0.0) / max(float(value[0]), 1e-18))
    names = [parameters.names[i] for i in free[law]]
    close = value < max(float(value[-1]), 0.0) / MOST_INDEX**2
    # The least eigenvalue is named in any case: the message must name something where the limit is just passed.
    close[0] = True
    alike = tuple(name for i, name in enumerate(names) if np.any(np.abs(vector[i, close]) > _NAMED))
    return CutCondition(level, index, alike)


def row_error(block: Residuals, x: Float) -> Float:
    """Length of each stretch's force error over the length of its force, (rows,)."""
    if not isinstance(block, ProductionResiduals):
        raise InputError("a block of production holds stretches of runs", value=block.name)
    force = block.pieces.force
    out: Float = np.linalg.norm(force - block.predict(x), axis=1) / np.maximum(np.linalg.norm(force, axis=1), 1e-9)
    return out


def find(
    block: ProductionResiduals,
    law: ForceLaw,
    known: Mapping[str, float],
    *,
    run: Int,
    level: str = "auto",
    sensor: SensorAccuracy | None = None,
    runout_m: float = RUNOUT_M,
    growth_sigma: Float | None = None,
    seed: int = 0,
) -> ConstantEstimate:
    """Find constants.

    Args:
        block: The stretches; its reference thickness is set.
        known: See :func:`constants_of`.
        run: (n,) number of the run of each stretch: with three runs or more whole runs are held out.
        level: Of :data:`LEVELS`, or ``auto``: as many constants as the data tell apart.
        sensor: How true the force sensor is.
        runout_m: Runout that is considered where the tool has none stated.
        growth_sigma: (n,) share of the force by which one standard deviation of the tool's growth moves each stretch.

    Raises:
        InputError: The level asked for cannot be told apart; the message names the constants and their index.
    """
    h_ref, span = reference_m(block)
    geometry = block.geometry.parameters
    conditions = tuple(
        condition_of(constants_of(law, h_ref, known, name) + geometry, block, name) for name in levels_of(law)
    )
    chosen = _chosen(conditions, level)
    parameters = constants_of(law, h_ref, known, chosen) + geometry
    held_out = cross_validate(
        parameters,
        [block],
        needed=[p.name for p in geometry if p.free],
        error=row_error,
        folds=_folds(block, run, seed),
    )
    fit = solve_physical(parameters, block)
    runs = np.unique(run, return_inverse=True)[1].reshape(-1).astype(np.int64)
    if int(runs.max()) + 1 >= FEWEST_PARTS:
        fit = with_jackknife(fit, [block], [runs])
    moved = shown_by_sensor(block.pieces.force, block.pieces.axes, SensorAccuracy() if sensor is None else sensor)
    eccentric = runout_of_arcs(block.arcs(), law, max(runout_m, block.cutter.runout_m))
    worn = block.pieces.force * (np.zeros(len(run)) if growth_sigma is None else growth_sigma)[:, None]
    shared = considered(fit, [block], [np.concatenate([moved, eccentric[:, :, None], worn[:, :, None]], axis=2)])
    difference = _difference(fit, shared)
    return ConstantEstimate(added(fit, shared), chosen, conditions, h_ref, span, held_out, difference, block)


def _chosen(conditions: Sequence[CutCondition], level: str) -> str:
    if level != "auto":
        requested = next((c for c in conditions if c.level == level), None)
        if requested is None:
            names = ", ".join(c.level for c in conditions)
            raise InputError("there is no such set of constants for this law", value=level, limit=f"auto, {names}")
        if not requested.is_enough:
            raise InputError(
                f"the runs cannot tell {', '.join(requested.alike)} apart",
                value=f"condition index {requested.index:.0f}",
                limit=f"at most {MOST_INDEX:g}",
                hint="Add runs with other feeds, widths or depths, or leave --set constants out: what cannot be told "
                "apart keeps the value of the cell file",
            )
        return level
    best = conditions[0]
    if not best.is_enough:
        raise InputError(
            f"the runs cannot tell even the directions of the force apart: {', '.join(best.alike)}",
            value=f"condition index {best.index:.0f}",
            limit=f"at most {MOST_INDEX:g}",
            hint="Add runs with other widths of cut",
        )
    for condition in conditions[1:]:
        if not condition.is_enough:
            break
        best = condition
    return best.level


def _folds(block: ProductionResiduals, run: Int, seed: int) -> Folds:
    """Whole runs are held out where there are three or more, else whole contacts, else single stretches."""
    if len(np.unique(run)) >= 3:
        return Folds(parts={0: np.unique(run, return_inverse=True)[1].reshape(-1).astype(np.int64)})
    if len(np.unique(block.group)) >= 3:
        return Folds(seed=seed)
    count = len(block.group)
    if count < 2:
        raise InputError(
            "one steady stretch of a cut is too little to find constants and to hold any out",
            value=count,
            limit="at least 2",
            hint="Give more runs",
        )
    return Folds(parts={0: np.arange(count, dtype=np.int64) % min(5, count)})


def _difference(fit: Fit, shared: Float) -> ConstantDifference:
    """Data alone against the stated values: the prior is taken out of the fit again."""
    # `C_d = (P^-1 - 1)^-1 + G`, `x_d - x_0 = (P^-1 - 1)^-1 P^-1 (x - x_0)` in units of the priors, for the constants
    # with all else eliminated; `T = (x_d - x_0)^T C_d^-1 (x_d - x_0)` is chi square.
    law = fit.free_index < LAW
    count = int(np.sum(law))
    u = fit.parameters.coordinates(fit.values)[fit.free_index][law]
    P = fit.covariance[np.ix_(law, law)]
    # The prior is taken out again: with it in, the stated values would be compared with themselves.
    info = np.linalg.inv(P) - np.eye(count)
    value, vector = np.linalg.eigh(0.5 * (info + info.T))
    seen = value > 0.05  # what the data say next to nothing about is no difference
    if not np.any(seen):
        raise ModelError("the runs say nothing about the constants", value=float(value[-1]))
    V = vector[:, seen]
    alone = V @ np.diag(1.0 / value[seen]) @ V.T @ np.linalg.solve(P, u)
    C = np.diag(1.0 / value[seen]) + V.T @ shared[np.ix_(law, law)] @ V
    d = V.T @ alone
    statistic = float(d @ np.linalg.solve(C, d))
    wide = float(d @ np.linalg.solve(C + np.eye(len(d)), d))
    return ConstantDifference(
        float(scipy.stats.chi2.sf(statistic, len(d))), float(scipy.stats.chi2.sf(wide, len(d))), statistic, len(d)
    )

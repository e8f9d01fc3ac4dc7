"""Parts added to an arm where held-out poses confirm them: turns by weight, lost motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import MM, MRAD, URAD
from counterflex.identify.data.data_checks import check_enough
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.model import CellModel
from counterflex.identify.geometry.arm_parameters import ArmModel, ArmPriors, arm_model, with_lost_motion
from counterflex.identify.geometry.known_frames import KnownFrames
from counterflex.identify.kinematics.approach_sense import PRIOR_RAD, better, describe, seen_axes, senses
from counterflex.identify.kinematics.held_out import held_out
from counterflex.identify.kinematics.periodic_errors import GAIN
from counterflex.identify.kinematics.setup import CalibrationSetup, set_up
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.solve import solve
from counterflex.robot.model.calibration import LARGEST_M, LARGEST_RAD

# Priors of an arm's displacements that the data contradict, widened by their evidence. An arm whose zeros are off by
# some ten times the prior cannot be fitted within it: the residuals stay large, the standard deviations of the data are
# widened for that, and wide ones let the prior hold. Both are consistent with each other; their evidence (marginal
# likelihood, Laplace's approximation) says which pair of them is the better one::
#
# E = - sum_b n_b ln s_b - u^T u / 2 + ln det C / 2
#
# n_b numbers of block b and s_b its factor, u the values and C their covariance in units of the prior. Wider priors are
# tried where residuals or values are off, the best is refined for lengths, tilts and zeros of the axes, each for itself
# and never below what was stated: ``sigma^2 <- sigma^2 sum u^2 / sum (1 - C)``, the sum below being the number of
# values that the data determine.
#
# Source: MacKay, Bayesian interpolation, Neural Computation 4 (1992) 415.

OPTIONS: Final = ("evidence", "stated")
MISFIT: Final = 2.0
"""Factor of the stated standard deviations of the data above which wider priors are tried."""
OFF: Final = 3.0
"""Prior standard deviations of a value above which they are tried as well."""
_STEPS: Final = (4.0, 16.0, 64.0)
_ROUNDS: Final = 4
_AT_REST: Final = 1.2
_WIDEST: Final = 1.0 / 3.0
"""Share of the largest displacement of a cell file that a prior may reach."""
_LEAST: Final = 1e-3
_SURE: Final = 3.0
"""Gain of the evidence (natural logarithm) that wider priors need: odds of 20 to 1."""
GROUPS: Final = ("lengths", "tilts", "zeros of the axes")


@dataclass(frozen=True, eq=False)
class Widened:
    """A calibration with the priors that its data bear out."""

    priors: ArmPriors  # as stated, or wider
    setup: CalibrationSetup
    fit: Fit  # of its blocks
    remarks: tuple[str, ...]  # sentences on priors that the data contradict


def widened(
    priors: ArmPriors, setup: CalibrationSetup, fit: Fit, made: Callable[[ArmPriors], CalibrationSetup], option: str
) -> Widened:
    """Widen priors that the data contradict.

    ``made``: Returns the setup with other priors: same parameters in the same order. ``option``: ``evidence``, or
    ``stated`` to name such priors only.
    """
    if not _misfit(setup, fit):
        return Widened(priors, setup, fit, ())
    best = _Trial(priors, setup, fit)
    for factor in _STEPS:
        trial = best.other(made, _scaled(priors, (factor, factor, factor), priors))
        if trial.evidence <= best.evidence:
            break
        best = trial
    if best.priors != priors:
        best = _refined(best, made, priors)
    # Wider priors always fit better; the evidence already charges for it, and 20 to 1 keeps noise from widening them.
    if best.evidence - _evidence(setup, fit) < _SURE or best.priors == priors:
        return Widened(priors, setup, fit, ())
    if option == "stated":
        remark = (
            f"The stated priors bind: {_described(priors, best)} would leave {_median_mm(best.setup, best.fit):.3g} mm "
            f"in the median in place of {_median_mm(setup, fit):.3g} mm. They were kept as requested."
        )
        return Widened(priors, setup, fit, (remark,))
    remark = (
        f"The data contradict the priors, which were widened by their evidence: {_described(priors, best)}. The median "
        f"residual is {_median_mm(best.setup, best.fit):.3g} mm; {_median_mm(setup, fit):.3g} mm with the stated ones."
    )
    return Widened(best.priors, best.setup, best.fit, (remark,))


class _Trial:
    """Priors with their fit and its evidence."""

    def __init__(self, priors: ArmPriors, setup: CalibrationSetup, fit: Fit) -> None:
        self.priors, self.setup, self.fit = priors, setup, fit
        self.evidence = _evidence(setup, fit)

    def other(self, made: Callable[[ArmPriors], CalibrationSetup], priors: ArmPriors) -> _Trial:
        """The same data with other priors, fitted from here."""
        setup = made(priors)
        start = self.fit.values
        return _Trial(priors, setup, solve(setup.parameters.with_fixed(setup.local), setup.blocks, start=start))


def _refined(best: _Trial, made: Callable[[ArmPriors], CalibrationSetup], stated: ArmPriors) -> _Trial:
    """Each group of priors as wide as its values are, with their uncertainty."""
    for _ in range(_ROUNDS):
        sizes = tuple(_size(best.setup, best.fit, places) for places in best.setup.groups)
        if max(max(s, 1.0 / s) for s in sizes) < _AT_REST:
            break
        trial = best.other(made, _scaled(best.priors, sizes, stated))
        if trial.evidence <= best.evidence:
            break
        best = trial
    return best


def _misfit(setup: CalibrationSetup, fit: Fit) -> bool:
    u = np.abs(setup.parameters.coordinates(fit.values))
    far = any(len(places) and float(np.max(u[places])) > OFF for places in setup.groups)
    return far or max(fit.sigma_factors, default=1.0) > MISFIT


def _size(setup: CalibrationSetup, fit: Fit, places: Int) -> float:
    """Root mean square of the values that the data determine, in units of the prior."""
    u = setup.parameters.coordinates(fit.values)[places]
    variance = (fit.sigma[places] / np.array([setup.parameters.items[i].unit_step for i in places])) ** 2
    determined = float(np.sum(np.clip(1.0 - variance, 0.0, 1.0)))
    return max(float(np.sqrt(np.sum(u**2) / determined)), _LEAST) if determined >= 1.0 else 1.0


def _evidence(setup: CalibrationSetup, fit: Fit) -> float:
    known = np.array([p.free and p.has_prior for p in fit.parameters], dtype=np.bool_)
    u = fit.parameters.coordinates(fit.values)[known]
    spread = sum(
        float(np.sum(w)) * b.sigma.shape[1] * float(np.log(s))
        for b, w, s in zip(setup.blocks, fit.weights, fit.sigma_factors, strict=True)
    )
    return float(0.5 * np.linalg.slogdet(fit.covariance)[1] - spread - 0.5 * float(u @ u))


def _scaled(priors: ArmPriors, factors: tuple[float, ...], stated: ArmPriors) -> ArmPriors:
    """Priors times factors, at least as stated and no wider than a cell file may say."""
    length, tilt, zero = factors
    most_m, most_rad = _WIDEST * LARGEST_M, _WIDEST * LARGEST_RAD
    return replace(
        priors,
        length_m=float(np.clip(priors.length_m * length, stated.length_m, max(most_m, stated.length_m))),
        angle_rad=float(np.clip(priors.angle_rad * tilt, stated.angle_rad, max(most_rad, stated.angle_rad))),
        zero_rad=float(np.clip(priors.of_zero * zero, stated.of_zero, max(most_rad, stated.of_zero))),
    )


def _described(stated: ArmPriors, best: _Trial) -> str:
    sizes = (
        (stated.length_m, best.priors.length_m, MM, "mm"),
        (stated.angle_rad, best.priors.angle_rad, MRAD, "mrad"),
        (stated.of_zero, best.priors.of_zero, MRAD, "mrad"),
    )
    changes = [
        f"{name} from {before / unit:.3g} to {now / unit:.3g} {word}"
        for name, (before, now, unit, word) in zip(GROUPS, sizes, strict=True)
        if now > before
    ]
    zeros = best.setup.groups[2]
    if not len(zeros):
        return ", ".join(changes)
    values: Float = best.fit.values[zeros]
    return f"{', '.join(changes)} (largest zero found {float(np.max(np.abs(values))) / MRAD:.3g} mrad)"


def _median_mm(setup: CalibrationSetup, fit: Fit) -> float:
    lengths = [np.linalg.norm((r * b.sigma)[:, :3], axis=1) for b, r in zip(setup.blocks, fit.residuals, strict=True)]
    return float(np.median(np.concatenate(lengths))) / MM


ENOUGH: Final = 8
"""Fewest poses to which an axis came from either side, for its lost motion to be looked for."""


def priors_of(options: Mapping[str, Any]) -> ArmPriors:
    """Standard deviations from the recipe's settings."""
    return ArmPriors(
        length_m=float(options["length_sigma_mm"]) * MM,
        angle_rad=float(options["angle_sigma_mrad"]) * MRAD,
        mass=float(options["mass_sigma"]),
        periodic_rad=float(options["periodic_sigma_urad"]) * URAD,
        sag_rad=float(options["sag_sigma_mrad"]) * MRAD,
    )


def model_of_data(cell: CellModel, data: Sequence[Dataset], priors: ArmPriors, sag: str, *, tied: bool) -> ArmModel:
    """The arm with the displacements that the kinds of data can tell from their own frames."""
    kinds = {d.kind for d in data}
    touching = bool(kinds & {"distances", "planes"})
    return arm_model(
        cell, priors, sag=sag, base=tied or "fiducials" in kinds, flange=tied or touching, tool=tied or touching
    )


def with_turns(
    cell: CellModel,
    setup: CalibrationSetup,
    fit: Fit,
    data: Sequence[Dataset],
    holdout: Sequence[Dataset],
    priors: ArmPriors,
    folds: int,
    known: KnownFrames | None,
) -> tuple[CalibrationSetup, Fit, tuple[str, ...]]:
    """The fit with turns of axes 2 and 3 by own weight where folds of the data are predicted better, else as given."""
    model = model_of_data(cell, [*data, *holdout], priors, "axes", tied=known is not None)
    wider = set_up(cell, model, data, holdout, known=known)
    try:
        check_enough(wider.parameters, wider.blocks)
    except InputError:
        return setup, fit, ("Too few poses to find what own weight turns axes 2 and 3 by; measure more of them.",)
    more = refitted(setup, fit, wider)
    without, with_error = held_out(setup, (), folds, fit).mean()[0], held_out(wider, (), folds, more).mean()[0]
    compared = f"the mean error of poses held out is {with_error / MM:.3g} mm with and {without / MM:.3g} mm without"
    if with_error > (1.0 - GAIN) * without:
        return setup, fit, (f"The rotation of axes 2 and 3 under own weight is not determined: {compared}.",)
    return wider, more, (f"Own weight turns axes 2 and 3: {compared}.",)


def with_lost(
    cell: CellModel,
    setup: CalibrationSetup,
    fit: Fit,
    data: Sequence[Dataset],
    holdout: Sequence[Dataset],
    folds: int,
    known: KnownFrames | None,
) -> tuple[CalibrationSetup, Fit, tuple[str, ...]]:
    """The fit with lost motion by the sense of approach, of the axes that show it, where poses held out bear it out.

    ``data``: Fitted datasets, with the channel ``approach``.
    """
    directions = np.concatenate([s for d in data if (s := senses(d)) is not None])
    axes = [
        a
        for a in range(directions.shape[1])
        if min(np.sum(directions[:, a] > 0.0), np.sum(directions[:, a] < 0.0)) >= ENOUGH
    ]
    wider, more = setup, fit
    for _ in range(2):  # all axes, then those that show it
        if not axes:
            return setup, fit, ("Lost motion by the direction of approach is not visible in any axis.",)
        wider = set_up(cell, with_lost_motion(setup.model, axes, PRIOR_RAD), data, holdout, known=known)
        check_enough(wider.parameters, wider.blocks)
        more = refitted(setup, fit, wider)
        axes = list(seen_axes(wider.model.layout.lost, more))
        if axes == list(wider.model.layout.lost):
            break
    if not axes:
        return setup, fit, ("Lost motion by the direction of approach is not visible in any axis.",)
    sure, compared = better(held_out(wider, holdout, folds, more), held_out(setup, holdout, folds, fit))
    description = describe(wider.model.layout.lost, more, sorted(wider.model.layout.lost))
    if not sure:
        return setup, fit, (f"Lost motion by the direction of approach was not kept ({description}): {compared}.",)
    return wider, more, (f"Lost motion by the sense of approach, half of it: {description}; {compared}.",)


def refitted(setup: CalibrationSetup, fit: Fit, wider: CalibrationSetup) -> Fit:
    """The fit of a setup whose arm has more parameters, behind those of the one before; frames as they were."""
    first, added = len(setup.model.parameters), len(wider.model.parameters) - len(setup.model.parameters)
    start = np.concatenate([fit.values[:first], np.zeros(added), fit.values[first:]])
    return solve(wider.parameters.with_fixed(wider.local), wider.blocks, start=start)

"""What a geometric calibration adds to an arm where poses held out bear it out: turns by weight, lost motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

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
from counterflex.identify.kinematics.setup import Setup, set_up
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.solve import solve

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
        cell,
        priors,
        sag=sag,
        base=tied or "fiducials" in kinds,
        flange=tied or touching,
        tool=tied or touching,
    )


def with_turns(
    cell: CellModel,
    setup: Setup,
    fit: Fit,
    data: Sequence[Dataset],
    holdout: Sequence[Dataset],
    priors: ArmPriors,
    folds: int,
    known: KnownFrames | None,
) -> tuple[Setup, Fit, tuple[str, ...]]:
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
    setup: Setup,
    fit: Fit,
    data: Sequence[Dataset],
    holdout: Sequence[Dataset],
    folds: int,
    known: KnownFrames | None,
) -> tuple[Setup, Fit, tuple[str, ...]]:
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


def refitted(setup: Setup, fit: Fit, wider: Setup) -> Fit:
    """The fit of a setup whose arm has more parameters, behind those of the one before; frames as they were."""
    first, added = len(setup.model.parameters), len(wider.model.parameters) - len(setup.model.parameters)
    start = np.concatenate([fit.values[:first], np.zeros(added), fit.values[first:]])
    return solve(wider.parameters.with_fixed(wider.local), wider.blocks, start=start)

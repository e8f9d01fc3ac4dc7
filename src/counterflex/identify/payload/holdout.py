"""What a flange sensor's constants are worth on orientations that were not used: forces and moments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from counterflex.core.progress import Progress, silent
from counterflex.identify.payload.parameters import needed
from counterflex.identify.payload.residuals import SensorReadings, force_error, moment_error
from counterflex.identify.solver.holdout import HeldOut, cross_validate
from counterflex.identify.solver.parameters import Parameters
from counterflex.identify.solver.solve import solve


def held_out_forces(chosen: Parameters, blocks: Sequence[SensorReadings], progress: Progress = silent) -> HeldOut:
    """Force errors by folds; the nominal ones with the zero found on the training part."""
    return cross_validate(chosen, blocks, needed=needed(), error=force_error, progress=progress)


def held_out_moments(
    force: HeldOut,
    chosen: Parameters,
    blocks: Sequence[SensorReadings],
    unseen: Sequence[SensorReadings],
    progress: Progress = silent,
) -> HeldOut:
    """Moment errors of the same rows by the same fits.

    ``unseen``: Readings of a separate file, or empty for folds of ``blocks``.
    """
    zero_only = chosen.with_fixed([name for name in chosen.names if name not in needed()])
    nominal, identified = np.empty(len(force.row)), np.empty(len(force.row))
    for fold, fit in enumerate(force.fits):
        mine = [(force.block == i) & (force.fold == fold) for i in range(len(unseen or blocks))]
        training = list(blocks)
        if not unseen:
            training = [
                b.subset(~np.isin(np.arange(len(b.group)), force.row[m])) for b, m in zip(blocks, mine, strict=True)
            ]
        before = solve(zero_only, training).values
        for block, m in zip(unseen or blocks, mine, strict=True):
            if np.any(m):
                rows = block.subset(np.isin(np.arange(len(block.group)), force.row[m]))
                identified[m], nominal[m] = moment_error(rows, fit.values), moment_error(rows, before)
        progress((fold + 1) / len(force.fits))
    return replace(force, nominal=nominal, identified=identified)

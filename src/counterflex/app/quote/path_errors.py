"""Errors of the path of the tool over cells that differ by all that is not known of one, as a plan's interval has them.

The draws are those of :mod:`counterflex.app.prediction_interval`, at nodes of the path: what the plan predicts there,
more or less of what the tool swings, and what each unknown leaves. A group of unknowns may count less, as after it was
measured. Each draw is as much larger or smaller as calibration moves its path error.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from counterflex.app.cut_points import CutPoints, points_of_plan
from counterflex.app.prediction_interval import (
    MODEL,
    SERVO,
    Kept,
    calibrated,
    calibration_of,
    swings,
    unknown_in_part,
)
from counterflex.app.unknowns import sources
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.evaluate.path_error.contacts import Nodes, nodes_of
from counterflex.files.cell.cell import Cell
from counterflex.plan.plan import Plan
from counterflex.robot.elasticity.compliance import shares

ALL: Kept = MappingProxyType({})
"""Everything that is not known counts as it is."""


@dataclass(frozen=True, eq=False)
class PathErrors:
    """Drawn errors of the tool at nodes of a path."""

    plan: Plan
    nodes: Nodes
    error_m: Float  # (draws, k, 3) m, part axes, actual - nominal

    def first(self, draws: int) -> PathErrors:
        """The first of the draws."""
        return replace(self, error_m=self.error_m[:draws])


def points_of(plan: Plan, cell: Cell, program: str) -> CutPoints:
    """Points of the cut at which the unknowns are drawn.

    Raises:
        InputError: The program cuts nothing, or the robot holds the part.
    """
    points = None if np.all(np.isnan(plan.deviation_compensated_part)) else points_of_plan(plan, cell, program)
    if points is None:
        raise InputError(
            "no error of the path can be drawn",
            where=program,
            value="the robot holds the part" if cell.holds_part else "the program cuts nothing",
            limit="a program that cuts a part on the table",
        )
    return points


def path_errors(plan: Plan, cell: Cell, points: CutPoints, *, compensated: bool = True, kept: Kept = ALL) -> PathErrors:
    """Draw the errors of the program as it is, or compensated.

    Args:
        points: Of the plan.
        kept: Share of each unknown that counts, by the word of its recipe; 1 where it is not listed.
    """
    nodes = nodes_of(plan.path, plan.deflection_part[:, :3])
    deviation = plan.deviation_compensated_part if compensated else plan.deviation_nominal_part
    swing, more = swings(plan, cell, deviation)
    unknown = unknown_in_part(plan, cell, points, kept)
    # unknowns change with posture and force, which the points follow; between them they are interpolated by time
    time = plan.path.time_s
    at = np.interp(time[nodes.row], time[points.row], np.arange(len(points.row), dtype=np.float64))
    low = np.minimum(at.astype(np.int64), max(len(points.row) - 2, 0))
    share, high = (at - low)[:, None], np.minimum(low + 1, len(points.row) - 1)
    error = unknown[:, low] + share * (unknown[:, high] - unknown[:, low])
    settled = kept.get(MODEL, 1.0) * (deviation - swing)
    error += settled[nodes.row] + (1.0 + more) * swing[nodes.row]
    if factors := calibration_of(cell):
        whole = unknown + settled[points.row] + (1.0 + more) * swing[points.row]
        drawn = points.sizes(whole @ cell.T_base_part[:3, :3].T)
        moved = calibrated(drawn, factors.after if compensated else factors.before)
        error *= (moved / np.where(drawn > 0.0, drawn, 1.0))[:, None, None]
    return PathErrors(plan, nodes, error)


def doubts(cell: Cell, points: CutPoints) -> Mapping[str, float]:
    """Root mean square of what the unknowns of each recipe leave, as a share of that of the deflection."""
    bend = shares(cell.chain, points.q, points.w_tcp_base)[..., :3].sum(axis=1)
    size = float(np.sqrt(np.mean(np.sum(bend**2, axis=-1))))
    square: dict[str, float] = {}
    for one in sources(cell, points):
        recipe = one.recipe.split()[0]
        square.setdefault(recipe, 0.0)
        if one.displacements is not None:
            square[recipe] += float(np.mean(np.sum(one.displacements**2, axis=-1)))
    square.setdefault(SERVO, 0.0)
    return {recipe: float(np.sqrt(value)) / size if size > 0.0 else 0.0 for recipe, value in square.items()}

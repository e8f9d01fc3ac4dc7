"""What the predicted path errors of a plan do not know: an interval that nine of ten such cells lie in.

The error of the tool at a point is what the plan predicts there and what each unknown of the cell
(:mod:`counterflex.app.unknowns`) leaves there, drawn from what is known of it. Beside the unknown values there are two
errors of the form of the model, as isotropic parts of the deflection:

- :data:`STRUCTURE` of it everywhere: Haehn and Weigold 2020 leave 6 % of the deflection after identification;
- :data:`DRIVES` of it where the force changes, unless the loop gains of the drives are known: how far a motor yields
  before its loop has answered.

Of each draw the figure is taken as of the plan: 99.7 % of the path in the cut stay below it, square to the feed. The
interval is of a plan's own figures, so it holds no error of the program, of the tool or of the part's clamping.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from counterflex.app.cut_points import CutPoints, points_of_plan
from counterflex.app.lowest_mode import at_largest_force
from counterflex.app.unknown_stiffness import ROBOTS, Expected, expected
from counterflex.app.unknowns import sources
from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell
from counterflex.plan.plan import Plan
from counterflex.robot.elasticity.compliance import shares

STRUCTURE: Final = 0.06
"""Of the deflection, in a direction of its own."""
DRIVES: Final = 0.10
"""The same near a change of force: a KR 300 with unknown drives left 0.255 instead of 0.114 mm of 1.65 mm."""
_CHANGE_S: Final = 0.3
"""So long before and after a row its force is compared with."""
_CHANGED: Final = 0.3
"""Share of the largest deflection that counts as a change."""
_SEED: Final = 10


def intervals(plan: Plan, cell: Cell) -> dict[str, Expected]:
    """Predicted path errors with what is not known.

    Args:
        plan: The plan, with its predictions.
        cell: The cell it was made for.

    Returns:
        By name, ``nominal`` and ``compensated``: 99.7 % of the path error across the feed, m; empty where nothing is
        cut, nothing was predicted, or the robot holds the part (which this does not count).
    """
    if cell.holds_part:
        return {}
    points = points_of_plan(plan, cell, "the program")
    if points is None or np.all(np.isnan(plan.deviation_compensated_part)):
        return {}
    off = _unknown_displacement(plan, cell, points)
    R_base_part = cell.T_base_part[:3, :3]
    out = {}
    for name, deviation in (
        ("nominal", plan.deviation_nominal_part),
        ("compensated", plan.deviation_compensated_part),
    ):
        predicted = deviation[points.row] @ R_base_part.T
        out[name] = expected(points.sizes(predicted + off), points.of)
    return out


def with_intervals(figures: dict[str, Any], plan: Plan, cell: Cell) -> dict[str, Any]:
    """Figures of a plan with the interval of each predicted error beside it.

    Args:
        figures: With ``predicted_nominal`` and ``predicted_compensated`` where they were predicted; left as it is.
        plan: The plan.
        cell: The cell.

    Returns:
        The same with ``p997_90_mm``, the two ends, in each of the two, and with the lowest mode that was taken.
    """
    out = dict(figures) | {"lowest_mode": at_largest_force(cell, plan).shown}
    for name, one in intervals(plan, cell).items():
        ends = [round(one.low_m / MM, 4), round(one.high_m / MM, 4)]
        out[f"predicted_{name}"] = {**figures[f"predicted_{name}"], "p997_90_mm": ends}
    return out


def interval_text(error: dict[str, Any]) -> str:
    """``0.05 to 0.31 mm in nine of ten such cells``; empty where there is none."""
    if "p997_90_mm" not in error:
        return ""
    low, high = error["p997_90_mm"]
    return f"{low:.2f} to {high:.2f} mm in nine of ten such cells"


def _unknown_displacement(plan: Plan, cell: Cell, points: CutPoints) -> Float:
    """(draws, n, 3) m, base axes: what all unknowns together leave."""
    rng = np.random.default_rng(_SEED)
    bend = np.linalg.norm(shares(cell.chain, points.q, points.w_tcp_base)[..., :3].sum(axis=1), axis=1)
    out: Float = STRUCTURE * bend[:, None] * rng.standard_normal((ROBOTS, 1, 3))
    if cell.chain.servo is None:
        changing = bend * _changing(plan, points)
        out = out + DRIVES * changing[:, None] * rng.standard_normal((ROBOTS, 1, 3))
    for one in sources(cell, points):
        if one.displacements is not None:
            out = out + one.displacements
    return out


def _changing(plan: Plan, points: CutPoints) -> Float:
    """(n,) 1 where the force changes within :data:`_CHANGE_S`, else 0."""
    size, time = np.linalg.norm(plan.deflection_part[:, :3], axis=1), plan.path.time_s
    begin = np.searchsorted(time, time[points.row] - _CHANGE_S)
    end = np.searchsorted(time, time[points.row] + _CHANGE_S, side="right")
    most = float(size.max(initial=0.0))
    return np.array(
        [float(np.ptp(size[a:b]) > _CHANGED * most) for a, b in zip(begin.tolist(), end.tolist(), strict=True)]
    )

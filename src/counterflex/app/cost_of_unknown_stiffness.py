"""What a robot of unknown stiffness yields in the cut of a program, by its class: said before a plan is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.app.inputs import Job, faults_in, setting_of
from counterflex.app.unknown_stiffness import Expected, drawn_deflections, expected, refusal
from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.class_stiffness import prior_of
from counterflex.plan.inputs import Inputs, solve_joints
from counterflex.plan.plan import Plan
from counterflex.plan.undisturbed_cut import undisturbed_cut
from counterflex.robot.elasticity.axis_springs import axis_deflections
from counterflex.robot.model.class_prior import ClassPrior

_POINTS: Final = 1000
"""Points of the cut that are looked at, evenly along it."""
_SHARE: Final = 0.997


def require_stiffness_for(job: Job, cell: Cell, progress: Progress = silent) -> None:
    """Refuse to plan a program on axes of unknown stiffness.

    Args:
        job: The program.
        cell: The cell.
        progress: Progress callback, fraction 0 to 1.

    Raises:
        InputError: An axis has no stiffness; says what it yields in this cut, and what to do.
        CounterflexError: The program does not fit the cell otherwise.
    """
    if cell.unknown_axes:
        raise refusal(cell, cost_in_cut(job, cell, progress))


def cost_in_cut(job: Job, cell: Cell, progress: Progress = silent) -> Expected | None:
    """Deflection square to the path by axes of unknown stiffness, below which 99.7 % of the path in the cut stay.

    The force is that of the undisturbed cut, the deflection at rest: ``sum_i J_i (J_i^T w) / k_i`` with k_i drawn from
    the robot's class.

    Args:
        job: The program.
        cell: The cell.
        progress: Progress callback, fraction 0 to 1.

    Returns:
        Its distribution; None where the class says nothing or nothing is cut.
    """
    try:
        prior = prior_of(cell.nominal_robot, cell.tables.robot)
    except InputError:
        return None
    setting = setting_of(cell, chain=cell.chain)
    path, line = job.path, job.line_of_motion[job.path.motion]
    with faults_in(job):
        q = solve_joints(path, line, setting).q
        cut = undisturbed_cut(Inputs(path, line, cell.stock(), setting, q), progress)
    name = Path(job.program.name).name
    what = f"in {name} ({100.0 * _SHARE:g} % of the path in the cut)"
    return cost_along(cell, prior, path.p_part_tcp, q, cut.w_tcp_part, cut.contact, what=what)


def cost_along(
    cell: Cell,
    prior: ClassPrior,
    p_part: Float,
    q: Float,
    w_tcp_part: Float,
    contact: Bool,
    *,
    what: str,
    beyond_median: bool = False,
) -> Expected | None:
    """The same along a path whose forces are known.

    Args:
        cell: The cell; its axes that nothing, or only their class, is known of yield.
        prior: Of its class.
        p_part: (n, 3) m.
        q: (n, 6) rad.
        w_tcp_part: (n, 6) N, N m, about the tip, part axes.
        contact: (n,) whether material is cut.
        what: What the length is, for messages.
        beyond_median: What a compensation with the median of the class leaves, not the whole.
    """
    axes = cell.unknown_axes if cell.class_stiffness is None else cell.class_stiffness.axes
    rows = np.flatnonzero(contact)
    rows = rows[:: max(1, len(rows) // _POINTS)]
    if not len(rows):
        return None
    step = np.diff(p_part, axis=0, prepend=p_part[:1])[rows]
    length = np.linalg.norm(step, axis=1, keepdims=True)
    along = step / np.where(length > 0.0, length, 1.0)
    R = cell.T_base_part[:3, :3]
    w = w_tcp_part[rows].reshape(-1, 2, 3) @ R.T
    per_stiffness = axis_deflections(cell.chain, q[rows], w.reshape(-1, 6), axes) @ R
    per_stiffness -= np.sum(per_stiffness * along[:, None, :], axis=2, keepdims=True) * along[:, None, :]
    d = drawn_deflections(prior, per_stiffness, axes)
    if beyond_median:
        d -= np.einsum("a,nad->nd", 1.0 / prior.median_nm_per_rad[list(axes)], per_stiffness)
    sizes = np.linalg.norm(d, axis=2)
    weights = np.broadcast_to(np.maximum(length[:, 0], 1e-12), sizes.shape)
    large = np.quantile(sizes, _SHARE, axis=1, weights=weights, method="inverted_cdf")
    return expected(large, what)


def left_by_class(plan: Plan, cell: Cell) -> Expected | None:
    """What a plan that stands on the median of the robot's class leaves of the deflection, by the spread of the class.

    Args:
        plan: The plan.
        cell: The cell, with what its class gave it.

    Returns:
        Deflection square to the path that stays, below which 99.7 % of the path in the cut stay; None where nothing is
        assumed or nothing is cut.
    """
    given = cell.class_stiffness
    if given is None:
        return None
    what = "of what the class does not know remains"
    p_part, q, w = plan.path.p_part_tcp, plan.q, plan.w_tcp_part
    return cost_along(cell, given.prior, p_part, q, w, plan.cutting, what=what, beyond_median=True)


def assumed(plan: Plan, cell: Cell) -> dict[str, Any]:
    """What a summary says of a stiffness that the robot's class gave; empty where it gave none.

    Args:
        plan: The plan.
        cell: The cell.
    """
    given, left = cell.class_stiffness, left_by_class(plan, cell)
    if given is None:
        return {}
    axes = list(given.axes)
    out: dict[str, Any] = {
        "axes": [axis + 1 for axis in axes],
        "from": "the robot's class: median of published robots, scaled by payload and reach",
        "median_nm_per_rad": [float(f"{value:.3g}") for value in given.prior.median_nm_per_rad[axes]],
        "factor_of_90_percent": [round(float(value), 2) for value in given.prior.factor[axes]],
    }
    if left is not None:
        out["left_mm"] = {
            "median": round(left.median_m / MM, 3),
            "of_90_percent": [round(left.low_m / MM, 3), round(left.high_m / MM, 3)],
        }
    return {"assumed": {"stiffness": out}}

"""What a robot of unknown stiffness yields in the cut of a program, by its class: said before a plan is refused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from counterflex.app.cut_points import points_of_plan, points_of_program
from counterflex.app.inputs import Job
from counterflex.app.unknown_stiffness import Expected, drawn_deflections, expected, refusal, unknown_stiffness
from counterflex.app.unknowns import sources
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.class_stiffness import prior_of
from counterflex.plan.plan import Plan
from counterflex.robot.elasticity.axis_springs import axis_deflections


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
    points = points_of_program(job, cell, progress)
    if points is None:
        return None
    per_stiffness = axis_deflections(cell.chain, points.q, points.w_tcp_base, cell.unknown_axes)
    return expected(points.sizes(drawn_deflections(prior, per_stiffness, cell.unknown_axes)), points.of)


@dataclass(frozen=True)
class Left:
    """What a plan on the median of a class leaves, by the spread of the class and whatever else is not known.

    Attributes:
        remaining: Deviation square to the path that stays.
        worse: Share of the robots of the class of which more stays than without compensation.
    """

    remaining: Expected
    worse: float


def left_by_class(plan: Plan, cell: Cell) -> Left | None:
    """What a plan that stands on the median of the robot's class leaves, by all that is not known of such a cell.

    Args:
        plan: The plan.
        cell: The cell, with what its class gave it.

    Returns:
        Deviation square to the path that stays, at rest, below which 99.7 % of the path in the cut stay; None where
        nothing is assumed or nothing is cut.
    """
    given, points = cell.class_stiffness, points_of_plan(plan, cell, "the program")
    if given is None or points is None:
        return None
    total = sum(
        (one.displacements for one in sources(cell, points) if one.displacements is not None), start=np.zeros(3)
    )
    per_stiffness = axis_deflections(cell.chain, points.q, points.w_tcp_base, given.axes)
    corrected = np.sum(per_stiffness / given.prior.median_nm_per_rad[list(given.axes), None], axis=1)
    after, before = points.sizes(total), points.sizes(total + corrected)
    return Left(expected(after, points.of), float(np.mean(after > before)))


def remarks(plan: Plan, cell: Cell) -> list[str]:
    """Warnings about what is not known of the stiffness, or only assumed.

    Args:
        plan: The plan.
        cell: The cell.
    """
    left = left_by_class(plan, cell)
    return unknown_stiffness(cell, 0.0 if left is None else left.worse)


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
        size = left.remaining
        out["left_mm"] = {
            "median": round(size.median_m / MM, 3),
            "of_90_percent": [round(size.low_m / MM, 3), round(size.high_m / MM, 3)],
        }
        out["worse_than_uncompensated"] = round(left.worse, 2)
    return {"assumed": {"stiffness": out}}

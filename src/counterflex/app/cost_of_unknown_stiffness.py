"""Deflection of a robot of unknown stiffness in the cut of a program, by its class; told before a plan is refused."""

from __future__ import annotations

from typing import Any

from counterflex.app.cut_points import points_of_program
from counterflex.app.inputs import Job
from counterflex.app.unknown_stiffness import Expected, drawn_deflections, expected, refusal
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.class_stiffness import prior_of
from counterflex.robot.elasticity.chain import axis_deflections


def require_stiffness_for(job: Job, cell: Cell, progress: Progress = silent) -> None:
    """Refuse to plan a program on axes of unknown stiffness.

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


def assumed(cell: Cell) -> dict[str, Any]:
    """Return what a summary says of stiffness and drives that the robot's class gave; empty where it gave none."""
    given, drives = cell.class_stiffness, cell.class_drives
    out: dict[str, Any] = {}
    if given is not None:
        axes = list(given.axes)
        stiffness = {
            "axes": [axis + 1 for axis in axes],
            "from": "the robot's class: median of published robots, scaled by payload and reach",
            "median_nm_per_rad": [float(f"{value:.3g}") for value in given.prior.median_nm_per_rad[axes]],
            "factor_of_90_percent": [round(float(value), 2) for value in given.prior.factor[axes]],
        }
        out["assumed"] = {"stiffness": stiffness}
    if drives is not None:
        out["assumed_drives"] = drives.shown
    return out

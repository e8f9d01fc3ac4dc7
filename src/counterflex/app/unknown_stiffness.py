"""Robots whose stiffness nobody has measured: what that costs, and no plan on it unless it is asked for.

A robot without stiffness is not rigid: what it yields is missing from every prediction and correction. How much that
is, its class says (:mod:`counterflex.robot.model.class_prior`), with the interval that nine of ten robots lie in.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, InputError
from counterflex.core.next_command import next_command
from counterflex.core.units import MM
from counterflex.cutting.stock import HeightMap
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.class_stiffness import axis_names, prior_of
from counterflex.geometry import pose
from counterflex.path.toolpath import tool_orientation
from counterflex.robot.elasticity.chain import axis_deflections
from counterflex.robot.kinematics import inverse
from counterflex.robot.model.class_prior import ClassPrior

FORCE_N: Final = 500.0
"""Force of a roughing cut, for what is said without a program."""
UNDER_FORCE: Final = f"under {FORCE_N:g} N at a corner of the blank, in the softest of the base axes"
ROBOTS: Final = 1000
"""Robots that are drawn."""
_SEED: Final = 1000
_QUANTILES: Final = (0.5, 0.05, 0.95)
OPTION: Final = "--assume-class"


@dataclass(frozen=True)
class Expected:
    """A length that is known by its distribution over the robots of a class."""

    median_m: float
    low_m: float
    high_m: float
    of: str

    @property
    def shown(self) -> str:
        """As it is printed: ``0.62 mm (0.21 to 1.90 mm ...)``."""
        median, low, high = (f"{value / MM:.2f}" for value in (self.median_m, self.low_m, self.high_m))
        return f"{median} mm ({low} to {high} mm in nine of ten robots of this class)"


def expected(sizes_m: Float, of: str) -> Expected:
    """Median and 90 % interval of a length drawn for many robots.

    Args:
        sizes_m: (robots,) m.
    """
    median, low, high = (float(value) for value in np.quantile(sizes_m, _QUANTILES))
    return Expected(median, low, high, of)


def drawn_deflections(prior: ClassPrior, per_stiffness: Float, axes: tuple[int, ...]) -> Float:
    """Deflections of robots of a class.

    Args:
        per_stiffness: (n, axes, 3) N m2/rad, see :func:`counterflex.robot.elasticity.chain.axis_deflections`.
        axes: Numbers 0..5 of the second index.

    Returns:
        (robots, n, 3) m, base axes.
    """
    compliance = 1.0 / prior.drawn(ROBOTS, seed=_SEED)[:, list(axes)]
    out: Float = np.einsum("ra,nad->rnd", compliance, per_stiffness)
    return out


def corner_of_blank(cell: Cell) -> Float:
    """(6,) rad, posture at the first corner of the blank's top. Raises ReachError where it is out of reach."""
    stock = cell.stock()
    corner = np.array([[stock.x_m()[0], stock.y_m()[0], _top(stock)]])
    posture = cell.tables.posture
    Rs_part_tcp = tool_orientation(np.array([[0.0, 0.0, 1.0]]), posture.rotation_about_tool_rad)
    Ts_base_hand = cell.hand_poses(pose.make(Rs_part_tcp, corner))
    q: Float = inverse.inverse_path(cell.controller_chain, Ts_base_hand, posture.branch).q[0]
    return q


def _top(stock: HeightMap) -> float:
    return float(stock.z.max())


def cost_at_blank(cell: Cell) -> Expected | None:
    """Estimate the deflection of axes of unknown stiffness at a corner of the blank under 500 N, softest direction.

    None where the class says nothing, or the file describes no blank that can be reached.
    """
    axes = cell.unknown_axes
    try:
        prior, q = prior_of(cell.nominal_robot, cell.tables.robot), corner_of_blank(cell)
    except CounterflexError:
        return None
    w = np.zeros((3, 6))
    w[:, :3] = FORCE_N * np.eye(3)
    per_stiffness = axis_deflections(cell.chain, np.tile(q, (3, 1)), w, axes)
    sizes = np.linalg.norm(drawn_deflections(prior, per_stiffness, axes), axis=2)
    return expected(sizes.max(axis=1), UNDER_FORCE)


def why_no_prior(cell: Cell) -> str:
    """Return why the class of a robot says nothing about it; empty where it does."""
    try:
        prior_of(cell.nominal_robot, cell.tables.robot)
    except InputError as fault:
        return str(fault)
    return ""


def measure_stiffness(cell: Cell) -> str:
    """Return the command that proposes pulls for the stiffness of a cell."""
    return next_command("identify stiffness", propose=30, cell=cell.path, out="pulls")


def refusal(cell: Cell, cost: Expected | None) -> InputError:
    """The error of a job that would take axes of unknown stiffness as rigid.

    Args:
        cost: What they yield, if it can be said.
    """
    axes, why = axis_names(cell.unknown_axes), why_no_prior(cell)
    measure = f"Measure it: {measure_stiffness(cell)}"
    stated = "or state it in [[robot.elastic]] (0 urad/kNm: rigid)"
    if why:
        estimate, hint = f"What that costs cannot be said: {why}", f"{measure}, {stated}"
    else:
        estimate = (
            "Nothing of it would be corrected" if cost is None else f"By its class it yields {cost.shown} {cost.of}"
        )
        hint = f"{measure}, {stated}, or plan with the median of its class: {OPTION} of compensate, prove and quote"
    return InputError(
        f"no stiffness is known of {axes} of {cell.chain.name}, so nothing can be planned",
        where=str(cell.path),
        hint=f"{estimate}. {hint}",
        axes=[axis + 1 for axis in cell.unknown_axes],
    )


def require_stiffness(cell: Cell) -> None:
    """Refuse a cell with axes of unknown stiffness.

    Raises:
        InputError: It has; one line that says which, what they cost and what to do.
    """
    if cell.unknown_axes:
        raise refusal(cell, cost_at_blank(cell))


def unknown_stiffness(cell: Cell) -> list[str]:
    """Warnings where axes or bodies of the end effector have no stiffness, or that of the robot's class."""
    return [*_unknown_axes(cell), *_unknown_end_effector(cell)]


def _unknown_end_effector(cell: Cell) -> list[str]:
    bodies = cell.bodies_of_unknown_stiffness
    if not bodies:
        return []
    return [
        f"no stiffness is known of {', '.join(bodies)}: taken as rigid, though an end effector can yield as much as "
        "the arm. State it in [[end_effector]] (0 urad/kNm: rigid), or measure it: counterflex identify stiffness"
    ]


def _unknown_axes(cell: Cell) -> list[str]:
    given = cell.class_stiffness
    if given is not None:
        low, high = (f"{factor:.1f}" for factor in (given.prior.factor.min(), given.prior.factor.max()))
        return [
            f"the stiffness of {given.named} of {cell.chain.name} is assumed from its class, not measured: nine of ten "
            f"robots lie within a factor of {low} to {high} of it. Measure it: "
            f"{measure_stiffness(cell)}"
        ]
    if not cell.unknown_axes:
        return []
    cost = cost_at_blank(cell)
    missing = "their deflection is missing from every prediction and correction"
    if cost is not None:
        missing += f": {cost.shown} {cost.of}"
    return [
        f"no stiffness is known of {axis_names(cell.unknown_axes)} of {cell.chain.name}: taken as rigid, {missing}. "
        f"Measure it: {measure_stiffness(cell)}"
    ]

"""What a compensation refuses before anything is read or planned in earnest."""

from __future__ import annotations

from pathlib import Path

from counterflex.core.errors import InputError
from counterflex.core.units import UM
from counterflex.plan.feed_for_tolerance import FeedTolerance
from counterflex.programs.compensated import marks
from counterflex.programs.program import Program

TOLERANCE_M = (0.1 * UM, 1000.0 * UM)
"""Smallest and largest tolerance of the written path."""


def require_options(tolerance_m: float, feed: FeedTolerance | None, *, predict: bool) -> None:
    """Refuse options that are out of range or contradict each other.

    Args:
        tolerance_m: Largest distance between the written path and the planned one.
        feed: Tolerance that the feed is lowered for, or None.
        predict: What remains is predicted.

    Raises:
        InputError: Names the option, its value and its range.
    """
    if not TOLERANCE_M[0] <= tolerance_m <= TOLERANCE_M[1]:
        raise InputError(
            "the tolerance of the written path is out of range",
            where="compensation.tolerance_um",
            value=f"{tolerance_m / UM:g}",
            limit=f"{TOLERANCE_M[0] / UM:g} to {TOLERANCE_M[1] / UM:g}",
        )
    if feed is not None and not predict:
        raise InputError("without a prediction no feed can be found for a tolerance", where="--no-predict")


def refuse_compensated(program: Program) -> None:
    """Refuse a program that carries the mark of a plan.

    Raises:
        InputError: It is compensated already.
    """
    carried = marks("\n".join(program.lines))
    if carried:
        raise InputError(
            "the program is compensated already and would be compensated twice",
            where=Path(program.name).name,
            value=f"job {', '.join(carried)}",
            hint="Give the original program",
        )

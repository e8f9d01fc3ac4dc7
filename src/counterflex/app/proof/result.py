"""What a proven compensation is: plan, truths, runs as machined, and how they were judged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from counterflex.app.proof.judge import Judged, Reference
from counterflex.plan.plan import Plan
from counterflex.twin.truth.truth import Truth


@dataclass(frozen=True, eq=False)
class Proof:
    """What the job found."""

    reference: Reference
    plan: Plan  # What the planner decided, knowing the cell file
    truths: dict[int, Truth]
    # By (seed, variant): ``nominal``, ``compensated``, ``exact`` (planned with the truth's exact constants)
    judged: dict[tuple[int, str], Judged]
    program_files: dict[str, str]
    summary: dict[str, Any]  # What ``summary.json`` holds
    timing: dict[str, float]  # Seconds per step

    @property
    def first_seed(self) -> int:
        """Seed whose runs are written and shown."""
        return next(iter(self.truths))

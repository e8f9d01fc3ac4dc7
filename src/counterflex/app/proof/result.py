"""Result of a proven compensation: plan, truths, runs as machined, and their judgement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from counterflex.app.proof.judge import JudgedRun, ProofReference
from counterflex.plan.plan import Plan
from counterflex.twin.truth.truth import Truth


@dataclass(frozen=True, eq=False)
class ProofResult:
    """Result of the job."""

    reference: ProofReference
    plan: Plan  # What the planner decided, knowing the cell file
    truths: dict[int, Truth]
    # By (seed, variant): ``nominal``, ``compensated``, ``exact`` (planned with the truth's exact constants)
    judged: dict[tuple[int, str], JudgedRun]
    program_files: dict[str, str]
    summary: dict[str, Any]  # What ``summary.json`` holds
    timing: dict[str, float]  # Seconds per step

    @property
    def first_seed(self) -> int:
        """Seed whose runs are written and shown."""
        return next(iter(self.truths))

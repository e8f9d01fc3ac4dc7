"""Counted rate at which the 95 % intervals of a recipe hold the truth; printed with its result.

The figures are those of ``benchmarks/interval_coverage.py`` (rows *errors*) and stand in docs/identify/method.md as
well; a test holds them to it. A share counted on simulated cells is no promise for a real one: what was simulated is
said with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class CountedShare:
    """Coverage of one recipe."""

    recipe: str
    share: float  # of all intervals that hold the truth
    worst_share: float  # of those of the worst parameter
    worst_name: str  # of that parameter
    seeds: int
    errors: str  # what they have that the recipe's model lacks

    @property
    def text(self) -> str:
        """One sentence."""
        return (
            f"Counted on {self.seeds} simulated campaigns with {self.errors}: {100 * self.share:.0f} % of all 95 % "
            f"intervals held the true value, those of {self.worst_name} the least, {100 * self.worst_share:.0f} %"
        )


COUNTED: Final[Mapping[str, CountedShare]] = {
    item.recipe: item
    for item in (
        CountedShare(
            "stiffness", 0.99, 0.92, "link_arm.rz", 15,
            "coupled springs, a cable 0.6 deg aside, friction, drift and a floor that tilts",
        ),
        CountedShare(
            "cubes", 0.99, 0.93, "link_arm.rz", 15,
            "stands that drift, cubes 0.5 % out of scale and a cable 0.6 deg aside",
        ),
        CountedShare(
            "cutting", 0.99, 0.98, "kr", 100,
            "2 % cross-talk, 1 % scale, 5 um runout, 0.3 % wear from cut to cut and forces that repeat within 2 %",
        ),
    )
}  # fmt: skip
"""By recipe."""

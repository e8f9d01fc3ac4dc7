"""Result of one seed about a recipe: intervals, and the truth that they should hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.intervals import intervals


@dataclass(frozen=True)
class Counted:
    """One parameter of one seed."""

    name: str  # of the parameter
    truth: float  # SI
    value: float  # as found
    sigma: float  # its stated standard deviation
    lower: float  # lower end of its 95 % interval
    upper: float  # upper end

    @property
    def inside(self) -> bool:
        """Return whether the interval holds the truth."""
        return self.lower <= self.truth <= self.upper


def counted(fit: Fit, truth: Mapping[str, float]) -> list[Counted]:
    """Parameters that the data see, with their true values.

    Args:
        fit: Of a recipe.
        truth: SI by name of the parameter; others are not counted.
    """
    ends = intervals(fit)
    return [
        Counted(name, truth[name], float(fit.values[i]), float(fit.sigma[i]), float(ends[i, 0]), float(ends[i, 1]))
        for i, name in enumerate(fit.parameters.names)
        if name in truth and fit.seen[i] in ("determined", "partly")
    ]

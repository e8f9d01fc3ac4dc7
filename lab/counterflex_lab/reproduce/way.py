"""Ways of correcting that an experiment compares, and how runs are counted."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

LIMITS: Final[dict[str, Any]] = {"correction_mm": 3.0, "speed_mm_s": 60.0, "acceleration_mm_s2": 4000.0}
"""Entries of ``[online]`` that all ways of milling have."""
REFUSED: Final = "Runs left out: the loop refused to act; the causes are in summary.json."


@dataclass(frozen=True)
class Way:
    """One way of correcting."""

    title: str  # for people
    online: dict[str, Any]  # what stands in ``[online]`` beside the limits
    compensated: bool = False  # the robot runs the compensated program
    armed: bool = True  # the loop acts; else it only watches
    force: bool = True  # the force sensor is wired
    tracker: bool = False  # the tracker is wired
    holder: bool = False  # the strain amplifiers of the holder are wired

    def acted(self, figures: Mapping[str, Any]) -> bool:
        """Return whether a run did what its way says: the loop corrected, or was to watch only."""
        return not self.armed or "active" in figures["loop"]["states"]

    def counted(self, runs: Sequence[Mapping[str, Any]]) -> tuple[list[Mapping[str, Any]], dict[str, Any]]:
        """Runs that say something of the correction, and how many these and the refused ones are."""
        acted = [run for run in runs if self.acted(run)]
        return acted, {"runs": len(acted), "refused": len(runs) - len(acted)}


def worst_and_median(name: str, values: Sequence[float]) -> dict[str, float]:
    """The largest of values under a name, their median beside it."""
    return {name: max(values), f"median_{name}": round(statistics.median(values), 6)}

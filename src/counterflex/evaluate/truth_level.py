"""Truth levels: what the planner knows of the simulated cell. Every figure of accuracy names one of them."""

from __future__ import annotations

from typing import Final, Literal

TruthLevel = Literal["catalogue", "identified", "exact"]
"""What the planner knew of the simulated cell, see :data:`TRUTH_LEVELS`."""
TRUTH_LEVELS: Final[dict[TruthLevel, str]] = {
    "catalogue": "what is published of this robot and material",
    "identified": "parameters identified on the simulated cell",
    "exact": "the exact parameters of the simulated cell",
}
"""The levels in the order of growing knowledge, each with what the planner knows at it."""

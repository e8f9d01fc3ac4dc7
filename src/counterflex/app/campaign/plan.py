"""Steps by which a laboratory sets up a cell, in order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from counterflex.core.errors import InputError
from counterflex.files.cell.cell import Cell

Setting = float | int | str | bool


@dataclass(frozen=True)
class CampaignRecipe:
    """One recipe of a campaign."""

    recipe: str
    count: int
    holdout: int  # Measurements to propose for validation, never used in the fit
    propose: Mapping[str, Setting] = field(default_factory=dict)
    identify: Mapping[str, Setting] = field(default_factory=dict)
    weight: float = 0.2


ORDER: Final = (
    CampaignRecipe("tracker-frame", 24, 12),
    CampaignRecipe("stiffness", 60, 20, weight=0.8),
    CampaignRecipe("kinematics", 60, 30, weight=0.6),
    CampaignRecipe("payload", 24, 12),
    CampaignRecipe("play", 24, 12, weight=0.6),
    CampaignRecipe("servo", 12, 6),
    CampaignRecipe("timing", 12, 6),
    CampaignRecipe("holder", 40, 20),
    CampaignRecipe("cutting", 16, 8, {"feed_ratio": 10.0}, {"as_stated": True}, weight=0.5),
)
"""Every recipe stands on what those before it found.

Frames first: pulls and poses are measured in them. Stiffness before geometry, so that the geometry is not bent to
explain sag; what hangs on the flange after both; play after stiffness, since a reversal shows friction times
compliance; then how the drives answer; test cuts last, from which the give of the robot is taken out. The test cuts go
down to thin chips, because a program's entries, exits and ramps have them and constants are good only where measured;
there ploughing can be so large that units would be suspected, which a laboratory knows of its own records.
"""


def campaign_of(cell: Cell, recipes: Sequence[str] | None = None) -> tuple[CampaignRecipe, ...]:
    """Recipes of a cell's campaign, in order.

    Args:
        cell: The holder is calibrated only where the cell has one.
        recipes: Only these; None is all.

    Raises:
        InputError: A recipe that is asked for is not part of a campaign.
    """
    known = [step.recipe for step in ORDER]
    for name in recipes or ():
        if name not in known:
            raise InputError("no such recipe in a campaign", value=name, limit=", ".join(known))
    has_holder = cell.tables.holder is not None
    return tuple(
        step
        for step in ORDER
        if (recipes is None or step.recipe in recipes) and (step.recipe != "holder" or has_holder)
    )

"""One recipe of a campaign: propose, measure on the twin, identify, validate on measurements of their own.

Every part works on files that the part before has written, so that each can be looked at, and repeated by hand with
the commands of the same names.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from counterflex.app.campaign import laboratory
from counterflex.app.identification import identify
from counterflex.app.identification.propose import propose
from counterflex.core import atomic
from counterflex.core.errors import CounterflexError, InputError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.set_up import copied_text

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


CELL: Final = "cell.toml"
DATA, HOLDOUT = "data", "holdout"
RESULT: Final = "result"
WORK: Final = {
    "propose data": 3.0,
    "measure data": 3.0,
    "propose holdout": 1.5,
    "measure holdout": 1.5,
    "identify": 3.0,
}
"""Parts of the work with what they cost in the mean over the recipes (``seconds`` of a step's result)."""
_HOLDOUT_SEED: Final = 1000  # Added to the seed of a proposal, so that validation stands elsewhere than the fit


def step(
    plan: CampaignRecipe, cell_file: str, truth_file: str, folder: str, seed: int, *, progress: Progress = silent
) -> dict[str, Any]:
    """Do one recipe.

    Writes into the folder: the two proposals, ``data/`` and ``holdout/`` (datasets), ``result/`` (what ``identify``
    writes) and ``cell.toml``, the cell to go on with: the identified one, or, where the identification was refused
    because it helped nothing, a copy of the one before.

    Args:
        truth_file: The simulated cell; only the measurements see it.

    Returns:
        ``recipe``, ``accepted``, ``why`` (it was refused), ``headline`` and ``figures`` of the identification,
        ``rows`` measured, ``seconds`` per part.
    """
    out = Path(folder)
    parts = in_parts(progress, WORK)
    seconds: dict[str, float] = {}
    rows: dict[str, int] = {}
    manifests: dict[str, str] = {}
    for name, count, offset in ((DATA, plan.count, 0), (HOLDOUT, plan.holdout, _HOLDOUT_SEED)):
        clock = time.perf_counter()
        proposal = propose(
            plan.recipe, count, cell_file, out / f"{name}-proposal", settings=plan.propose, seed=seed + offset
        )
        seconds[f"propose {name}"] = time.perf_counter() - clock
        parts[f"propose {name}"](1.0)
        clock = time.perf_counter()
        measured = laboratory.measure(
            proposal,
            cell_file,
            truth_file,
            out / name,
            seed=seed,
            session=f"{plan.recipe} {name}",
            progress=parts[f"measure {name}"],
        )
        seconds[f"measure {name}"] = time.perf_counter() - clock
        rows[name], manifests[name] = measured["rows"], measured["manifest"]
    clock = time.perf_counter()
    outcome: dict[str, Any] = {"recipe": plan.recipe, "rows": rows}
    try:
        result = identify.run(
            plan.recipe,
            [manifests[DATA]],
            cell_file,
            out / RESULT,
            holdout=[manifests[HOLDOUT]],
            settings=plan.identify,
            seed=seed,
            progress=parts["identify"],
        )
    except CounterflexError as fault:
        outcome |= {"accepted": False, "why": str(fault), "headline": [], "figures": []}
        new_cell = Path(cell_file)
    else:
        outcome |= {"accepted": True, "why": "", "headline": result["headline"], "figures": result["figures"]}
        new_cell = out / RESULT / CELL
    atomic.write_text(out / CELL, copied_text(new_cell, out))
    seconds["identify"] = time.perf_counter() - clock
    outcome["seconds"] = {key: round(value, 2) for key, value in seconds.items()}
    return outcome

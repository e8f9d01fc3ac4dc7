"""One recipe of a campaign: propose, measure on the twin, identify, validate on measurements of their own.

Every part works on files that the part before has written, so that each can be looked at, and repeated by hand with
the commands of the same names.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, Final

from counterflex.app.campaign import laboratory
from counterflex.app.campaign.plan import CampaignRecipe
from counterflex.app.identification import identify
from counterflex.app.identification.propose import propose
from counterflex.core import atomic
from counterflex.core.errors import CounterflexError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.files.cell.set_up import copied_text

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
_HOLDOUT_SEED: Final = 1000
"""Added to the seed of a proposal, so that validation stands elsewhere than the fit."""


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

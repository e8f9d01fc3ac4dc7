"""Constants from production in a new cell file with their provenance: only when asked for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from counterflex import __version__
from counterflex.app.production.result import Produced
from counterflex.core.errors import ModelError
from counterflex.files.cell.measured import IdentifiedTable, IdentifiedValue
from counterflex.files.cell.update import require_new, updated_text, write_new
from counterflex.files.identification_file import parameter_rows
from counterflex.identify.cutting.force_forms import NAMES
from counterflex.identify.recipe import Identification


def apply_constants(
    p: Produced, identification: Identification, target: Path, place: Path, date: str
) -> dict[str, Any]:
    """Write a cell file with the constants found.

    Args:
        p: Of the job.
        identification: Its changes are written.
        target: New cell file.
        place: Where it is written until the results are complete.
        date: As printed.

    Returns:
        What was taken over, plain values.

    Raises:
        InputError: The target is the cell file or any file that is there.
        ModelError: Nothing is proposed, or the new cell is no possible one.
    """
    require_new(target, p.cell.path)
    mean, before = p.estimate.held_out.mean()
    if not p.is_proposed:
        raise ModelError(
            "the runs give no reason to change the constants; nothing was written",
            value=f"probability of the difference {p.estimate.difference.chance:.2g}, error on stretches held out "
            f"{100 * mean:.2f} % (before {100 * before:.2f} %)",
            limit="below 0.01, and a smaller error than before",
            hint="Leave --apply out, or give more runs",
        )
    names = [kept.facts["run"] for kept in p.runs]
    entry = IdentifiedTable(
        recipe="production",
        date=date,
        data=tuple(names),
        data_sha256=tuple(kept.facts["sha256"] for kept in p.runs),
        counterflex=__version__,
        holdout=f"mean error of the mean force held out: {100 * mean:.4g} % ({100 * before:.4g} % before), "
        + ("on whole runs in turn" if len(p.runs) >= 3 else "on parts of the runs in turn"),
        values=tuple(
            IdentifiedValue(
                name=row["name"], value=row["value"], sigma=row["sigma"], unit=row["unit"], seen=row["seen"]
            )
            for row in parameter_rows(p.estimate.fit)
            if row["free"] and row["name"] in NAMES
        ),
    )
    text = updated_text(p.cell, identification.changes, entry, target.parent)
    write_new(text, target, place, "what the runs show")
    return {"cell": target.name, "constants": p.estimate.level}

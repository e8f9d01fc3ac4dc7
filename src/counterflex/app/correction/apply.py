"""Constants that a part explains, in a new cell file with their provenance: only when asked for."""

from __future__ import annotations

import datetime
import hashlib
from pathlib import Path
from typing import Any, Final

from counterflex import __version__
from counterflex.app.correction.causes import changes_of
from counterflex.app.correction.result import Corrected
from counterflex.core import file_content
from counterflex.core.errors import ModelError
from counterflex.evaluate.path_error.estimate import EVIDENCE
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.measured import IdentifiedTable, IdentifiedValue
from counterflex.files.cell.update import require_new, updated_text, write_new

RECIPE: Final = "correct"
_SI: Final = {"relative": "", "m": "m", "rad": "rad"}


def apply_constants(result: Corrected, cell: Cell, target: Path, place: Path, scans: list[Path]) -> dict[str, Any]:
    """Write a cell file with the constants of the likeliest explanation.

    Args:
        place: Where it is written until the results are complete.

    Raises:
        InputError: The target is the cell file or any file that is there, or what is likeliest has no place in a
            cell file.
        ModelError: No explanation is likelier than none, or the new cell is no possible one.
    """
    require_new(target, cell.path)
    best = result.explained[0]
    if best.log_evidence < EVIDENCE:
        raise ModelError(
            "no constant explains the part better than none",
            value=f"{best.name}, logarithm of the evidence {best.log_evidence:.1f}",
            limit=f">= {EVIDENCE:g}",
            hint="Correct the program only: leave --apply out",
        )
    changes = changes_of(best, result.plan, cell)
    entry = IdentifiedTable(
        recipe=RECIPE,
        date=datetime.datetime.now(tz=datetime.UTC).strftime("%Y-%m-%d %H:%M:%S UTC"),
        data=tuple(scan.name for scan in scans),
        data_sha256=tuple(_digest(scan) for scan in scans),
        counterflex=__version__,
        holdout=f"{best.name}: logarithm of the evidence {best.log_evidence:.1f} over no constant, "
        f"{100.0 * best.explained:.0f} % of the deviations explained; no part held out",
        values=tuple(
            IdentifiedValue(
                name=name.rpartition(", ")[0],
                value=float(best.value[k]),
                sigma=float(best.sigma[k]),
                unit=_SI[name.rpartition(", ")[2]],
            )
            for k, name in enumerate(best.factors)
        ),
    )
    text = updated_text(cell, changes, entry, target.parent)
    write_new(text, target, place, "what the part explains")
    return {"explanation": best.name, "cell": target.name}


def _digest(scan: Path) -> str:
    """SHA-256 of a scan; of a folder, of the machined surface or the deviations in it."""
    files = [scan] if scan.is_file() else sorted(scan.glob("*surface.npz")) or sorted(scan.glob("deviations.parquet"))
    return hashlib.sha256(b"".join(file_content.content(file) for file in files)).hexdigest()

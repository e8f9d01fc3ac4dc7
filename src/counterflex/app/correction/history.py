"""The parts that a program was corrected from: one numbered folder each, kept with every corrected program."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core import atomic, file_content
from counterflex.core.units import UM
from counterflex.evaluate.inspection.part_deviations import PartDeviations
from counterflex.evaluate.path_error.repeated import MeasuredError
from counterflex.files.part_deviations import MeasuredPart, write_part_deviations
from counterflex.files.path_error_file import read_path_error, write_path_error

PARTS: Final = "parts"
ERROR, SCAN, FACTS = "path-error.parquet", "deviations.parquet", "part.json"
_INCOMPLETE: Final = "Copy the folder of the plan again, or write it again with counterflex correct"


@dataclass(frozen=True, eq=False)
class Part:
    """A part of the history.

    Attributes:
        error: Of its path.
        facts: Figures, plain values.
    """

    error: MeasuredError
    facts: dict[str, Any]


def read_parts(plan_folder: Path) -> list[Part]:
    """Parts that a plan was corrected from, in their order; none for a plan of ``compensate``.

    Raises:
        FileFormatError: A part is not complete.
    """
    out = []
    for folder in sorted((plan_folder / PARTS).glob("[0-9]*")):
        error, _ = read_path_error(folder / ERROR)
        facts = file_content.json_value(folder / FACTS, hint=_INCOMPLETE)
        out.append(Part(error, facts))
    return out


def keep_parts(
    plan_folder: Path, out: Path, new: list[tuple[PartDeviations, MeasuredPart, Part]], about: dict[str, Any]
) -> None:
    """Write the history of the next program: that of the plan, and the new parts."""
    target, count = out / PARTS, 0
    target.mkdir()
    for folder in sorted((plan_folder / PARTS).glob("[0-9]*")):
        shutil.copytree(folder, target / folder.name)
        count += 1
    for number, (deviations, measured, part) in enumerate(new, count + 1):
        folder = target / f"{number:03d}"
        folder.mkdir()
        write_part_deviations(folder / SCAN, deviations, measured)
        write_path_error(folder / ERROR, part.error, about)
        atomic.write_text(folder / FACTS, json.dumps(part.facts, indent=2) + "\n")


def trend(parts: list[Part]) -> list[dict[str, Any]]:
    """A row for each part: its figures, and how far what it asks for is from what the parts before it asked for."""
    rows: list[dict[str, Any]] = []
    for number, part in enumerate(parts, 1):
        row = {"part": number, **part.facts}
        if number > 1:
            before = parts[number - 2].error
            both = part.error.seen & before.seen
            if np.any(both):
                change = (part.error.taken_m + part.error.error_m - before.taken_m - before.error_m)[both]
                sigma = np.hypot(part.error.sigma_m, before.sigma_m)[both]
                row["changed_um"] = round(float(np.sqrt(np.mean(change**2))) / UM, 1)
                row["changed_sigmas"] = round(float(np.sqrt(np.mean((change / sigma) ** 2))), 1)
        rows.append(row)
    return rows

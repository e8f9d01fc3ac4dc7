"""Result of the job ``correct``: findings and decisions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from counterflex.app.correction.scans import PartScan
from counterflex.app.inputs import Job
from counterflex.core.arrays import Float
from counterflex.evaluate.path_error.contacts import Contacts
from counterflex.evaluate.path_error.estimate import PathError
from counterflex.evaluate.path_error.explanations import Explanation
from counterflex.evaluate.path_error.learning import Learned, MeasuredError
from counterflex.files.cell.cell import Cell
from counterflex.plan.plan import Plan


@dataclass(frozen=True, eq=False)
class MeasuredScan:
    """A scan and the error of the path that it shows."""

    scan: PartScan
    contacts: Contacts  # Which stretches may have made its places
    estimate: PathError  # Error at the nodes of the path
    error: MeasuredError  # The same at its rows


@dataclass(frozen=True, eq=False)
class Corrected:
    """Result of the job."""

    plan: Plan
    files: dict[str, str]
    encoding: str
    measured: list[MeasuredScan]
    state: Learned  # Error of the next part without a change, and response of the tool, from all parts
    taken: MeasuredError  # What the next program takes back, and the error that is expected
    explained: list[Explanation]
    job: Job
    cell: Cell  # In the working plane of the program
    change_m: Float  # (n, 3) m, change of the correction at the rows of the path
    summary: dict[str, Any]  # What ``summary.json`` holds

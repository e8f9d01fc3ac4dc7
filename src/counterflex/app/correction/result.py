"""What the job ``correct`` finds and decides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from counterflex.app.correction.scans import Scan
from counterflex.app.inputs import Job
from counterflex.core.arrays import Float
from counterflex.evaluate.path_error.contacts import Contacts
from counterflex.evaluate.path_error.estimate import PathError
from counterflex.evaluate.path_error.explanations import Explanation
from counterflex.evaluate.path_error.repeated import MeasuredError, Repeated
from counterflex.files.cell.cell import Cell
from counterflex.plan.plan import Plan


@dataclass(frozen=True, eq=False)
class Measured:
    """A scan and the error of the path that it shows.

    Attributes:
        contacts: Which stretches may have made its places.
        estimate: Error at the nodes of the path.
        error: The same at its rows.
    """

    scan: Scan
    contacts: Contacts
    estimate: PathError
    error: MeasuredError


@dataclass(frozen=True, eq=False)
class Corrected:
    """Result of the job.

    Attributes:
        together: What they and the earlier parts say.
        taken: What the next program takes back, and the error that is expected.
        cell: In the working plane of the program.
        change_m: (n, 3) m, change of the correction at the rows of the path.
        summary: What ``summary.json`` holds.
    """

    plan: Plan
    files: dict[str, str]
    encoding: str
    measured: list[Measured]
    together: Repeated
    taken: MeasuredError
    explained: list[Explanation]
    job: Job
    cell: Cell
    change_m: Float
    summary: dict[str, Any]

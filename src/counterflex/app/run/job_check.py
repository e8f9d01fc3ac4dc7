"""Check that program and plan of a run belong together, and that nothing is corrected twice."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from counterflex.app.external_moves import refuse_places
from counterflex.app.plan_of_cell import require_of_cell
from counterflex.app.unknown_stiffness import require_stiffness
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.file_content import content
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.plan_file import CLASS_ASSUMED
from counterflex.plan.plan import Plan
from counterflex.programs.compensated import job_number, marks


def check_job(program: Path, planned: tuple[Plan, Mapping[str, Any]] | None, *, compensated: bool) -> None:
    """Compare the hash that a program carries with that of the plan.

    Args:
        program: What the robot runs, any language.
        planned: Plan and metadata as read, or None: then the loop corrects everything.
        compensated: The robot is said to run the compensated program.

    Raises:
        FileFormatError: The program cannot be read, or the plan carries no hash.
        InputError: The program is of another plan, is not compensated and should be, or is and should not be.
    """
    carried = _marks(program)
    if planned is None or not compensated:
        if carried:
            raise InputError(
                "the program is compensated already and would be compensated twice",
                where=str(program),
                value=f"job {', '.join(carried)}",
                hint="Give its plan with --plan"
                if compensated
                else "Leave out --original, or let the robot run the original program",
            )
        return
    plan, about = planned
    expected = about.get("job_hash")
    if not isinstance(expected, str):
        raise FileFormatError(
            "the plan does not say which program was written from it",
            where=str(about.get("program", "plan")),
            hint="Make both anew with counterflex compensate",
        )
    if carried == (expected,) or (not carried and not np.any(plan.correction_part)):
        return
    raise InputError(
        "program and plan are of different jobs" if carried else "the program is not a compensated one",
        where=str(program),
        value=f"job {', '.join(carried)}" if carried else "no job",
        limit=f"job {expected}",
        hint="Give program and plan of one counterflex compensate"
        if carried
        else "Give --original where the robot runs the original program",
    )


def cell_of_run(
    cell: str | Path, planned: tuple[Plan, Mapping[str, Any]] | None, plan_file: str | Path | None = None
) -> Cell:
    """Read the cell of a run: where the plan stands on the class of the robot, so does the run.

    Args:
        planned: Plan and metadata as read, or None.
        plan_file: Where it was read from.

    Raises:
        FileFormatError: The file cannot be used.
        InputError: Axes have no stiffness and no plan assumes one, the plan was made for another cell, or external axes
            move along the program.
    """
    read = read_cell(cell, assume_class=planned is not None and bool(planned[1].get(CLASS_ASSUMED, False)))
    if planned is not None:
        require_of_cell(*planned, read, plan_file or "the plan")
    refuse_places(1 + max((len(axis.moves) for axis in read.tables.external_axes), default=0), cell)
    read.require_milling()
    require_stiffness(read)
    return read


def program_job(program: Path) -> int:
    """Number by which a robot program says of which job it is; 0 where it carries none, or several.

    Raises:
        FileFormatError: It cannot be read.
    """
    carried = _marks(program)
    return job_number(carried[0]) if len(carried) == 1 else 0


def _marks(program: Path) -> tuple[str, ...]:
    return marks(content(program).decode("latin-1"))


def job_of(planned: tuple[Plan, Mapping[str, Any]] | None, *, compensated: bool) -> int | None:
    """Number that the running robot program must say, where it says one.

    Args:
        planned: Plan and metadata as read, or None.
        compensated: The robot is said to run the compensated program.

    Returns:
        That of the plan's job; 0 where the program must not be a compensated one; None where it is not known.
    """
    if planned is None or not compensated:
        return 0
    job = planned[1].get("job_hash")
    return job_number(job) if isinstance(job, str) else None

"""The command that sets up a cell as a laboratory would, on simulated cells."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.commands.prove import SEEDS, FamilyName, Workers
from counterflex.cli.option_records import with_records
from counterflex.cli.output import keep_inputs, print_made_again, print_summary, resumable_progress
from counterflex.core.errors import InputError
from counterflex.identify.recipes import RECIPES


def _either(name: str, given: bool, other: str, its: bool, hint: str | None = None, *, one: bool = False) -> None:
    """Refuse two options that exclude each other, and where ``one`` is needed none of them."""
    if (given and its) or (one and not (given or its)):
        raise InputError(f"use either {name} or {other}", value="both" if given else "neither", hint=hint)


@dataclass(frozen=True)
class CellOptions:
    """Options that name the cell file and the simulated cells made of it."""

    cell: Annotated[
        Path | None, option("--cell", "Cell file; default: cell and part of the demonstration.", arguments.file, "CELL")
    ] = None
    twin: Annotated[Path | None, option("--twin", "Truth file: the one simulated cell.", arguments.file, "TRUTH")] = (
        None
    )
    seeds: Annotated[str | None, SEEDS] = None
    family: FamilyName = "mild"

    def numbers(self) -> list[int] | None:
        """Seeds; None where the one simulated cell is given.

        Raises:
            InputError: Both or neither are given, or the seeds are none.
        """
        _either(
            "--twin",
            self.twin is not None,
            "--seeds",
            self.seeds is not None,
            "--twin TRUTH is one simulated cell, --seeds 5 makes five",
            one=True,
        )
        return None if self.seeds is None else arguments.seeds(self.seeds)


@dataclass(frozen=True)
class WorkerOptions:
    """Options that say which processes do the work."""

    workers: Workers = None
    scheduler: Annotated[
        str | None,
        option(
            "--scheduler",
            "Scheduler of dask whose workers do the work; without it processes of this machine do.",
            arguments.scheduler,
            "ADDRESS",
        ),
    ] = None

    def chosen(self) -> str | int | None:
        """Address of the scheduler, or number of processes; says where a scheduler is open to others."""
        from counterflex.app.long_jobs.scheduler import open_to_others, require_scheduler_address

        if self.scheduler is not None and (message := open_to_others(require_scheduler_address(self.scheduler))):
            typer.echo(message, err=True)
        return self.scheduler or self.workers


@with_records
def campaign(
    out: Annotated[Path, option("--out", "Folder for the results.", arguments.output_folder, "DIR")],
    program: Annotated[
        list[Path] | None,
        argument("Programs to machine before and after; none: identify only.", arguments.file, "[PROGRAM]..."),
    ] = None,
    *,
    cells: CellOptions,
    recipe: Annotated[
        list[str] | None,
        option("--recipe", "Only this recipe; may be given several times.", arguments.one_of(RECIPES.own)),
    ] = None,
    exact: Annotated[bool, option("--exact/--no-exact", "Also plan with the truth's exact constants.")] = False,
    identify: Annotated[
        bool, option("--identify/--no-identify", "Identify the cells; otherwise only the cell file plans.")
    ] = True,
    placements: Annotated[
        Path | None,
        option(
            "--placements",
            "CSV file of places for the part: name and any of x_mm y_mm z_mm a_deg b_deg c_deg, as in [part].",
            arguments.file,
            "FILE",
        ),
    ] = None,
    posture: Annotated[
        list[str] | None,
        option(
            "--posture",
            "present (cell file), chosen (as plan posture), or 'front up noflip 180'; may be given several times.",
            arguments.postures,
            "POSTURE",
        ),
    ] = None,
    machines: WorkerOptions,
    as_json: Annotated[bool, option("--json", "Print the summary as JSON.")] = False,
) -> None:
    """Identify a complete cell on simulated cells, as a laboratory would, and show the accuracy gained.

    For each recipe: propose, measure on the twin, identify, validate on separate measurements. Then programs are
    machined before and after compensation, planned with the original and with the identified cell file: every program
    at every placement in every posture on every simulated cell. An interrupted campaign continues when the same command
    is given again; results.parquet has a row for each result.

    With all recipes a cell takes minutes; --recipe does one of them, --no-identify none. --scheduler tls://HOST:8786
    does the same on other machines (docs/campaign.md).

    Example: `counterflex campaign part.ngc --cell cell.toml --twin truth.toml --recipe tracker-frame --out campaign`
    """
    numbers = cells.numbers()
    _either("--recipe", bool(recipe), "--no-identify", not identify)
    by_scheduler, by_workers = bool(machines.scheduler), bool(machines.workers)
    _either("--scheduler", by_scheduler, "--workers", by_workers, "A scheduler's workers are started beside it")
    programs, cell = list(program or ()), cells.cell
    keep_inputs(out, *programs, cell, cells.twin, placements)
    from counterflex.app import examples
    from counterflex.app.campaign import campaign as job
    from counterflex.app.campaign.axes import Grid, read_placements
    from counterflex.app.campaign.report import CampaignSummary
    from counterflex.twin.truth.family import family_of

    workers = machines.chosen()
    places = () if placements is None else read_placements(placements)
    with tempfile.TemporaryDirectory() as folder, resumable_progress("campaign", out, "finished steps") as progress:
        if cell is None:
            cell = Path(folder) / "cell.toml"
            _, part = examples.write(cell)
            programs = programs or [part]
        summary = job.run(
            cell,
            out,
            grid=Grid(programs, places, posture or ()),
            seeds=numbers,
            family=family_of(cells.family),
            truth_file=cells.twin,
            recipes=(recipe or None) if identify else [],
            with_exact=exact,
            workers=workers,
            progress=progress,
        )
    print_summary(CampaignSummary(summary), as_json)
    if not as_json:
        print_made_again(summary)
        typer.echo(f"report: {out / 'report.html'}")

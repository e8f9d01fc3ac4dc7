"""The demonstration: the whole job on data that ships with the package."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import given
from counterflex.cli.commands.prove import FamilyName, Seeds, Workers, show_proof
from counterflex.cli.output import print_json, progress_bar


def register(app: typer.Typer) -> None:
    """Add this command."""
    app.command()(demo)


def demo(
    out: Annotated[
        Path, typer.Option("--out", help="Folder for the results.", metavar="DIR", callback=given.output_folder)
    ] = Path("counterflex-demo"),
    seeds: Seeds = "1",
    family: FamilyName = "mild",
    workers: Workers = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Run the complete chain on built-in data: compensate a test part, machine it before and after, compare, report.

    Grooves, ramps and a circular pocket in EN AW-2017 on a KR 300 R2500 ultra (after Haehn and Weigold 2020). Takes
    about two minutes on two cores; --seeds 5 about eight.

    Example: `counterflex demo --out out/demo`
    """
    numbers = given.seeds(seeds)
    from counterflex.app import examples
    from counterflex.app.proof import prove as job
    from counterflex.twin.truth.family import family_of

    with tempfile.TemporaryDirectory() as folder, progress_bar("demonstration") as progress:
        cell = Path(folder) / "cell.toml"
        _, part = examples.write(cell)
        summary = job.run(part, cell, out, seeds=numbers, family=family_of(family), workers=workers, progress=progress)
    if as_json:
        print_json(summary)
    else:
        show_proof(summary, out)

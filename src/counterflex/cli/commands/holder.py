"""Commands of the force-sensing spindle holder: its design."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.commands.program import Out
from counterflex.cli.output import keep_inputs, print_summary, progress_bar
from counterflex.core.errors import InputError

holder = typer.Typer(no_args_is_help=True, help="Design a spindle holder that senses the cutting force by strain.")


def design(
    holder: Annotated[Path, argument("Drawing of the holder (.toml).", arguments.file, "HOLDER")],
    out: Out,
    mesh_mm: Annotated[
        float, option("--mesh", "Largest edge of a finite element, mm.", metavar="MM", min=1.0, max=200.0)
    ] = 12.0,
    bricks: Annotated[
        int,
        option(
            "--bricks",
            "Fewest finite elements over every pocket's height, width and depth, and over the wall behind it.",
            metavar="N",
            min=1,
            max=12,
        ),
    ] = 4,
    choose: Annotated[
        int | None,
        option(
            "--choose",
            "Choose places for so many bridges, with pockets like the first of the drawing.",
            metavar="N",
            min=3,
            max=12,
        ),
    ] = None,
    lost_percent: Annotated[
        float, option("--most-lost", "Stiffness that a choice may cost in any direction, %.", min=0.1, max=90.0)
    ] = 10.0,
    cell: Annotated[
        Path | None, option("--cell", "Cell file: maps of the arm with this spindle.", arguments.file, "CELL")
    ] = None,
    mounting: Annotated[
        str | None,
        option(
            "--mounting",
            "Angles at which the spindle may be mounted, beside the present one: spindle.b_deg=-35.",
            arguments.angles_of_body,
            "BODY.KEY=A,B",
        ),
    ] = None,
    force_n: Annotated[float, option("--force", "Radial force for the maps, N.", min=1.0, max=1e5)] = 500.0,
    as_json: Annotated[bool, option("--json", "Print the summary as JSON.")] = False,
) -> None:
    """Compute what the pockets of a sensing holder cost in stiffness and give in signal.

    Finite elements of both cheeks against beam theory and Denkena2015: compliance at the tool tip, strain of each
    bridge per newton, gain of pocket and rib, condition of M and what noise remains in the force. With --cell also maps
    of what the arm yields for each angle of the spindle. Writes into DIR: report.html, summary.json, and holder.toml
    with --choose.

    Example: `counterflex holder design holder.toml --mesh 30 --out design`
    """
    if mounting is not None and cell is None:
        raise InputError("--mounting needs the cell that the spindle is mounted in", hint="Give --cell CELL")
    keep_inputs(out, holder, cell)
    from counterflex.app import holder_design as job
    from counterflex.app.holder_design import Spindle
    from counterflex.app.placement.region import Mounting

    spindle = None
    if cell is not None:
        angles = None if mounting is None else Mounting(*arguments.body_angles(mounting, "--mounting"))
        spindle = Spindle(cell, angles, force_n)
    with progress_bar(f"solving {holder.name}") as progress:
        summary = job.run(
            holder,
            out,
            mesh_mm=mesh_mm,
            bricks=bricks,
            choose_count=choose,
            lost_percent=lost_percent,
            spindle=spindle,
            progress=progress,
        )
    files = ", holder.toml" if choose is not None else ""
    print_summary(summary, as_json, out, f": report.html, summary.json{files}")


holder.command("design")(design)

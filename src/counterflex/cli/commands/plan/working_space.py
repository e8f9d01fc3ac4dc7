"""Command plan map: stiffness, first natural frequency and deflection of a program over the working space."""

from __future__ import annotations

from typing import Annotated, cast

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import option
from counterflex.cli.commands.program import CellFile, JudgedSurface, Out, Program, ReadingOptions
from counterflex.cli.option_records import with_records
from counterflex.cli.output import MODEL_NOTE, MODEL_UM, keep_inputs, print_table, progress_bar, say_written


@with_records
def working_space(
    program: Program,
    cell: CellFile,
    out: Out,
    region: Annotated[
        str | None,
        option(
            "--region",
            "What is mapped, mm in the robot base: x and y of the middle of the program, z of the part frame. "
            "Without it: in front of the robot, from its foot to half its reach.",
            arguments.numbers_of(6),
            "X0,X1,Y0,Y1,Z0,Z1",
        ),
    ] = None,
    points: Annotated[int, option("--points", "Places along each axis of a map.", min=2, max=200)] = 21,
    surface: JudgedSurface = "both",
    *,
    source: ReadingOptions,
) -> None:
    """Map the working space: where a program bends the robot least, where it is stiff, where it swings slowly.

    Two maps: level, at the present height of the part, and upright, at the present y. At each place the posture is
    chosen along the program, as plan placement does it; the part stays turned as it is. Writes into DIR: report.html
    (the maps as pictures), map.csv (all places, what refuses them), summary.json.

    Example: `counterflex plan map part.ngc --cell cell.toml --points 9 --out map`
    """
    keep_inputs(out, program, cell, source.parameters)
    from counterflex.app.placement import placement_map as job
    from counterflex.app.placement.region import Wish
    from counterflex.plan.posture.cut_path import Surface

    box = arguments.numbers(region, "--region", 6)
    with progress_bar(f"mapping the working space for {program.name}") as progress:
        summary = job.run(
            program,
            cell,
            out,
            reading=source.reading(),
            surface=cast("Surface", surface),
            wish=Wish(None if box is None else tuple(box)),
            points=points,
            progress=progress,
        )
    rows = {"present": summary["present"], **{f"best, {view}": row for view, row in summary["best"].items()}}
    keys = ("x_mm", "y_mm", "z_mm", "deflection_um", "stiffness_n_per_um", "first_mode_hz", "margin_deg")
    print_table(
        f"{summary['program']} on {summary['cell']}",
        ["place", "x mm", "y mm", "z mm", MODEL_UM, "softest N/um", "first mode Hz", "margin deg"],
        [
            [name, *("" if row is None or row[key] is None else f"{row[key]:g}" for key in keys)]
            for name, row in rows.items()
        ],
        note=f"Deflection without compensation. {MODEL_NOTE}",
    )
    typer.echo(f"{summary['places']} places, {summary['refused']} of them refused")
    say_written(out, f"wrote {out}: report.html, map.csv, summary.json")

"""Command plan map: stiffness, first natural frequency and deflection of a program over the working space."""

from __future__ import annotations

from typing import Annotated, cast

from counterflex.cli import arguments
from counterflex.cli.arguments import option
from counterflex.cli.commands.program import CellFile, JudgedSurface, Out, Program, ReadingOptions
from counterflex.cli.option_records import with_records
from counterflex.cli.output import keep_inputs, print_summary, progress_bar


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
    print_summary(summary, False, out, ": report.html, map.csv, summary.json")

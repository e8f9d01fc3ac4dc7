"""Command plan posture: arm configuration and rotation about the tool axis for a program."""

from __future__ import annotations

from typing import Annotated, cast

from counterflex.cli.arguments import option
from counterflex.cli.commands.program import CellFile, JudgedSurface, Out, Program, ReadingOptions
from counterflex.cli.option_records import with_records
from counterflex.cli.output import keep_inputs, print_summary, progress_bar
from counterflex.core.units import DEG


@with_records
def posture(
    program: Program,
    cell: CellFile,
    out: Out,
    surface: JudgedSurface = "both",
    rotations: Annotated[
        int, option("--rotations", "Rotations about the tool axis that are tried.", min=4, max=720)
    ] = 72,
    turning: Annotated[
        float,
        option(
            "--turning",
            "Let the tool turn about its axis along the path, at this rate at most; 0: it is held still.",
            metavar="DEG_PER_S",
            min=0.0,
            max=360.0,
        ),
    ] = 0.0,
    *,
    source: ReadingOptions,
    as_json: Annotated[bool, option("--json", "Print the summary as JSON.")] = False,
) -> None:
    """Choose arm configuration and rotation about the tool axis: smallest deflection normal to the machined surface.

    Milling leaves the rotation about the tool axis free, and the arm reaches most poses in several configurations.
    Each is tried at every point, under the predicted cutting force. Left out are those that break joint limits or
    cables, come too close to singularities or bring coarse bodies together; axes that turn round or are unloaded in
    the cut, and wound-up axes 4 and 6, cost extra.

    Writes into DIR: cell.toml (the cell file with the chosen [posture]; compensate, simulate, prove and run take it
    from there, KRL and RAPID programs are written in it), postures.csv (deflection in each posture), summary.json.

    Example: `counterflex plan posture part.ngc --cell cell.toml --out posture`
    """
    keep_inputs(out, program, cell, source.parameters)
    from counterflex.app import posture as job
    from counterflex.plan.posture.choose import Freedom
    from counterflex.plan.posture.cut_path import Surface

    with progress_bar(f"choosing the posture for {program.name}") as progress:
        summary = job.run(
            program,
            cell,
            out,
            reading=source.reading(),
            surface=cast("Surface", surface),
            freedom=Freedom(rotations, turning * DEG, turning * DEG),
            progress=progress,
        )
    print_summary(summary, as_json, out, ": cell.toml, postures.csv, summary.json")

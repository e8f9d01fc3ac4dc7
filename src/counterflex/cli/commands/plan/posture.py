"""Command plan posture: arm configuration and rotation about the tool axis for a program."""

from __future__ import annotations

from typing import Annotated, Any, Final, cast

import typer

from counterflex.cli.arguments import option
from counterflex.cli.commands.program import CellFile, JudgedSurface, Out, Program, ReadingOptions
from counterflex.cli.option_records import with_records
from counterflex.cli.output import (
    EXPECTED_NOTE,
    EXPECTED_UM,
    MODEL_UM,
    expected_text,
    keep_inputs,
    print_json,
    print_table,
    progress_bar,
    say_written,
)
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
    if as_json:
        print_json(summary)
        return
    _show(summary)
    say_written(out, f"wrote {out}: cell.toml, postures.csv, summary.json")


def _show(summary: dict[str, Any]) -> None:
    rows = [[name, *_row(summary[name])] for name in ("present", "chosen")]
    columns = ["posture", EXPECTED_UM, "branch", "rotation deg", "turned deg", MODEL_UM, "largest um", "in line"]
    columns += ["reversals", "unloadings", "limit margin deg", "wrist deg"]
    note = (
        f"Deflection without compensation: 99.7 % of the cut stay below it, normal to "
        f"{_SURFACE_WORDS[summary['surface']]}. {EXPECTED_NOTE}"
    )
    print_table(f"{summary['program']} on {summary['cell']}", columns, rows, note=note)
    if summary["reduction_percent"] is not None:
        typer.echo(f"{summary['reduction_percent']:g} % less deflection than in the present posture")
    typer.echo(f"{summary['poses']} postures tried; no posture could be below {summary['bound_um']:g} um in the mean")


_SURFACE_WORDS: Final = {"both": "wall and floor", "wall": "the wall", "floor": "the floor"}


def _row(held: dict[str, Any] | None) -> list[str]:
    if held is None:
        return ["out of reach", *[""] * 10]
    keys = (
        "branch",
        "rotation_about_tool_deg",
        "turned_deg",
        "deflection_um",
        "largest_um",
        "largest_in_line",
        "reversals",
    )
    return [
        expected_text(held),
        *(str(held[key]) if isinstance(held[key], str) else f"{held[key]:g}" for key in keys),
        *(f"{held[key]:g}" for key in ("unloadings", "limit_margin_deg", "wrist_deg")),
    ]

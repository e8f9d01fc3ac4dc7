"""The command ``correct``: the program of the next part, corrected from measured ones."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import option
from counterflex.cli.commands.program import CellFile, Out, Program
from counterflex.cli.output import keep_inputs, print_result, print_table, progress_bar, warn
from counterflex.core.units import UM

_SHOWN = 6


def correct(
    program: Program,
    cell: CellFile,
    plan: Annotated[
        Path,
        option(
            "--plan",
            "Folder of compensate or correct: the program that the measured parts were made by.",
            arguments.folder,
            "DIR",
        ),
    ],
    scan: Annotated[
        list[Path],
        option(
            "--scan",
            "A measured part: deviations (or folder) of inspect, or a folder of simulate or prove. Repeatable.",
            arguments.file_or_folder,
            "PART",
        ),
    ],
    out: Out,
    limit_um: Annotated[
        float, option("--limit-um", "Largest change of a correction; more is refused.", min=5.0, max=5000.0)
    ] = 1500.0,
    apply: Annotated[
        Path | None,
        option(
            "--apply",
            "Write a new cell file with the constants of the likeliest explanation; no file is overwritten.",
            arguments.output_file,
            "CELL",
        ),
    ] = None,
    report: Annotated[bool, option("--report/--no-report", "Write report.html.")] = True,
    as_json: Annotated[bool, option("--json", "Print the summary as JSON.")] = False,
) -> None:
    """Correct the next part: measured deviations in, the program that takes back what repeats of them out.

    PROGRAM is the original program; --plan says by which corrected one the parts were made. Every place of a scan is
    attributed to the stretch of path that made it; noise is told from error by the evidence of the data, and only
    error is taken back, normal to the surface. What would explain it (force, stiffness, part frame) is weighed and
    printed; a cell file is written only with --apply.

    Writes into DIR: the program, plan.parquet, path-error.parquet, parts/ (all parts so far), summary.json and
    report.html. Either all of them or none. DIR is the --plan of the next time.

    Example: `counterflex correct part.ngc --cell cell.toml --plan out --scan part1 --out out2`
    """
    keep_inputs(out, program, cell, plan, *scan)
    keep_inputs(apply, program, cell, option="--apply")
    from counterflex.app.correction import correct as job

    with progress_bar(f"correcting {program.name}") as progress:
        summary = job.run(
            program, cell, plan, scan, out, apply=apply, report=report, progress=progress, limit_m=limit_um * UM
        )
    print_result(summary, as_json, show, out)


def show(summary: dict[str, Any], out: Path) -> None:
    """Print what was found."""
    values = summary["correct"]
    print_table(
        f"Parts of {summary['program']}",
        ["part", "measured in", "places", "noise um", "surface 99.7 % um", "error", "changed um"],
        [
            [
                str(row["part"]),
                row["source"],
                str(row["places"]),
                f"{row['noise_um']:g}",
                f"{row['surface_p997_um']:g}",
                "believed" if row["believed"] else "noise only",
                f"{row['changed_um']:g}" if "changed_um" in row else "",
            ]
            for row in values["parts"]
        ],
    )
    print_table(
        "What explains it",
        ["explanation", "log evidence", "explained", "factors"],
        [
            [
                row["explanation"],
                f"{row['log_evidence']:g}",
                f"{row['explained_percent']:g} %",
                "; ".join(
                    f"{one['name']} {one['value']:+g} +- {one['standard_deviation']:g} {one['unit']}"
                    for one in row["factors"]
                ),
            ]
            for row in values["explanations"][:_SHOWN]
        ],
    )
    if len(values["alike"]) > 1:
        typer.echo(f"not to be told apart by this part: {'; '.join(values['alike'])}")
    hidden = values["not_seen"]
    if hidden["of_cut_percent"] > 0.0:
        typer.echo(f"no surface shows {hidden['of_cut_percent']:g} % of the cut: run over later, or cut in air")
    if not values["changed"]:
        typer.echo("the parts show nothing but noise, or less than 5 um: the program stays as it is")
    else:
        e = values["expected"]
        typer.echo(
            f"largest change of the correction {values['change_um']:g} um; surface, 99.7 %: {e['now_p997_um']:g} um "
            f"now, {e['next_p997_um']:g} um ({e['next_5_percent_um']:g} to {e['next_95_percent_um']:g}) expected"
        )
    if "stiffness" in summary.get("assumed", {}):
        warn(f"the stiffness of axes is assumed, as in the plan: {summary['assumed']['stiffness']['from']}")
    if "applied" in summary:
        typer.echo(f"wrote {summary['applied']['cell']}: {summary['applied']['explanation']}")
    files = [*summary["files"], "plan.parquet", "path-error.parquet", "parts/", "summary.json"]
    typer.echo(f"wrote {out}: {', '.join(files)} ({summary['seconds']:.1f} s)")

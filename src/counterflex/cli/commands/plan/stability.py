"""Command plan stability: margin of a program against chatter."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.commands.program import CellFile, ReadingOptions
from counterflex.cli.option_records import with_records
from counterflex.cli.output import keep_inputs, line_of, print_result, print_table, progress_bar, say_written


@with_records
def stability(
    program: Annotated[Path, argument("G-code file.", arguments.file, "PROGRAM")],
    cell: CellFile,
    out: Annotated[
        Path | None,
        option(
            "--out",
            "Folder for report.html (lobes, margin along the path), stability.csv, lobes.csv and summary.json; "
            "made when missing.",
            arguments.output_folder,
            "DIR",
        ),
    ] = None,
    response: Annotated[
        Path | None,
        option(
            "--response",
            "Measured frequency response of the tool tip (.csv): direction (x, y, z of the TCP frame), "
            "frequency_hz, real_um_per_n, imaginary_um_per_n.",
            arguments.file,
            "CSV",
        ),
    ] = None,
    modal: Annotated[
        Path | None,
        option(
            "--modal",
            "Modal parameters of spindle and tool (.csv): direction, frequency_hz, damping_ratio, stiffness_n_per_um.",
            arguments.file,
            "CSV",
        ),
    ] = None,
    damping: Annotated[
        float | None,
        option(
            "--damping",
            "Damping ratio of the robot's modes, 0.001 to 0.7. Default: that of the tap test in the cell file, "
            "otherwise 0.1 is assumed, which stands for 0.02 to 0.3.",
            arguments.between(0.001, 0.7),
            "RATIO",
        ),
    ] = None,
    *,
    source: ReadingOptions,
    as_json: Annotated[bool, option("--json", "Print JSON instead of the table.")] = False,
) -> None:
    """Compute the margin of a program against chatter along its path, and name the worst line.

    The margin is the factor by which the cut could be deeper; below 1 it chatters. The robot's modes depend on the
    posture and come from the masses and compliances of the cell file; spindle and tool come from a measured response
    or from modal parameters. Without either they are taken as rigid.

    Verdicts: stable; chatter (exit status 1). Where the damping ratio was not measured, the least one needed is
    printed, and the verdict is marked as open if it changes within the interval of the assumed ratio.

    Example: `counterflex plan stability part.ngc --cell cell.toml --out stability`
    """
    keep_inputs(out, cell, program, source.parameters, response, modal)
    from counterflex.app import stability as job

    with progress_bar(f"stability of {program.name}") as progress:
        summary = job.run(
            program,
            cell,
            out,
            response=response,
            modal=modal,
            damping_ratio=damping,
            reading=source.reading(),
            progress=progress,
        )
    print_result(summary, as_json, _show)
    if out is not None and not as_json:
        say_written(out, f"wrote {out}: report.html, stability.csv, lobes.csv, summary.json")
    if summary["verdict"] == "chatter":
        raise typer.Exit(1)


def _show(summary: dict[str, Any]) -> None:
    rows = []
    for tool in summary["tools"]:
        worst = tool["worst"]
        rows.append(
            [
                f"T{tool['tool']}",
                line_of(worst),
                _number(worst["axial_depth_mm"], "mm"),
                f"{worst['entry_deg']:.0f} to {worst['exit_deg']:.0f} deg",
                f"{worst['spindle_rpm']:.0f} rpm",
                _number(worst["robot_margin"], "", "no limit"),
                _number(worst["tool_margin"], "", "no limit"),
                _number(tool["semi_discretisation_margin"], "", "no limit"),
                _number(worst["chatter_hz"], "Hz"),
            ]
        )
    print_table(
        f"{summary['program']} on {summary['cell']}: the worst stretch of each tool",
        ["tool", "worst", "depth", "engaged", "speed", "margin robot", "margin tool", "semi-discr.", "chatter at"],
        rows,
    )
    worst = summary["worst"]
    typer.echo(
        f"{summary['verdict']}: least margin {worst['margin']:.3g} at {line_of(worst)} ({worst['method']}); "
        f"{summary['below_1']} of {summary['stretches']} stretches below 1"
    )
    needed = max(tool["needed_damping_ratio"] for tool in summary["tools"])
    low, high = summary["robot_damping_between"]
    between = "" if low == high else f", {low:g} to {high:g}"
    typer.echo(
        f"robot: damping ratio {summary['robot_damping_ratio']:g} ({summary['robot_damping_from']}{between}); "
        f"stable from {needed:.3g} upwards"
    )
    if summary["verdict_over_interval"] == "open":
        typer.echo(
            f"open: the damping ratio was not measured; below {needed:.3g} the program chatters. Give --damping, or "
            "measure it: counterflex identify servo"
        )
    if summary["engagement"] != "closed form":
        typer.echo(f"engagement: {summary['engagement']} ({summary['cell_mm']:g} mm): the blank is no box")
    typer.echo(f"spindle and tool: {summary['tool_tip']['from']}")


def _number(value: float | None, unit: str, otherwise: str = "") -> str:
    return otherwise if value is None else f"{value:.3g} {unit}".rstrip()

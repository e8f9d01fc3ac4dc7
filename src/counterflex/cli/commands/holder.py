"""Commands of the force-sensing spindle holder: its design."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.commands.program import Out
from counterflex.cli.output import keep_inputs, print_json, print_table, progress_bar, say_written
from counterflex.core.errors import InputError

_SETTLED: Final = 5.0  # Change of a strain from half as many bricks above which more are advised, %
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
    if as_json:
        print_json(summary)
        return
    _show(summary)
    files = "report.html, summary.json" + (", holder.toml" if choose is not None else "")
    say_written(out, f"wrote {out}: {files}")


def _settled_line(settled: dict[str, float] | None, bricks: int) -> str:
    if settled is None:
        return "warning: one brick over a pocket: the strains may be wrong by half; give --bricks 4 or more"
    change = (
        f"from {max(1, bricks // 2)} to {bricks} bricks over a pocket the strains change by "
        f"{settled['strain']:g} %, the compliance by {settled['compliance']:g} %: they are settled to about as much"
    )
    more = "" if settled["strain"] <= _SETTLED else f"; give --bricks {2 * bricks} or more"
    return f"{'note' if not more else 'warning'}: {change}{more}"


def _show(summary: dict[str, Any]) -> None:
    rows = summary["compliance_um_per_kn"]
    print_table(
        f"Compliance at the tool tip of {summary['holder']}, um/kN",
        ["", "x", "y", "z"],
        [
            *([name.replace("_", " "), *(f"{v:.2f}" for v in row)] for name, row in rows.items()),
            ["stiffness lost, %", *(f"{v:.1f}" for v in summary["lost_stiffness_percent"])],
            ["Denkena2015, lost, %", *(f"{v:.1f}" for v in summary["denkena2015_lost_percent"])],
        ],
    )
    print_table(
        "Bridges: strain by a force at the tool tip, um/m per kN",
        ["cheek", "face", "y mm", "z mm", "x", "y", "z", "gain", "rib"],
        [
            [row["cheek"], row["face"], f"{row['y_mm']:g}", f"{row['z_mm']:g}"]
            + [f"{v:.2f}" for v in row["strain_um_m_per_kn"]]
            + [f"{row['gain']:.2f}", "" if row["rib_gain"] is None else f"{row['rib_gain']:.2f}"]
            for row in summary["bridges"]
        ],
    )
    if summary["condition_of_m"] is not None:
        sigma = ", ".join(f"{v:.1f} N along {a}" for a, v in zip("xyz", summary["force_sigma_n"], strict=True))
        typer.echo(
            f"condition of M {summary['condition_of_m']:g} (Denkena2015, printed: "
            f"{summary['denkena2015_condition']:g}); {summary['noise_um_m']:g} um/m of noise are {sigma}"
        )
    typer.echo(_settled_line(summary["settled_percent"], summary["bricks"]))
    spindle = summary["spindle"]
    for row in [] if spindle is None else spindle["angles"]:
        angle = "as it is" if row["angle_deg"] is None else f"{spindle['mounting']} = {row['angle_deg']:g} deg"
        typer.echo(
            f"spindle {angle}: {spindle['force_n']:g} N radial bend the arm by a median of {row['median_um']} um "
            f"({row['least_um']} to {row['most_um']}, {row['reached']} places)"
        )


holder.command("design")(design)

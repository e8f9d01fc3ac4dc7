"""Commands iso230: circular tests, straightness and positioning from raw measurements."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.commands.question import AsJson
from counterflex.cli.commands.standards.options import Average, Files, Format, FrameOf, Out
from counterflex.cli.output import keep_inputs, print_json, print_table, progress_bar, say_written

_iso230 = typer.Typer(no_args_is_help=True, help="Circular tests, straightness and positioning (ISO 230).")

CommandedPath = Annotated[
    Path | None,
    option("--path", "What was commanded: table (.csv: x_mm,y_mm,z_mm) or program.", arguments.file, "CSV|PROGRAM"),
]


def register(app: typer.Typer) -> None:
    """Add these commands."""
    _iso230.command("circularity")(circularity)
    _iso230.command("straightness")(straightness)
    _iso230.command("positioning")(positioning)
    _iso230.callback()(_group)
    app.add_typer(_iso230, name="iso230")


def _group() -> None:
    """Circular tests, straightness and positioning (ISO 230)."""


def circularity(
    files: Files,
    path: CommandedPath = None,
    radius_mm: Annotated[
        float | None,
        option(
            "--radius-mm",
            "Nominal radius where --path is not given; without both there is no F and no D.",
            arguments.between(0.1, 1e5),
            "MM",
        ),
    ] = None,
    frame: FrameOf = "as-measured",
    form: Format = "counterflex",
    average_ms: Average = 0.0,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Compute the figures of ISO 230-4 of circular paths: G, F, and for both directions G(b), D and H.

    Whole turns are found in the logs; of each stretch in one direction the middle turn is judged.

    Example: `counterflex iso230 circularity ring.csv --path circle.ngc --out circle`
    """
    if out is not None:
        keep_inputs(out, *files, *([] if path is None else [path]))
    from counterflex.app.robot_tests import iso230 as job

    with progress_bar("ISO 230-4") as progress:
        summary = job.circular(
            files, out, path=path, radius_mm=radius_mm, frame=frame, form=form, average_ms=average_ms, progress=progress
        )
    if as_json:
        print_json(summary)
        return
    radius = summary["radius_mm"]
    names = ["G_um", "G_lsc_um", "F_max_um", "F_min_um", "F_nominal_max_um", "F_nominal_min_um", "axial_um"]
    names = [name for name in names if any(row.get(name) is not None for row in summary["turns"])]
    print_table(
        "Turns, um" if radius is None else f"Turns about a nominal radius of {radius:g} mm, um",
        ["turn", "direction", *(name.removesuffix("_um").replace("_", " ") for name in names), "radius mm"],
        [
            [str(row["turn"]), row["direction"], *(_um(row.get(name)) for name in names), f"{row['radius_mm']:.4f}"]
            for row in summary["turns"]
        ],
    )
    if summary["bi_directional"]:
        print_table(
            "Both directions, um",
            ["pair", "G(b)", "G(b) lsc", "D", "H (1996)"],
            [
                [str(row["pair"]), *(_um(row[name]) for name in ("G_b_um", "G_b_lsc_um", "D_um", "H_um"))]
                for row in summary["bi_directional"]
            ],
        )
    _show_conditions(summary, out)


def straightness(
    files: Files,
    path: CommandedPath = None,
    frame: FrameOf = "as-measured",
    form: Format = "counterflex",
    average_ms: Average = 0.0,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Compute the straightness (ISO 230-1, ISO 1101) of the straight stretches of a path, or of a whole log.

    Minimum zone: two parallel lines, horizontal and vertical, and a cylinder; and about the least-squares line.

    Example: `counterflex iso230 straightness log.csv --path square.ngc`
    """
    if out is not None:
        keep_inputs(out, *files, *([] if path is None else [path]))
    from counterflex.app.robot_tests import iso230 as job

    with progress_bar("straightness") as progress:
        summary = job.straight(files, out, path=path, frame=frame, form=form, average_ms=average_ms, progress=progress)
    if as_json:
        print_json(summary)
        return
    names = ["horizontal", "horizontal_ls", "vertical", "vertical_ls", "cylinder", "cylinder_ls"]
    print_table(
        "Straightness, um: minimum zone and least squares (ls)",
        ["stretch", "cycle", "length mm", *(name.replace("_", " ") for name in names)],
        [
            [str(row["stretch"]), str(row["cycle"]), f"{row['length_mm']:.1f}", *(_um(row[f"{n}_um"]) for n in names)]
            for row in summary["stretches"]
        ],
        note=f"left out: {summary['ends_left_out']}",
    )
    _show_conditions(summary, out)


def positioning(
    file: Annotated[
        Path,
        argument(
            "Table: target_mm, one of position_mm, deviation_um, deviation_mm, and direction where known.",
            arguments.file,
            "CSV",
        ),
    ],
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Compute the figures of ISO 230-2 of an axis: A, R, E, M and B, of both directions and of each.

    Without a direction the rows are in the order of the test. The length is not corrected to 20 degC.

    Example: `counterflex iso230 positioning axis.csv --out axis`
    """
    if out is not None:
        keep_inputs(out, file)
    from counterflex.app.robot_tests.positioning import judge_positioning

    summary = judge_positioning(file, out)
    if as_json:
        print_json(summary)
        return
    figures = summary["figures"]
    print_table(
        f"Positioning over {summary['length_mm']:g} mm, um",
        ["figure", "both directions", "up", "down"],
        [[letter, *(_um(figures.get(f"{letter}{way}_um")) for way in ("", "_up", "_down"))] for letter in "AREMB"],
        note="up: towards larger targets; not corrected to 20 degC",
    )
    for line in summary["not_by_standard"]:
        typer.echo(f"not by ISO 230-2: {line}")
    if out is not None:
        say_written(out, f"wrote {out}: report.html, figures.csv, summary.json")


def _um(value: float | None) -> str:
    return "" if value is None else f"{value:.1f}"


def _show_conditions(summary: dict[str, Any], out: Path | None) -> None:
    typer.echo(f"frame: {summary['frame']}; filter: {summary['filter']}; commanded: {summary['commanded']}")
    if out is not None:
        say_written(out, f"wrote {out}: report.html, figures.csv, readings.parquet, summary.json")

"""Commands iso230: circular tests, straightness and positioning from raw measurements."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.commands.question import AsJson
from counterflex.cli.commands.standards.options import Average, Files, Format, FrameOf, Out
from counterflex.cli.output import keep_inputs, print_summary, progress_bar

iso230 = typer.Typer(no_args_is_help=True, help="Circular tests, straightness and positioning (ISO 230).")

CommandedPath = Annotated[
    Path | None,
    option("--path", "What was commanded: table (.csv: x_mm,y_mm,z_mm) or program.", arguments.file, "CSV|PROGRAM"),
]

_FILES = ": report.html, figures.csv, readings.parquet, summary.json"


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
    keep_inputs(out, *files, path)
    from counterflex.app.robot_tests import iso230 as job

    with progress_bar("ISO 230-4") as progress:
        summary = job.circular(
            files, out, path=path, radius_mm=radius_mm, frame=frame, form=form, average_ms=average_ms, progress=progress
        )
    print_summary(summary, as_json, out, _FILES)


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
    keep_inputs(out, *files, path)
    from counterflex.app.robot_tests import iso230 as job

    with progress_bar("straightness") as progress:
        summary = job.straight(files, out, path=path, frame=frame, form=form, average_ms=average_ms, progress=progress)
    print_summary(summary, as_json, out, _FILES)


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
    keep_inputs(out, file)
    from counterflex.app.robot_tests.positioning import judge_positioning

    summary = judge_positioning(file, out)
    print_summary(summary, as_json, out, ": report.html, figures.csv, summary.json")


iso230.command("circularity")(circularity)
iso230.command("straightness")(straightness)
iso230.command("positioning")(positioning)

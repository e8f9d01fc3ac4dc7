"""Commands on runs that have ended: log history, log compare, log page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import MOST_RECORDS, argument, option
from counterflex.cli.output import keep_folders, print_summary, progress_bar

INCOMPLETE: Final = 5
"""Exit status: what there is was read, but cycles are missing or a log cannot be read."""
Folder = Annotated[Path, argument("Folder of the run log.", arguments.folder, "DIR")]
Out = Annotated[Path, option("--out", "Folder of the page.", arguments.output_folder, "DIR")]
Number = Annotated[
    int | None, option("--run", "Number of the run, as `log show` says it; the last.", min=0, max=MOST_RECORDS)
]
AsJson = Annotated[bool, option("--json", "Print JSON.")]


def history(
    folder: Annotated[Path, argument("Searched with all folders below it.", arguments.folder, "DIR")],
    out: Annotated[Path | None, option("--out", "Folder of the page.", arguments.output_folder, "DIR")] = None,
    as_json: AsJson = False,
) -> None:
    """List all runs below a folder with their figures, and the trends over runs of the same program.

    Deviations are 99.7 % of the cut, across the feed and along the tool: predicted, corrected by program and loop,
    remaining by the model, measured by a tracker. Of a compensated program the first two need the plan file where it
    was. Trends come from four runs on. Ends with status 5 when cycles are missing or a log cannot be read.

    Example: `counterflex log history . --out history`
    """
    if out is not None:
        keep_folders(out, folder, *sorted({file.parent for file in folder.rglob("run-*.mcap")}))
    from counterflex.app.run_history import history as job

    with progress_bar("reading runs") as progress:
        summary = job.history(folder, out, progress)
    print_summary(summary, as_json, out, ": report.html, summary.json")
    if summary["incomplete"]:
        raise typer.Exit(INCOMPLETE)


def compare(
    first: Folder,
    second: Annotated[Path, argument("Folder of the other run's log.", arguments.folder, "DIR")],
    out: Out,
    number: Number = None,
    second_number: Annotated[
        int | None, option("--second-run", "Number of the other run; the last.", min=0, max=MOST_RECORDS)
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compare two runs: their figures with differences, and a page with the curves of both on the same axis.

    Example: `counterflex log compare monday tuesday --out compared`
    """
    keep_folders(out, first, second)
    from counterflex.app.run_history import pages as job

    summary = job.compare(first, second, out, (number, second_number))
    print_summary(summary, as_json, out, ": report.html, summary.json")


def page(folder: Folder, out: Out, number: Number = None, as_json: AsJson = False) -> None:
    """Open the log of a run again as a page: figures, curves along the path, incidents, what operators did.

    Example: `counterflex log page log --out page`
    """
    keep_folders(out, folder)
    from counterflex.app.run_history import pages as job

    summary = job.page(folder, out, number)
    print_summary(summary, as_json, out, ": report.html, summary.json")

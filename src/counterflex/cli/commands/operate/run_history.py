"""Commands on runs that have ended: log history, log compare, log page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import MOST_RECORDS, argument, option
from counterflex.cli.output import keep_folders, print_json, print_table, progress_bar, say_written

INCOMPLETE: Final = 5
"""Exit status: what there is was read, but cycles are missing or a log cannot be read."""
Folder = Annotated[Path, argument("Folder of the run log.", arguments.folder, "DIR")]
Out = Annotated[Path, option("--out", "Folder of the page.", arguments.output_folder, "DIR")]
Number = Annotated[
    int | None, option("--run", "Number of the run, as `log show` says it; the last.", min=0, max=MOST_RECORDS)
]
AsJson = Annotated[bool, option("--json", "Print JSON.")]
_COLUMNS: Final = {
    "begun": "begun (UTC)",
    "program": "program",
    "folder": "folder",
    "run": "run",
    "seconds": "s",
    "share_percent": "path %",
    "predicted_um": "predicted um",
    "corrected_um": "corrected um",
    "remaining_um": "remaining (model) um",
    "measured_um": "measured um",
    "force_peak_n": "force N",
    "incidents": "incidents",
    "reply_p99_us": "answer p99 us",
    "telegrams_lost": "telegrams lost",
}


def register(log: typer.Typer) -> None:
    """Add these commands to those on a run log."""
    log.command("history")(history)
    log.command("compare")(compare)
    log.command("page")(page)


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
    if as_json:
        print_json(summary)
    else:
        _show(summary)
        if out is not None:
            say_written(out, f"wrote {out}: report.html, summary.json")
    if summary["incomplete"]:
        raise typer.Exit(INCOMPLETE)


def _show(summary: dict[str, Any]) -> None:
    rows = []
    for row in summary["runs"]:
        flat = {**row, "reply_p99_us": (row["reply_us"] or {}).get("p99")}
        flat["folder"] = Path(row["folder"]).name
        flat["begun"] = None if row["begun"] is None else row["begun"][:19].replace("T", " ")
        rows.append([_text(flat[name]) for name in _COLUMNS])
    print_table("Runs", list(_COLUMNS.values()), rows)
    for program in summary["programs"]:
        if program["trends"]:
            print_table(
                f"Trends of {program['program'] or program['program_sha256'][:12]}, {len(program['runs'])} runs",
                ["figure", "unit", "mean", "change per run", "+- (95 %)", "verdict"],
                [
                    [
                        one["title"],
                        one["unit"],
                        f"{one['mean']:g}",
                        f"{one['slope_per_run']:+g}",
                        f"{one['half_width95']:g}",
                        "changes" if one["clear"] else "no change to be told",
                    ]
                    for one in program["trends"]
                ],
            )
    for one in summary["unreadable"]:
        typer.echo(f"cannot be read: {one['folder']}: {one['why']}")


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
    if as_json:
        print_json(summary)
        return
    print_table(
        "Two runs",
        ["figure", "first", "second", "difference"],
        [
            [job.COMPARED[name], _text(one["first"]), _text(one["second"]), _signed(one["difference"])]
            for name, one in summary["figures"].items()
        ],
        note="" if summary["same_program"] else "the runs are not of the same program, or it is not known",
    )
    say_written(out, f"wrote {out}: report.html, summary.json")


def page(folder: Folder, out: Out, number: Number = None, as_json: AsJson = False) -> None:
    """Open the log of a run again as a page: figures, curves along the path, incidents, what operators did.

    Example: `counterflex log page log --out page`
    """
    keep_folders(out, folder)
    from counterflex.app.run_history import pages as job

    summary = job.page(folder, out, number)
    if as_json:
        print_json(summary)
        return
    print_table(
        f"Run {summary['run']}",
        ["figure", "value"],
        [[job.COMPARED[name], _text(value)] for name, value in job.flat(summary).items()],
    )
    say_written(out, f"wrote {out}: report.html, summary.json")


def _text(value: float | str | None) -> str:
    if value is None:
        return "-"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _signed(value: float | None) -> str:
    return "-" if value is None else f"{value:+g}"

"""The job ``log history``: all runs below a folder with their figures, and trends over runs of the same program."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from counterflex import __version__
from counterflex.app.run_history.logged_run import read_runs
from counterflex.core import atomic
from counterflex.core.errors import CounterflexError, FileFormatError
from counterflex.core.progress import Progress, silent
from counterflex.core.result import Parts, ShownTable, Summary
from counterflex.core.units import plain
from counterflex.evaluate.run_curves import trend
from counterflex.files.summary_file import write_summary

TRENDS: Final[dict[str, tuple[str, str, Callable[[dict[str, Any]], float | None]]]] = {
    "force_ratio": ("wear: measured by planned force", "", lambda row: row["force_ratio"]),
    "correction_across": ("drift: mean correction across the feed", "um", lambda row: _mean(row, 0)),
    "correction_along_tool": ("drift: mean correction along the tool", "um", lambda row: _mean(row, 1)),
    "remaining": ("remaining deviation (model), 99.7 %", "um", lambda row: row["remaining_um"]),
    "measured": ("measured deviation, 99.7 %", "um", lambda row: row["measured_um"]),
    "force_peak": ("largest force", "N", lambda row: row["force_peak_n"]),
    "reply_p99": ("time to answer, 99 %", "us", lambda row: (row["reply_us"] or {}).get("p99")),
}
"""What is followed over the runs of a program: title, unit, and how a row says it."""


def _mean(row: dict[str, Any], place: int) -> float | None:
    values = row["mean_correction_um"]
    return None if values is None else float(values[place])


_COLUMNS: Final = (
    "begun (UTC)=begun | program | folder | run | s=seconds:g | path %=share_percent:g | predicted um:g | "
    "corrected um:g | remaining (model) um=remaining_um:g | measured um:g | force N=force_peak_n:g | incidents | "
    "answer p99 us=reply_p99_us:g | telegrams lost"
)


class RunHistory(Summary):
    """Runs below a folder, and trends over those of the same program."""

    def _shown(self) -> Parts:
        rows = [
            row
            | {
                "reply_p99_us": (row["reply_us"] or {}).get("p99"),
                "folder": Path(row["folder"]).name,
                "begun": None if row["begun"] is None else row["begun"][:19].replace("T", " "),
            }
            for row in self["runs"]
        ]
        yield ShownTable.of("Runs", " | ".join(f"{one.strip()}~-" for one in _COLUMNS.split("|")), rows)
        for program in self["programs"]:
            if program["trends"]:
                words = {True: "changes", False: "no change to be told"}
                yield ShownTable.of(
                    f"Trends of {program['program'] or program['program_sha256'][:12]}, {len(program['runs'])} runs",
                    "figure=title | unit | mean:g | change per run=slope_per_run:+g | +- (95 %)=half_width95:g | "
                    "verdict=said",
                    [one | {"said": words[one["clear"]]} for one in program["trends"]],
                )
        yield from self.each("unreadable", "cannot be read: {folder}: {why}")


def log_folders(folder: Path) -> list[Path]:
    """Folders with a run log: this one and those below it, by name. Raises FileFormatError: there is none."""
    folders = sorted({file.parent for file in folder.rglob("run-*.mcap")})
    if not folders:
        raise FileFormatError(
            "there is no run log in this folder or below it", where=str(folder), hint="Expected run-000.mcap"
        )
    return folders


def history(folder: Path, out: Path | None = None, progress: Progress = silent) -> RunHistory:
    """Runs below a folder; with ``out``, write ``report.html`` and ``summary.json``.

    Args:
        out: Folder of the results, or None.

    Returns:
        ``runs``: rows of :func:`counterflex.app.run_history.logged_run.read_runs` in the order in which they began;
        ``programs``: runs of the same program with their trends; ``unreadable`` folders and why.

    Raises:
        FileFormatError: There is no run log, or none can be read.
    """
    rows: list[dict[str, Any]] = []
    unreadable: list[dict[str, str]] = []
    refused: CounterflexError | None = None
    folders = log_folders(folder)
    for k, place in enumerate(folders):
        progress(k / len(folders), place.name)
        try:
            rows += [one.row for one in read_runs(place)]
        except CounterflexError as fault:
            refused = refused or fault
            unreadable.append({"folder": str(place), "why": str(fault)})
    if not rows and refused is not None:
        raise refused
    rows.sort(key=lambda row: (row["begun"] or "", row["folder"], row["run"]))
    summary = {
        "job": "log history",
        "folder": str(folder),
        "runs": rows,
        "programs": _programs(rows),
        "unreadable": unreadable,
        "incomplete": bool(unreadable) or any(row["incomplete"] for row in rows),
        "counterflex": __version__,
    }
    if out is not None:
        from counterflex.report.page import write_page
        from counterflex.report.run_history.page import history_page

        with atomic.atomic_folder(out) as staging:
            write_page(history_page(summary), staging / "report.html")
            write_summary(staging / "summary.json", summary)
    progress(1.0)
    return RunHistory(summary)


def _programs(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Runs by program, those with several first; their trends."""
    by_program: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        if row["program_sha256"] is not None:
            by_program.setdefault(row["program_sha256"], []).append(row)
    return [
        {
            "program": runs[0]["program"],
            "program_sha256": sha256,
            "runs": [{"folder": row["folder"], "run": row["run"]} for row in runs],
            "figures": {name: [of(row) for row in runs] for name, (_, _, of) in TRENDS.items()},
            "trends": [
                {
                    "figure": name,
                    "title": title,
                    "unit": unit,
                    **plain(one, "runs mean:4 slope_per_run=slope:5 half_width95=half_width:5 clear"),
                }
                for name, (title, unit, of) in TRENDS.items()
                if (one := trend([of(row) for row in runs])) is not None
            ],
        }
        for sha256, runs in sorted(by_program.items(), key=lambda item: -len(item[1]))
    ]

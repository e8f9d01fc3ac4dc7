"""The jobs ``log compare`` and ``log page``: two runs beside each other, or one again, as a page with curves."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from counterflex import __version__
from counterflex.app.run_history.logged_run import RunOfHistory
from counterflex.core import atomic
from counterflex.core.errors import InputError
from counterflex.core.result import Parts, ShownTable, Summary
from counterflex.files.summary_file import write_summary
from counterflex.report.page import write_page
from counterflex.report.run_history.page import ShownRun, runs_page

COMPARED: Final = {
    "seconds": "duration, s",
    "share_percent": "share of the path, %",
    "predicted_um": "predicted deviation, 99.7 %, um",
    "corrected_um": "corrected by program and loop, 99.7 %, um",
    "remaining_um": "remaining by the model, 99.7 %, um",
    "measured_um": "measured deviation, 99.7 %, um",
    "force_peak_n": "largest force, N",
    "force_ratio": "measured by planned force",
    "incidents": "holds and faults",
    "reply_p50_us": "time to answer, median, us",
    "reply_p99_us": "time to answer, 99 %, us",
    "reply_max_us": "time to answer, largest, us",
    "telegrams_lost": "telegrams lost",
    "records_lost": "records lost",
}
"""Figures of a run and their headings."""


def flat(row: dict[str, Any]) -> dict[str, float | None]:
    """Figures of a row by the names of :data:`COMPARED`."""
    reply = row["reply_us"] or {}
    rest = {f"reply_{name}_us": reply.get(name) for name in ("p50", "p99", "max")}
    return {name: (rest | row)[name] for name in COMPARED}


def page(folder: Path, out: Path, number: int | None = None) -> LoggedRunSummary:
    """Open a log again: one run as a page.

    Args:
        out: Folder of ``report.html`` and ``summary.json``.
        number: Of the run; None is the last.
    """
    run = RunOfHistory.of(folder, number)
    summary = {
        "job": "log page",
        **run.row,
        "incidents_by_number": [one.shown() for one in run.incidents],
        "operator_actions": list(run.actions),
        "counterflex": __version__,
    }
    _write(out, summary, [run], [])
    return LoggedRunSummary(summary)


class LoggedRunSummary(Summary):
    """A run of a log."""

    def _shown(self) -> Parts:
        rows = [(COMPARED[name], value) for name, value in flat(self).items()]
        yield ShownTable.of(f"Run {self['run']}", "figure=0 | value=1:g~-", rows)


class ComparedRuns(Summary):
    """Two runs beside each other."""

    def _shown(self) -> Parts:
        yield ShownTable.of(
            "Two runs",
            "figure=title | first:g~- | second:g~- | difference:+g~-",
            [one | {"title": COMPARED[name]} for name, one in self["figures"].items()],
            "" if self["same_program"] else "the runs are not of the same program, or it is not known",
        )


def compare(
    first: Path, second: Path, out: Path, numbers: tuple[int | None, int | None] = (None, None)
) -> ComparedRuns:
    """Two runs beside each other: figures with their differences, and curves on the same axis.

    Args:
        out: Folder of ``report.html`` and ``summary.json``.
        numbers: Of the runs; None is the last.

    Raises:
        InputError: Both are the same run.
    """
    runs = [
        RunOfHistory.of(place, number, option)
        for place, number, option in zip((first, second), numbers, ("--run", "--second-run"), strict=True)
    ]
    a, b = (one.row for one in runs)
    if first.resolve() == second.resolve() and a["run"] == b["run"]:
        raise InputError(
            "both are the same run",
            where=f"{first}, run {a['run']}",
            hint="Give --run and --second-run, or two folders",
        )
    notes = []
    if a["program_sha256"] is None or a["program_sha256"] != b["program_sha256"]:
        notes.append("The runs are not of the same program, or it is not known: places along the path do not agree.")
    values = [flat(row) for row in (a, b)]
    summary = {
        "job": "log compare",
        "same_program": not notes,
        "runs": [a, b],
        "figures": {
            name: {
                "first": values[0][name],
                "second": values[1][name],
                "difference": _difference(values[0][name], values[1][name]),
            }
            for name in COMPARED
        },
        "counterflex": __version__,
    }
    _write(out, summary, runs, notes)
    return ComparedRuns(summary)


def _difference(first: float | None, second: float | None) -> float | None:
    return None if first is None or second is None else round(second - first, 4)


def verdict(run: RunOfHistory) -> str:
    """Say in one sentence how far a run came, what stopped it and what the model says that remains."""
    row, causes = run.row, [str(one.shown()["cause"]).replace("_", " ") for one in run.incidents]
    share = "" if row["share_percent"] is None else f" over {row['share_percent']:g} % of the path"
    ended = "no hold and no fault"
    if causes:
        count = "one hold or fault" if len(causes) == 1 else f"{len(causes)} holds and faults, the first"
        ended = f"{count}: {causes[0]}"
    remains = "what remains is not known"
    if row["remaining_um"] is not None:
        remains = f"{row['remaining_um']:g} um remain by the model (99.7 % of the cut)"
    measured = "not measured by a tracker" if row["measured_um"] is None else f"measured {row['measured_um']:g} um"
    missing = "; cycles are missing" if row["incomplete"] else ""
    return f"{row['seconds']:g} s{share}: {ended}; {remains}, {measured}{missing}."


def _cell_of(run: RunOfHistory) -> str:
    name = run.about.get("files", {}).get("cell")
    return "cell not known" if name is None else Path(str(name)).name


def _write(out: Path, summary: dict[str, Any], runs: list[RunOfHistory], notes: list[str]) -> None:
    shown = [
        ShownRun(
            f"{Path(one.row['folder']).name} run {one.row['run']}",
            flat(one.row),
            one.curves,
            one.contained_m,
            [incident.shown() for incident in one.incidents],
            list(one.actions),
            {
                **{str(k): str(v) for k, v in one.about.get("files", {}).items()},
                "begun": one.row["begun"] or "not known",
                "folder": one.row["folder"],
            },
            verdict(one),
        )
        for one in runs
    ]
    with atomic.atomic_folder(out) as staging:
        title = " and ".join(dict.fromkeys(one.row["program"] or "program not known" for one in runs))
        cells = " and ".join(dict.fromkeys(_cell_of(one) for one in runs))
        subtitle = f"{' and '.join(one.name for one in shown)}, {cells}"
        write_page(runs_page(title, subtitle, shown, COMPARED, notes), staging / "report.html")
        write_summary(staging / "summary.json", summary)

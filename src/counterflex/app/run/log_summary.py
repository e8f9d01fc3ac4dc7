"""Lines and tables of a run log, and of what process monitoring found in a run."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from counterflex.core.next_command import next_command
from counterflex.core.result import Parts, ShownTable, Summary
from counterflex.protocols.session.comparison import not_closed_line

_SHOWN: Final = 20  # Rows of a table of the prompt


class LogSummary(Summary):
    """Runs of a log, and what of it is missing."""

    def _shown(self) -> Parts:
        for run in self["runs"]:
            yield from _run_parts(run, several=len(self["runs"]) > 1)
        yield f"segments: {len(self['segments'])}"
        if self["unread"]:
            count = len(self["unread"])
            yield f"by their digests: {count} of them; their records were not read, without --brief they are"
        yield from self["lines"]
        if self["cut"]:
            yield self.line("cut short: {cut}. ") + f"{next_command('log repair', self.folder)} writes them anew"
        elif self["damage"]:
            yield f"{next_command('log repair', self.folder)} writes damaged segments anew"

    def __init__(self, folder: str | Path, values: dict[str, Any]) -> None:
        super().__init__(values)
        self.folder = folder


def _run_parts(run: dict[str, Any], *, several: bool) -> Parts:
    yield ShownTable.of(
        f"Run {run['run']}" if several else "Run",
        "answered | no telegram=waited | telegrams lost | records lost | seconds:g | largest correction um:g | "
        "step um=largest_step_um:g",
        [run],
    )
    reply = run["reply_us"] or dict.fromkeys(("p50", "p99", "p99.9", "max"))
    columns = " | ".join(f"{name}={k}:g~-" for k, name in enumerate(reply))
    yield ShownTable.of("Time to answer, us", columns, [tuple(reply.values())])
    columns = "state={0!w} | cycles={1[cycles]} | seconds={1[seconds]:g}"
    yield ShownTable.of("States", columns, run["states"].items())
    if run["sources"]:
        yield ShownTable.of("The estimate rested on", "sources=0 | cycles=1", run["sources"].items())
    for title, key in (("its sources", "sources_changes"), ("the force sensors", "force_sensors_changes")):
        yield from _changes(f"Changes of {title}", run[key])
    yield from _changes("Changes", run["changes"])
    columns = "incident=number | cycle | seconds=time_s:.3f | state={state!w} | cause={cause!w} | out of={before!w}"
    yield from _first("Incidents", columns, run["incidents"], run["incidents_total"])
    actions = [
        one
        | {
            "said": str(one.get("action", one.get("text", ""))),
            "outcome": "done" if one.get("done") else str(one.get("refused", "")),
        }
        for one in run["operator_actions"]
    ]
    columns = "seconds=time_s:.3f~- | who=who? | from=from? | action=said | outcome"
    yield from _first("Operator", columns, actions, len(actions))
    yield from process_parts(run)
    if run["not_closed"]:
        yield f"at its start: {not_closed_line(run['not_closed'])}"
    if run["causes"]:
        causes = (f"{name.replace('_', ' ')} {count}" for name, count in run["causes"].items())
        yield "cycles with a cause: " + ", ".join(causes)


def _changes(title: str, changes: list[dict[str, Any]]) -> Parts:
    rows = [one | {"why": "" if one["cause"] == "none" else one["cause"]} for one in changes]
    columns = "cycle | seconds=time_s:.3f | from={from!w} | to={to!w} | cause={why!w}"
    yield from _first(title, columns, rows, len(rows))


def _first(title: str, columns: str, rows: list[dict[str, Any]], count: int) -> Parts:
    if rows:
        note = f"and {count - _SHOWN} more; --json lists them" if count > _SHOWN else ""
        yield ShownTable.of(title, columns, rows[:_SHOWN], note)


def process_parts(figures: dict[str, Any]) -> Parts:
    """Lines and tables of what process monitoring found in a run."""
    yield from figures.get("not_looked_at", [])
    if events := figures["events"]:
        counts = figures["event_counts"]
        kinds = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in counts.items())
        yield ShownTable.of(
            "Process events",
            "event={event!w} | path mm:.1f | seconds=time_s:.3f | cycle | value:g | limit:g | =unit",
            events[:_SHOWN],
            f"in all {kinds}; --json lists {len(events)}" if sum(counts.values()) > _SHOWN else "",
        )
    wear = figures["wear"]
    if wear is not None and wear["trend_percent_per_m"] is None:
        yield f"{wear['cut_m']:g} m of cut: too short for a trend of measured over predicted force"
    elif wear is not None:
        yield (
            f"force by predicted force over {wear['cut_m']:g} m of cut: {wear['trend_percent_per_m']:+g}"
            f" +- {wear['range95_percent_per_m']:g} % per metre (95 %)"
        )
    if figures["slowed_share"] > 0.0:
        yield (
            f"slowed in {100.0 * figures['slowed_share']:.1f} % of the cycles,"
            f" down to {100.0 * figures['least_speed']:.0f} % of the programmed speed"
        )

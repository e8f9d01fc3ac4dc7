"""Commands on a run log: log show, log replay, log export, log repair; those on ended runs are added."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.commands.operate import log_export, run_history
from counterflex.cli.commands.program import CellFile
from counterflex.cli.output import print_json, print_table, progress_bar
from counterflex.core.next_command import next_command

log = typer.Typer(no_args_is_help=True, help="What online runs logged: show, replay, export, repair, compare.")
_SHOWN = 20
INCOMPLETE: Final = 5
"""Exit status: what there is was read, but cycles are missing or something cannot be read."""

Folder = Annotated[Path, argument("Folder of the run log.", arguments.folder, "DIR")]
AsJson = Annotated[bool, option("--json", "Print JSON instead of tables.")]


def show(
    folder: Folder,
    brief: Annotated[
        bool, option("--brief", "Take the digest at the end of each segment in place of its records.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Show a run: cycles, states, holds and faults with their causes, reply times, losses.

    With --brief a day takes seconds; records that are damaged are not found then, and percentiles are at most 1 % high.

    Ends with status 5 when cycles are missing or something cannot be read.

    Example: `counterflex log show log`
    """
    from counterflex.app.run import log as job

    answer = job.show(folder, brief=brief)
    if as_json:
        print_json({key: value for key, value in answer.items() if key != "lines"})
        _end(incomplete=answer["incomplete"])
        return
    for run in answer["runs"]:
        _show_run(run, several=len(answer["runs"]) > 1)
    typer.echo(f"segments: {len(answer['segments'])}")
    if answer["unread"]:
        typer.echo(
            f"by their digests: {len(answer['unread'])} of them; their records were not read, without --brief they are"
        )
    for line in answer["lines"]:
        typer.echo(line)
    if answer["cut"]:
        typer.echo(f"cut short: {', '.join(answer['cut'])}. {next_command('log repair', folder)} writes them anew")
    elif answer["damage"]:
        typer.echo(f"{next_command('log repair', folder)} writes damaged segments anew")
    _end(incomplete=answer["incomplete"])


def _end(*, incomplete: bool) -> None:
    if incomplete:
        raise typer.Exit(INCOMPLETE)


def _show_run(run: dict[str, Any], *, several: bool) -> None:
    reply = run["reply_us"] or dict.fromkeys(("p50", "p99", "p99.9", "max"))
    print_table(
        f"Run {run['run']}" if several else "Run",
        ["answered", "no telegram", "telegrams lost", "records lost", "seconds", "largest correction um", "step um"],
        [
            [
                *(str(run[key]) for key in ("answered", "waited", "telegrams_lost", "records_lost")),
                *(f"{run[key]:g}" for key in ("seconds", "largest_correction_um", "largest_step_um")),
            ]
        ],
    )
    print_table(
        "Time to answer, us", list(reply), [["-" if value is None else f"{value:g}" for value in reply.values()]]
    )
    print_table(
        "States",
        ["state", "cycles", "seconds"],
        [
            [name.replace("_", " "), str(value["cycles"]), f"{value['seconds']:g}"]
            for name, value in run["states"].items()
        ],
    )
    if run["sources"]:
        print_table(
            "The estimate rested on", ["sources", "cycles"], [[name, str(n)] for name, n in run["sources"].items()]
        )
    _show_changes("Changes of its sources", run["sources_changes"])
    _show_changes("Changes of the force sensors", run["force_sensors_changes"])
    _show_changes("Changes", run["changes"])
    _show_incidents(run["incidents"], run["incidents_total"])
    _show_actions(run["operator_actions"])
    show_process(run)
    if run["not_closed"]:
        from counterflex.protocols.session.comparison import not_closed_line

        typer.echo(f"at its start: {not_closed_line(run['not_closed'])}")
    if run["causes"]:
        causes = (f"{name.replace('_', ' ')} {count}" for name, count in run["causes"].items())
        typer.echo("cycles with a cause: " + ", ".join(causes))


def _show_actions(actions: list[dict[str, Any]]) -> None:
    """Print what operators did, and what came of it."""
    if actions:
        print_table(
            "Operator",
            ["seconds", "who", "from", "action", "outcome"],
            [
                [
                    "-" if one["time_s"] is None else f"{one['time_s']:.3f}",
                    str(one.get("who", "")),
                    str(one.get("from", "")),
                    str(one.get("action", one.get("text", ""))),
                    "done" if one.get("done") else str(one.get("refused", "")),
                ]
                for one in actions[:_SHOWN]
            ],
            note=f"and {len(actions) - _SHOWN} more; --json lists them" if len(actions) > _SHOWN else "",
        )


def _show_changes(title: str, changes: list[dict[str, Any]]) -> None:
    if changes:
        print_table(
            title,
            ["cycle", "seconds", "from", "to", "cause"],
            [
                [
                    str(change["cycle"]),
                    f"{change['time_s']:.3f}",
                    change["from"].replace("_", " "),
                    change["to"].replace("_", " "),
                    "" if change["cause"] == "none" else change["cause"].replace("_", " "),
                ]
                for change in changes[:_SHOWN]
            ],
            note=f"and {len(changes) - _SHOWN} more; --json lists them" if len(changes) > _SHOWN else "",
        )


def _show_incidents(incidents: list[dict[str, Any]], total: int) -> None:
    if incidents:
        print_table(
            "Incidents",
            ["incident", "cycle", "seconds", "state", "cause", "out of"],
            [
                [
                    str(one["number"]),
                    str(one["cycle"]),
                    f"{one['time_s']:.3f}",
                    *(one[key].replace("_", " ") for key in ("state", "cause", "before")),
                ]
                for one in incidents[:_SHOWN]
            ],
            note=f"and {total - _SHOWN} more; --json lists them" if total > _SHOWN else "",
        )


def show_process(figures: dict[str, Any]) -> None:
    """Print what process monitoring found, and what it cannot see."""
    for line in figures.get("not_looked_at", []):
        typer.echo(line)
    events = figures["events"]
    if events:
        print_table(
            "Process events",
            ["event", "path mm", "seconds", "cycle", "value", "limit", ""],
            [
                [
                    event["event"].replace("_", " "),
                    f"{event['path_mm']:.1f}",
                    f"{event['time_s']:.3f}",
                    str(event["cycle"]),
                    f"{event['value']:g}",
                    f"{event['limit']:g}",
                    event["unit"],
                ]
                for event in events[:_SHOWN]
            ],
            note=_others(figures["event_counts"], len(events)),
        )
    wear = figures["wear"]
    if wear is not None and wear["trend_percent_per_m"] is None:
        typer.echo(f"{wear['cut_m']:g} m of cut: too short for a trend of measured over predicted force")
    elif wear is not None:
        typer.echo(
            f"force by predicted force over {wear['cut_m']:g} m of cut: {wear['trend_percent_per_m']:+g}"
            f" +- {wear['range95_percent_per_m']:g} % per metre (95 %)"
        )
    if figures["slowed_share"] > 0.0:
        typer.echo(
            f"slowed in {100.0 * figures['slowed_share']:.1f} % of the cycles,"
            f" down to {100.0 * figures['least_speed']:.0f} % of the programmed speed"
        )


def _others(counts: dict[str, int], listed: int) -> str:
    """Return what a table of the first events leaves out."""
    total = sum(counts.values())
    if total <= _SHOWN:
        return ""
    kinds = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in counts.items())
    return f"in all {kinds}; --json lists {listed}"


def replay(
    folder: Folder,
    cell: CellFile,
    plan: Annotated[Path | None, option("--plan", "Plan file of the run (.parquet).", arguments.file, "PLAN")] = None,
    original: Annotated[
        bool, option("--original", "The robot ran the original program, not the compensated one.")
    ] = False,
    from_s: Annotated[float, option("--from", "Begin there, s: at the last recorded state before.", min=0.0)] = 0.0,
    as_json: Annotated[bool, option("--json", "Print JSON.")] = False,
) -> None:
    """Replay the logged inputs through the loop: corrections and states must equal the logged ones bit for bit.

    Ends with status 1 when they are not, with 5 when cycles are missing, so that not every one could be compared.

    Example: `counterflex log replay log --cell cell.toml`
    """
    from counterflex.app.run import log as job

    with progress_bar("replaying") as progress:
        replayed = job.replay(folder, cell, plan, compensated=not original, from_s=from_s, progress=progress)
    if as_json:
        print_json(_plain(replayed))
    else:
        _show_replay(replayed)
    if replayed.difference is not None:
        raise typer.Exit(1)
    _end(incomplete=not replayed.proved or replayed.lost.incomplete)


def _plain(replayed: Any) -> dict[str, Any]:
    first = replayed.difference
    return {
        "records": replayed.records,
        "compared": replayed.compared,
        "skipped": replayed.skipped,
        "missing": replayed.missing,
        "same": replayed.proved,
        "difference": None
        if first is None
        else {
            "run": replayed.run,
            "cycle": first.cycle,
            "counter_ms": first.counter_ms,
            "column": first.column,
            "logged": repr(first.logged),
            "replayed": repr(first.replayed),
            "columns": first.columns,
        },
        "begun_after": replayed.begun,
        **replayed.lost.shown(),
        "gaps": [{"after": gap.after, "missing": gap.missing} for gap in replayed.gaps],
        "notes": replayed.notes,
    }


def _show_replay(replayed: Any) -> None:
    for note in replayed.notes:
        typer.echo(f"note: {note}")
    for gap in replayed.gaps:
        where = f"after cycle {gap.after}" if gap.after else "at the beginning"
        typer.echo(
            f"{gap.missing} cycles missing {where}: what follows cannot be computed again, up to the next"
            " recorded state"
        )
    for one in replayed.lost.damage:
        typer.echo(f"damaged: {one.segment}, bytes {one.begin} to {one.end - 1} cannot be read")
    for name in replayed.lost.empty:
        typer.echo(f"nothing of {name} can be read")
    for cycle in replayed.begun:
        typer.echo(f"began from the state recorded after cycle {cycle}")
    if replayed.lost.cut:
        typer.echo(f"cut short: {', '.join(replayed.lost.cut)}; the available cycles were compared")
    first = replayed.difference
    if first is not None:
        more = f", and {first.columns - 1} more columns of that cycle" if first.columns > 1 else ""
        typer.echo(
            f"first difference: cycle {first.cycle} (counter {first.counter_ms}), {first.column}:"
            f" logged {first.logged!r}, replayed {first.replayed!r}{more}"
        )
    same = "bit for bit the same" if first is None else "the same until there"
    typer.echo(
        f"{replayed.compared} of {replayed.records + replayed.missing} cycles {same}"
        + _omitted(replayed.missing, replayed.skipped)
    )


def _omitted(missing: int, skipped: int) -> str:
    parts = [f"{missing} cycles missing"] if missing else []
    parts += [f"{skipped} not computed: after a gap"] if skipped else []
    return "".join(f", {part}" for part in parts)


def repair(folder: Folder) -> None:
    """Rewrite truncated or damaged segments so that any MCAP reader accepts them; the originals are kept.

    Ends with status 5 when cycles are missing all the same.

    Example: `counterflex log repair log`
    """
    from counterflex.app.run import log as job

    done, missing = job.repair(folder)
    for item in done:
        if item.note:
            typer.echo(f"{item.name}: {item.note}")
        else:
            typer.echo(f"{item.name}: {item.records} records; the original is kept as {item.kept}")
    if not done:
        typer.echo("no segment is cut short or damaged")
    for line in missing.lines():
        typer.echo(line)
    _end(incomplete=missing.incomplete)


log.command("show")(show)
log.command("replay")(replay)
log.command("export")(log_export.export)
log.command("repair")(repair)
for command in (run_history.history, run_history.compare, run_history.page):
    log.command()(command)

"""Commands on a run log: log show, log replay, log export, log repair; those on ended runs are added."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.commands.operate import log_export, run_history
from counterflex.cli.commands.program import CellFile
from counterflex.cli.output import print_json, print_part, progress_bar
from counterflex.core.units import plain

log = typer.Typer(no_args_is_help=True, help="What online runs logged: show, replay, export, repair, compare.")
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
    for part in answer.parts():
        print_part(part)
    _end(incomplete=answer["incomplete"])


def _end(*, incomplete: bool) -> None:
    if incomplete:
        raise typer.Exit(INCOMPLETE)


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
        **plain(replayed, "records compared skipped missing same=proved"),
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

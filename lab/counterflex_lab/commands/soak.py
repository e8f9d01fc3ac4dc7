"""The soak command: the online loop for hours against a simulated cell in real time."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from counterflex.cli.commands.program import Out
from counterflex.cli.output import print_json, print_table, progress_bar


def register(app: typer.Typer) -> None:
    """Add ``counterflex soak``: the online loop for hours."""
    app.command()(soak)


def soak(
    out: Out,
    minutes: Annotated[float, typer.Option("--minutes", help="How long.", min=0.02)] = 60.0,
    force: Annotated[
        Literal["none", "measured", "pilot", "scale"], typer.Option("--force", help="What the loop corrects from.")
    ] = "scale",
    tracker: Annotated[
        Literal["none", "integrator", "observer"], typer.Option("--tracker", help="How it uses the tracker.")
    ] = "observer",
    keep_log: Annotated[bool, typer.Option("--keep-log", help="Keep the run log, about 1 GB per hour.")] = False,
    onlookers: Annotated[
        bool, typer.Option("--onlookers", help="With panel and OPC UA server, and a client that reads each.")
    ] = False,
    simulated: Annotated[
        bool,
        typer.Option(
            "--simulated", help="On a virtual clock, in this process, without sockets: --minutes are simulated ones."
        ),
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Run the online loop for a long time in real time and record memory, latency and late answers.

    A recorded pass of the demonstration cell is replayed back and forth: telegrams every 4 ms, force and poses every
    millisecond. After every telegram a datagram of the same length goes to a program that echoes it. DIR gets
    `summary.json`, `minutes.csv` and `memory.csv`. Real-time priority helps: start it as root or with CAP_SYS_NICE.

    With --simulated one cell corrects with force, tracker and plan for hours of its own time; rules are looked at in
    each cycle, DIR gets a row for each half hour as it goes (`stretches.csv`). It may be stopped and continued (kill
    -STOP, -CONT). It ends with status 1 where a rule did not hold.

    Example: `counterflex soak --minutes 60 --out soak`
    """
    if simulated:
        _soak_simulated(out, minutes / 60.0, keep_log=keep_log, as_json=as_json)
        return
    from counterflex_lab.soak import soak as job

    settings = job.SoakSettings(minutes=minutes, force=force, tracker=tracker, keep_log=keep_log, onlookers=onlookers)
    with progress_bar("soaking") as progress:
        summary = job.run(settings, out, progress=progress)
    if as_json:
        print_json(summary)
        return
    names = ("p50", "p99", "p999", "max")
    rows = {
        "reply, all telegrams": "reply_us",
        "reply, while the correction acts": "reply_active_us",
        "the same outside of standstills": "reply_active_outside_us",
        "do-nothing echo": "echo_us",
        "echo outside of standstills": "echo_outside_us",
    }
    print_table(
        f"{summary['telegrams']} telegrams; us",
        ["", "p50", "p99", "p99.9", "max"],
        [[what, *(f"{summary[key][name]:g}" for name in names)] for what, key in rows.items()],
    )
    print_table(
        "Growth per hour",
        ["", "slope", "standard error"],
        [
            [name.replace("_", " "), *(["-", "-"] if g is None else [f"{g['slope']:g}", f"{g['standard_error']:g}"])]
            for name, g in summary["growth_per_hour"].items()
        ],
    )
    load, stood, run = summary["load"], summary["standstill"], summary["run"]
    typer.echo(
        f"correction acts in {summary['active_share']:.1%} of {summary['cycles']} cycles; feed held in "
        f"{summary['held']}, program ended {_counted(summary['programs_ended'])}"
    )
    typer.echo(
        f"not answered within the cycle: {summary['unanswered']}, {summary['unanswered_active']} of them while the "
        f"correction acts, {stood['unanswered_active']} of these in standstills of the machine"
    )
    typer.echo(
        f"standstills: {stood['cycles']} cycles, {stood['missed']} more without a telegram, the longest "
        f"{stood['longest_ms']:g} ms"
    )
    typer.echo(f"reply over echo {summary['ratio_p50']:g}; load {load['mean']:.1f}, stolen {load['stolen']:.1%}")
    typer.echo(f"holds and faults: {_counted(run['incidents_by_cause'])}")
    typer.echo(f"requests of the operator: {_counted(summary['operator']['requests'])}")
    typer.echo(f"cycles by state: {_counted(run['states'])}; records lost {run['records_lost']}")
    allowed = (f"{name} {'yes' if one['fifo'] else 'no'}" for name, one in summary["realtime"].items())
    typer.echo(f"real-time priority: {', '.join(allowed)}")
    typer.echo(f"wrote {out}")


def _counted(counts: dict[str, int]) -> str:
    return ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in counts.items()) or "none"


def _soak_simulated(out: Path, hours: float, *, keep_log: bool, as_json: bool) -> None:
    from counterflex_lab.composed import endurance

    stretch_s = min(endurance.STRETCH_S, 3600.0 * hours / 4.0)
    with progress_bar("soaking") as progress:
        done = endurance.run(out, minutes=60.0 * hours, keep_log=keep_log, stretch_s=stretch_s, progress=progress)
    if as_json:
        print_json({"interrupted": done.interrupted, "broken": done.broken, "stretches": done.rows})
    else:
        names = ("hours", "cycles", "counter", "resident_mb", "open_files", "active", "programs", "replayed", "lost")
        print_table(
            "Simulated",
            [name.replace("_", " ") for name in names],
            [[f"{row[name]:.10g}" for name in names] for row in done.rows],
        )
        for one in done.broken:
            typer.echo(f"rule broken: {one['rule']} at {one['at_s']:g} s: {one['happened']}")
        typer.echo(f"wrote {out}")
    if done.broken:
        raise typer.Exit(1)

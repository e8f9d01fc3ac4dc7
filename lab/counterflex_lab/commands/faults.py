"""The faults command: inject every fault and see what the online loop makes of it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import LARGEST_SEED, MOST_WORKERS
from counterflex.cli.commands.program import Out
from counterflex.cli.output import print_json, print_table, progress_bar


def register(app: typer.Typer) -> None:
    """Add ``counterflex faults``: faults injected into the online loop."""
    app.command()(faults)


def faults(
    out: Out,
    only: Annotated[
        str, typer.Option("--only", help="Requirements or faults, by commas; all by default.", metavar="R3,R4")
    ] = "",
    quick: Annotated[bool, typer.Option("--quick", help="Small samples: rare events are not proved.")] = False,
    realtime: Annotated[
        bool, typer.Option("--realtime/--no-realtime", help="Also those that take real time and show this machine.")
    ] = True,
    sensors: Annotated[
        str,
        typer.Option(
            "--sensors",
            help="Inputs of the correction: force, or both (force and tracker).",
            callback=arguments.one_of(("force", "both"), "sensors"),
        ),
    ] = "force",
    random: Annotated[
        bool, typer.Option("--random", help="Faults of every kind, composed at random in simulated time.")
    ] = False,
    minutes: Annotated[
        float, typer.Option("--minutes", help="Simulated minutes of cells, with --random.", min=0.01, max=1e7)
    ] = 5.0,
    seed: Annotated[int, typer.Option("--seed", help="Of everything that is random.", min=0, max=LARGEST_SEED)] = 0,
    workers: Annotated[
        int | None,
        typer.Option("--workers", help="Processes with --random; by default one per core.", min=1, max=MOST_WORKERS),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Inject faults into the online loop and evaluate its reaction.

    The loop runs against a simulated RSI controller, an impaired network and a failing force sensor. Writes faults.csv,
    faults.md and summary.json. Ends with status 1 when a requirement does not hold.

    With --random stories of several faults are composed from the seed, the next story from the next seed, and rules are
    checked in every cycle. A story that breaks one is shortened and written to stories.json. The result does not depend
    on --workers, and an interrupted campaign goes on with the same --seed and --out.

    Example: `counterflex faults --quick --no-realtime --out out/faults`
    """
    if random:
        _composed(out, minutes, seed, workers, as_json=as_json, others=bool(only) or quick or sensors != "force")
        return
    from counterflex_lab.faults import faults as job
    from counterflex_lab.faults.scenario import Effort

    words = tuple(word.strip() for word in only.split(",") if word.strip())
    with progress_bar("injecting faults") as progress:
        results = job.run(
            out, only=words, quick=quick, realtime=realtime, seed=seed, sensors=sensors, progress=progress
        )
    if as_json:
        print_json(job.summary(results, job.machine(), Effort(quick, seed, sensors)))
    else:
        print_table(
            "Faults",
            ["", "injected", "happened", "largest step mm", "safe after s", "holds"],
            [
                [
                    f"{r.scenario.requirement} {r.scenario.name}",
                    r.scenario.injected,
                    r.outcome.happened,
                    "" if r.outcome.step_m is None else f"{r.outcome.step_m * 1e3:.3f}",
                    "" if r.outcome.safe_s is None else f"{r.outcome.safe_s:.3f}",
                    "yes" if r.outcome.passed else "NO",
                ]
                for r in results
            ],
        )
        passed = sum(r.outcome.passed for r in results)
        typer.echo(f"{passed} of {len(results)} hold; wrote {out}")
    if not all(r.outcome.passed for r in results):
        raise typer.Exit(1)


def _composed(out: Path, minutes: float, seed: int, workers: int | None, *, as_json: bool, others: bool) -> None:
    from counterflex.core.errors import InputError
    from counterflex_lab.composed import campaign as job

    if others:
        raise InputError(
            "stories at random choose sensors and faults themselves",
            where="--random",
            hint="Leave out --only, --quick and --sensors",
        )
    with progress_bar("telling stories") as progress:
        campaign = job.run(out, minutes=minutes, seed=seed, workers=workers, progress=progress)
    if as_json:
        print_json(campaign.summary())
    else:
        print_table(
            "Corrections ended by",
            ["cause", "times"],
            [[cause.replace("_", " "), str(count)] for cause, count in campaign.incidents.most_common()],
        )
        for story_seed, rule, words in campaign.broken:
            typer.echo(f"seed {story_seed} breaks: {rule}, {words}")
        typer.echo(
            f"{campaign.stories} stories from seed {seed}, {campaign.minutes:.1f} cell-minutes, "
            f"{sum(campaign.kinds.values())} faults of {len(campaign.kinds)} kinds, {campaign.compared} records "
            f"replayed, {campaign.per_real:.1f} times real time; {len(campaign.broken)} rules broken"
            f"{', interrupted' if campaign.interrupted else ''}; wrote {out}"
        )
    if campaign.broken:
        raise typer.Exit(1)

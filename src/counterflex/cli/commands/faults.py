"""The faults command: inject every fault and see what the online loop makes of it."""

from __future__ import annotations

from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import LARGEST_SEED
from counterflex.cli.commands.program import Out
from counterflex.cli.output import print_json, print_table, progress_bar


def register(app: typer.Typer) -> None:
    """Add this command."""
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
    seed: Annotated[int, typer.Option("--seed", help="Of everything that is random.", min=0, max=LARGEST_SEED)] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Inject faults into the online loop over sockets and evaluate its reaction.

    The loop runs against a simulated RSI controller, an impaired network and a failing force sensor. Writes faults.csv,
    faults.md and summary.json. Ends with status 1 when a requirement does not hold.

    Example: `counterflex faults --quick --no-realtime --out out/faults`
    """
    from counterflex.validation.faults import faults as job
    from counterflex.validation.faults.scenario import Effort

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

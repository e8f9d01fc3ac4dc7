"""The doctor command: whether this machine keeps time for the online loop."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import option
from counterflex.cli.output import print_json, print_table, progress_bar


def doctor(
    seconds: Annotated[
        float, option("--seconds", "How long to measure; less than 4 is too short for a verdict.", min=0.1)
    ] = 10.0,
    log: Annotated[
        Path,
        option("--log", "Folder where run logs will be written; its disk is measured.", arguments.output_folder, "DIR"),
    ] = Path(),
    as_json: Annotated[bool, option("--json", "Print JSON.")] = False,
) -> None:
    """Measure whether this computer is fast enough for the online loop: clock, step, network stack, disk of the log.

    The verdict is valid for a week; `run --arm` needs one. Exit status 1 if the computer does not fit.

    Example: `counterflex doctor --seconds 10`
    """
    from counterflex.app import doctor as job, warm

    with progress_bar("measuring") as progress:
        checkup = job.run(seconds, log, progress=progress).described()
    there = warm.states()
    kernels = {kept: [one.name for one in there if one.kept == kept] for kept in ("native", "shipped", "missing")}
    checkup["kernels"] = kernels
    if as_json:
        print_json(checkup)
    else:
        names = ("p50", "p99", "p99.9", "max")
        print_table(
            f"{checkup['cycles']} cycles of {checkup['period_ms']:g} ms; us",
            ["", *names],
            [
                [what, *("-" if times[name] is None else f"{times[name]:g}" for name in names)]
                for what, times in checkup["times_us"].items()
            ],
        )
        granted = {"real-time priority": checkup["fifo"], "locked memory": checkup["locked"]}
        typer.echo(
            f"{checkup['host']}, kernel {checkup['kernel']}, {checkup['cores']} cores, "
            + ", ".join(f"{name} {'yes' if value else 'no'}" for name, value in granted.items())
            + f", clock {checkup['clock_source'] or 'not known'}, governor {checkup['governor'] or 'not known'}"
            + f", stolen {checkup['steal']:.1%}"
        )
        typer.echo(
            f"kernels compiled for this processor {len(kernels['native'])}, with the package for a common one "
            f"{len(kernels['shipped'])}, missing {len(kernels['missing'])}"
            + (": counterflex warm compiles them" if kernels["missing"] else "")
        )
        typer.echo(f"{checkup['verdict']}: {checkup['in_time']:.2%} of the replies within {checkup['budget_us']:g} us")
        for reason in checkup["reasons"]:
            typer.echo(f"- {reason}")
    if not checkup["fits"]:
        raise typer.Exit(1)

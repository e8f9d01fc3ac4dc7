"""The warm command: compile the kernels now, not when they are first needed."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from typing import Annotated

import typer

from counterflex.cli.arguments import argument, option
from counterflex.cli.output import print_json, print_table, progress_bar


def warm(
    rooms: Annotated[
        list[str] | None, argument("Only those of these rooms, folders or modules: plan, cutting.tridexel, twin ...")
    ] = None,
    native: Annotated[
        bool, option("--native", "For this processor, also what the package brings compiled for a common one.")
    ] = False,
    jobs: Annotated[int | None, option("--jobs", "Processes. Default: one for each core.", min=1, max=256)] = None,
    as_json: Annotated[bool, option("--json", "Print JSON.")] = False,
) -> None:
    """Compile all kernels that are not compiled, in as many processes as there are cores.

    Once for a computer and a version; afterwards no command waits for the compiler. On the computer of the online loop
    use --native. `counterflex doctor` prints what is there.

    Example: `counterflex warm --native`
    """
    from counterflex.app import warm as job
    from counterflex.core.errors import InputError

    requested = rooms or []
    for room in requested:
        if not job.modules([room]):
            known = ", ".join(sorted({name.split(".")[0] for name in job.modules()}))
            raise InputError("no kernel that is called from outside stands there", value=room, limit=known)
    with progress_bar("compiling kernels") as progress:
        done = job.warm(requested, native=native, jobs=jobs, progress=progress)
    if as_json:
        print_json([asdict(one) for one in done])
        return
    compiled = [one for one in done if one.seconds is not None]
    if compiled:
        print_table(
            "compiled, longest first; processor time",
            ["kernel", "s"],
            [[one.name, f"{one.seconds:.1f}"] for one in compiled[:20]],
        )
    there = Counter(one.kept for one in done)
    seconds = sum(one.seconds or 0.0 for one in compiled)
    typer.echo(
        f"{len(done)} kernels: {len(compiled)} compiled now in {seconds:.0f} processor seconds, "
        f"{there['native']} were there for this processor, {there['shipped']} come with the package"
    )

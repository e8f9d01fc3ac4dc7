"""Commands of the four papers: every figure beside ours, with a verdict."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Final

import typer

from counterflex.cli import arguments
from counterflex.cli.commands.prove import Workers
from counterflex.cli.output import print_json, print_table, resumable_progress
from counterflex.core.errors import InputError

SEEDS = "1001-1003"
LEVEL = "identified"
Pages = Annotated[
    Path | None,
    typer.Option("--out", help="Folder for pages, pictures and runs.", metavar="DIR", callback=arguments.output_folder),
]
Long = Annotated[
    bool, typer.Option("--long", help="Run the experiments again in DIR instead of taking stored results: hours.")
]
Level = Annotated[
    str,
    typer.Option(
        "--level",
        help="With --long. identified: simulated cells are measured first; catalogue: as little as a run needs.",
        callback=arguments.one_of(("identified", "catalogue"), "level"),
    ),
]
LongSeeds = Annotated[
    str,
    typer.Option(
        "--seeds", help="With --long: truth seeds, how many from 1 on, or which: 2001-2008,2011.", metavar="N|A-B,C"
    ),
]
Quick = Annotated[bool, typer.Option("--quick", help="With --long: as briefly as possible, on one simulated cell.")]
Json = Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")]


ABOUT: Final = {
    "denkena2015": "Compliance and modes of a KR 500, spindle angle, sensing holder, validation cut "
    "(Denkena and Lepper 2015).",
    "haehn2020": "Virtual joints, 60 load cases, sensor equations, pilot control, groove (Haehn and Weigold 2020).",
    "berger2013": "Force formulas, cutting data, constants, strategy and stiffness (Berger and others 2013).",
    "mandiola2023": "Pose from the tracker, gain, square and circle with the tracker in the loop "
    "(Mandiola and others 2023).",
}
"""Papers with commands of their own, and what of them is shown."""


def of_paper(name: str) -> Callable[..., None]:
    """The command of one paper.

    Args:
        name: One of :data:`ABOUT`.
    """

    def paper(
        out: Pages = None,
        long: Long = False,
        seeds: LongSeeds = SEEDS,
        level: Level = LEVEL,
        quick: Quick = False,
        workers: Workers = None,
        as_json: Json = False,
    ) -> None:
        _table((name,), out, long, seeds, level, quick, workers, as_json=as_json)

    paper.__doc__ = f"""{ABOUT[name]}

    Each figure that the paper prints stands beside ours, with a verdict by a rule stated beforehand: reproduced,
    differs and why, cannot be checked and why.

    Example: `counterflex reproduce {name}`
    """
    return paper


def every_paper(
    out: Pages = None,
    long: Long = False,
    seeds: LongSeeds = SEEDS,
    level: Level = LEVEL,
    quick: Quick = False,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Figures of the four papers beside ours, a verdict each; with --out a page and pictures of each paper.

    Figures of formulas are computed; those of milled parts and tracked paths come from stored results of experiments,
    or with --long from experiments run again. Interrupted, the same command goes on where it was.

    Example: `counterflex reproduce all --out papers`
    """
    from counterflex_lab.reproduce.papers.read import PAPERS

    _table(PAPERS, out, long, seeds, level, quick, workers, as_json=as_json)


def _table(
    papers: tuple[str, ...],
    out: Path | None,
    long: bool,
    seeds: str,
    level: str,
    quick: bool,
    workers: int | None,
    *,
    as_json: bool,
) -> None:
    numbers = arguments.seeds(seeds)
    given = {"--quick": quick, "--workers": workers is not None, "--seeds": seeds != SEEDS, "--level": level != LEVEL}
    for option in (name for name, is_given in given.items() if is_given and not long):
        raise InputError("this option says how experiments are run", where=option, hint="Add --long")
    from counterflex_lab.reproduce.papers import pages, table

    with resumable_progress("figures of papers", out) as progress:
        summary = table.run(
            papers, out, long=long, seeds=numbers, level=level, quick=quick, workers=workers, progress=progress
        )
    if as_json:
        print_json(summary)
        return
    for name in papers:
        rows = [table.cells(row) for row in summary["figures"] if row["paper"] == name]
        print_table(table.title(name), list(table.COLUMNS), rows)
        for text in table.assumed(name):
            typer.echo(f"assumed: {text}")
    for name, data in summary["experiments"].items():
        typer.echo(f"{name}: {data['command']}, {data['cells']}, version {data['version']}")
    typer.echo(pages.counted(summary["counts"]))
    if out is not None:
        typer.echo(f"wrote {out}: report.html, summary.json, pages and pictures")

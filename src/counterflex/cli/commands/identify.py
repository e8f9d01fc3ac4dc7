"""The command ``identify``: parameters of a cell from measurements."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import LARGEST_SEED, MOST_PROPOSED, argument, option, pairs
from counterflex.cli.output import keep_inputs, print_json, print_summary, progress_bar
from counterflex.core.errors import InputError
from counterflex.core.next_command import next_command
from counterflex.identify.recipes import RECIPES, own_title

HISTORY = "history"
_LIST = "\n\n".join(f"`{name}`: {own_title(name)}" for name in RECIPES.own)
_HELP = f"""Identify parameters of a cell from measured data: a new cell file with standard deviations, and a report.

DATA are manifests of datasets. Writes into DIR: cell.toml (the cell file with the identified values), result.json
(every parameter with its 95 % interval, hold-out, outliers), report.html and a copy of everything in archive/. Either
all of them or none; values that predict held-out data worse than the cell file are refused.

Recipes, besides those of other packages (`counterflex extensions`):

{_LIST}

Examples:

`counterflex identify tracker-frame --propose 20 --cell cell.toml --out proposal` says which poses to measure.

`counterflex identify tracker-frame points.toml --cell cell.toml --out out` finds the parameters.

`counterflex identify history out` lists what was identified below a folder and what changed.
"""


def _recipe(param: arguments.Param, value: Any) -> Any:
    """A recipe or ``history``; run logs are no data of a recipe."""
    if value == "production":
        raise InputError(
            "production runs have a command of their own",
            hint="counterflex production RUN... --plan PLAN --cell CELL --out DIR",
        )
    return arguments.one_of(RECIPES, "recipe", HISTORY)(param, value)


def identify(
    recipe: Annotated[str, argument("What to find, or history.", _recipe, "RECIPE")],
    data: Annotated[
        list[Path] | None, argument("Manifests of datasets (.toml).", arguments.file_or_folder, "DATA...")
    ] = None,
    cell: Annotated[Path | None, option("--cell", "Cell file (.toml).", arguments.file, "CELL")] = None,
    out: Annotated[
        Path | None, option("--out", "Folder for the results; made when missing.", arguments.output_folder, "DIR")
    ] = None,
    holdout: Annotated[
        list[Path] | None,
        option("--holdout", "Manifest of data that are only predicted; else folds of DATA.", arguments.file, "DATA"),
    ] = None,
    settings: Annotated[
        list[str] | None, option("--set", "A setting of the recipe.", arguments.settings, "KEY=VALUE")
    ] = None,
    seed: Annotated[int, option("--seed", "Of whatever is drawn: folds, starts, poses.", min=0, max=LARGEST_SEED)] = 0,
    propose: Annotated[
        int | None,
        option("--propose", "Propose this many measurements instead.", metavar="N", min=1, max=MOST_PROPOSED),
    ] = None,
    archive: Annotated[
        Path | None, option("--archive", "Archive of all runs; default DIR/archive.", arguments.output_folder, "DIR")
    ] = None,
    as_json: Annotated[bool, option("--json", "Print the result as JSON.")] = False,
) -> None:
    """See the help text above."""
    if recipe == HISTORY:
        _history(data or [Path()], as_json)
        return
    if cell is None or out is None:
        raise InputError(f"--{'cell' if cell is None else 'out'} is missing", hint="counterflex identify --help")
    if propose is not None:
        _propose(recipe, propose, data or [], cell, out, settings or [], seed, as_json)
        return
    if not data:
        raise InputError("no data are given", limit="one or more manifests", hint="Or --propose N for what to measure")
    keep_inputs(out, cell, *data, *(holdout or []))
    chosen = pairs(settings or [])
    from counterflex.app.identification import identify as job

    with progress_bar(f"identifying {recipe}") as progress:
        result = job.run(
            recipe,
            data,
            cell,
            out,
            holdout=holdout or (),
            settings=chosen,
            seed=seed,
            archive=archive,
            progress=progress,
        )
    if as_json:
        from counterflex.files.identification_file import plain_json

        print_json(plain_json(result))
        return
    from counterflex.report.identification_page import IdentificationSummary

    files = ": cell.toml, result.json, report.html ({seconds:.1f} s)"
    print_summary(IdentificationSummary(result), False, out, files)


identify.__doc__ = _HELP


def _history(folders: list[Path], as_json: bool) -> None:
    if len(folders) > 1:
        raise InputError("history takes one folder", value=len(folders))
    from counterflex.app.identification.history import history

    changes = history(folders[0])
    print_summary(changes, as_json)


def _propose(
    recipe: str, count: int, data: list[Path], cell: Path, out: Path, settings: list[str], seed: int, as_json: bool
) -> None:
    if data:
        raise InputError("--propose takes no data", value=data[0], hint="Measure the proposal, then identify from it")
    keep_inputs(out, cell)
    chosen = pairs(settings)
    from counterflex.app.identification import propose as job

    with progress_bar(f"choosing {count} measurements"):
        proposal = job.run(recipe, count, cell, out, settings=chosen, seed=seed)
    print_summary(proposal, as_json, out, ": {files}")
    if as_json:
        return
    manifest = f"{proposal['recipe']}.toml"
    if manifest in proposal["files"]:
        typer.echo(
            f"next: measure the rows of proposal.csv in their order, fill {proposal['recipe']}.csv or name the file of"
            f" the instrument in {manifest}, state sigma there, then "
            + next_command(f"identify {proposal['recipe']}", out / manifest, cell=cell, out="identified")
        )
        typer.echo(
            "or on a simulated cell: "
            + next_command("twin measure", out / "proposal.toml", cell=cell, truth="TRUTH", out="DATA")
            + f", which writes DATA/{manifest}"
        )
    else:
        typer.echo("next: measure the rows of proposal.csv in their order and write a manifest (docs/datasets.md)")

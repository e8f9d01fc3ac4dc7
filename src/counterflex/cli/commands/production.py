"""The command ``production``: constants and wear from run logs of ordinary cuts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from counterflex.cli import arguments
from counterflex.cli.arguments import LARGEST_SEED, argument, option, pairs
from counterflex.cli.commands.program import CellFile, Out
from counterflex.cli.output import keep_inputs, print_summary, progress_bar


def production(
    runs: Annotated[list[Path], argument("Folders of run logs, as run writes them.", arguments.folder, "RUN...")],
    cell: CellFile,
    plan: Annotated[list[Path], option("--plan", "Plan file of the runs. Repeatable.", arguments.file, "PLAN")],
    out: Out,
    settings: Annotated[list[str] | None, option("--set", "A setting.", arguments.settings, "KEY=VALUE")] = None,
    seed: Annotated[int, option("--seed", "Of what is held out.", min=0, max=LARGEST_SEED)] = 0,
    apply: Annotated[
        Path | None, option("--apply", "Write a new cell file with the constants found.", arguments.output_file, "CELL")
    ] = None,
    as_json: Annotated[bool, option("--json", "Print the result as JSON.")] = False,
) -> None:
    """Find constants of the cutting force, and tool wear, from run logs of ordinary cuts.

    The force of each run is put on the plan that it was made with; steady stretches give the constants of tool and
    material, beside those of the cell file, tested and held out. The factor of each run over the length cut shows wear.
    A cell file is written with --apply only.

    Writes into DIR: result.json, report.html, and runs/ with what each run gave. Either all of them or none. Give the
    same DIR again: its runs go in.

    Settings: tool, constants (directions, exponents, all), new_tool, wear_limit, trim_diameters, settle_s, top_sigma_m,
    runout_sigma_m, force_scale_sigma, force_cross_talk_sigma.

    Example: `counterflex production run-log --cell cell.toml --plan plan.parquet --out wear`
    """
    keep_inputs(out, cell, *plan)
    keep_inputs(apply, cell, *plan, option="--apply")
    chosen = pairs(settings or [])
    from counterflex.app.production import production as job

    with progress_bar("identifying production") as progress:
        result = job.run(runs, cell, plan, out, settings=chosen, seed=seed, apply=apply, progress=progress)
    print_summary(result, as_json, out, ": result.json, report.html, runs/ ({seconds:.1f} s)")

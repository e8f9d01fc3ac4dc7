"""The command ``production``: constants and wear from run logs of ordinary cuts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import LARGEST_SEED, argument, option, pairs
from counterflex.cli.commands.program import CellFile, Out
from counterflex.cli.output import keep_inputs, print_result, print_table, progress_bar
from counterflex.files.shop_unit import digits_of, unit_of_name

_WEAR_WORDS = {
    "beyond": "worn beyond its limit",
    "at": "perhaps beyond its limit",
    "within": "within its limit",
    "unknown": "not known",
}


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
    print_result(result, as_json, show, out)


def show(result: dict[str, Any], out: Path) -> None:
    """Figures, the runs with the factor of each, what it means."""
    rows = [
        [
            f["text"],
            digits_of(f["value"], 4),
            "" if f["nominal"] is None else digits_of(f["nominal"], 4),
            unit_of_name(f["name"]),
        ]
        for f in (*result["headline"], *result["figures"])
    ]
    print_table(
        f"Production with T{result['tool']} in {result['material']}: {result['cell']}",
        ["figure", "found", "stated", "unit"],
        rows,
    )
    print_table(
        f"Force over the life of the tool: {_WEAR_WORDS[result['wear']]}",
        ["run", "edge", "cut by it m", "removed cm3", "force", "standard deviation", "event", "delay ms"],
        [
            [
                row["run"],
                f"{row['edge']}{' new: ' + row['new_edge'] if row['new_edge'] else ''}",
                f"{row['edge_cut_m']:.3f}",
                f"{row['edge_removed_cm3']:.2f}",
                f"{row['factor']:.4f}",
                f"{row['factor_sigma']:.4f}",
                row["event"],
                "" if row["delay_ms"] is None else f"{row['delay_ms']:g} +- {row['delay_sigma_ms']:g}",
            ]
            for row in result["runs"]
        ],
    )
    for remark in result["remarks"]:
        typer.echo(f"note: {remark}")
    if "applied" in result:
        typer.echo(f"wrote {result['applied']['cell']}: constants of {', '.join(r['run'] for r in result['runs'][:4])}")
    typer.echo(f"wrote {out}: result.json, report.html, runs/ ({result['seconds']:.1f} s)")

"""Tables that ``identify`` prints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from counterflex.cli.output import print_table
from counterflex.core.next_command import next_command
from counterflex.core.result import digits_of
from counterflex.files.shop_unit import unit_of_name

_OUTLIERS = 5
_SENTENCES = 3
_PARAMETERS = 60


def show_result(result: dict[str, Any], out: Path) -> None:
    """Figures, parameters, outliers, what is not seen."""
    rows = [
        [f["text"], _number(f["value"], 4), _number(f["nominal"], 4), unit_of_name(f["name"])]
        for f in (*result["headline"], *result["figures"])
    ]
    print_table(f"{result['recipe']} of {result['cell']}", ["figure", "identified", "before", "unit"], rows)
    for name, fit in result["fits"].items():
        free = [p for p in fit["parameters"] if p["free"]]
        print_table(
            f"Parameters of {name}",
            ["parameter", "value", "standard deviation", "unit", "before", "by the data"],
            [
                [
                    p["label"],
                    _number(p["value"], 5),
                    _number(p["sigma"], 2),
                    p["unit"],
                    _number(p["nominal"], 5),
                    {"determined": "determined", "partly": "partly", "prior": "prior"}[p["seen"]],
                ]
                for p in free[:_PARAMETERS]
            ],
            note=f"Rank {fit['rank']} of {fit['free']}, condition {fit['condition']:.2g}, "
            f"{sum(fit['rows'])} rows, {len(fit['outliers'])} outliers. {fit['reason']}",
        )
        if len(free) > _PARAMETERS:
            typer.echo(f"note: {len(free) - _PARAMETERS} more parameters in report.html")
        _show_doubts(fit, result["remarks"])
    for remark in result["remarks"]:
        typer.echo(f"note: {remark}")
    typer.echo(f"wrote {out}: cell.toml, result.json, report.html ({result['seconds']:.1f} s)")


def _show_doubts(fit: dict[str, Any], remarks: list[str]) -> None:
    """Print what is unsure of a fit, and not said by the remarks."""
    if not fit["converged"]:
        typer.echo("warning: the solver did not converge")
    for name_at_bound in fit["at_bound"]:
        typer.echo(f"warning: {name_at_bound} rests against its bound; the data would have it beyond")
    for outlier in fit["outliers"][:_OUTLIERS]:
        typer.echo(f"outlier: {outlier['where']}: {outlier['size']:.1f} times its standard deviation")
    if len(fit["outliers"]) > _OUTLIERS:
        typer.echo(f"outlier: {len(fit['outliers']) - _OUTLIERS} more in result.json")
    hidden = [sentence for sentence in fit["hidden"] if sentence not in remarks]
    for sentence in hidden[:_SENTENCES]:
        typer.echo(f"note: {sentence}")
    if len(hidden) > _SENTENCES:
        typer.echo(f"note: {len(hidden) - _SENTENCES} more such sentences in report.html")


def show_proposal(proposal: dict[str, Any], out: Path, cell: Path) -> None:
    """Expected standard deviations and what to do."""
    if proposal["expected"]:
        print_table(
            f"Expected from {proposal['rows']} measurements",
            ["parameter", "standard deviation", "unit"],
            [[row["name"], _number(row["sigma"], 3), row["unit"]] for row in proposal["expected"]],
        )
    for remark in proposal["remarks"]:
        typer.echo(f"note: {remark}")
    typer.echo(f"wrote {out}: {', '.join(proposal['files'])}")
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


def show_history(changes: dict[str, Any]) -> None:
    """Runs, and what changed between the latest of each recipe."""
    print_table(
        "Identifications",
        ["date", "recipe", "cell", "data", "rows", "figure", "value", "before", "outliers", "folder"],
        [
            [
                run["date"],
                run["recipe"],
                run["cell"],
                ", ".join(run["data"]),
                str(run["rows"]),
                run["figure"],
                _number(run["value"], 4),
                _number(run["nominal"], 4),
                str(run["outliers"]),
                run["folder"],
            ]
            for run in changes["runs"]
        ],
    )
    for name, folders in changes["not_compared"].items():
        typer.echo(f"note: {name}: not compared, of another cell than the latest: {', '.join(folders)}")
    for name, rows in changes["compared"].items():
        count = max(len(row["values"]) for row in rows)
        columns = [f"{count - 1 - i} before" if i < count - 1 else "latest" for i in range(count)]
        print_table(
            f"{name}: values of the latest runs, with standard deviations",
            ["parameter", "unit", *columns, "change / its sd", ""],
            [
                [
                    row["parameter"],
                    row["unit"],
                    *(
                        "" if value is None else f"{_number(value['value'], 5)} ± {_number(value['sigma'], 2)}"
                        for value in row["values"]
                    ),
                    "" if row["change_in_sigma"] is None else f"{row['change_in_sigma']:+.1f}",
                    "CHANGED" if row["significant"] else "",
                ]
                for row in rows
            ],
            note="CHANGED: latest and the one before differ by more than 3 standard deviations of their difference.",
        )


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else digits_of(value, digits)

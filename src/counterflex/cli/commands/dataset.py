"""Commands about measured data: dataset check, dataset channels."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.output import print_json, print_summary, print_table

dataset = typer.Typer(no_args_is_help=True, help="Read measured data and summarise them.")


def check(
    data: Annotated[Path, argument("Manifest of a dataset (.toml).", arguments.file, "DATA")],
    as_json: Annotated[bool, option("--json", "Print JSON instead of a table.")] = False,
) -> None:
    """Read a dataset as identify does, and print rows, ranges and standard deviations.

    Example: `counterflex dataset check points.toml`
    """
    from counterflex.app.identification.dataset_check import described

    answer = described(data)
    print_summary(answer, as_json)


def channels(as_json: Annotated[bool, option("--json", "Print JSON instead of tables.")] = False) -> None:
    """List the kinds of datasets, the channels and the settings that a manifest can name.

    Example: `counterflex dataset channels`
    """
    from counterflex.identify.data.channels import CHANNELS, KINDS, SETTINGS

    if as_json:
        answer: dict[str, Any] = {
            "kinds": KINDS,
            "channels": {name: {"meaning": k.text, "numbers": list(k.allowed)} for name, k in CHANNELS.items()},
            "settings": SETTINGS,
        }
        print_json(answer)
        return
    print_table("Kinds of datasets", ["kind", "meaning"], [[name, text] for name, text in KINDS.items()])
    print_table(
        "Channels",
        ["name", "numbers", "SI unit", "meaning"],
        [
            [
                name,
                " or ".join(map(str, _ends(kind.allowed))),
                ", ".join(dict.fromkeys(kind.si_units(max(kind.allowed)))),
                kind.text,
            ]
            for name, kind in CHANNELS.items()
        ],
    )
    print_table("Settings, by SI name", ["name", "meaning"], [[name, text] for name, text in SETTINGS.items()])


def _ends(counts: tuple[int, ...]) -> list[str]:
    if len(counts) > 2 and counts == tuple(range(counts[0], counts[-1] + 1)):
        return [f"{counts[0]} to {counts[-1]}"]
    return [str(count) for count in counts]


dataset.command("check")(check)
dataset.command("channels")(channels)

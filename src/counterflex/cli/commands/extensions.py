"""The command ``extensions``: what can be named in cell files and on the command line, and which package brings it."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from types import FunctionType
from typing import Annotated, Final

import typer

from counterflex.cli.arguments import argument, file, option
from counterflex.cli.output import print_json, print_table
from counterflex.core.errors import InputError
from counterflex.core.registry import Registry

COMMANDS: Final[Registry[FunctionType]] = Registry("counterflex.commands", "command", "types:FunctionType")
"""Commands of other packages: by the word that calls it, the function that adds it to the command line."""


def extensions(
    language: Annotated[str | None, argument("Language of a robot to be tried.", metavar="LANGUAGE")] = None,
    cell: Annotated[Path | None, option("--cell", "Cell that it is tried in.", file)] = None,
    as_json: Annotated[bool, option("--json", "Print JSON.")] = False,
) -> None:
    """List recipes, force laws, force sensors, languages, robots, materials, commands that packages add, and our own.

    Each is loaded, with the parts that it names, to see whether it works. With a language, a program is converted to
    it, read back, written in place, split, cut short. Ends with status 1 when one fails. docs/extend.md says how to add
    one.

    Examples: `counterflex extensions`, `counterflex extensions krl --cell cell.toml`
    """
    if (language is None) != (cell is None):
        raise InputError("a language is tried in a cell", where="extensions", value=language or cell,
                         limit="LANGUAGE --cell FILE")  # fmt: skip
    if language is not None and cell is not None:
        _try(language, cell, as_json=as_json)
        return
    from counterflex.app.extensions import REGISTRIES, extensions as look

    entries = look((*REGISTRIES, COMMANDS))
    if as_json:
        print_json([asdict(item) for item in entries])
    else:
        rows = [[item.group.partition(".")[2], item.name, item.package, item.fault or item.title] for item in entries]
        print_table("extensions", ["group", "name", "package", "what it is"], rows)
    if any(item.fault for item in entries):
        raise typer.Exit(1)


def _try(language: str, cell: Path, *, as_json: bool) -> None:
    from counterflex.app.language_trial import trial

    outcomes = trial(language, cell)
    if as_json:
        print_json([{"law": law, "fault": fault} for law, fault in outcomes])
    else:
        print_table(language, ["law", "holds"], [[law, fault or "yes"] for law, fault in outcomes])
    if any(fault for _, fault in outcomes):
        raise typer.Exit(1)

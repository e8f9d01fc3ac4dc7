"""The command ``extensions``: what can be named in cell files and on the command line, and which package brings it."""

from __future__ import annotations

from dataclasses import asdict
from types import FunctionType
from typing import Annotated, Final

import typer

from counterflex.cli.arguments import option
from counterflex.cli.output import print_json, print_table
from counterflex.core.registry import Registry

COMMANDS: Final[Registry[FunctionType]] = Registry("counterflex.commands", "command", "types:FunctionType")
"""Commands of other packages: by the word that calls it, the function that adds it to the command line."""


def extensions(as_json: Annotated[bool, option("--json", "Print JSON.")] = False) -> None:
    """List recipes, force laws, force sensors, languages, robots, materials, commands that packages add, and our own.

    Each is loaded to see whether it works. Ends with status 1 when one does not. docs/extend.md says how to add one.

    Example: `counterflex extensions`
    """
    from counterflex.app.extensions import REGISTRIES, extensions as look

    entries = look((*REGISTRIES, COMMANDS))
    if as_json:
        print_json([asdict(item) for item in entries])
    else:
        rows = [[item.group.partition(".")[2], item.name, item.package, item.fault or item.title] for item in entries]
        print_table("extensions", ["group", "name", "package", "what it is"], rows)
    if any(item.fault for item in entries):
        raise typer.Exit(1)

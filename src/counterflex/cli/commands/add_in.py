"""The command ``add-in``: a script with which another program calls counterflex."""

from __future__ import annotations

from typing import Annotated

import typer

from counterflex.cli.arguments import argument
from counterflex.cli.commands.program import Out


def add_in(
    name: Annotated[str, argument("Program to add counterflex to: freecad, robodk.", metavar="NAME")],
    out: Out,
) -> None:
    """Write the script with which another program calls counterflex: FreeCAD's post-processor, RoboDK's app.

    The script runs in the other program and starts this counterflex, which it names by its path. Scripts of other
    packages: `counterflex extensions`.

    Example: `counterflex add-in freecad --out macros`
    """
    from counterflex.app.add_ins import ADD_INS, write

    chosen = ADD_INS[name]
    typer.echo(f"wrote {write(chosen, out)}; it belongs into {chosen.place}\n{chosen.next_step}")

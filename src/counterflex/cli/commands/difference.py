"""The command that compares two versions of a program: ``diff``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.commands.program import Dialect, WithoutEnd
from counterflex.cli.output import print_json, print_table
from counterflex.programs.language import BY_ENDING

_ORDERS = ("change", "line")


def register(app: typer.Typer) -> None:
    """Add this command."""
    app.command(name="diff")(difference)


def difference(
    before: Annotated[Path, argument("Program.", arguments.file, "BEFORE")],
    after: Annotated[Path, argument("The same program, compensated.", arguments.file, "AFTER")],
    by: Annotated[
        str, option("--by", "Order: change (largest first) or line.", arguments.one_of(_ORDERS, "order"))
    ] = _ORDERS[0],
    most: Annotated[int, option("--most", "Rows of the table at most.", min=1, max=1_000_000)] = 20,
    dialect: Dialect = BY_ENDING,
    without_end: WithoutEnd = False,
    as_json: Annotated[bool, option("--json", "Print every changed motion as JSON.")] = False,
) -> None:
    """Say what changed between two versions of a program: how far each target moved, in um and deg per coordinate.

    Reads every language that `path` reads. Points put in are counted with the motion that they lead to; "off path" is
    how far its points lie from the programmed motion, the feed after is the lowest one.

    Example: `counterflex diff part.ngc out/part.ngc --by line`
    """
    from counterflex.app.inputs import Reading
    from counterflex.programs.difference import differences, largest_first, summary

    old, new = (Reading(dialect, complete=not without_end).program(file) for file in (before, after))
    changes = differences(old, new)
    about = summary(old, new, changes)
    ordered = list(largest_first(changes)) if by == "change" else [change for change in changes if change.changed]
    rows = [change.shown() for change in ordered]
    if as_json:
        print_json({**about, "changes": rows})
        return
    if rows:
        columns = ("line_before", "line_after", "motion", "off_path_um", "x_um", "y_um", "z_um")
        more = ("a_deg", "b_deg", "c_deg", "feed_before_mm_min", "feed_after_mm_min", "points_added")
        names = [name.replace("_mm_min", "_mm/min").replace("_", " ") for name in columns + more]
        keys = [(name, name.replace("line_", "place_")) for name in columns + more]
        shown = [[_text(row.get(place, row[name])) for name, place in keys] for row in rows[:most]]
        print_table(f"{before.name} and {after.name}", names, shown)
    left = f", {len(rows) - most} not shown (--most)" if len(rows) > most else ""
    largest = about.get("largest_place") or f"line {about['largest_line']}"
    typer.echo(
        f"{about['changed']} of {about['motions_before']} motions changed{left}; {about['points_added']} points added; "
        f"largest {about['largest_um']} um in {largest}"
    )


def _text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)

"""Commands of a TwinCAT: list, read and write its symbols, pass its tracker on."""

from __future__ import annotations

from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import MOST_RECORDS, address, argument, option
from counterflex.cli.commands.program import CellFile
from counterflex.cli.commands.question import AsJson
from counterflex.cli.output import print_json, print_summary, print_table
from counterflex.core.result import Lines, PlainLine, ShownTable

ads = typer.Typer(no_args_is_help=True, help="A TwinCAT (Beckhoff ADS): check the connection, read, write, forward.")


def list_(
    cell: CellFile,
    containing: Annotated[str, option("--containing", "Only names with this text in them.")] = "",
    as_json: AsJson = False,
) -> None:
    """List the variables of the TwinCAT: what the table [ads] of the cell file can name.

    Example: `counterflex ads list --cell cell.toml --containing strain`
    """
    from counterflex.app.plc import PLCS

    symbols = PLCS["ads"].symbols(cell, containing)
    if as_json:
        print_json([{"name": one.name, "type": one.kind, "comment": one.comment} for one in symbols])
        return
    rows = [[one.name, one.kind, one.comment] for one in symbols]
    print_table(f"{len(symbols)} variables", ["name", "type", "comment"], rows)


def read(cell: CellFile, as_json: AsJson = False) -> None:
    """Read every symbol of the table [ads] once, in the units of the table, and the force of an instrumented holder.

    Example: `counterflex ads read --cell cell.toml`
    """
    from counterflex.app.plc import PLCS

    readings = PLCS["ads"].read(cell)
    rows = [(name, value, readings["types"][name]) for name, value in readings["values"].items()]
    table = ShownTable.of(f"Read in {readings['took_ms']:g} ms", "name=0 | value=1:g~not a number | type=2", rows)
    force = [] if readings["force_n"] is None else ["force at the tool, holder axes: {force_n:.1f} N"]
    print_summary(Lines(readings, table, *force), as_json)


def write(
    name: Annotated[str, argument("A parameter of the table [ads].", metavar="NAME")],
    value: Annotated[float, argument("In the unit of the table.", metavar="VALUE")],
    cell: CellFile,
    as_json: AsJson = False,
) -> None:
    """Write a parameter that the table allows to be written (write = true), within its limits, and read it back.

    Example: `counterflex ads write filter_hz 8 --cell cell.toml`
    """
    from counterflex.app.plc import PLCS

    result = PLCS["ads"].write(cell, name, value)
    print_summary(Lines(result, PlainLine(f"{name}: {result['before']} before, {result['after']} now")), as_json)


def forward(
    to: Annotated[
        str,
        argument("Where datagrams go: the loop's tracker.address or strain.address.", arguments.host_port, "HOST:PORT"),
    ],
    cell: CellFile,
    readings: Annotated[
        int | None, option("--readings", "Number of readings; default: until Ctrl-C.", min=1, max=MOST_RECORDS)
    ] = None,
    strain: Annotated[
        bool, option("--strain", "Forward the strain terminals of the holder, to strain.address.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Forward tracker or strain readings of a TwinCAT to the loop, as datagrams, from a separate process.

    Example: `counterflex ads forward 127.0.0.1:5002 --cell cell.toml --strain`
    """
    from counterflex.app.plc import PLCS

    result = PLCS["ads"].forward(cell, address(to, "HOST:PORT"), readings=readings, strain=strain)
    print_summary(
        Lines(result, "{sent} datagrams sent, {unusable} not usable; {failed_readings} readings failed"), as_json
    )


ads.command("list")(list_)
ads.command("read")(read)
ads.command("write")(write)
ads.command("forward")(forward)

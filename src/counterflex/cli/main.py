"""The ``counterflex`` command."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from counterflex import __version__
from counterflex.cli import demo, program, prove, question
from counterflex.core.errors import CounterflexError

app = typer.Typer(
    name="counterflex",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    help=(
        "Makes a milling robot accurate: predicts how far it bends under the cutting force and gives back the same "
        "program, compensated.\n\nFirst steps:\n\n"
        "`counterflex demo --out out/demo` runs the whole job on a simulated cell.\n\n"
        "`counterflex cell example --out cell.toml` writes a cell file to start from.\n\n"
        "`counterflex compensate part.ngc --cell cell.toml --out out` compensates your program."
    ),
)
question.register(app)
program.register(app)
prove.register(app)
demo.register(app)


def _version(value: bool) -> None:
    if value:
        typer.echo(f"counterflex {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    pass


def run() -> None:
    """Run the command line; faults of the user's making end in one line on standard error and exit status 2."""
    try:
        app()
    except CounterflexError as fault:
        _end(f"error: {fault}")
    except KeyboardInterrupt:
        _end("interrupted: nothing was written")
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(0)


def _end(line: str) -> None:
    print(line, file=sys.stderr)
    sys.exit(2)

"""Printing: tables for people, JSON for programs, a progress bar for the impatient."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from counterflex.cli.arguments import address, option
from counterflex.cli.printed import below, everything_is_text
from counterflex.core.errors import InputError, Interrupted
from counterflex.core.meter import Meter, duration
from counterflex.core.output_place import is_printed
from counterflex.core.printable import printable
from counterflex.core.progress import Progress
from counterflex.core.remarks import shown
from counterflex.core.result import Part, ShownTable, Summary, Warned

Layers = Annotated[
    list[str] | None,
    option(
        "--scenario -s",
        "What is set once for a trial, repeatable, the later one wins: a file, a name out of `twin scenarios`, or "
        "TABLE.KEY=VALUE.",
        metavar="SCENARIO",
    ),
]


def host_port(text: str | None) -> tuple[str, int] | None:
    """Host and port of an address of the scenario, or None."""
    return None if text is None else address(text, "--scenario")


def print_json(data: Any) -> None:
    """Print data as JSON on standard output."""
    print(json.dumps(data, indent=2, allow_nan=False))


def print_part(part: Part) -> None:
    """Print a line or a table of a result."""
    import typer

    if isinstance(part, ShownTable):
        print_table(part.title, part.columns, part.rows, note=part.note)
    elif isinstance(part, Warned):
        warn(part)
    else:
        typer.echo(part)
        shown(part)


def print_summary(result: Summary, as_json: bool, out: Path | None = None, files: str = "") -> None:
    """Print a result as JSON, or the lines and tables that show it and what was written.

    Args:
        files: What was written into ``out``, with values of the result in braces.
    """
    if as_json:
        print_json(result)
        return
    for part in result.parts():
        print_part(part)
    say_written(out, f"wrote {out}{result.line(files)}")


def say_written(out: Path | None, line: str) -> None:
    """Say what was written, if anything; on standard error where the output itself goes to standard output."""
    import typer

    if out is not None:
        typer.echo(line, err=is_printed(out))


def warn(sentence: str, *, err: bool = False) -> None:
    """Print a warning; a remark that says the same is not printed again."""
    import typer

    typer.echo(f"warning: {sentence}", err=err)
    shown(sentence)


def keep_inputs(out: Path | None, *inputs: Path | None, option: str = "--out") -> None:
    """Refuse an output that would replace an input: the same file, or the folder that the input lies in.

    What is not given, output or input, is None.

    Args:
        option: Name of the option that says ``out``.

    Raises:
        InputError: It would.
    """
    for path in inputs:
        if out is None or path is None:
            continue
        if out.resolve() == path.resolve() or (out.is_file() and path.is_file() and out.samefile(path)):
            what = f"the output would replace {path.name}"
        elif out.resolve() == path.resolve().parent:
            what = f"{path.name} lies in this folder and could be replaced"
        else:
            continue
        raise InputError(what, where=f"{option} {out}", hint=f"Choose another {option}")


def keep_folders(out: Path | None, *folders: Path) -> None:
    """Refuse to write results into a folder that is read. Raises InputError: ``out`` is one of them."""
    for folder in folders:
        if out is not None and out.resolve() == folder.resolve():
            raise InputError(
                "the results would replace the summary of the run", where=f"--out {out}", hint="Choose another --out"
            )


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], *, note: str = "") -> None:
    """Print a table; numbers (columns whose header ends in a unit or a figure) are right-aligned."""
    from rich.console import Console
    from rich.table import Table

    width = None if sys.stdout.isatty() else 160
    console = Console(file=below(sys.stdout), width=width, highlight=False)
    table = Table(title=_text(title, "table.title"), title_justify="left", show_edge=False, pad_edge=False)
    for i, column in enumerate(columns):
        numeric = bool(rows) and all(_is_number(row[i]) for row in rows if row[i])
        table.add_column(_text(column), justify="right" if numeric else "left", overflow="fold")
    for row in rows:
        table.add_row(*map(_text, row))
    console.print(table)
    if note:
        console.print(_text(note))


def _text(words: str, style: str = "") -> Any:
    """Text without markup and without :emoji:."""
    from rich.text import Text

    return Text(printable(words), style=style)


def print_made_again(summary: Mapping[str, Any]) -> None:
    """Say in a line each why finished steps were made again, and how many for that reason.

    Args:
        summary: Of a job; ``made_again`` counts by reason.
    """
    import typer

    for reason, count in summary.get("made_again", {}).items():
        typer.echo(f"made again: {count} ({reason})")


def _is_number(text: str) -> bool:
    try:
        float(text.rstrip("%").replace(" ", ""))
    except ValueError:
        return False
    return True


@contextlib.contextmanager
def progress_bar(what: str, *, quiet: bool = False) -> Iterator[Progress]:
    """Progress on standard error, as a bar with the time left or, where that is no terminal, a line now and then.

    Yields the function jobs report to. A line comes every 10 s, also while a job says nothing; the environment variable
    COUNTERFLEX_PROGRESS_S says another period, 0 none.
    """
    meter = Meter(what)
    if quiet:
        yield meter
    elif sys.stderr.isatty():
        with _bar(meter) as progress:
            yield progress
    else:
        with _lines(meter, line_period_s()):
            yield meter


@contextlib.contextmanager
def resumable_progress(what: str, out: Path | None, kept: str = "finished runs") -> Iterator[Progress]:
    """As :func:`progress_bar`, for a job that the same command continues.

    Raises:
        Interrupted: Ctrl-C; it says what is stored.
    """
    with progress_bar(what) as progress:
        try:
            yield progress
        except KeyboardInterrupt as stop:
            raise Interrupted(
                f"interrupted; {kept} are stored", where=str(out), hint="The same command continues"
            ) from stop


def line_period_s() -> float:
    """Return how often progress is told where there is no terminal, s; 0: never."""
    try:
        return max(0.0, float(os.environ.get("COUNTERFLEX_PROGRESS_S", "10")))
    except ValueError:
        return 10.0


@contextlib.contextmanager
def _lines(meter: Meter, period_s: float) -> Iterator[None]:
    ended = threading.Event()
    teller = threading.Thread(target=_tell, args=(meter, ended, period_s), name="progress", daemon=True)
    if period_s > 0.0:
        teller.start()
    try:
        yield
    finally:
        ended.set()
        if period_s > 0.0:
            teller.join()


def _tell(meter: Meter, ended: threading.Event, period_s: float) -> None:
    while not ended.wait(period_s):
        print(meter.line(), file=sys.stderr, flush=True)


class _Left:
    """The time left, as a text of the moment when it is shown."""

    def __init__(self, meter: Meter) -> None:
        self._meter = meter

    def __str__(self) -> str:
        remaining_s = self._meter.remaining_s()
        return duration(self._meter.elapsed_s()) if remaining_s is None else f"about {duration(remaining_s)} left"


@contextlib.contextmanager
def _bar(meter: Meter) -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress as Bar, TextColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%"),
        TextColumn("{task.fields[left]}", markup=False, style="none"),
    )
    with Bar(*columns, console=Console(file=below(sys.stderr)), transient=True) as bar, everything_is_text():
        task = bar.add_task(printable(meter.what), total=1.0, left=_Left(meter))
        meter.on_change = lambda: bar.update(task, completed=meter.fraction, description=printable(meter.what))
        yield meter

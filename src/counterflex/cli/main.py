"""The ``counterflex`` command."""

from __future__ import annotations

import math
import os
import sys
import time
from typing import Annotated, Any, Final, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup

from counterflex import __version__
from counterflex.cli import (
    ads,
    campaign,
    dataset,
    demo,
    doctor,
    egm,
    faults,
    identify,
    interrupt,
    log,
    online,
    operator,
    program,
    prove,
    question,
    reproduce,
    rsi,
    soak,
    tracker,
    twin,
)
from counterflex.cli.interrupt import interruptible
from counterflex.cli.output import line_period_s
from counterflex.core import compiling
from counterflex.core.errors import CounterflexError, InputError, Interrupted

_INTERRUPTED: Final = 130
"""Status that the command parser gives an interrupted command."""
_CommandLineFault: Final[type[Exception]] = next(
    kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException"
)


class _Command(TyperCommand):
    """A command whose numbers are finite: ``nan`` and ``inf`` pass every range that the parser checks."""

    def invoke(self, ctx: Any) -> Any:
        for name, value in ctx.params.items():
            if isinstance(value, float) and not math.isfinite(value):
                option = "--" + name.replace("_", "-")
                raise InputError(f"{option} is not a number that can be used", value=value, limit="a finite number")
        return super().invoke(ctx)


def _with_finite_numbers(app: typer.Typer) -> None:
    for command in app.registered_commands:
        command.cls = _Command
    for group in app.registered_groups:
        if group.typer_instance is not None:
            _with_finite_numbers(group.typer_instance)


PANELS: Final = {
    "Plan": ("cell", "robots", "pose", "deflection", "path", "compensate"),
    "Prove": ("demo", "prove", "truth", "simulate", "evaluate", "report"),
    "Identify": ("identify", "dataset", "campaign"),
    "Online": ("run", "operator", "log", "rsi", "egm"),
    "Devices": ("twin", "tracker", "ads"),
    "Tools": ("doctor", "soak", "faults", "reproduce"),
}
"""Commands by what they are for, in the order of ``--help``."""


class _Groups(TyperGroup):
    """The commands in the order of :data:`PANELS`."""

    def list_commands(self, ctx: Any) -> list[str]:
        names = [name for panel in PANELS.values() for name in panel]
        return sorted(super().list_commands(ctx), key=names.index)


app = typer.Typer(
    name="counterflex",
    cls=_Groups,
    no_args_is_help=True,
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


def _in_panels(app: typer.Typer) -> None:
    """Put every command under the heading of its use."""
    panel_of = {name: panel for panel, names in PANELS.items() for name in names}
    for command in app.registered_commands:
        command.rich_help_panel = panel_of[str(command.name or getattr(command.callback, "__name__", ""))]
    for group in app.registered_groups:
        group.rich_help_panel = panel_of[str(group.name)]


for room in (question, program, prove, dataset, identify, twin, tracker, ads, campaign):
    room.register(app)
for room in (online, operator, log, doctor, soak, faults, rsi, egm, reproduce, demo):
    room.register(app)
_in_panels(app)
_with_finite_numbers(app)


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
    """Run the command line; faults of the user's making end in one line on standard error and exit status 2.

    A fault of the program itself is not hidden: it shows its traceback and ends with status 1. A command that a signal
    has asked to end ends with 128 and the signal's number, whatever else happened: 130 Ctrl-C, 143 request to
    terminate, 129 terminal closed.
    """
    # Matrices are small here: on a busy machine the threads of BLAS wait for one another, fifty times longer than they
    # compute. Must be said before NumPy is imported.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if line_period_s() > 0.0:
        compiling.tell(_Compiling(line_period_s()))
    with interruptible():
        try:
            status = operator.quick(sys.argv[1:])
            if status is None:
                status = app(prog_name="counterflex", standalone_mode=False)
            sys.stdout.flush()  # a full disk behind it is told here
        except KeyboardInterrupt:
            status = _INTERRUPTED
        except Interrupted as fault:
            _end(str(fault), interrupt.status() or _INTERRUPTED)
        except CounterflexError as fault:
            _end(str(fault))
        except _CommandLineFault as fault:
            _end_usage(fault)
        except BrokenPipeError:
            sys.stderr.close()
            sys.exit(0)
        except OSError as fault:  # of a disk, a device, a socket: of the computer, not of the program
            if not fault.strerror:
                raise
            _end(f"{fault.filename or 'counterflex'}: {fault.strerror}")
        asked = interrupt.status()  # 128 and the number of the signal, whatever the command made of it
    if status == _INTERRUPTED:
        _end(f"interrupted; {interrupt.left()}", asked or _INTERRUPTED)
    if asked is not None:
        sys.exit(asked)
    sys.exit(status if isinstance(status, int) else 0)


class _Compiling:
    """Tells that kernels are compiled: at the first one, and then now and then."""

    def __init__(self, period_s: float) -> None:
        self._period_s, self._count = period_s, 0
        self._begin = self._last = 0.0

    def __call__(self) -> None:
        self._count += 1
        now = time.monotonic()
        if self._count == 1:
            self._begin = self._last = now
            self._say("once on this computer: takes a minute or some")
        elif now - self._last >= self._period_s:
            self._last = now
            self._say(f"{self._count} so far, in {now - self._begin:.0f} s")

    @staticmethod
    def _say(what: str) -> None:
        print(f"compiling the numerical kernels, {what}", file=sys.stderr, flush=True)


def _end_usage(fault: Any) -> NoReturn:
    """End with a fault of the command line: unknown command or option, missing or malformed argument."""
    context = getattr(fault, "ctx", None)
    command = context.command_path if context is not None else "counterflex"
    message = _with_value(" ".join(fault.format_message().split()), fault)
    if type(fault).__name__ == "NoArgsIsHelpError":
        print(fault.format_message())
        sys.exit(2)
    stop = "" if message.endswith((".", "?", "!")) else "."
    _end(f"{message}{stop} {command} --help shows how it is used")


def _with_value(message: str, fault: Any) -> str:
    """A message of the parser with the value that was given, which its checks of types and bounds leave out."""
    errors = getattr(fault.__cause__, "errors", None)
    found = errors() if callable(errors) else []
    if not found or "input" not in found[0] or "Input should" not in message:
        return message
    return message.replace("Input should be", f"got {str(found[0]['input'])[:60]}; expected", 1).replace(
        "Input should", f"got {str(found[0]['input'])[:60]}; it should", 1
    )


def _end(line: str, status: int = 2) -> NoReturn:
    print(f"error: {' '.join(line.split())}", file=sys.stderr)
    sys.exit(status)

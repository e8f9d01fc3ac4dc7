"""The commands of ``counterflex`` and how they are read."""

from __future__ import annotations

import copy
import importlib
import inspect
import math
import os
import sys
import textwrap
import time
import types
from collections.abc import Mapping, Sequence
from functools import cache
from types import MappingProxyType
from typing import Annotated, Any, Final, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup

from counterflex import __version__
from counterflex.cli.arguments import option
from counterflex.cli.commands.extensions import COMMANDS
from counterflex.cli.interrupt import end
from counterflex.cli.output import line_period_s, warn
from counterflex.core import compiling, remarks
from counterflex.core.errors import InputError

__all__ = ["parsed", "whole"]
_CommandLineFault: Final[type[Exception]] = next(
    kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException"
)


def _write_help(text: str, formatter: Any) -> None:
    """Write help paragraph by paragraph; options are not broken at their hyphens, examples not at all."""
    for paragraph in inspect.cleandoc(text).split("\n\n"):
        line = " ".join(paragraph.split())
        indent = " " * (formatter.current_indent + 2)
        if not line.startswith("Example:"):
            line = textwrap.fill(
                line, formatter.width - 2, break_on_hyphens=False, break_long_words=False, subsequent_indent=indent
            )
        formatter.write(f"\n{indent}{line}\n")


class _Command(TyperCommand):
    """A command whose numbers are finite: ``nan`` and ``inf`` pass every range that the parser checks."""

    def format_help_text(self, _ctx: Any, formatter: Any) -> None:
        """Write what the command does."""
        _write_help(self.help or "", formatter)

    def invoke(self, ctx: Any) -> Any:
        for name, value in ctx.params.items():
            if isinstance(value, float) and not math.isfinite(value):
                option = "--" + name.replace("_", "-")
                raise InputError(f"{option} is not a number that can be used", value=value, limit="a finite number")
        with remarks.collected() as made:
            try:
                result = super().invoke(ctx)
            except typer.Exit:
                _say_remarks(made)
                raise
        _say_remarks(made)
        return result


def _say_remarks(made: Mapping[str, bool]) -> None:
    """Print on standard error what the command has not shown of the remarks on its inputs."""
    for sentence, was_shown in made.items():
        if not was_shown:
            warn(sentence, err=True)


def _with_own_classes(app: typer.Typer) -> None:
    for command in app.registered_commands:
        command.cls = _Command
    for group in app.registered_groups:
        if group.typer_instance is not None:
            group.typer_instance.info.cls = _Group
            _with_own_classes(group.typer_instance)


LAB: Final = ("soak", "faults", "reproduce")
"""Commands of the package counterflex-lab, which proves counterflex and comes beside it in a clone."""
_QUESTIONS: Final = ("cell", "robots", "pose", "deflection")
_PROVE: Final = ("demo", "prove", "truth", "simulate", "evaluate", "mesh", "report", "predict", "reveal")
PANELS: Final = {
    "Start": ("studio",),
    "Plan": (*_QUESTIONS, "path", "modes", "plan", "preflight", "compensate", "diff", "convert", "correct", "quote"),
    "Prove": (*_PROVE, "inspect", "benchmark-part"),
    "Identify": ("identify", "firstcut", "production", "dataset", "dcc", "holder", "campaign"),
    "Measure": ("iso9283", "iso230", "thermal"),
    "Online": ("run", "operator", "panel", "panel-user", "opcua", "log", "rsi", "egm"),
    "Devices": ("twin", "tracker", "ads"),
    "Tools": ("doctor", "warm", "add-in", "extensions", *LAB),
}
"""Commands by what they are for, in the order of ``--help``."""
_OWN: Final = tuple(name for names in PANELS.values() for name in names if name not in LAB)
_MODULES: Final = {
    **dict.fromkeys(_QUESTIONS, "question"),
    **dict.fromkeys(("path", "compensate"), "program"),
    **dict.fromkeys(_PROVE, "prove"),
    **{
        name: f"operate.{name.removesuffix('-user')}" for name in ("operator", "panel", "panel-user", "opcua", "studio")
    },
    **{name: f"standards.{name}" for name in ("iso9283", "iso230", "dcc")},
    "diff": "difference",
    "firstcut": "first_cut",
    "inspect": "inspection",
    "plan": "plan.group",
}
"""Module of a command, below ``cli.commands``, where it has another name."""


class _Group(TyperGroup):
    """Commands below a word, each with its whole first sentence."""

    panels: Mapping[str, Sequence[str]] = MappingProxyType({})

    def format_help_text(self, _ctx: Any, formatter: Any) -> None:
        """Write what the commands are for."""
        _write_help(self.help or "", formatter)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands, under the headings of their use where there are any."""
        left = self.list_commands(ctx)
        for heading, names in {**self.panels, "Other packages" if self.panels else "Commands": tuple(left)}.items():
            there = [name for name in names if name in left]
            left = [name for name in left if name not in there]
            if there:
                with formatter.section(heading):
                    formatter.write_dl([(name, self.commands[name].get_short_help_str(200)) for name in there])


class _Groups(_Group):
    """The commands in the order of :data:`PANELS`, those of other packages behind them."""

    panels = PANELS

    def list_commands(self, ctx: Any) -> list[str]:
        names = [name for listed in PANELS.values() for name in listed]
        return sorted(super().list_commands(ctx), key=[*names, *super().list_commands(ctx)].index)


app = typer.Typer(
    name="counterflex",
    cls=_Groups,
    context_settings={"max_content_width": 110},
    no_args_is_help=True,
    rich_markup_mode=None,  # plain help: the library that draws boxes takes a third of the time of --help to load
    pretty_exceptions_enable=False,
    help=(
        "Makes a milling robot accurate: predicts its deflection under the cutting force and writes the same "
        "program, compensated.\n\nFirst steps:\n\n"
        "`counterflex demo --out out/demo` runs the complete chain on a simulated cell.\n\n"
        "`counterflex cell example --out cell.toml` writes an example cell file.\n\n"
        "`counterflex compensate part.ngc --cell cell.toml --out out` compensates your program."
    ),
)


def _name(info: Any) -> str:
    """The word that calls a command or a group."""
    return str(info.name or getattr(getattr(info, "callback", None), "__name__", ""))


@cache
def _room(name: str) -> typer.Typer:
    """The command or the group of a name, the only one of these: its module is loaded."""
    module, room = _MODULES.get(name, name.replace("-", "_")), typer.Typer()
    command = getattr(importlib.import_module(f"counterflex.cli.commands.{module}"), name.replace("-", "_"))
    if isinstance(command, typer.Typer):
        room.add_typer(command, name=name)
    else:
        room.command(name)(command)
    _with_own_classes(room)
    return room


def _own(*names: str) -> typer.Typer:
    """The commands of ours that have these names, their modules loaded and no others."""
    together = copy.copy(app)
    rooms = [_room(name) for name in names]
    together.registered_commands = [info for room in rooms for info in room.registered_commands]
    together.registered_groups = [info for room in rooms for info in room.registered_groups]
    return together


def whole() -> typer.Typer:
    """The commands, those that other packages add (:data:`COMMANDS`) among them; a package that is broken adds none."""
    together = _own(*_OWN)
    for name, add in COMMANDS.items():
        if name not in _OWN:
            add(together)
    _with_own_classes(together)
    return together


def _only(words: Sequence[str]) -> typer.Typer:
    """The command that is called, alone where it is ours; else all, of the others name and help only.

    Reading the options of all takes longer than a stop may.

    Raises:
        InputError: The package of the command is broken, or is not installed.
    """
    called = next((word for word in words if not word.startswith("-")), "")
    if called in _OWN and words[0] == called:
        return _own(called)
    if called in COMMANDS and called not in _OWN:
        COMMANDS[called]  # what is wrong with its package is said, not that there is no such command
    elif called in LAB:
        raise InputError(
            "this command belongs to the package counterflex-lab, which is not installed",
            value=f"counterflex {called}",
            hint="In a clone of counterflex: python -m pip install -e lab",
        )
    small = whole()
    small.registered_commands = [
        info if called == _name(info) else _named_only(info) for info in small.registered_commands
    ]
    small.registered_groups = [
        info if called == info.name else _without_commands(info) for info in small.registered_groups
    ]
    return small


def _named_only(info: Any) -> Any:
    """A command that has its name and what it does, and no options."""
    named = types.FunctionType(_nothing.__code__, {})
    named.__doc__ = info.callback.__doc__
    copied = copy.copy(info)
    copied.name, copied.callback = _name(info), named
    return copied


def _nothing() -> None:
    pass


def _without_commands(info: Any) -> Any:
    """A group that has its name and what it is for, and no commands."""
    copied = copy.copy(info)
    copied.typer_instance = copy.copy(info.typer_instance)
    copied.typer_instance.registered_commands, copied.typer_instance.registered_groups = [], []
    return copied


def _version(value: bool) -> None:
    if value:
        from counterflex.core.build_data import sentence

        typer.echo(sentence(__version__))
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, option("--version", "Print version, commit, Python and platform, and stop.", _version, is_eager=True)
    ] = False,
) -> None:
    pass


def parsed(words: Sequence[str]) -> object:
    """Do what a command line says.

    Args:
        words: Of the command line, without the command itself.

    Returns:
        Exit status, or None.

    Raises:
        CounterflexError: A fault of the user's making.
    """
    if line_period_s() > 0.0:
        compiling.tell(_Compiling(line_period_s()))
    commands = whole() if "_COUNTERFLEX_COMPLETE" in os.environ else _only(words)
    try:
        return commands(list(words), prog_name="counterflex", standalone_mode=False)
    except _CommandLineFault as fault:
        _end_usage(fault)


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
            self._say("once on this computer: takes about a minute")
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
    end(f"{message}{stop} {command} --help shows how it is used")


def _with_value(message: str, fault: Any) -> str:
    """A message of the parser with the value that was given, which its checks of types and bounds leave out."""
    errors = getattr(fault.__cause__, "errors", None)
    faults = errors() if callable(errors) else []
    if not faults or "input" not in faults[0] or "Input should" not in message:
        return message
    return message.replace("Input should be", f"got {str(faults[0]['input'])[:60]}; expected", 1).replace(
        "Input should", f"got {str(faults[0]['input'])[:60]}; it should", 1
    )

"""Commands that messages, reports and written files suggest, as they can be typed.

Every suggested command that has options or arguments is made here. `tests/cli/test_suggested_commands.py` collects the
calls and holds each against the command's own parser: name, options, number of arguments, and what may not be left out.
"""

from __future__ import annotations

import itertools
import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Final

_PLACEHOLDER: Final = re.compile(r"[A-Z][A-Z0-9]*(?:\.\.\.)?|[\w.]+=[A-Z]+")
"""A word that the user replaces: CELL, PROGRAM, RUN...; ``tool=N``."""


def next_command(command: str, *values: object, **options: object) -> str:
    """Return a command line, quoted for the shell.

    Args:
        command: Command and subcommand, ``"identify stiffness"``.
        values: Arguments: files as the user gave them, or placeholders in capitals. None is left out.
        options: By name, ``assume_class`` for ``--assume-class``; a name that Python keeps for itself ends in ``_``.
            True is a flag, False and None are left out, a list or tuple repeats the option. An ``out`` folder in which
            one of the files lies gets a number: commands do not write into a folder that they read from.

    Returns:
        ``counterflex prove part.ngc --cell "my cell.toml" --out proof``.
    """
    if isinstance(options.get("out"), str):
        options["out"] = _free(str(options["out"]), [*values, *options.values()])
    words = [*command.split(), *(word(_argument(value)) for value in values if value is not None)]
    for name, given in options.items():
        option = f"--{name.strip('_').replace('_', '-')}"
        for value in given if isinstance(given, (list, tuple)) else [given]:
            if value is True:
                words.append(option)
            elif value is not None and value is not False:
                words += [option, word(value)]
    return " ".join(["counterflex", *words])


def _free(out: str, files: Sequence[object]) -> str:
    """Return the name of a folder, with a number where a file of the command lies in it."""
    taken = {Path(str(file)).parent.resolve() for file in files}
    names = (out if number == 1 else f"{out}-{number}" for number in itertools.count(1))
    return next(name for name in names if Path(name).resolve() not in taken)


def _argument(value: object) -> str:
    """Return an argument that is not taken for an option, whatever the file is named."""
    text = str(value)
    return f"./{text}" if text.startswith("-") else text


def word(value: object) -> str:
    """Return one word of a command line, quoted where the shell would take it apart."""
    text = str(value)
    return text if _PLACEHOLDER.fullmatch(text) else shlex.quote(text)

"""Hold a command line against the parser of the command itself: name, options, arguments, what may not be left out."""

from __future__ import annotations

import re
import shlex
from typing import Any

import typer

from counterflex.cli.main import whole

COMMANDS: Any = typer.main.get_command(whole())


def command_of(words: list[str]) -> tuple[Any, list[str]]:
    """The command that a line calls and the words behind its name; None where there is no such command."""
    command, rest = COMMANDS, list(words)
    while rest and rest[0] in getattr(command, "commands", {}):
        command = command.commands[rest.pop(0)]
    return (None if command is COMMANDS else command), rest


def options_of(command: Any) -> set[str]:
    """Every option of a command, short ones too."""
    return {name for param in command.params for name in (*param.opts, *param.secondary_opts)} | {"--help"}


def faults(line: str) -> list[str]:
    """What is wrong with ``counterflex ...``: empty where it can be typed as it is.

    Values are not looked at; a word in capitals stands for one. What may not be left out must be there.
    """
    words = shlex.split(line)
    assert words[0] == "counterflex", line
    command, rest = command_of(words[1:])
    if command is None:
        return [f"{line}: there is no such command"]
    if getattr(command, "commands", {}):
        return [f"{line}: a subcommand is missing" if not rest else f"{line}: there is no such subcommand"]
    context = command.context_class(command, info_name=command.name)
    try:
        values, left, _ = command.make_parser(context).parse_args(args=list(rest))
    except Exception as fault:
        return [f"{line}: {getattr(fault, 'message', fault)}"]
    wrong = [f"{line}: {' '.join(map(str, left))} is one argument too many"] if left else []
    for param in command.params:
        given = values.get(param.name)
        if param.required and (given is None or given == () or type(given).__name__ == "Sentinel"):
            wrong.append(f"{line}: {param.opts[0]} is missing")
    return wrong


def commands_in(text: str) -> list[str]:
    """Command lines in a printed text: ``counterflex`` with a command's name, up to the end of the line or clause."""
    found = []
    for clause in re.split(r"(?<![\w./])counterflex (?=[a-z])", text)[1:]:
        before = re.split(r"[`\n;()]|, |\.(?: |$)", clause)[0]
        words = [word.rstrip(".:,") if word.endswith((".", ":", ",")) else word for word in _split(before)]
        command, rest = command_of(words)
        if command is None:
            continue  # a sentence about the program itself
        taken = words[: len(words) - len(rest)]
        for place, item in enumerate(rest):
            if not _of_command_line(rest, place, command):
                break
            taken.append(item)
        found.append(" ".join(["counterflex", *map(shlex.quote, taken)]))
    return found


def _split(text: str) -> list[str]:
    try:
        return shlex.split(text)
    except ValueError:
        return text.split()


_WORD = re.compile(r"[A-Z][A-Z0-9.]*|.*[./=\d].*|-.*")


def _of_command_line(rest: list[str], place: int, command: Any) -> bool:
    """Whether a word belongs to the line: an option, its value, a file, a placeholder; a word of prose ends it."""
    if _WORD.fullmatch(rest[place]):
        return True
    if place == 0 and len(rest) > 1 and _WORD.fullmatch(rest[1]):
        return True  # a recipe in front of its files and options
    before = rest[place - 1] if place else ""
    flags = {name for p in command.params if getattr(p, "is_flag", False) for name in (*p.opts, *p.secondary_opts)}
    return before.startswith("-") and before not in flags

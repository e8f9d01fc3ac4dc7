"""Commands that messages, reports and written files suggest: they exist, and so does every option that they name."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer

from counterflex.cli.main import app

COMMANDS: Any = typer.main.get_command(app)
SOURCES = Path(__file__).resolve().parents[2] / "src" / "counterflex"
_SUGGESTED = re.compile(r"counterflex ([a-z][a-z0-9-]*(?: [a-z][a-z0-9-]*)?)((?:(?! counterflex |[`\n;]|\. ).)*)")
_OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")


def _texts(tree: ast.AST) -> Iterator[str]:
    """Every text of a module; what is filled in stands as X."""
    inside = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield "".join(str(part.value) if isinstance(part, ast.Constant) else "X" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in inside:
            yield node.value


def faults(text: str) -> list[str]:
    """What is wrong with the commands that a text suggests."""
    wrong = []
    for words, rest in _SUGGESTED.findall(" ".join(text.split())):
        command: Any = COMMANDS
        for word in words.split():
            below = getattr(command, "commands", {})
            if word in below:
                command = below[word]
        if command.name == "counterflex":
            continue  # a sentence about the program itself
        known = {name for param in command.params for name in (*param.opts, *param.secondary_opts)}
        if getattr(command, "commands", {}):
            continue  # a group
        wrong += [f"{words} {option}" for option in _OPTION.findall(rest) if option not in {*known, "--help"}]
    return wrong


def test_every_suggested_command_has_its_options() -> None:
    wrong = []
    for file in sorted(SOURCES.rglob("*.py")):
        source = file.read_text(encoding="utf-8")
        if "counterflex " in source:
            name = file.relative_to(SOURCES)
            wrong += [f"{name}: {fault}" for text in _texts(ast.parse(source)) for fault in faults(text)]
    assert wrong == []


def test_an_option_that_is_none_is_seen() -> None:
    assert faults("A lower feed: counterflex compensate X --feed-for-tolerance-um 50 ...") == [
        "compensate --feed-for-tolerance-um"
    ]
    assert faults("counterflex compensate X --cell CELL; counterflex evaluate --none") == ["evaluate --none"]
    assert faults("counterflex computes; `counterflex identify cutting --propose 12 --cell c`. See --nothing") == []

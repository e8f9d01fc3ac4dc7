"""Commands that messages, reports, help texts and pages suggest are typed as they stand: the commands take them."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from command_parser import COMMANDS, command_of, commands_in, faults, options_of
from counterflex.core.next_command import next_command

ROOT = Path(__file__).resolve().parents[2]
SOURCES = (ROOT / "src" / "counterflex", ROOT / "lab")
MODULES = {path.relative_to(base).as_posix(): path for base in SOURCES for path in sorted(base.rglob("*.py"))}
_OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")
_LONG = re.compile(r"counterflex ([a-z][a-z0-9-]*)(.*)", re.DOTALL)
NO_COMMANDS = {"COMMAND", "job"}
"""What follows the name of the program elsewhere: a placeholder, the mark of a compensated program."""
OF_SCRIPTS = {
    "integrations/freecad/counterflex_post.py": {
        "--results",
        "--without-preflight",
        "--counterflex",
        "--no-show-editor",
    },
}
"""Own options of scripts that run in other programs, and those of such a program."""
_STANDS = "X"
"""For a value that is only known when the line is printed."""


def _calls(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Every call of :func:`next_command` as the line it makes; values that are computed stand as X."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "next_command":
            command = _text(node.args[0])
            for name in _recipes(command):
                options = {str(word.arg): _value(word.value) for word in node.keywords if word.arg}
                yield node.lineno, next_command(name, *map(_value, node.args[1:]), **options)


def _recipes(command: str) -> list[str]:
    """A command as it stands, with a recipe and a paper where it takes one."""
    return [command.replace(_STANDS, "all" if command.startswith("reproduce") else "stiffness")]


def _text(node: ast.AST) -> str:
    if isinstance(node, ast.Constant):
        return str(node.value)
    assert isinstance(node, ast.JoinedStr)
    return "".join(str(part.value) if isinstance(part, ast.Constant) else _STANDS for part in node.values)


def _value(node: ast.AST) -> object:
    """A constant as it is; a comparison or a name of a flag is a flag; else a value that is not known here."""
    if isinstance(node, ast.Constant):
        return node.value
    return True if isinstance(node, ast.Compare) or (isinstance(node, ast.Name) and node.id == "quick") else _STANDS


def _texts(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Every text of a module without its docstrings; what is filled in stands as X."""
    inside = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield node.lineno, _text(node)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in inside:
            yield node.lineno, node.value


def _parsed(pattern: str) -> Iterator[tuple[str, ast.Module]]:
    """Modules whose text has a pattern."""
    for name, file in MODULES.items():
        text = file.read_text(encoding="utf-8")
        if re.search(pattern, text):
            yield name, ast.parse(text)


def _docstrings(tree: ast.AST) -> set[int]:
    return {
        node.body[0].value.lineno
        for node in ast.walk(tree)
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef))
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }


def test_every_command_that_the_program_makes_is_taken() -> None:
    count, wrong = 0, []
    for name, tree in _parsed(r"next_command\("):
        for line, text in _calls(tree):
            count += 1
            wrong += [f"{name}:{line}: {fault}" for fault in faults(text)]
    assert not wrong, "\n".join(wrong)
    assert count > 20


SKETCHES = {
    "integrations/abb/link/readme.py": "a page that says what is typed in which order, with optional parts in brackets",
    "integrations/kuka/link/readme.py": "the same for RSI",
    "integrations/abb/language/egm.py": "texts of at most 40 characters on the teach pendant",
    "counterflex_lab/reproduce/papers/pages.py": "a comment that says what wrote the page",
}
"""Texts with part of a command line."""


def test_commands_with_options_are_made_by_next_command_alone() -> None:
    """A text may name a command (`counterflex rsi tune finds gains`); what one can type is made and checked."""
    wrong = []
    for name, tree in _parsed(r"counterflex(?! import)[^\w.]"):
        if name in SKETCHES:
            continue
        help_texts = _docstrings(tree)
        for line, text in _texts(tree):
            if line in help_texts or name == "cli/main.py" or name == "cli/commands/identify.py":
                continue  # examples of --help: below
            for found in _LONG.finditer(" ".join(text.split())):
                clause = re.split(r"[.;)] |`|: ", found[2])[0]
                if found[1] in COMMANDS.commands and (_OPTION.search(clause) or " ..." in clause):
                    wrong.append(f"{name}:{line}: counterflex {found[1]}{clause}")
    assert not wrong, "\n".join(wrong)
    assert set(SKETCHES) <= set(MODULES)


def test_every_named_option_is_one_of_some_command() -> None:
    known = {name for command in _all(COMMANDS) for name in options_of(command)} | {"--version"}
    others = {"--nthreads", "--nworkers"}  # of dask
    wrong = []
    for name, tree in _parsed("--"):
        for line, text in _texts(tree):
            named = set(_OPTION.findall(text)) - known - others - OF_SCRIPTS.get(name, set())
            wrong += [f"{name}:{line}: {option}" for option in sorted(named)]
    assert not wrong, "\n".join(wrong)


def _all(group: Any) -> Iterator[Any]:
    for command in group.commands.values():
        yield command
        if getattr(command, "commands", {}):
            yield from _all(command)


def test_examples_of_help_are_taken() -> None:
    wrong, count = [], 0
    for command in (COMMANDS, *_all(COMMANDS)):
        for line in re.findall(r"`(counterflex [^`]+)`", command.help or ""):
            count += 1
            if command_of(line.split()[1:])[1]:  # else it names the command
                wrong += faults(line)
    assert not wrong, "\n".join(wrong)
    assert count > 60


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md", "docs"])
def test_commands_of_the_pages_are_taken(name: str) -> None:
    """Also those in sentences and tables, which no block runs."""
    path = ROOT / name
    wrong = []
    for file in sorted(path.rglob("*.md")) if path.is_dir() else [path]:
        if "adr" in file.parts or "_build" in file.parts:
            continue  # decisions of their day
        for line in re.findall(r"(?<!`)`(counterflex [^`\n]+)`", file.read_text(encoding="utf-8")):
            command, rest = command_of(line.split()[1:])
            if command is None and (rest[0].startswith("-") or rest[0] in NO_COMMANDS):
                continue
            if command is None:
                wrong.append(f"{file.name}: {line}: no such command")
                continue
            named = {word.partition("=")[0] for word in rest if word.startswith("--")}
            wrong += [f"{file.name}: {line}: {word}" for word in sorted(named - options_of(command))]
    assert not wrong, "\n".join(wrong)


def test_what_is_wrong_is_seen() -> None:
    assert faults("counterflex compensate part.ngc --cell cell.toml --out out") == []
    assert "no such option" in faults("counterflex compensate X --cell C --out D --tolerance-um 5")[0].lower()
    assert "--out is missing" in faults("counterflex prove X --cell C")[0]
    assert "too many" in faults("counterflex cell check a.toml b.toml")[0]
    assert "program is missing" in faults("counterflex prove --cell C --out D")[0]
    assert "no such command" in faults("counterflex mill part.ngc")[0]
    assert "subcommand" in faults("counterflex cell")[0]
    said = "Try it: counterflex prove 'my part.ngc' --cell C --assume-class --out proof. Then counterflex run."
    assert commands_in(said) == [
        "counterflex prove 'my part.ngc' --cell C --assume-class --out proof",
        "counterflex run",
    ]
    assert commands_in("counterflex identify stiffness --propose 30 --cell a.toml --out pulls, or state it") == [
        "counterflex identify stiffness --propose 30 --cell a.toml --out pulls"
    ]


@pytest.mark.parametrize(
    ("made", "line"),
    [
        (next_command("prove", "my part.ngc", cell="c.toml"), "counterflex prove 'my part.ngc' --cell c.toml"),
        (next_command("truth", "CELL", out=None, assume_class=True), "counterflex truth CELL --assume-class"),
        (next_command("dcc", "A", as_="k", set_=["a=1", "b=2"]), "counterflex dcc A --as k --set a=1 --set b=2"),
        (next_command("cell check", "$(rm -r x).toml", exact=False), "counterflex cell check '$(rm -r x).toml'"),
    ],
)
def test_words_are_quoted_for_the_shell(made: str, line: str) -> None:
    assert made == line


def test_a_suggested_folder_is_not_one_that_the_command_reads_from() -> None:
    """Commands refuse to write where their cell lies: what was suggested behind an identification ended in an error."""
    named = {"cell": Path("identified/cell.toml"), "out": "identified"}
    assert next_command("identify cutting", "d/cutting.toml", **named).endswith("--out identified-2")
    named["cell"] = Path("identified-2") / "cell.toml"
    assert next_command("identify cutting", "identified/m.toml", **named).endswith("--out identified-3")
    assert next_command("prove", "part.ngc", cell=Path("cell.toml"), out="proof").endswith("--out proof")

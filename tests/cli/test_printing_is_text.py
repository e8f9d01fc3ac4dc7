"""Everything is printed through one door: the library that reads markup is used in one module and is given text."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import counterflex
from counterflex.cli import output
from counterflex.core.printable import all_printable, printable

SOURCE = Path(counterflex.__file__).parent
OUTPUT = Path(output.__file__)
STEERS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
SHOWS_ITS_TEXT = {
    "print", "add_row", "add_column", "add_task", "update", "Table", "Text", "log", "rule", "input", "status", "Panel",
}  # fmt: skip
"""Functions of the library that print what they are given, as text or as markup."""


def naming(word: str) -> list[tuple[Path, ast.Module]]:
    """Modules whose text has a word."""
    texts = ((path, path.read_text(encoding="utf-8")) for path in sorted(SOURCE.rglob("*.py")))
    return [(path, ast.parse(text)) for path, text in texts if word in text]


def uses(tree: ast.AST, library: str) -> bool:
    for node in ast.walk(tree):
        names = [one.name for one in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
        if any(name.partition(".")[0] == library for name in names):
            return True
    return False


def test_one_module_uses_the_library_that_reads_markup() -> None:
    assert [path for path, tree in naming("rich") if uses(tree, "rich")] == [OUTPUT]


def is_text(node: ast.expr) -> bool:
    """Names cannot come in as markup: a constant, a number, or what has been made text."""
    if isinstance(node, ast.Starred):
        return is_text(node.value)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        if node.func.id == "map":
            return isinstance(node.args[0], ast.Name) and node.args[0].id == "_text"
        return node.func.id in ("_text", "Text", "printable", "TextColumn", "BarColumn")
    return isinstance(node, ast.Constant) or (isinstance(node, ast.Name) and node.id == "table")


def test_that_module_gives_it_text_only() -> None:
    """No f-string, no name: what is printed as markup is made :class:`rich.text.Text` of :func:`printable` before."""
    tree = ast.parse(OUTPUT.read_text(encoding="utf-8"))
    seen = 0
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef) or not uses(function, "rich"):
            continue
        for call in ast.walk(function):
            if not isinstance(call, ast.Call):
                continue
            name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
            if name not in SHOWS_ITS_TEXT or any(one.arg == "markup" for one in call.keywords):
                continue
            shown = [one for one in call.args if not (isinstance(one, ast.Name) and one.id == "task")]
            shown += [one.value for one in call.keywords if one.arg in ("title", "caption", "description", "header")]
            if name == "Text":  # reads no markup; what steers the terminal is escaped, or the text is of the program
                continue
            seen += 1
            assert all(is_text(one) for one in shown), ast.unparse(call)
    assert seen >= 5
    columns = [call for call in ast.walk(tree) if isinstance(call, ast.Call) and "TextColumn" in ast.unparse(call.func)]
    for call in columns:
        constant = isinstance(call.args[0], ast.Constant) and "description" not in str(call.args[0].value)
        assert constant or any(one.arg == "markup" and ast.unparse(one.value) == "False" for one in call.keywords)


def test_nothing_is_printed_past_the_stream_that_shows_control_characters() -> None:
    past = re.compile(r"__std(out|err)__|std(out|err)\.buffer|os\.write\([12],|/dev/tty")
    found = {
        f"{path.relative_to(SOURCE)}: {line.strip()}"
        for path in SOURCE.rglob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if past.search(line) and not line.strip().startswith(("#", '"""'))
    }
    assert found == set()
    below = {path.name for path in (SOURCE / "cli").rglob("*.py") if re.search(r"\bbelow\(", path.read_text("utf-8"))}
    assert below == {"output.py", "printed.py"}


def test_plain_data_is_shown_as_text() -> None:
    name = "a\x1b[2J\u202e\udcff"
    assert all_printable({name: [name, (name, 1.5, None, True)]}) == {
        printable(name): [printable(name), [printable(name), 1.5, None, True]]
    }
    assert STEERS.search(printable(name)) is None
    printable(name).encode()  # bytes of a file name that are no UTF-8


def test_a_fault_of_the_program_is_printed_as_text() -> None:
    code = (
        "import counterflex.cli.start as s\n"
        "def fails(_): raise RuntimeError('cell\\x1b]0;PWN\\x07 [/3]')\n"
        "s._parsed = fails\n"
        "import sys; sys.argv = ['counterflex', 'path', 'x.ngc']\n"
        "s.run()\n"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert "RuntimeError: cell\\x1b]0;PWN\\x07 [/3]" in ended.stderr
    assert STEERS.search(ended.stderr) is None


@pytest.mark.parametrize("name", ["groove[rev2].ngc", "groove [red] [bold]x :smile:.ngc", "groove\x1b[2J\u202e.ngc"])
def test_names_of_files_are_printed_as_they_are(folder: Path, counterflex: Any, refused: Any, name: str) -> None:
    (folder / "part.ngc").rename(folder / name)
    shown = re.sub(r"\s", "", printable(name))
    ended = counterflex("compensate", name, "--cell", "cell.toml", "--out", "out")
    printed = ended.out + ended.err
    assert ended.status == 0, printed
    assert not STEERS.search(printed)
    assert shown in re.sub(r"\s", "", printed)
    line = refused("path", f"no {name}")
    assert printable(f"no {name}") in line

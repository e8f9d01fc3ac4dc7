"""Measure how the source is built: folders, functions, imports, constants in kernels; of one tree or of two.

    python tools/measure_structure.py
    git worktree add ../before edd1e91 && python tools/measure_structure.py --before ../before --entered
    python tools/measure_structure.py --entered --files
    python tools/measure_structure.py --hold

Figures are counted from the syntax trees below src/counterflex; words of README.md and of docs are those outside
code blocks that no program writes; --entered runs a shipped program twice and counts the files of which a function
is called, without what importing calls: once as `counterflex compensate`, once as the call `compensate(program,
read_cell(cell))` of counterflex.app.compensation.compensate, which leaves out command line, report and writing of
files; --files prints which files those are; --hold ends with status 1 where a figure has passed its ceiling below (a
ceiling is what stands today, and is lowered with what it counts), or where a room has fewer comments than its floor.
"""

from __future__ import annotations

import argparse
import ast
import functools
import gc
import os
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Final

Function = ast.FunctionDef | ast.AsyncFunctionDef
MANY_ARGUMENTS, COMPLEX, LONG_STAGE, LONG_MODULE, WIDE = 10, 15, 60, 400, 20
_PATHS, _LONG = (
    f"functions above complexity {COMPLEX} outside kernels",
    f"functions above {LONG_STAGE} lines outside kernels",
)
_ARGUMENTS = f"functions with more than {MANY_ARGUMENTS} arguments outside kernels"
_COMMENTS = "whole-line comments in 1000 lines of code in `{}`"
_WIDE, _BIG = f"folders above {WIDE} modules", f"modules above {LONG_MODULE} lines"
CEILINGS = {
    "modules": 1161,
    "lines": 220_349,
    _BIG: 7,
    _WIDE: 5,
    _PATHS: 0,
    _LONG: 0,
    _ARGUMENTS: 0,
    "nested functions": 0,
    "circles": 0,
    "dataclasses that only carry data": 304,
    "class names used twice or more": 4,
    "import lines": 15_061,
    "module docstrings that begin with What, How, Which": 0,
    "words in hand-written docs": 89_990,
    "links of docs/index.md": 25,
}
"""What no change may pass: as it stood when it was last lowered."""
COMMENTED: Final = ("cutting", "identify", "plan", "robot", "runtime")
"""Rooms of kernels, plausibility tests, recipes and planners, whose comments say why."""
FLOORS: Final = dict.fromkeys(map(_COMMENTS.format, COMMENTED), 20.0)
"""What no change may fall below."""
_OPENING = re.compile(r"(What|How|Where|Which|Whether|Why|When)\b")
_GENERATED = ("statements", "reference", "_build", "gallery"), ("nomenclature.md", "licences.md")
"""Folders and pages of docs that are made from tables and sources, beside those that say "written by"."""
_NOT_PROSE = re.compile(
    r"^[ \t]*```.*?^[ \t]*```|^<!-- (\w+): (?:begin|written by)[^\n]*-->.*?^<!-- (?:end of \1|\1: end) -->",
    re.MULTILINE | re.DOTALL,
)
"""Code blocks, and tables that a program writes between two comments."""
_CONSTANT = re.compile(r"_?[A-Z][A-Z0-9]*(_[A-Z0-9]+)*$")
_ENTERED = """
import sys, threading
entered = set()
def importing(frame):
    while frame is not None:
        if frame.f_code.co_name == "<module>" and "/src/counterflex/" in frame.f_code.co_filename:
            return True
        frame = frame.f_back
    return False
def note(frame, event, argument):
    file = frame.f_code.co_filename
    if event == "call" and "/src/counterflex/" in file and file not in entered and not importing(frame):
        entered.add(file)
program, cell = "examples/programs/groove.ngc", "examples/cells/kr300_d16_small.toml"
way, out = sys.argv[1:]
if way == "command":
    from counterflex.cli import start
    sys.argv = ["counterflex", "compensate", program, "--cell", cell, "--out", out]
    job = start.run
else:
    from counterflex.app.compensation.compensate import compensate
    from counterflex.files.cell.cell import read_cell
    job = lambda: compensate(program, read_cell(cell))
sys.setprofile(note)
threading.setprofile(note)
try:
    job()
except SystemExit as end:
    failed = end.code
else:
    failed = None
sys.setprofile(None)
if failed:
    sys.exit(failed)
print("entered", *sorted(file.split("/src/counterflex/")[1] for file in entered))
"""


@dataclass(frozen=True)
class Module:
    """One source file: its dotted name, its text, its syntax tree."""

    name: str
    package: bool
    text: str
    tree: ast.Module

    @classmethod
    def read(cls, root: Path, file: Path) -> Module:
        """From a file below the folder that holds `counterflex`."""
        parts = file.relative_to(root).with_suffix("").parts
        package = parts[-1] == "__init__"
        text = file.read_text(encoding="utf-8")
        return cls(".".join(parts[:-1] if package else parts), package, text, ast.parse(text))

    @functools.cached_property
    def nodes(self) -> list[ast.AST]:
        """All nodes of its tree, as `ast.walk` finds them."""
        return list(ast.walk(self.tree))

    def functions(self) -> Iterator[tuple[Function, bool]]:
        """Each function, and whether it is a compiled kernel."""
        for node in self.nodes:
            if isinstance(node, Function):
                yield node, any("kernel" in ast.unparse(mark).split("(")[0].lower() for mark in node.decorator_list)


def complexity(function: Function) -> int:
    """Independent paths through a function (McCabe 1976), counted as radon does, nested functions with it.

    One, and one for each branch, condition joined by `and` or `or`, loop, comprehension and its tests, handler, case.
    """
    total = 1
    for node in ast.walk(function):
        match node:
            case ast.If() | ast.IfExp() | ast.Assert():
                total += 1
            case ast.For() | ast.AsyncFor() | ast.While():
                total += 1 + bool(node.orelse)
            case ast.BoolOp():
                total += len(node.values) - 1
            case ast.comprehension():
                total += 1 + len(node.ifs)
            case ast.Try():
                total += len(node.handlers) + bool(node.orelse)
            case ast.Match():
                total += len(node.cases) - any(ast.unparse(case.pattern) == "_" for case in node.cases)
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                total += node is not function
    return total


def nested(module: Module) -> int:
    """Functions defined inside of functions; left out are those that the outer one returns, as a decorator does."""
    total = 0
    for outer, _ in module.functions():
        inner = [node for node in ast.walk(outer) if isinstance(node, Function) and node is not outer]
        returned = {
            node.value.id
            for node in (ast.walk(outer) if inner else ())
            if isinstance(node, ast.Return) and isinstance(node.value, ast.Name)
        }
        total += sum(node.name not in returned for node in inner)
    return total


def only_data(module: Module) -> int:
    """Dataclasses without a method or property of their own."""
    return sum(
        any("dataclass" in ast.unparse(mark) for mark in node.decorator_list)
        and not any(isinstance(part, Function) for part in node.body)
        for node in module.nodes
        if isinstance(node, ast.ClassDef)
    )


def import_lines(module: Module) -> int:
    """Lines that import, also inside of functions."""
    nodes = (node for node in module.nodes if isinstance(node, ast.Import | ast.ImportFrom))
    return sum((node.end_lineno or node.lineno) - node.lineno + 1 for node in nodes)


def code_and_comments(module: Module) -> tuple[int, int]:
    """Lines of code, less docstrings, blanks and imports, and whole-line comments."""
    left_out: set[int] = set()
    for node in module.nodes:
        if not isinstance(node, ast.Expr | ast.Import | ast.ImportFrom):
            continue
        value = node.value if isinstance(node, ast.Expr) else ast.Constant("")
        if isinstance(value, ast.Constant) and isinstance(value.value, str):
            left_out |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    lines = [line.strip() for n, line in enumerate(module.text.split("\n"), start=1) if n not in left_out]
    comments = sum(line.startswith("#") for line in lines)
    return sum(bool(line) for line in lines) - comments, comments


def comments_in_1000(modules: list[Module]) -> dict[str, str]:
    """Whole-line comments in 1000 lines of code of each room of :data:`COMMENTED`."""
    out = {}
    for room in COMMENTED:
        counts = [code_and_comments(m) for m in modules if m.name.startswith(f"counterflex.{room}.")]
        code, comments = (sum(column) for column in zip(*counts, strict=True))
        out[_COMMENTS.format(room)] = f"{1000 * comments / code:.1f}"
    return out


def arguments(function: Function) -> int:
    """Arguments of a function without `self` and `cls`."""
    names = [a.arg for a in (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs)]
    return len([name for name in names if name not in ("self", "cls")])


def index_constants(function: Function) -> int:
    """Constants in capitals that stand in the index of a subscript, such as `state[at.PLACE + k]`."""
    total = 0
    for node in ast.walk(function):
        if isinstance(node, ast.Subscript):
            for part in ast.walk(node.slice):
                name = part.attr if isinstance(part, ast.Attribute) else part.id if isinstance(part, ast.Name) else ""
                total += bool(len(name) > 1 and _CONSTANT.match(name))
    return total


def imported(module: Module, names: set[str]) -> set[str]:
    """Modules of the package that a module imports anywhere, also inside functions and under TYPE_CHECKING."""
    found: set[str] = set()
    for node in module.nodes:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                found.add(inner if inner in names else node.module)
    return (found & names) - {module.name}


def circles(modules: list[Module]) -> int:
    """Groups of modules that import one another in a circle (strongly connected, Tarjan 1972)."""
    names = {m.name for m in modules}
    graph = {m.name: sorted(imported(m, names)) for m in modules}
    order: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    count = 0

    def visit(name: str) -> None:
        nonlocal count
        order[name] = low[name] = len(order)
        stack.append(name)
        for other in graph[name]:
            if other not in order:
                visit(other)
                low[name] = min(low[name], low[other])
            elif other in stack:
                low[name] = min(low[name], order[other])
        if low[name] == order[name]:
            group: list[str] = []
            while not group or group[-1] != name:
                group.append(stack.pop())
            count += len(group) > 1

    sys.setrecursionlimit(10_000)
    for name in graph:
        if name not in order:
            visit(name)
    return count


def entered(root: Path, way: str) -> list[str]:
    """Files below src/counterflex of which a function is called by one compensation.

    Args:
        root: Of the tree.
        way: "command" for all of `counterflex compensate`, "text" for program and cell file to compensated text alone.
    """
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"PYTHONPATH": str(root / "src")}
        command = [sys.executable, "-c", _ENTERED, way, str(Path(folder) / "out")]
        done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=True)
    return done.stdout.rsplit("entered", 1)[1].split()


def hand_written_words(root: Path) -> int:
    """Words of README.md and of docs without code and what programs write; a word holds a letter or digit."""
    folders, names = _GENERATED
    pages = [page for page in (root / "docs").rglob("*.md") if page.name not in names]
    pages = [page for page in pages if not set(page.relative_to(root).parts) & set(folders)]
    texts = [page.read_text(encoding="utf-8") for page in [root / "README.md", *pages]]
    words = " ".join(_NOT_PROSE.sub("", text) for text in texts if "<!-- written by:" not in text[:400]).split()
    return sum(any(map(str.isalnum, word)) for word in words)


def measure(root: Path, ways: dict[str, list[str]]) -> dict[str, str]:
    """All figures of one tree, by what they count; ``ways``: files entered, see :func:`entered`."""
    source = root / "src"
    modules = [Module.read(source, file) for file in sorted((source / "counterflex").rglob("*.py"))]
    own = [m for m in modules if not m.package]
    width = Counter(m.name.rsplit(".", 1)[0] for m in own)
    widest = max(width, key=lambda name: width[name])
    pairs = [(f, is_kernel) for m in modules for f, is_kernel in m.functions()]
    many = [is_kernel for f, is_kernel in pairs if arguments(f) > MANY_ARGUMENTS]
    step = [
        f for m in modules if m.name.startswith("counterflex.runtime") for f, is_kernel in m.functions() if is_kernel
    ]
    text = "\n".join(m.text for m in modules)
    outside = [f for f, is_kernel in pairs if not is_kernel]
    lengths = [m.text.count("\n") for m in own]
    full = [line.strip() for line in text.split("\n") if line.strip()]
    comments = sum(line.startswith("#") for line in full)
    classes = Counter(node.name for m in modules for node in m.nodes if isinstance(node, ast.ClassDef))

    def begun(*kinds: type[ast.AST]) -> int:
        nodes = (node for m in modules for node in m.nodes if isinstance(node, kinds))
        return sum(bool(_OPENING.match(ast.get_docstring(node) or "")) for node in nodes)  # type: ignore[arg-type]

    figures = {
        "modules": len(own),
        "lines": text.count("\n"),
        "median module": f"{median(lengths):g}",
        _BIG: sum(length > LONG_MODULE for length in lengths),
        "widest folder": f"{width[widest]} ({widest.removeprefix('counterflex.')})",
        "median folder": f"{median(width.values()):g}",
        _WIDE: sum(count > WIDE for count in width.values()),
        "files entered by one compensate": len(ways["command"]) if ways else "not run",
        "files entered from program to compensated text": len(ways["text"]) if ways else "not run",
        _PATHS: sum(complexity(f) > COMPLEX for f in outside),
        _LONG: sum(_code_lines(f) > LONG_STAGE for f in outside),
        _ARGUMENTS: many.count(False),
        f"functions with more than {MANY_ARGUMENTS} arguments in kernels": many.count(True),
        "nested functions": sum(nested(m) for m in modules),
        f"kernels of the loop above {LONG_STAGE} lines": sum(_code_lines(f) > LONG_STAGE for f in step),
        "circles": circles(modules),
        "dataclasses that only carry data": sum(only_data(m) for m in modules),
        "class names used twice or more": sum(count > 1 for count in classes.values()),
        "import lines": sum(import_lines(m) for m in modules),
        "import lines in 1000": f"{1000 * sum(import_lines(m) for m in modules) / len(full):.0f}",
        "comment lines in 1000": f"{1000 * comments / len(full):.1f}",
        "module docstrings that begin with What, How, Which": begun(ast.Module),
        "other docstrings that do": begun(ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef),
        "index constants in kernels": sum(index_constants(f) for f, is_kernel in pairs if is_kernel),
        "index constants in kernels of the loop": sum(index_constants(f) for f in step),
        "`Any`": len(re.findall(r"\bAny\b", text)),
        "`type: ignore`": text.count("type: ignore"),
        "words in hand-written docs": hand_written_words(root),
        "links of docs/index.md": (root / "docs" / "index.md").read_text(encoding="utf-8").count("]("),
        "imports under TYPE_CHECKING": len(re.findall(r"^if TYPE_CHECKING", text, re.MULTILINE)),
    }
    rooms = Counter(m.name.split(".")[1] for m in own if "." in m.name)
    lines: Counter[str] = Counter()
    for m in modules:
        if "." in m.name:
            lines[m.name.split(".")[1]] += m.text.count("\n")
    figures |= comments_in_1000(modules)
    figures |= {f"lines (modules) in `{room}`": f"{lines[room]} ({rooms[room]})" for room in sorted(rooms)}
    return {name: str(value) for name, value in figures.items()}


def _code_lines(function: Function) -> int:
    """Lines of a function's body after its docstring."""
    body = function.body[1:] if ast.get_docstring(function) is not None and len(function.body) > 1 else function.body
    return (body[-1].end_lineno or 0) - body[0].lineno + 1


def main() -> None:
    """Print the table."""
    gc.disable()  # syntax trees of 1400 modules stay
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--before", type=Path, help="a second tree to compare with, for example a git worktree")
    parser.add_argument(
        "--entered", action="store_true", help="run compensate and count the files it enters (some 40 s)"
    )
    parser.add_argument("--files", action="store_true", help="with --entered: print which files these are")
    parser.add_argument(
        "--hold",
        action="store_true",
        help="end with status 1 where a figure has passed its ceiling or fallen below its floor",
    )
    asked = parser.parse_args()
    if asked.files and not asked.entered:
        parser.error("--files lists what --entered counts: give both")

    def ways(root: Path) -> dict[str, list[str]]:
        return {way: entered(root, way) for way in ("command", "text")} if asked.entered else {}

    here = Path(__file__).resolve().parents[1]
    files = ways(here)
    if asked.files:
        for file in sorted({*files["command"], *files["text"]}):
            print(f"{'text   ' if file in files['text'] else 'command'} {file}")
    after = measure(here, files)
    if asked.hold:
        passed = [name for name, ceiling in CEILINGS.items() if float(after[name]) > ceiling]
        for name in passed:
            print(f"{name}: {after[name]}, at most {CEILINGS[name]}; see CONTRIBUTING.md, or lower what it counts")
        short = [name for name, floor in FLOORS.items() if float(after[name]) < floor]
        for name in short:
            print(f"{name}: {after[name]}, at least {FLOORS[name]:g}; see CONTRIBUTING.md, say why where it helps")
        sys.exit(bool(passed or short))
    if asked.before is None:
        print("| | now |\n|---|---|")
        print("\n".join(f"| {name} | {value} |" for name, value in after.items()))
        return
    root = asked.before.resolve()
    before = measure(root, ways(root))
    print("| | before | after |\n|---|---|---|")
    for name in dict.fromkeys([*before, *after]):
        print(f"| {name} | {before.get(name, '-')} | {after.get(name, '-')} |")


if __name__ == "__main__":
    main()

"""Order of the test files by nearness to one place of the source.

The nearest files are those whose text names the changed function and that import its module; then those that reach
the module over the fewest imports. Nothing is imported for that: the graph is read from the text.
"""

from __future__ import annotations

import ast
import functools
import importlib.util
import re
import sys
from collections import deque
from pathlib import Path

_FOLDERS = ("benchmarks", "tests/references", "tools")
"""Folders whose modules tests import besides the package."""
SLOW = 5
"""Steps of import that long files (listed in tests/conftest.py) and rooms that start processes are put further away."""


@functools.cache
def _imports(file: Path) -> frozenset[str]:
    """Modules of the package that a file imports anywhere, as dotted names below ``counterflex``; ``_lab`` as is."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("counterflex"):
            base = node.module.removeprefix("counterflex").lstrip(".")
            names.add(base)
            names.update(f"{base}.{one.name}".lstrip(".") for one in node.names)
        elif isinstance(node, ast.Import):
            names.update(
                one.name.removeprefix("counterflex.") for one in node.names if one.name.startswith("counterflex.")
            )
    return frozenset(names)


@functools.cache
def _importers(root: Path) -> dict[str, frozenset[str]]:
    """Importing modules of each module of ``src``."""
    importers: dict[str, set[str]] = {}
    for folder, package in ((root / "src", "counterflex"), (root / "lab", "counterflex_lab")):
        for file in (folder / package).rglob("*.py"):
            module = ".".join(file.relative_to(folder).with_suffix("").parts).removesuffix(".__init__")
            for name in _imports(file):
                importers.setdefault(name, set()).add(module.removeprefix("counterflex").lstrip("."))
    return {name: frozenset(modules) for name, modules in importers.items()}


@functools.cache
def _distances(root: Path, module: str) -> dict[str, int]:
    """Number of imports from each module down to one module, over all modules that reach it."""
    importers, distances, todo = _importers(root), {module: 0}, deque([module])
    while todo:
        name = todo.popleft()
        for above in importers.get(name, ()):
            if above not in distances:
                distances[above] = distances[name] + 1
                todo.append(above)
    return distances


def enclosing_name(text: str, offset: int) -> str:
    """Name of the innermost function or class around a place in a source text; empty at module level."""
    line, name, size = text.count("\n", 0, offset) + 1, "", len(text)
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            first = min([node.lineno, *(one.lineno for one in node.decorator_list)])
            last = node.end_lineno or first
            public = not node.name.startswith("__")
            if first <= line <= last and last - first < size and public:
                name, size = node.name, last - first
    return name


@functools.cache
def _is_installed(module: str) -> bool:
    return module in sys.modules or importlib.util.find_spec(module) is not None


def _can_run(root: Path, file: Path) -> bool:
    """False where a library that a test file imports is not installed: it would fail without any defect."""
    own = {path.stem for folder in (*_FOLDERS, file.parent) for path in (root / folder).iterdir()}
    tree = ast.parse(file.read_text(encoding="utf-8"))
    names = {one.name for node in tree.body if isinstance(node, ast.Import) for one in node.names}
    names |= {node.module for node in tree.body if isinstance(node, ast.ImportFrom) and node.module and not node.level}
    return all(top in own or top == "tests" or _is_installed(top) for top in {name.partition(".")[0] for name in names})


@functools.cache
def _texts(root: Path) -> dict[Path, str]:
    files = sorted((root / "tests").rglob("test_*.py"))
    return {file: file.read_text(encoding="utf-8") for file in files if _can_run(root, file)}


@functools.cache
def _long_files(root: Path) -> frozenset[Path]:
    """Test files that take longest, as ``tests/conftest.py`` lists them."""
    found = re.search(r"LONGEST = \((.*?)\)", (root / "tests" / "conftest.py").read_text(encoding="utf-8"), re.DOTALL)
    return frozenset(root / "tests" / name for name in re.findall(r'"([^"]+)"', found[1] if found else ""))


def nearest_tests(root: Path, source: str, name: str) -> tuple[list[str], list[str]]:
    """Return the test files that reach a source file, nearest first: those of its own room, those above.

    Args:
        root: Folder of the tree.
        source: Path of the source file below it.
        name: Name of the changed function or class, "" for none.
    """
    path = Path(source).with_suffix("")
    parts = ("lab", *path.parts[2:]) if path.parts[0] == "lab" else path.relative_to("src/counterflex").parts
    distances = _distances(root, ".".join(parts if parts[0] != "lab" else ("_lab", *parts[1:])))
    word = re.compile(rf"\b{re.escape(name.lstrip('_'))}\b") if name else None
    ranked = []
    for file, text in _texts(root).items():
        steps = min((distances[module] for module in _imports(file) if module in distances), default=None)
        if steps is None and not (word and word.search(text)):
            continue
        far = 9 if steps is None else steps
        here = file.relative_to(root / "tests").parts
        far += SLOW * (file in _long_files(root) or here[0] in ("tools", "outside", "lab"))
        same_folder = sum(one == other for one, other in zip(here[:-1], parts[:-1], strict=False))
        ranked.append((far - 2 * bool(word and word.search(text)), -same_folder, len(text), file, here[0] == parts[0]))
    ranked.sort(key=lambda row: row[:3])
    paths = [(row[3].relative_to(root).as_posix(), row[4]) for row in ranked]
    return [path for path, own in paths if own], [path for path, own in paths if not own]

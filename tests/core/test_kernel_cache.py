"""Compiled kernels are kept by all sources that they depend on: Python's own parser is the judge of what these are."""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterator
from pathlib import Path

import pytest

import counterflex
from counterflex.core import jit

PACKAGE = Path(counterflex.__file__).parent
KERNELS = sorted(path for path in PACKAGE.rglob("*.py") if "@kernel(" in path.read_text(encoding="utf-8"))


def named(path: Path) -> str:
    return ".".join(path.relative_to(PACKAGE).with_suffix("").parts)


@functools.cache
def imported(path: Path) -> set[str]:
    """Modules of the package that a module imports at its top, by the syntax tree."""
    found = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("counterflex."):
            base = (node.module or "").removeprefix("counterflex.")
            found |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            found |= {a.name.removeprefix("counterflex.") for a in node.names if a.name.startswith("counterflex.")}
    return {name for name in found if (PACKAGE / (name.replace(".", "/") + ".py")).is_file()}


def test_there_are_kernels() -> None:
    assert len(KERNELS) > 30


@pytest.mark.parametrize("path", KERNELS, ids=named)
def test_a_kernel_module_depends_on_all_that_it_imports(path: Path) -> None:
    todo, seen = [named(path)], set()
    while todo:
        name = todo.pop()
        if name not in seen:
            seen.add(name)
            todo.extend(imported(PACKAGE / (name.replace(".", "/") + ".py")))
    assert jit._closure(named(path)) == seen


def _forget() -> None:
    for known in (jit._source, jit._imported, jit._closure, jit._cache_root, jit.folder_name):
        known.cache_clear()


@pytest.fixture
def house(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A package of three modules: a imports b (over two lines), c stands alone."""
    (tmp_path / "room").mkdir()
    (tmp_path / "room" / "a.py").write_text("from counterflex.room.b import (\n    one,\n)\n")
    (tmp_path / "room" / "b.py").write_text("from counterflex.room import d\none = 1\n")
    (tmp_path / "room" / "c.py").write_text("two = 2\n")
    (tmp_path / "room" / "d.py").write_text("three = 3\n")
    monkeypatch.setattr(jit, "_PACKAGE", tmp_path)
    monkeypatch.setenv("COUNTERFLEX_CACHE", str(tmp_path / "cache"))
    _forget()
    yield tmp_path
    _forget()


@pytest.mark.parametrize(("changed", "moves"), [("a", True), ("b", True), ("d", True), ("c", False)])
def test_the_folder_changes_with_what_a_kernel_depends_on_and_with_nothing_else(
    changed: str, moves: bool, house: Path
) -> None:
    before = jit.cache_folder("counterflex.room.a")
    file = house / "room" / f"{changed}.py"
    file.write_text(file.read_text() + "# another\n")
    _forget()
    assert (jit.cache_folder("counterflex.room.a") != before) == moves

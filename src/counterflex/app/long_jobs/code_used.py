"""Which code of this program a step rests on, as hashes: a result is as old as the code that made it.

Followed are the imports of a module, those inside functions included, through all of this package but the rooms that
only show things and modules that begin with importing from these. Comments, docstrings and layout do not count.
Tables that come with a room (catalogues) do.
"""

from __future__ import annotations

import ast
import hashlib
import json
import tomllib
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Final

import counterflex

_ROOT: Final = Path(counterflex.__file__).parent
_PACKAGE: Final = "counterflex"
_SHOW: Final = ("cli", "report")
"""Rooms that show results and make none."""
_JOBS: Final = "app"
"""The room whose tables are examples, given to jobs as files."""


@cache
def code_of(*modules: str, without: tuple[str, ...] = ()) -> dict[str, str]:
    """Hashes of the code that modules rest on, by room of the package.

    Args:
        modules: Full names, ``counterflex.app.compensation.compensate``.
        without: Rooms that are imported but do not take part: what reads a cell file knows the settings of every table.

    Returns:
        SHA-256, 16 hexadecimal digits, by room; the empty name is the package itself.
    """
    rooms: dict[str, list[str]] = {}
    for name in sorted(reached(*modules, without=without)):
        rooms.setdefault(_room(name), []).append(_code(name))
    for room, parts in rooms.items():
        if room not in ("", _JOBS):
            parts += [_content(file) for file in _tables(_ROOT / room)]
    return {room: hashlib.sha256("".join(parts).encode()).hexdigest()[:16] for room, parts in sorted(rooms.items())}


def reached(*modules: str, without: tuple[str, ...] = ()) -> set[str]:
    """Names of the modules of this package that some modules import, themselves included.

    Args:
        modules: Full names; they count even where they show things.
        without: Rooms that are not entered.
    """
    found: set[str] = set()
    waiting = [name for name in modules if _file(name) is not None]
    while waiting:
        name = waiting.pop()
        if name in found or _room(name) in without or (name not in modules and _shows(name)):
            continue
        found.add(name)
        waiting += [other for other in _imports(ast.walk(_tree(name))) if _file(other) is not None]
    return found


def toml_parts(file: Path) -> dict[str, str]:
    """SHA-256, 16 hexadecimal digits, of the meaning of every table of a TOML file; keys outside tables under ``""``.

    Args:
        file: Of valid TOML.

    Raises:
        OSError: It cannot be read.
        ValueError: It is not TOML.
    """
    data = tomllib.loads(file.read_text(encoding="utf-8"))
    tables = {key: value for key, value in data.items() if isinstance(value, dict | list)}
    parts = {key: _hashed(value) for key, value in sorted(tables.items())}
    return {"": _hashed({key: value for key, value in data.items() if key not in tables}), **parts}


def _hashed(value: object) -> str:
    text = json.dumps(value, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _room(name: str) -> str:
    inside = name.split(".")[1:]
    return inside[0] if inside and (_ROOT / inside[0]).is_dir() else ""


@cache
def _shows(name: str) -> bool:
    return _room(name) in _SHOW or any(_room(other) in _SHOW for other in _imports(_tree(name).body))


@cache
def _file(name: str) -> Path | None:
    """Source of a module of this package, None where it is none."""
    first, *rest = name.split(".")
    if first != _PACKAGE:
        return None
    place = _ROOT.joinpath(*rest)
    for file in (place.with_suffix(".py"), place / "__init__.py"):
        if rest and file.is_file():
            return file
    return None


@cache
def _tree(name: str) -> ast.Module:
    file = _file(name)
    tree = ast.parse("" if file is None else file.read_bytes())
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            body = node.body
            if body and isinstance(body[0], ast.Expr) and isinstance(body[0].value, ast.Constant):
                node.body = body[1:]
    return tree


def _code(name: str) -> str:
    return hashlib.sha256(f"{name}\n{ast.dump(_tree(name))}".encode()).hexdigest()


def _imports(nodes: Iterable[ast.AST]) -> Iterator[str]:
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module is not None:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _tables(room: Path) -> list[Path]:
    return sorted(
        file for file in room.rglob("*") if file.is_file() and file.suffix != ".py" and "__pycache__" not in file.parts
    )


def _content(file: Path) -> str:
    name = file.relative_to(_ROOT).as_posix()
    what = json.dumps(toml_parts(file)) if file.suffix == ".toml" else hashlib.sha256(file.read_bytes()).hexdigest()
    return f"{name}\n{what}\n"

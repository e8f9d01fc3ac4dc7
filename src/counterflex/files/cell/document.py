"""A cell file as a document: read, changed and written back with comments, order and everything else kept."""

from __future__ import annotations

import os
from collections.abc import MutableMapping
from pathlib import Path
from typing import Any, Final

import tomlkit

from counterflex.core import file_content

FILES: Final = (("robot", "urdf"), ("part", "stock", "stl"), ("part", "stock", "result"))
"""Keys under which a cell file names another file."""
Doc = MutableMapping[str, Any]


def parsed(path: Path) -> tomlkit.TOMLDocument:
    """A cell file with its comments and order."""
    text = file_content.text(path)
    with file_content.readable(path, "TOML"):
        return tomlkit.parse(text)


def new_table() -> Any:
    """An empty table with an empty line above it."""
    table = tomlkit.table()
    table.trivia.indent = "\n"
    return table


def table_of(doc: Doc, key: str) -> Doc:
    """The table with a key; made when there is none."""
    if key not in doc:
        doc[key] = new_table()
    result: Doc = doc[key]
    return result


def row_of(parent: Doc, key: str, by: str, value: str | int) -> Doc:
    """The row of a list of tables whose key ``by`` has a value; added when there is none."""
    if key not in parent:
        parent[key] = tomlkit.aot()
    rows = parent[key]
    for row in rows:
        if row[by] == value:
            result: Doc = row
            return result
    inline = isinstance(rows, tomlkit.items.Array)
    new = tomlkit.inline_table() if inline else new_table()
    new[by] = value
    rows.append(new)
    made: Doc = rows[-1]
    return made


def move_paths(doc: Doc, here: Path, there: Path) -> None:
    """Make relative paths of files relative to another folder."""
    for *keys, last in FILES:
        table: Any = doc
        for key in keys:
            table = table.get(key, {})
        named = table.get(last)
        if named is not None and not Path(str(named)).is_absolute():
            table[last] = Path(os.path.relpath(here / str(named), there)).as_posix()

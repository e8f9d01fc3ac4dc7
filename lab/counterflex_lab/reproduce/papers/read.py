"""The papers as data: printed figures, assumptions, experiments, what was left undone; results that were stored."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any, Final

from counterflex.core.errors import FileFormatError
from counterflex_lab.reproduce.papers.row import Row, rule_of

PAPERS: Final = ("denkena2015", "haehn2020", "berger2013", "mandiola2023")
_ROOT: Final = "counterflex_lab.reproduce.papers"
_KEYS: Final = {"name", "place", "what", "printed", "shown", "unit", "rule", "cannot", "differs", "note", "assumed"}


@dataclass(frozen=True)
class Paper:
    """One paper."""

    name: str  # of PAPERS
    title: str  # authors and year
    source: str  # full reference
    subject: str  # what it is about
    assumptions: Mapping[str, str]  # what the paper does not say and what was assumed, by key
    experiments: Mapping[str, str]  # what each experiment is whose results its rows are taken from, by name
    rows: tuple[Row, ...]  # its figures
    left_open: tuple[tuple[str, str], ...]  # what it left undone, and what counterflex does about it


@cache
def paper(name: str) -> Paper:
    """A paper by its name.

    Args:
        name: Of :data:`PAPERS`.

    Raises:
        FileFormatError: Its data file contradicts itself.
    """
    data = tomllib.loads((resources.files(_ROOT) / "data" / f"{name}.toml").read_text(encoding="utf-8"))
    rows = tuple(_row(table, data, name) for table in data["row"])
    if len({row.name for row in rows}) != len(rows):
        raise FileFormatError("two rows have one name", where=name)
    return Paper(
        name=name,
        title=data["title"],
        source=data["source"],
        subject=data["subject"],
        assumptions=data["assumptions"],
        experiments=data["experiments"],
        rows=rows,
        left_open=tuple((item["what"], item["here"]) for item in data["undone"]),
    )


def _row(table: Mapping[str, Any], data: Mapping[str, Any], name: str) -> Row:
    where = f"{name}, row {table['name']}"
    if unknown := set(table) - _KEYS - {"stored"}:
        raise FileFormatError("unknown key", where=where, value=", ".join(sorted(unknown)))
    if ("rule" in table) == ("cannot" in table) or ("rule" in table) != ("differs" in table):
        raise FileFormatError("a row has a rule and differs, or cannot", where=where)
    assumed, stored = tuple(table.get("assumed", ())), table.get("stored", "")
    for key in assumed:
        if key not in data["assumptions"]:
            raise FileFormatError("no such assumption", where=where, value=key)
    if stored and stored not in data["experiments"]:
        raise FileFormatError("no such experiment", where=where, value=stored)
    return Row(
        name=table["name"],
        place=table["place"],
        what=table["what"],
        printed=table.get("shown", table["printed"]),
        unit=table.get("unit", ""),
        rule=rule_of(table["rule"], table["printed"], where) if "rule" in table else None,
        reason=table.get("cannot", table.get("differs", "")),
        note=table.get("note", ""),
        assumed=assumed,
        stored=stored,
    )


def stored(name: str) -> dict[str, Any] | None:
    """Stored results of an experiment: command, commit, version and results; None where nothing is.

    Args:
        name: Of the experiment.
    """
    file = resources.files(_ROOT) / "stored" / f"{name}.json"
    if not file.is_file():
        return None
    data: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return data

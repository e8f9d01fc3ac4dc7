"""Identifications one after the other: what was found when, and what changed."""

from __future__ import annotations

import math
import shutil
from pathlib import Path
from typing import Any, Final

from counterflex.core import atomic, held
from counterflex.core.errors import FileFormatError
from counterflex.core.result import Parts, ShownTable, Summary
from counterflex.files.identification_file import ArchivedRun, keep_inputs, run_name, runs_below

SIGNIFICANT: Final = 3.0
"""A change of so many standard deviations of the difference is marked: 3 in 1000 are by chance."""
SHOWN: Final = 4
"""Latest runs whose values stand side by side."""


def keep(
    archive: Path, staging: Path, cell: Path, manifests: list[Path], result: dict[str, Any], *, taken: Path
) -> Path:
    """Keep a run: results and inputs in a folder of its own.

    ``result``: Content of ``result.json``. ``taken``: Archive in which the run will end up; its name is new there.
    """
    with held.alone(archive / "run"):  # two runs of one second get two names
        folder = archive / run_name(result["date"], result["recipe"], taken)
        with atomic.atomic_folder(folder) as inside:
            for path in sorted(staging.iterdir()):
                if path.is_file():
                    shutil.copyfile(path, inside / path.name)
            keep_inputs(inside, cell, manifests)
    return folder


class IdentificationHistory(Summary):
    """Identifications below a folder, and the values of the latest beside each other."""

    def _shown(self) -> Parts:
        yield self.rows(
            "runs",
            "Identifications",
            "date | recipe | cell | data | rows | figure | value:D4 | before=nominal:D4 | outliers | folder",
        )
        for name, folders in self["not_compared"].items():
            yield f"note: {name}: not compared, of another cell than the latest: {', '.join(folders)}"
        for name, rows in self["compared"].items():
            last = max(len(row["values"]) for row in rows) - 1
            values = "".join(
                f"{head}={{values[{i}][value]:D5}} ± {{values[{i}][sigma]:D2}} | "
                for i, head in enumerate([*(f"{back} before" for back in range(last, 0, -1)), "latest"])
            )
            yield ShownTable.of(
                f"{name}: values of the latest runs, with standard deviations",
                f"parameter | unit | {values}change / its sd=change_in_sigma:+.1f | =mark",
                [row | {"mark": "CHANGED" if row["significant"] else ""} for row in rows],
                "CHANGED: latest and the one before differ by more than 3 standard deviations of their difference.",
            )


def history(folder: Path, recipe: str | None = None) -> IdentificationHistory:
    """All runs below a folder, and per recipe the values of the latest beside each other.

    Returns:
        ``runs``: one row each; ``compared``: per recipe with two runs or more, one row for each parameter, runs of the
        cell of the latest run only; ``not_compared``: folders of the other cells' runs.

    Raises:
        FileFormatError: The folder does not exist or holds no identification.
    """
    runs = [run for run in runs_below(folder) if recipe in (None, run.result["recipe"])]
    if not runs:
        raise FileFormatError(
            "no identification is kept here",
            where=str(folder),
            hint="Every identification is kept in the folder archive of its --out, or in its --archive",
        )
    names = list(dict.fromkeys(run.result["recipe"] for run in runs))
    compared: dict[str, Any] = {}
    others: dict[str, list[str]] = {}
    for name in names:
        own = [run for run in runs if run.result["recipe"] == name]
        alike = [run for run in own if run.result["cell"] == own[-1].result["cell"]]
        if len(alike) > 1:
            compared[name] = _compare(alike[-SHOWN:])
        if len(alike) < len(own):
            others[name] = [run.folder.relative_to(folder).as_posix() for run in own if run not in alike]
    lines = [run.line(folder) for run in runs]
    return IdentificationHistory(runs=lines, compared=compared, not_compared=others)


def _compare(runs: list[ArchivedRun]) -> list[dict[str, Any]]:
    tables = [
        {(name, p["name"]): p for name, fit in run.result["fits"].items() for p in fit["parameters"] if p["free"]}
        for run in runs
    ]
    rows = []
    for key, last in tables[-1].items():
        before = tables[-2].get(key)
        change = None if before is None else _change(before, last)
        rows.append(
            {
                "parameter": last["label"],
                "unit": last["unit"],
                "values": [
                    None if key not in t else {k: t[key][k] for k in ("value", "sigma", "low", "high", "seen")}
                    for t in tables
                ],
                "change_in_sigma": change,
                "significant": change is not None and abs(change) >= SIGNIFICANT,
            }
        )
    return rows


def _change(before: dict[str, Any], last: dict[str, Any]) -> float | None:
    """Difference over its standard deviation, the two taken as independent; of logarithmic values, of the logarithm."""
    if before["unit"] != last["unit"] or "prior" in (before["seen"], last["seen"]):
        return None
    a, b, sa, sb = (float(row[key]) for key in ("value", "sigma") for row in (before, last))
    if last["log"] and a > 0.0 and b > 0.0:
        a, b, sa, sb = math.log(a), math.log(b), sa / a, sb / b
    spread = math.hypot(sa, sb)
    return None if spread == 0.0 else round((b - a) / spread, 2)

"""The job ``identify``: measured data in, a new cell file, a result and a report out."""

from __future__ import annotations

import datetime
import importlib.metadata
import math
import platform
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from counterflex import __version__
from counterflex.app.identification.cell_model import Setting, in_model_angles, model_of, read_settings, starting_cell
from counterflex.app.identification.history import keep
from counterflex.app.identification.propose import propose as propose
from counterflex.core import atomic
from counterflex.core.errors import CounterflexError, ModelError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.measured import IdentifiedTable, IdentifiedValue
from counterflex.files.cell.update import check_update, updated_text
from counterflex.files.dataset.reader import read_dataset
from counterflex.files.identification_file import (
    figure_rows,
    fit_table,
    parameter_rows,
    write_identification,
)
from counterflex.files.shop_unit import unit_of_name
from counterflex.identify.data.changes import TableValues
from counterflex.identify.data.data_checks import joined, joined_by_rows, require_disjoint
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.recipe import Figure, Identification, Recipe
from counterflex.identify.recipes import RECIPES
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.intervals import agreement, contradicted

Outcome = Literal["better", "confirmed"]
GAIN: Final = 0.02
"""Share by which the error on data not used has to fall for values that agree with the former ones to replace them."""
_MOST_NAMED: Final = 5
_PLACES: Final = ("tracker",)
"""Tables of where something stands during these measurements: there is no former value to keep."""


def judged(result: Identification, *, separate: bool) -> tuple[Identification, Outcome]:
    """Decide what goes into the cell file.

    ``separate``: The error on data not used comes from data of their own (``--holdout``).

    Returns:
        The result with what is said about it, and ``better`` (its values go into the cell file) or ``confirmed`` (the
        data agree with the cell file within noise: the values there stay, with the standard deviations found).

    Raises:
        ModelError: The values predict data not used worse than the cell file does, by more than noise, or there is no
            such figure.
    """
    first = _first(result)
    against = [line for fit in result.fits.values() for line in _against(fit)]
    result = replace(result, remarks=(*against, *result.remarks))
    if first.nominal is None:
        return result, "better"
    compared = f"{first.text}: {first.value:.4g} {unit_of_name(first.name)}, {first.nominal:.4g} with the former values"
    if first.value <= (1.0 - GAIN) * first.nominal:
        return result, "better"
    match = agreement(result.fits.values())
    nothing = f"No gain on {'the data of --holdout' if separate else 'data not used'} ({compared})."
    if match.agrees and match.directions and first.value <= match.growth * first.nominal:
        remark = (
            f"Confirmed: the data agree with the cell file within noise (probability of a larger difference "
            f"{match.chance:.2g}; {compared}). Its values stay; their standard deviations are those found now."
        )
        return confirmed(replace(result, remarks=(remark, *result.remarks))), "confirmed"
    if first.value <= first.nominal:
        return replace(result, remarks=(nothing, *result.remarks)), "better"
    raise _worse(result, first, nothing)


def confirmed(result: Identification) -> Identification:
    """The result with the former values in place of the fitted ones.

    The standard deviation of a former value is ``hypot(sigma, fitted - former)``: it holds the distance of both.
    """
    fits = {}
    for name, fit in result.fits.items():
        known = np.array([p.free and p.has_prior for p in fit.parameters], dtype=np.bool_)
        former = np.where(known, fit.parameters.nominal, fit.values)
        fits[name] = replace(fit, values=former, sigma=np.hypot(fit.sigma, fit.values - former))
    placed = tuple(c for c in result.changes if isinstance(c, TableValues) and c.table in _PLACES)
    return replace(result, fits=fits, changes=placed)


def _first(result: Identification) -> Figure:
    if not result.headline:
        raise ModelError("the recipe gave no error on data not used", where=result.recipe)
    first = result.headline[0]
    if not math.isfinite(first.value):
        raise ModelError("the error on data not used is not a number", where=result.recipe, value=first.value)
    return first


def _against(fit: Fit) -> list[str]:
    """A sentence where the data contradict the priors."""
    off = contradicted(fit)
    if not off:
        return []
    named = ", ".join(f"{name} ({distance:.1f})" for name, distance in off[:_MOST_NAMED])
    more = f" and {len(off) - _MOST_NAMED} more" if len(off) > _MOST_NAMED else ""
    return [
        f"The data contradict what was known before, in standard deviations of that: {named}{more}. Check units, signs "
        "and columns; if the data are right, the former values or their standard deviations were wrong."
    ]


def _worse(result: Identification, first: Figure, nothing: str) -> ModelError:
    lines = "; ".join(
        f"{f.text}: {f.value:.4g}" + ("" if f.nominal is None else f", before {f.nominal:.4g}") for f in result.headline
    )
    return ModelError(
        "the identified values predict data not used worse than the cell file does; nothing was written",
        where=result.recipe,
        value=f"{first.name} = {first.value:.4g}",
        limit=f"at most {first.nominal:.4g} (with the values of the cell file)",
        hint=f"{nothing} {lines}. Measure more or better, or check units, signs and frames in the manifest",
    )


CELL: Final = "cell.toml"
RESULT: Final = "result.json"
REPORT: Final = "report.html"
ARCHIVE: Final = "archive"
READING, FINDING, WRITING = "reading the data", "identifying", "writing the results"
WORK: Final = {READING: 0.5, FINDING: 10.0, WRITING: 1.0}
"""Parts of the work with what they cost for some hundred measurements (``tools/measure_progress.py``)."""
FEW: Final = 10
"""Measurements (groups of rows) below which an error on data not used says little."""
_UNSEEN: Final = ("holdout_", "region_", "file_")
"""What the names of figures of the data not used begin with; all others are values and no errors."""

_GROWN: Final = 1.02  # Growth of an error on data not used below which it is called the same
_LIBRARIES: Final = ("numpy", "scipy", "numba")


@dataclass(frozen=True, eq=False)
class IdentificationTask:
    """Recipe, cell and data of an identification."""

    recipe: Recipe
    cell: Cell
    data: tuple[Dataset, ...]  # Datasets that parameters are fitted to
    holdout: tuple[Dataset, ...]  # Datasets that are only predicted; empty for k folds of ``data``
    settings: Mapping[str, Any]  # Of the recipe, with ``seed``
    remark: str = ""  # What the cell begins with besides what its file says; may be empty

    def provenance(self, result: Identification, date: str, outcome: Outcome = "better") -> IdentifiedTable:
        """The entry ``[[identified]]`` of the cell file."""
        head = result.headline[0]
        unit = unit_of_name(head.name)
        before = "" if head.nominal is None else f" ({head.nominal:.4g} before)"
        how = "a separate file" if self.holdout else "folds of the data"
        prefix = "confirmed, " if outcome == "confirmed" else ""
        values = tuple(
            IdentifiedValue(
                name=row["name"], value=row["value"], sigma=row["sigma"], unit=row["unit"], seen=row["seen"]
            )
            for fit in result.fits.values()
            for row in parameter_rows(fit)
            if row["free"]
        )
        return IdentifiedTable(
            recipe=self.recipe.name,
            date=date,
            data=tuple(Path(d.where).name for d in self.data),
            data_sha256=tuple(d.fingerprint for d in self.data),
            counterflex=__version__,
            holdout=f"{prefix}{head.text}: {head.value:.4g} {unit}".rstrip() + f"{before}, on {how}",
            values=values,
        )

    def result(self, result: Identification, date: str, outcome: Outcome = "better") -> dict[str, Any]:
        """Everything that was found, as plain values."""
        place = self.place_of(result)
        return {
            "recipe": self.recipe.name,
            "title": self.recipe.title,
            "outcome": outcome,
            "date": date,
            "cell": self.cell.name,
            "cell_file": self.cell.path.name,
            "data": _described(self.data),
            "holdout_data": _described(self.holdout),
            "holdout": "separate data" if self.holdout else "folds of the data",
            "headline": figure_rows(result.headline),
            "figures": figure_rows(result.figures),
            "fits": {key: fit_table(fit, place) for key, fit in result.fits.items()},
            "remarks": [*self._few(), *grown(result), *result.remarks],
            "settings": dict(self.settings),
            "versions": {
                "counterflex": __version__,
                "Python": platform.python_version(),
                **{library: importlib.metadata.version(library) for library in _LIBRARIES},
            },
        }

    def _few(self) -> list[str]:
        """A warning where the error on data not used rests on few measurements."""
        count = sum(len(np.unique(d.group)) for d in self.holdout or self.data)
        if count >= FEW or any("time_s" in d.channels for d in self.data):
            return []
        return [f"The error on data not used rests on {count} measurements only and says little; measure more"]

    def place_of(self, result: Identification) -> Any:
        """Place of a row of a block of residuals in the files."""

        def place(block: str, row: int) -> str:
            named = [d for d in self.data if d.name == block]
            counts = {len(r) for fit in result.fits.values() for r in fit.residuals}
            alike = named or [d for d in self.data if len(d) in counts]
            if len(alike) == 1 and row < len(alike[0]):
                return alike[0].place(row)
            return f"{block}: row {row + 1}"

        return place


def prepare(
    name: str,
    data: Sequence[str | Path],
    cell: str | Path,
    *,
    holdout: Sequence[str | Path] = (),
    settings: Mapping[str, Setting] | None = None,
    seed: int = 0,
) -> IdentificationTask:
    """Read everything and check that it fits together.

    ``settings``: Of the recipe, as text or as values. Raises FileFormatError: a file cannot be used. Raises InputError:
    unknown recipe or setting, a dataset of a kind that the recipe does not use, a measurement twice.
    """
    recipe: Recipe = RECIPES[name]
    chosen = read_settings(recipe, settings or {}, seed)
    known, chosen, remark = starting_cell(cell, recipe, chosen)
    fitted, unseen = _with_unique_names(*(tuple(read_dataset(path) for path in paths) for paths in (data, holdout)))
    fitted, unseen = (tuple(in_model_angles(one, known.robot.axes) for one in part) for part in (fitted, unseen))
    recipe.require_usable((*fitted, *unseen))
    require_disjoint(fitted, unseen)
    return IdentificationTask(recipe, known, joined_by_rows(joined(fitted)), unseen, chosen, remark)


def _with_unique_names(*parts: tuple[Dataset, ...]) -> tuple[tuple[Dataset, ...], ...]:
    """Datasets whose names differ: an outlier is named by its own file."""
    count = Counter(dataset.name for part in parts for dataset in part)
    return tuple(
        tuple(
            replace(dataset, name=f"{dataset.name} ({Path(dataset.where).name})")
            if count[dataset.name] > 1
            else dataset
            for dataset in part
        )
        for part in parts
    )


def run(
    name: str,
    data: Sequence[str | Path],
    cell: str | Path,
    out: str | Path,
    *,
    holdout: Sequence[str | Path] = (),
    settings: Mapping[str, Setting] | None = None,
    seed: int = 0,
    archive: str | Path | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Do the job on files.

    Writes ``cell.toml`` (the cell file with what was found, everything else as it was), ``result.json`` and
    ``report.html``; all of them or none. The run is kept in the archive besides.

    ``settings``: Of the recipe, as text or as values. ``archive``: Folder that keeps every run; None is ``archive`` in
    ``out``. ``progress``: Progress callback, fraction 0 to 1. Returns the result, as in ``result.json``. Raises
    ModelError: the result is worse than the cell file on data not used, by more than noise; nothing is written.
    """
    begin = time.perf_counter()
    parts = in_parts(progress, WORK)
    parts[READING](0.0)
    task = prepare(name, data, cell, holdout=holdout, settings=settings, seed=seed)
    parts[READING](1.0)
    folder = Path(out)
    with atomic.atomic_folder(folder) as staging:
        identified = task.recipe.identify(model_of(task.cell), task.data, task.holdout, task.settings, parts[FINDING])
        parts[WRITING](0.0)
        identified = replace(identified, remarks=(*identified.remarks, *([task.remark] if task.remark else [])))
        identified, outcome = judged(identified, separate=bool(task.holdout))
        date = datetime.datetime.now(tz=datetime.UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
        entry = task.provenance(identified, date, outcome)
        text = updated_text(task.cell, identified.changes, entry, folder)
        result = task.result(identified, date, outcome)
        result["seconds"] = round(time.perf_counter() - begin, 3)
        _check_cell(text, folder, staging)
        atomic.write_text(staging / CELL, text)
        write_identification(staging / RESULT, result)
        from counterflex.report.identification_page import identification_page
        from counterflex.report.page import write_page

        write_page(identification_page(identified, result), staging / REPORT)
        keep(
            staging / ARCHIVE if archive is None else Path(archive),
            staging,
            task.cell.path,
            [Path(dataset.where) for dataset in (*task.data, *task.holdout)],
            result,
            taken=folder / ARCHIVE if archive is None else Path(archive),
        )
        parts[WRITING](1.0)
    return result


def _described(datasets: Sequence[Dataset]) -> list[dict[str, Any]]:
    return [
        {
            "manifest": Path(d.where).name,
            "name": d.name,
            "kind": d.kind,
            "rows": len(d),
            "groups": len(np.unique(d.group)),
            "sha256": d.fingerprint,
            "channels": {
                key: {"source": c.source, "sigma": None if c.sigma is None else np.median(c.sigma, axis=0).tolist()}
                for key, c in d.channels.items()
            },
            "settings": dict(d.settings),
        }
        for d in datasets
    ]


def grown(result: Identification) -> list[str]:
    """A warning for each figure of the data not used that has become worse, the largest error first of all."""
    return [
        f"Warning: {figure.text} grows from {figure.nominal:.3g} to {figure.value:.3g} {unit_of_name(figure.name)}: "
        "the values fit most of the data and not all; look for what differs there (play, another posture, a bad row)."
        for figure in (*result.headline, *result.figures)
        if figure.name.startswith(_UNSEEN)
        and "explained" not in figure.name.split("_")  # a share that is better when larger
        and figure.nominal is not None
        and figure.value > _GROWN * figure.nominal
        and unit_of_name(figure.name)
    ]


def _check_cell(text: str, folder: Path, staging: Path) -> None:
    """Read the new cell file back before anything is kept, from where it will lie."""
    location = folder if folder.exists() else staging
    trial = location / f".{CELL}.trial.toml"
    try:
        check_update(text, trial)
    except CounterflexError as fault:
        raise ModelError(
            "what was identified is no possible cell",
            where=CELL,
            value=str(fault).replace(str(trial), CELL),
            hint="Nothing was written. Check units, signs and frames in the manifest",
        ) from fault
    finally:
        trial.unlink(missing_ok=True)

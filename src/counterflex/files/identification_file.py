"""``result.json`` of an identification (``counterflex-identification``, version 1): everything that was found."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Final

import numpy as np
import tomlkit

from counterflex.core import atomic, file_content
from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, FileFormatError
from counterflex.files.dataset.manifest import read_manifest
from counterflex.files.schema import check_header
from counterflex.files.shop_unit import shop
from counterflex.identify.recipe import Figure
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.intervals import covariance_si, intervals
from counterflex.identify.solver.parameters import Parameter

FORMAT: Final = "counterflex-identification"
VERSION: Final = 1
Place = Callable[[str, int], str]
"""Where a row of a block stands: ``data.csv:12``."""


def parameter_rows(fit: Fit) -> list[dict[str, Any]]:
    """One row for each parameter: value, standard deviation and 95 % interval in its shop unit, prior, how it is seen.

    Intervals are those of :func:`counterflex.identify.solver.intervals.intervals`; held parameters have none.
    """
    rows = []
    ends = intervals(fit)
    for place, (item, value, sigma, seen) in enumerate(
        zip(fit.parameters, fit.values, fit.sigma, fit.seen, strict=True)
    ):
        unit, factor = shop(item.unit)
        low, high = ends[place]
        rows.append(
            {
                "name": item.name,
                "label": item.label or item.name,
                "unit": unit,
                "value": _round(value / factor),
                "sigma": _round(sigma / factor),
                "low": _round(low / factor) if seen != "held" else None,
                "high": _round(high / factor) if seen != "held" else None,
                "nominal": _round(item.nominal / factor),
                "prior_sigma": _round(_prior(item) / factor) if item.has_prior and item.free else None,
                "seen": seen,
                "free": bool(fit.parameters.free[place]),
                "log": item.log,
            }
        )
    return rows


def _prior(item: Parameter) -> float:
    return item.prior_sigma * item.nominal if item.log else item.prior_sigma


def fit_table(fit: Fit, place: Place) -> dict[str, Any]:
    """A fit as plain values."""
    covariance = covariance_shop(fit)
    return {
        "parameters": parameter_rows(fit),
        "covariance": {
            "names": [fit.parameters.names[i] for i in fit.free_index],
            "values": [[_round(v) for v in row] for row in covariance],
        },
        "rank": fit.rank,
        "free": len(fit.free_index),
        "condition": _round(fit.condition),
        "hidden": list(fit.hidden),
        "chi2_reduced": _round(fit.chi2_reduced),
        "dof": _round(fit.dof),
        "sigma_factors": [_round(s) for s in fit.sigma_factors],
        "rows": [len(r) for r in fit.residuals],
        "outliers": [
            {
                "where": place(o.block, o.row),
                "block": o.block,
                "row": o.row,
                "size": _round(o.size),
                "weight": _round(o.weight),
            }
            for o in fit.outliers
        ],
        "reason": fit.reason,
        "evaluations": fit.evaluations,
        "converged": fit.converged,
        "at_bound": list(fit.at_bound),
    }


def covariance_shop(fit: Fit) -> Float:
    """(f, f) covariance of the free parameters in their shop units."""
    factors = np.array([shop(fit.parameters.items[i].unit)[1] for i in fit.free_index])
    out: Float = covariance_si(fit)[np.ix_(fit.free_index, fit.free_index)] / np.outer(factors, factors)
    return out


def figure_rows(figures: Sequence[Figure]) -> list[dict[str, Any]]:
    """Figures as plain values."""
    return [
        {
            "name": f.name,
            "text": f.text,
            "value": _round(f.value),
            "nominal": None if f.nominal is None else _round(f.nominal),
            "limit": None if f.limit is None else _round(f.limit),
        }
        for f in figures
    ]


def write_identification(path: Path, data: Mapping[str, Any]) -> None:
    """Write a result; format and version are put first, numbers that are not finite become null."""
    text = json.dumps({"format": FORMAT, "version": VERSION, **plain_json(data)}, indent=1, allow_nan=False)
    atomic.write_text(path, text + "\n")


def read_identification(path: Path) -> dict[str, Any]:
    """Read a result. Raises FileFormatError: missing, not JSON, another format, or newer than this program."""
    data = file_content.json_value(path)
    if not isinstance(data, dict):
        raise FileFormatError(f"not a {FORMAT} file", where=str(path))
    check_header(data, kind=FORMAT, version=VERSION, where=str(path))
    return data


def _round(value: float) -> float:
    return float(f"{float(value):.8g}")


def plain_json(value: Any) -> Any:
    """A value as JSON has it: no arrays, tuples as lists, numbers that are not finite as None."""
    if isinstance(value, Mapping):
        return {str(key): plain_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain_json(item) for item in value]
    if isinstance(value, np.generic | np.ndarray):
        return plain_json(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


RESULT: Final = "result.json"
INPUTS: Final = "inputs"


@dataclass(frozen=True, eq=False)
class ArchivedRun:
    """One identification of an archive."""

    folder: Path  # Where it is kept
    result: dict[str, Any]  # Content of its ``result.json``

    def line(self, folder: Path) -> dict[str, Any]:
        """Row of the printed history."""
        result = self.result
        head = result["headline"][0]
        return {
            "date": result["date"],
            "recipe": result["recipe"],
            "cell": result["cell"],
            "data": [d["manifest"] for d in result["data"]],
            "rows": sum(d["rows"] for d in result["data"]),
            "figure": head["name"],
            "value": head["value"],
            "nominal": head["nominal"],
            "outliers": sum(len(fit["outliers"]) for fit in result["fits"].values()),
            "counterflex": result["versions"]["counterflex"],
            "folder": self.folder.relative_to(folder).as_posix(),
        }


def run_name(date: str, recipe: str, taken: Path) -> str:
    """Name of the folder of a run: date, time and recipe, numbered where there is one already.

    Args:
        date: ``2026-11-21 22:31:05 UTC``.
        taken: Archive in which the name must be new.
    """
    stem = f"{date.removesuffix(' UTC').replace(' ', '_').replace(':', '')}_{recipe}"
    name, number = stem, 1
    while (taken / name).exists():
        number += 1
        name = f"{stem}_{number:02d}"
    return name


def keep_inputs(folder: Path, cell: Path, manifests: Sequence[Path]) -> None:
    """Copy the cell file and the datasets of a run into its folder.

    Args:
        folder: Of the run; gets ``inputs/cell.toml`` and ``inputs/1``, ``inputs/2``, ... with one dataset each.
        manifests: Of the datasets. Files that lie elsewhere than below their manifest are put beside the copy, and
            the copied manifest names them there.
    """
    atomic.write_bytes(folder / INPUTS / "cell.toml", file_content.content(cell))
    for number, path in enumerate(manifests, 1):
        target = folder / INPUTS / str(number)
        moved: dict[str, str] = {}
        for i, file in enumerate(read_manifest(path).files, 1):
            name = PurePosixPath(file.path.replace("\\", "/"))
            inside = not Path(file.path).is_absolute() and ".." not in name.parts
            relative = str(name) if inside else f"file{i}{name.suffix}"
            if not inside:
                moved[file.path] = relative
            atomic.write_bytes(target / relative, file_content.content(path.parent / file.path))
        text = file_content.content(path)
        if moved:
            doc: Any = tomlkit.parse(text.decode("utf-8-sig"))
            for table in doc["files"]:
                table["path"] = moved.get(str(table["path"]), table["path"])
            text = tomlkit.dumps(doc).encode()
        atomic.write_bytes(target / path.name, text)


def runs_below(folder: Path) -> list[ArchivedRun]:
    """All identifications in and below a folder, oldest first; a run that is there twice counts once.

    Raises:
        FileFormatError: The folder does not exist.
    """
    if not folder.is_dir():
        raise FileFormatError("no such folder", where=str(folder))
    results: dict[tuple[str, ...], ArchivedRun] = {}
    # The copy in an archive comes before the one beside it: its name tells which of two in one second was later.
    for path in sorted(folder.rglob(RESULT), key=lambda p: (-len(p.parts), str(p))):
        try:
            result = read_identification(path)
        except CounterflexError:
            continue
        key = (result["date"], result["recipe"], *(d["sha256"] for d in result["data"]), str(result["headline"]))
        results.setdefault(key, ArchivedRun(path.parent, result))
    return sorted(results.values(), key=lambda run: (run.result["date"], run.folder.name))

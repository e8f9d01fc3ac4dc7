"""The job `iso9283`: figures of ISO 9283 from raw measurements."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import polars as pl

from counterflex import __version__
from counterflex.app.robot_tests import path_test, pose_test
from counterflex.app.robot_tests.commanded import commanded_path, commanded_poses
from counterflex.app.robot_tests.measured import AS_MEASURED, frame_of, read_measured
from counterflex.core import atomic
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.units import MM, MS, UM
from counterflex.evaluate.iso9283.intervals import CONFIDENCE
from counterflex.evaluate.iso9283.settling import BAND_M
from counterflex.files.logs.tracker_exports.formats import OWN
from counterflex.files.summary_file import write_summary

_UNITS: Final = {"_um": "um", "_mdeg": "mdeg", "_percent": "%", "_mm_s": "mm/s", "_s": "s"}
_SINGLE: Final = ("CR_um", "CO_um", "FV_mm_s", "overshoot_um", "stabilisation_time_s")
"""Figures without an interval: the largest over cycles or places, or a mean of three."""

CYCLES: Final = {"pose": 30, "path": 10}
"""Cycles that the standard measures."""


def run(
    files: Sequence[str | Path],
    out: str | Path | None = None,
    *,
    poses: str | Path | None = None,
    path: str | Path | None = None,
    frame: str = AS_MEASURED,
    form: str = OWN,
    average_ms: float = 0.0,
    band_mm: float = BAND_M / MM,
    by_direction: bool = False,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Judge measurements by ISO 9283; with ``out``, write tables, ``summary.json`` and ``report.html`` there.

    Args:
        files: Logs, exports or datasets.
        out: Folder, made when missing; None writes nothing.
        poses: Commanded poses: a table, or a program that dwells at them; None where datasets state them.
        path: Commanded path: a table or a program. With it the path test is judged, without it the pose test.
        by_direction: Every file holds the cycles from another direction of approach.

    Raises:
        CounterflexError: A file cannot be used, or does not hold the test.
    """
    if poses is not None and path is not None:
        raise InputError("poses and a path are given", where="--poses and --path", hint="Give one of them")
    place = frame_of(frame)
    measured = []
    for k, file in enumerate(files):
        measured.append(read_measured(file, form))
        progress(0.4 * (k + 1) / len(files), f"reading {Path(file).name}")
    seconds = average_ms * MS
    result: pose_test.PoseResult | path_test.PathResult
    if path is not None:
        result = path_test.judge(measured, commanded_path(path), place, average_s=seconds)
    else:
        commanded = None if poses is None else commanded_poses(poses)
        result = pose_test.judge(
            measured, commanded, place, average_s=seconds, band_m=band_mm * MM, by_direction=by_direction
        )
    progress(0.9)
    summary = {
        "job": "iso9283",
        "standard": "ISO 9283:1998",
        "files": [one.name for one in measured],
        "commanded": Path(str(poses or path)).name if poses or path else "stated by the dataset",
        "frame": place.text,
        "frame_fitted": place.fitted,
        "filter": f"moving mean over {average_ms:g} ms" if average_ms > 0.0 else "none",
        "limit_band_mm": band_mm,
        "confidence": CONFIDENCE,
        "tracker_sigma_um": round(max(one.sigma_m for one in measured) / UM, 3),
        **result.summary,
        "cycles_of_the_standard": CYCLES[result.summary["test"]],
        "counterflex": __version__,
    }
    if out is not None:
        with atomic.atomic_folder(out) as staging:
            atomic.write_made(staging / "attained.parquet", result.table.write_parquet)
            atomic.write_text(staging / "attained.csv", result.table.write_csv())
            atomic.write_text(staging / "figures.csv", figure_table(summary).write_csv())
            write_summary(staging / "summary.json", summary)
            _write_page(result, summary, staging / "report.html")
    progress(1.0)
    return summary


def figure_table(summary: dict[str, Any]) -> pl.DataFrame:
    """All figures of a summary with their intervals: ``figure, where, unit, value, low, high, cycles``."""
    parts = [("", summary)]
    for name, label in (("poses", "pose"), ("multi_directional", "pose"), ("corner", "corner")):
        parts += [(f"{label} {row[label]}", row) for row in summary.get(name, [])]
    parts += [(f"poses {row['from']} and {row['to']}", row) for row in summary.get("distances", [])]
    parts.append(("middle of the path", summary.get("velocity", {})))
    rows = []
    for where, part in parts:
        for key, value in part.items():
            ending = next((end for end in _UNITS if key.endswith(end)), None)
            if ending is None:
                continue
            head: dict[str, Any] = {"figure": key.removesuffix(ending), "where": where, "unit": _UNITS[ending]}
            if isinstance(value, dict):
                rows.append(head | value)
            elif isinstance(value, float) and key in _SINGLE:
                rows.append(head | {"value": value})
    schema = {"figure": pl.String, "where": pl.String, "unit": pl.String, "value": pl.Float64, "low": pl.Float64,
              "high": pl.Float64, "cycles": pl.Int64}  # fmt: skip
    return pl.DataFrame(rows, schema=schema)


def _write_page(result: pose_test.PoseResult | path_test.PathResult, summary: dict[str, Any], target: Path) -> None:
    from counterflex.report.page import write_page
    from counterflex.report.robot_tests import page

    if isinstance(result, pose_test.PoseResult):
        write_page(page.pose_page(summary, result.poses), target)
    else:
        write_page(page.path_page(summary, result.path, result.figures, result.cycles, result.velocity), target)

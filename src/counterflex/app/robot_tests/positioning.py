"""The job `iso230 positioning`: figures of ISO 230-2 of an axis, from a table of approaches."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import polars as pl

from counterflex import __version__
from counterflex.core import atomic
from counterflex.core.result import Parts, ShownTable, Summary
from counterflex.core.units import MM, UM
from counterflex.evaluate.iso230.positioning import Positioning, TargetFigures
from counterflex.files.positioning_file import read_approaches
from counterflex.files.summary_file import write_summary

FIGURES: Final = {
    "A": "accuracy_m",
    "A_up": "accuracy_up_m",
    "A_down": "accuracy_down_m",
    "R": "repeatability_m",
    "R_up": "repeatability_up_m",
    "R_down": "repeatability_down_m",
    "E": "systematic_m",
    "E_up": "systematic_up_m",
    "E_down": "systematic_down_m",
    "M": "mean_deviation_m",
    "B": "reversal_m",
    "B_mean": "mean_reversal_m",
}
"""Letters of the standard to attributes of the result."""


class PositioningTest(Summary):
    """Positioning of one axis."""

    def _shown(self) -> Parts:
        figures = self["figures"]
        rows = [(letter, *(figures.get(f"{letter}{way}_um") for way in ("", "_up", "_down"))) for letter in "AREMB"]
        yield ShownTable.of(
            self.line("Positioning over {length_mm:g} mm, um"),
            "figure=0 | both directions=1:.1f | up=2:.1f | down=3:.1f",
            rows,
            "up: towards larger targets; not corrected to 20 degC",
        )
        yield from self.each("not_by_standard", "not by ISO 230-2: {}")


def judge_positioning(file: str | Path, out: str | Path | None = None) -> PositioningTest:
    """Judge an axis by ISO 230-2; with ``out``, write tables, ``summary.json`` and ``report.html``.

    Args:
        file: Table of approaches (:mod:`counterflex.files.positioning_file`).
    """
    result = read_approaches(file).figures()
    targets = result.targets
    summary = {
        "job": "iso230 positioning",
        "standard": "ISO 230-2:2014",
        "file": Path(file).name,
        "length_mm": round((targets[-1].target_m - targets[0].target_m) / MM, 4),
        "runs": {"up": [one.runs[0] for one in targets], "down": [one.runs[1] for one in targets]},
        "figures": {f"{letter}_um": _um(getattr(result, name)) for letter, name in FIGURES.items()},
        "targets": [_row(one) for one in targets],
        "not_by_standard": list(result.not_by_standard),
        "thermal_correction": "none",
        "counterflex": __version__,
    }
    if out is not None:
        _write(out, summary, result)
    return PositioningTest(summary)


def _row(one: TargetFigures) -> dict[str, Any]:
    values = {name: value for name, value in asdict(one).items() if name not in ("target_m", "runs")}
    row: dict[str, Any] = {"target_mm": round(one.target_m / MM, 6)}
    return row | {f"{name.removesuffix('_m')}_um": _um(value) for name, value in values.items()}


def _um(value_m: float | None) -> float | None:
    return None if value_m is None or math.isnan(value_m) else round(value_m / UM, 4)


def _write(out: str | Path, summary: dict[str, Any], result: Positioning) -> None:
    from counterflex.report.page import write_page
    from counterflex.report.robot_tests.iso230_page import positioning_page

    with atomic.atomic_folder(out) as staging:
        atomic.write_text(staging / "figures.csv", pl.DataFrame(summary["targets"]).write_csv())
        write_summary(staging / "summary.json", summary)
        write_page(positioning_page(summary, result), staging / "report.html")

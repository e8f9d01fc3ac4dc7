"""Page of a test of positioning: mean deviations with their bands in both directions, and the figures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from counterflex.core.units import MM, UM
from counterflex.evaluate.iso230.positioning import Positioning
from counterflex.report.figure_data import numbers
from counterflex.report.robot_tests.section import CYCLE_COLOURS, GRID, Section, test_page

NAMES: Final = {
    "A": "accuracy",
    "R": "repeatability",
    "E": "systematic deviation",
    "M": "mean bidirectional deviation",
    "B": "reversal",
}
"""Words for the letters of the standard."""


def positioning_page(summary: Mapping[str, Any], result: Positioning) -> str:
    """The page, as HTML text."""
    figures = summary["figures"]
    parts = [f"{letter} {figures[f'{letter}_um']:.1f} um" for letter in NAMES if figures[f"{letter}_um"] is not None]
    verdict = f"{', '.join(parts) or 'No figure of both directions'} over {summary['length_mm']:g} mm."
    missing = summary["not_by_standard"]
    head = ["target, mm", "mean up", "mean down", "s up", "s down", "B", "R"]
    keys = ("mean_up_um", "mean_down_um", "s_up_um", "s_down_um", "reversal_um", "repeatability_um")
    sections = [
        Section(
            "Figures, um",
            ("Not by the standard: " + "; ".join(missing) + ". " if missing else "")
            + "Not corrected to 20 °C. Up: towards larger targets.",
            columns=["figure", "both directions", "up", "down"],
            rows=[
                [f"{letter}, {name}", *(_text(figures.get(f"{letter}{way}_um")) for way in ("", "_up", "_down"))]
                for letter, name in NAMES.items()
            ]
            + [["mean of B", _text(figures["B_mean_um"]), "", ""]],
        ),
        Section("Deviation along the axis", "Mean deviations, and two standard deviations on both sides.", "bands"),
        Section(
            "Each target, um",
            "",
            columns=head,
            rows=[[f"{row['target_mm']:g}", *(_text(row[key]) for key in keys)] for row in summary["targets"]],
        ),
    ]
    title = f"Positioning by {summary['standard']}"
    return test_page(title, summary["file"], verdict, sections, {"bands": band_figure(result)})


def _text(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def band_figure(result: Positioning) -> dict[str, Any]:
    """Mean deviation of both directions over the axis, with two standard deviations on each side."""
    place = np.array([one.target_m for one in result.targets]) / MM
    data = []
    for k, way in enumerate(("up", "down")):
        mean = np.array([getattr(one, f"mean_{way}_m") for one in result.targets]) / UM
        s = np.nan_to_num(np.array([getattr(one, f"s_{way}_m") for one in result.targets])) / UM
        if not np.isfinite(mean).all():
            continue
        data.append(
            {"type": "scatter", "mode": "lines+markers", "name": way, "x": numbers(place, 3), "y": numbers(mean, 3),
             "line": {"color": CYCLE_COLOURS[k]}, "error_y": {"type": "data", "array": numbers(2.0 * s, 3)}}
        )  # fmt: skip
    layout = {
        "height": 380,
        "margin": {"l": 60, "r": 12, "t": 40, "b": 44},
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0.0},
        "xaxis": {**GRID, "title": {"text": "target, mm"}},
        "yaxis": {**GRID, "title": {"text": "deviation, um"}},
    }
    return {"data": data, "layout": layout}

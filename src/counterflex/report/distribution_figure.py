"""Bars: where the error comes from, and how the surface deviation is distributed."""

from __future__ import annotations

from typing import Any

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM, UM
from counterflex.evaluate.error_budget import REMAINDER, BudgetLine
from counterflex.evaluate.surface import NominalSurface, SurfaceDeviation
from counterflex.report.figure_data import AFTER, BEFORE, numbers


def budget_figure(budget: tuple[BudgetLine, ...]) -> dict[str, Any]:
    """Mean contribution of each cause to the deviation met, largest on top, the remainder last."""
    causes = sorted((line for line in budget if line.name != REMAINDER), key=lambda line: abs(line.share))
    ordered = [*(line for line in budget if line.name == REMAINDER), *causes]
    mean_um = [round(line.mean_m / UM, 2) for line in ordered]
    low, high = min([0.0, *mean_um]), max([0.0, *mean_um])
    span = high - low or 1.0
    names = [line.name for line in ordered]
    return {
        "data": [
            {
                "type": "bar",
                "orientation": "h",
                "y": names,
                "x": mean_um,
                "marker": {"color": ["#9aa3ad" if name == REMAINDER else "#33689c" for name in names]},
                "hovertemplate": "%{y}: %{x:.1f} µm<extra></extra>",
            },
            {
                "type": "scatter",
                "mode": "text",
                "y": names,
                "x": [max(value, 0.0) + 0.015 * span for value in mean_um],
                "text": [
                    f"{value:.0f} µm · {100.0 * line.share:.1f} %".replace("-", "−")
                    for value, line in zip(mean_um, ordered, strict=True)
                ],
                "textposition": "middle right",
                "hoverinfo": "skip",
            },
        ],
        "layout": {
            "height": 90 + 26 * len(ordered),
            "margin": {"l": 10, "r": 10, "t": 8, "b": 44},
            "xaxis": {
                "title": {"text": "mean part of the deviation, µm"},
                "zeroline": True,
                "range": [low - 0.03 * span, high + 0.4 * span],
            },
            "yaxis": {"automargin": True},
            "showlegend": False,
        },
        "narrow": {
            "xaxis.title.text": "mean part, µm",
            "xaxis.range": [low - 0.03 * span, high + 1.3 * span],
            "xaxis.nticks": 4,
            "yaxis.tickfont": {"size": 10},
        },
    }


def histogram_figure(
    surface: NominalSurface, before: SurfaceDeviation, after: SurfaceDeviation, limit_mm: float
) -> dict[str, Any]:
    """Share of the machined area in each class of deviation, before and after, 61 classes over the map's scale."""
    edges = np.linspace(-limit_mm, limit_mm, 62)
    centre = 0.5 * (edges[1:] + edges[:-1])
    data = []
    for name, colour, result in (("before", BEFORE, before), ("after", AFTER, after)):
        data.append(
            {
                "type": "bar",
                "name": name,
                "x": numbers(centre, 4),
                "y": numbers(100.0 * area_shares(surface, result, edges), 4),
                "marker": {"color": colour, "opacity": 0.75},
                "width": round(float(edges[1] - edges[0]), 5),
                "hovertemplate": "%{x:+.3f} mm: %{y:.2f} % of the area<extra></extra>",
            }
        )
    return {
        "data": data,
        "layout": {
            "height": 300,
            "barmode": "overlay",
            "margin": {"l": 60, "r": 14, "t": 24, "b": 46},
            "xaxis": {"title": {"text": "surface deviation, mm (+ = material left)"}, "tickformat": "+.2~f"},
            "yaxis": {"title": {"text": "share of area, %"}, "type": "log", "dtick": 1, "range": [-2.5, 2.0]},
            "legend": {"orientation": "h", "x": 0.0, "y": 1.0, "yanchor": "bottom"},
        },
        "narrow": {"xaxis.title.text": "deviation, mm (+ = material left)", "margin.l": 52},
    }


def area_shares(surface: NominalSurface, deviation: SurfaceDeviation, edges_mm: Float) -> Float:
    """Share of the evaluated floor and wall area in each class; what lies beyond the ends counts in the end classes."""
    floor = deviation.floor_m[~np.isnan(deviation.floor_m)].astype(np.float64)
    known = ~np.isnan(deviation.wall_m)
    value = np.concatenate([floor, deviation.wall_m[known]]) / MM
    area = np.concatenate([np.full(len(floor), surface.nominal.cell_m**2), surface.wall_area_m2[known]])
    inside = np.clip(value, edges_mm[0], edges_mm[-1])
    counted: Float = np.histogram(inside, bins=edges_mm, weights=area)[0]
    return counted / max(float(area.sum()), 1e-30)

"""Sections across grooves: nominal profile as a line, measured points with their deviation enlarged."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from counterflex.core.units import MM
from counterflex.evaluate.inspection.sections import Section
from counterflex.report.figure_data import AFTER, BEFORE, numbers

_ENLARGED: Final = (1, 2, 5, 10, 20, 50, 100)
_ROOM_M: Final = 2.0 * MM
_MOST_POINTS: Final = 1500
_COLOURS: Final = {"part": AFTER, "before": BEFORE, "after": AFTER}


def enlarged(section: Section) -> int:
    """How many times larger than the part the deviations of a section are drawn: up to about 2 mm."""
    every = np.concatenate([np.zeros(1), *(np.abs(one.deviation_m) for one in section.profiles.values())])
    largest = float(np.percentile(every, 95.0))
    return max((k for k in _ENLARGED if k * largest <= _ROOM_M), default=1)


def section_figure(section: Section) -> dict[str, Any]:
    """Plotly specification of one section, seen along the programmed motion: left is left of the feed."""
    factor = enlarged(section)
    traces: list[dict[str, Any]] = []
    for name, profile in section.profiles.items():
        rows = np.arange(len(profile.deviation_m))[:: max(1, len(profile.deviation_m) // _MOST_POINTS)]
        drawn = factor * profile.deviation_m[rows, None] * profile.normal[rows]
        traces.append(
            {
                "type": "scatter",
                "mode": "markers",
                "name": name,
                "x": numbers((profile.across_m[rows] + drawn[:, 0]) / MM, 3),
                "y": numbers((profile.height_m[rows] + drawn[:, 1]) / MM, 3),
                "customdata": numbers(profile.deviation_m[rows] / MM, 4),
                "marker": {"size": 3, "color": _COLOURS.get(name, AFTER)},
                "hovertemplate": "deviation %{customdata:+.3f} mm<extra></extra>",
            }
        )
    traces.append(
        {
            "type": "scatter",
            "mode": "lines",
            "name": "nominal",
            "x": numbers(section.across_m / MM, 3),
            "y": numbers(section.height_m / MM, 3),
            "line": {"color": "#1b2530", "width": 1.4},
            "hoverinfo": "skip",
        }
    )
    layout = {
        "height": 330,
        "margin": {"l": 56, "r": 12, "t": 30, "b": 46},
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0.0},
        "xaxis": {"title": {"text": "to the left of the feed, mm"}, "zeroline": False, "autorange": "reversed"},
        "yaxis": {"title": {"text": "z, mm"}, "zeroline": False, "scaleanchor": "x"},
    }
    return {"data": traces, "layout": layout, "narrow": {"height": 280}}

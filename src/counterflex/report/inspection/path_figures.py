"""The measured path of the tool: its places coloured by deviation, its components over the length, its figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.evaluate.path_deviation import PathDeviation, PathFigures
from counterflex.report.figure_data import AFTER, BEFORE, METROLOGY, NOT_MACHINED, edges_mm, numbers, stepped
from counterflex.report.series_figure import components_figure

_COLOURS: Final = {"part": AFTER, "before": BEFORE, "after": AFTER}
_TITLES: Final = {
    "path": "Across the feed, where the tool cut",
    "entry": "Entries",
    "exit": "Exits",
    "plateau": "Between them",
    "air": "Feed motion in air",
    "along": "Along the feed (not counted)",
}
_MOST: Final = 5000


@dataclass(frozen=True, eq=False)
class MeasuredPath:
    """A measured path."""

    deviation: PathDeviation
    # By surface (floor, wall_left, wall_right), (k,) m along its normal; nan where the station makes none
    normal_m: Mapping[str, Float]
    figures: PathFigures
    cut_known: bool  # Whether it is known where the tool cut
    along_known: bool  # Whether the deviation along the feed is known

    def map_figure(self, limit_mm: float) -> dict[str, Any]:
        """Plotly specification of the path seen from above, coloured by the largest deviation along a normal."""
        values = np.stack([np.nan_to_num(v) for v in self.normal_m.values()])
        none = np.all(np.isnan(np.stack(list(self.normal_m.values()))), axis=0)
        worst = np.take_along_axis(values, np.argmax(np.abs(values), axis=0)[None], axis=0)[0] / MM
        place = self.deviation.p_part_nominal / MM
        traces: list[dict[str, Any]] = []
        for rows, colour in ((np.flatnonzero(none), None), (np.flatnonzero(~none), worst)):
            some = rows[:: max(1, -(-len(rows) // _MOST))]
            marker: dict[str, Any] = {"size": 3, "color": NOT_MACHINED}
            if colour is not None:
                some = some[np.argsort(np.abs(colour[some]), kind="stable")]  # the largest on top
                marker = {"size": 6, "color": numbers(colour[some], 4), "coloraxis": "coloraxis"}
            traces.append(
                {
                    "type": "scatter",
                    "mode": "markers",
                    "x": numbers(place[some, 0], 2),
                    "y": numbers(place[some, 1], 2),
                    "marker": marker,
                    "hovertemplate": "x %{x:.1f}, y %{y:.1f} mm<br>%{marker.color:+.3f} mm<extra></extra>",
                    "hoverinfo": "skip" if colour is None else "all",
                }
            )
            if colour is None:
                del traces[-1]["hovertemplate"]
        bar = {
            "orientation": "h",
            "x": 0.5,
            "y": 1.03,
            "yanchor": "bottom",
            "len": 0.86,
            "thickness": 12,
            "tickvals": edges_mm(limit_mm)[::3],
            "tickformat": "+.3~f",
            "title": {"text": "deviation along the normal, mm", "side": "top"},
        }
        layout = {
            "height": 440,
            "margin": {"l": 56, "r": 10, "t": 76, "b": 46},
            "showlegend": False,
            "coloraxis": {"cmin": -limit_mm, "cmax": limit_mm, "colorscale": stepped(METROLOGY), "colorbar": bar},
            "xaxis": {"title": {"text": "x, mm"}, "zeroline": False, "constrain": "domain"},
            "yaxis": {"title": {"text": "y, mm"}, "zeroline": False, "scaleanchor": "x"},
        }
        return {"data": traces, "layout": layout, "narrow": {"height": 360}}


def path_series(paths: Mapping[str, MeasuredPath]) -> dict[str, Any]:
    """Plotly specification of the components of each path over the length of the program."""
    lines = [(name, _COLOURS.get(name, AFTER), path.deviation) for name, path in paths.items()]
    return components_figure(lines, along=all(path.along_known for path in paths.values()))


def path_rows(paths: Mapping[str, MeasuredPath]) -> list[dict[str, Any]]:
    """Rows of the table of figures: name, and max, 99.7 %, rms in mm and length in mm of each path."""
    rows = []
    for key, title in _TITLES.items():
        if not paths or (key not in ("path", "along") and not all(path.cut_known for path in paths.values())):
            continue
        if key == "along" and not all(path.along_known for path in paths.values()):
            continue
        if key == "path" and not all(path.cut_known for path in paths.values()):
            title = "Across the feed, all feed motion"
        cells = []
        for path in paths.values():
            figures = getattr(path.figures, key)
            cells += [f"{v / MM:.3f}" for v in (figures.max_m, figures.p997_m, figures.rms_m)]
            cells.append(f"{figures.extent / MM:.1f}")
        rows.append({"name": title, "cells": cells})
    return rows

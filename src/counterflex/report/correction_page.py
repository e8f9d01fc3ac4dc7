"""The page of a corrected program: what the parts showed, what the next one should be like, and what explains it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.units import MM, UM
from counterflex.report.figure_data import AFTER, BEFORE, numbers
from counterflex.report.page import render


@dataclass(frozen=True, eq=False)
class CorrectionData:
    """Everything on the page."""

    title: str
    subtitle: str
    created: str
    summary: Mapping[str, Any]  # Section ``correct`` of the summary
    way_m: Float  # (k,) m, length along the cut
    error_m: Float  # (k, 3) m, error of the path that the last part showed; nan between runs
    sigma_m: Float  # (k, 3) m
    change_m: Float  # (k, 3) m, change of the correction

    def page(self) -> str:
        """The page, as HTML text."""
        figures = {"error": self.error_figure()}
        return render(
            "correction.html.j2", figures, [], data=self, summary=self.summary, verdict=_verdict(self.summary)
        )

    def error_figure(self) -> dict[str, Any]:
        """Plotly specification: error of the path with its interval, and the change of the correction, by axis."""
        traces: list[dict[str, Any]] = []
        layout: dict[str, Any] = {
            "height": 560,
            "margin": {"l": 64, "r": 16, "t": 24, "b": 48},
            "xaxis": {"title": {"text": "way along the cut, mm"}, "anchor": "y3"},
            "legend": {"orientation": "h", "y": 1.08},
        }
        way = self.way_m / MM
        for axis in range(3):
            name = "" if axis == 0 else str(axis + 1)
            layout[f"yaxis{name}"] = {
                "title": {"text": f"{'xyz'[axis]}, um"},
                "domain": [0.70 - 0.35 * axis, 0.98 - 0.35 * axis],
                "zeroline": True,
            }
            e, s = self.error_m[:, axis] / UM, 2.0 * self.sigma_m[:, axis] / UM
            common = {
                "type": "scatter",
                "mode": "lines",
                "x": numbers(way, 2),
                "yaxis": f"y{name}",
                "connectgaps": False,
            }
            traces += [
                {
                    **common,
                    "y": numbers(e + sign * s, 1),
                    "line": {"width": 0},
                    "fill": "tonexty" if sign > 0 else None,
                    "fillcolor": "rgba(120,130,140,0.25)",
                    "hoverinfo": "skip",
                    "name": "2 standard deviations",
                    "showlegend": sign > 0 and axis == 0,
                }
                for sign in (-1.0, 1.0)
            ]
            for values, colour, text in (
                (e, BEFORE, "error that the part showed"),
                (self.change_m[:, axis] / UM, AFTER, "change of the correction"),
            ):
                traces.append(
                    {
                        **common,
                        "y": numbers(values, 1),
                        "line": {"color": colour, "width": 1.6},
                        "name": text,
                        "showlegend": axis == 0,
                    }
                )
        return {"data": traces, "layout": layout}


def _verdict(summary: Mapping[str, Any]) -> str:
    expected = summary["expected"]
    if not summary["changed"]:
        return "The parts show nothing but noise, or less than 5 um: the program stays as it is."
    return (
        f"Surface, 99.7 %: {expected['now_p997_um']:.0f} um on the measured part; {expected['next_p997_um']:.0f} um "
        f"({expected['next_5_percent_um']:.0f} to {expected['next_95_percent_um']:.0f}) expected on the next one."
    )


def broken(values: Float, chain: Int) -> Float:
    """Values (k, 3) with a gap where the number of the run changes."""
    out = np.array(values, dtype=np.float64)
    out[np.flatnonzero(np.diff(chain) != 0)] = np.nan
    return out

"""The page of stability: margin along the path, and the lobe diagram at the worst stretch of each tool."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.report.data import Head
from counterflex.report.figure_data import numbers, thin
from counterflex.report.page import render

_POINTS: Final = 3000
_SHOWN: Final = 20.0
"""Margins above are drawn at this height: nothing is to be read from them."""
_TEXTS: Final = {"stable": "Stable along the whole path.", "chatter": "The program chatters: do not run it as it is."}


@dataclass(frozen=True, eq=False)
class StabilityData:
    """Everything on the page."""

    summary: Mapping[str, Any]
    stretches: Sequence[Mapping[str, Any]]  # Rows of ``stability.csv``
    lobes: Sequence[Mapping[str, Any]]  # Rows of ``lobes.csv``
    title: str = "Stability"

    def page(self) -> str:
        """The page, as HTML text."""
        figures = {"margins": margin_figure(self.stretches)}
        for tool in self.summary["tools"]:
            rows = [row for row in self.lobes if row["tool"] == tool["tool"]]
            figures[f"lobes{tool['tool']}"] = lobe_figure(rows, tool["worst"])
        summary = self.summary
        worst = summary["worst"]
        least = f"{worst['margin']:.3g} at line {worst['line']} ({worst['method']})"
        verdict = f"{_TEXTS[summary['verdict']]} Least margin {least}."
        needed = max(tool["needed_damping_ratio"] for tool in summary["tools"])
        if summary["verdict_over_interval"] == "open":
            low, high = summary["robot_damping_between"]
            verdict += (
                f" Open: the damping ratio was not measured and may be {low:g} to {high:g}; below {needed:.3g} "
                "the program chatters."
            )
        return render(
            "stability.html.j2",
            figures,
            [],
            data=Head(f"Stability: {summary['program']}", f"{summary['cell']}, {summary['robot']}"),
            summary=summary,
            verdict=verdict,
            needed=needed,
        )


def margin_figure(stretches: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Margins of robot and tool over time; the worst stretch is marked with its line of the program."""
    time = np.array([row["time_s"] for row in stretches])
    margin = np.array([row["margin"] for row in stretches])
    traces: list[dict[str, Any]] = []
    for key, name, colour in (
        ("robot_margin", "robot", "#0369a1"),
        ("tool_margin", "spindle and tool", "#7c3aed"),
        ("low_frequency_margin", "robot, low-frequency criterion", "#15803d"),
    ):
        values = np.array([np.nan if row[key] is None else row[key] for row in stretches])
        if np.all(np.isnan(values)):
            continue
        x, y = thin(time, np.minimum(values, _SHOWN), ~np.isnan(values), _POINTS)
        dash = "dot" if key == "low_frequency_margin" else "solid"
        traces.append(
            {"type": "scatter", "mode": "lines+markers", "name": name, "x": numbers(x, 3), "y": numbers(y, 3),
             "line": {"color": colour, "width": 1.6, "dash": dash}, "marker": {"size": 4}}
        )  # fmt: skip
    at = int(np.argmin(margin))
    low = min(float(margin[at]), 0.5)
    layout = {
        "height": 420,
        "margin": {"l": 64, "r": 12, "t": 40, "b": 44},
        "hovermode": "x",
        "legend": {"orientation": "h", "y": 1.03, "yanchor": "bottom", "x": 0.0},
        "xaxis": {"title": {"text": "time at the programmed feed, s"}, "zeroline": False},
        "yaxis": {
            "title": {"text": f"margin (drawn up to {_SHOWN:g})"},
            "type": "log",
            "range": [float(np.log10(0.8 * low)), float(np.log10(1.15 * _SHOWN))],
        },
        "shapes": [
            {"type": "line", "xref": "paper", "x0": 0.0, "x1": 1.0, "y0": 1.0, "y1": 1.0,
             "line": {"color": "#b91c1c", "width": 1.2, "dash": "dash"}}
        ],
        "annotations": [
            {"text": f"line {stretches[at]['line']}: {margin[at]:.3g}", "x": round(float(time[at]), 3),
             "y": float(np.log10(min(margin[at], _SHOWN))), "ax": 0, "ay": 28, "showarrow": True,
             "bgcolor": "rgba(255,255,255,0.85)", "font": {"size": 11, "color": "#1b2530"}}
        ],
    }  # fmt: skip
    return {"data": traces, "layout": layout}


def lobe_figure(rows: Sequence[Mapping[str, Any]], worst: Mapping[str, Any]) -> dict[str, Any]:
    """Deepest stable cut over the spindle speed, with the programmed depth and speed."""
    depth = float(worst["axial_depth_mm"])
    traces: list[dict[str, Any]] = []
    top = 2.5 * depth
    for method, mode, colour in (("zeroth order", "lines", "#0369a1"), ("semi-discretisation", "markers", "#c2410c")):
        own = [row for row in rows if row["method"] == method]
        x = np.array([row["spindle_rpm"] for row in own])
        y = np.array([np.nan if row["depth_mm"] is None else row["depth_mm"] for row in own])
        if np.any(~np.isnan(y)):
            top = max(top, 2.5 * float(np.nanmedian(y)))
        traces.append(
            {"type": "scatter", "mode": mode, "name": method, "x": numbers(x, 1), "y": numbers(y, 4),
             "line": {"color": colour, "width": 1.8}, "marker": {"color": colour, "size": 7}}
        )  # fmt: skip
    traces.append(
        {"type": "scatter", "mode": "markers", "name": f"program, line {worst['line']}", "x": [worst["spindle_rpm"]],
         "y": [depth], "marker": {"color": "#1b2530", "size": 12, "symbol": "x"}}
    )  # fmt: skip
    layout = {
        "height": 420,
        "margin": {"l": 64, "r": 12, "t": 40, "b": 44},
        "legend": {"orientation": "h", "y": 1.03, "yanchor": "bottom", "x": 0.0},
        "xaxis": {"title": {"text": "spindle speed, rpm"}, "zeroline": False},
        "yaxis": {"title": {"text": "axial depth, mm"}, "range": [0.0, top]},
    }
    return {"data": traces, "layout": layout}

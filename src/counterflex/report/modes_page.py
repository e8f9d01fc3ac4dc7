"""The page of modes: their table, and each of them moving, from the side and from above."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.report.figure_data import numbers
from counterflex.report.page import render

_DRAWN: Final = 0.12
"""Largest motion in the picture, as a share of the arm's length; real ones are some thousand times smaller."""
_PHASES: Final = 24
_PERIODS: Final = 6
_FRAME_MS: Final = 50
_REST: Final = "#9aa5b0"
_ARM: Final = "#e2701c"
_TOOL: Final = "#26384a"


@dataclass(frozen=True, eq=False)
class ModesData:
    """Everything on the page."""

    summary: Mapping[str, Any]
    points_m: Float  # (k, 3) m, base axes, from the robot's foot to the tool's tip
    moved_m: Float  # (k, 3, m) m, their motion in each mode, of any size
    flange: int  # Index of the flange among the points
    title: str = "Modes"
    subtitle: str = ""
    created: str = ""  # Date as printed, or empty

    def page(self) -> str:
        """The page, as HTML text."""
        rows = self.summary["modes"]
        figures = {f"mode{k}": mode_figure(self.points_m, self.moved_m[:, :, k], self.flange) for k in range(len(rows))}
        lowest = rows[0]
        low, high = lowest["of_90_percent_hz"]
        verdict = (
            f"The lowest mode is at {lowest['hz']:.1f} Hz ({low:.1f} to {high:.1f} Hz in nine of ten such robots)."
        )
        return render("modes.html.j2", figures, [], data=self, summary=self.summary, verdict=verdict)


def mode_figure(points_m: Float, moved_m: Float, flange: int) -> dict[str, Any]:
    """Plotly specification of one mode in two elevations, with its frames: one period, enlarged.

    The view from the side lies in the vertical plane through axis 1 and the tool tip; motion across it is seen from
    above only.

    Args:
        points_m: (k, 3) m, base axes.
        moved_m: (k, 3) m, motion of the points in the mode, of any size.
    """
    length = float(np.sum(np.linalg.norm(np.diff(points_m, axis=0), axis=1)))
    largest = float(np.max(np.linalg.norm(moved_m, axis=1)))
    moved = moved_m * (_DRAWN * length / largest if largest > 0.0 else 0.0)
    tip = points_m[-1, :2]
    along = tip / max(float(np.linalg.norm(tip)), 1e-9)
    views = (np.array([[along[0], along[1], 0.0], [0.0, 0.0, 1.0]]), np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    parts = ((slice(0, flange + 1), "robot", _ARM), (slice(flange, len(points_m)), "tool", _TOOL))
    rest = [_line(points_m @ V.T, view, "at rest", _REST, 3.0) for view, V in enumerate(views)]
    phase = np.sin(2.0 * np.pi * np.arange(_PHASES) / _PHASES)
    shown = [
        [
            _line((points_m + s * moved)[rows] @ V.T, view, name, colour, 7.0)
            for view, V in enumerate(views)
            for rows, name, colour in parts
        ]
        for s in phase
    ]
    first = shown[_PHASES // 4]  # still: where it is farthest out
    data = [*rest, *first]
    for at, trace in enumerate(data):
        trace["showlegend"] = trace["name"] not in {one["name"] for one in data[:at]}
    frames = [
        {
            "name": str(k),
            "traces": list(range(len(rest), len(data))),
            "data": [{"x": trace["x"], "y": trace["y"]} for trace in traces],
        }
        for k, traces in enumerate(shown)
    ]
    reached = np.concatenate([points_m + moved, points_m - moved])
    return {"data": data, "layout": _layout([reached @ V.T / MM for V in views]), "narrow": _narrow(), "frames": frames}


def _line(points_m: Float, view: int, name: str, colour: str, width: float) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "lines+markers",
        "name": name,
        "legendgroup": name,
        "x": numbers(points_m[:, 0] / MM, 1),
        "y": numbers(points_m[:, 1] / MM, 1),
        "xaxis": f"x{view + 1 if view else ''}",
        "yaxis": f"y{view + 1 if view else ''}",
        "line": {"color": colour, "width": width},
        "marker": {"size": width + 1.0, "color": colour},
        "hoverinfo": "name",
    }


def _layout(reached_mm: list[Float]) -> dict[str, Any]:
    frame = {"zeroline": True, "zerolinecolor": "#c5cdd5", "showgrid": True, "gridcolor": "#eef1f4"}
    axes: dict[str, Any] = {}
    titles = (("distance from axis 1, mm", "height, mm"), ("x of the base, mm", "y of the base, mm"))
    for view, (points, (x, y)) in enumerate(zip(reached_mm, titles, strict=True)):
        n = "2" if view else ""
        low, high = points.min(axis=0) - 100.0, points.max(axis=0) + 100.0
        axes[f"xaxis{n}"] = {
            **frame, "domain": [0.56, 1.0] if view else [0.0, 0.47], "title": {"text": x}, "anchor": f"y{n}",
            "range": [float(low[0]), float(high[0])], "constrain": "domain",
        }  # fmt: skip
        axes[f"yaxis{n}"] = {
            **frame, "title": {"text": y}, "anchor": f"x{n}", "scaleanchor": f"x{n}", "constrain": "domain",
            "range": [float(low[1]), float(high[1])],
        }  # fmt: skip
    names = [str(k) for k in range(_PHASES)] * _PERIODS
    how = {"frame": {"duration": _FRAME_MS, "redraw": False}, "transition": {"duration": 0}, "mode": "immediate"}
    buttons = [
        {"label": "Play", "method": "animate", "args": [names, how]},
        {"label": "Stop", "method": "animate", "args": [[None], {**how, "frame": {"duration": 0, "redraw": False}}]},
    ]
    return {
        "height": 420,
        "margin": {"l": 60, "r": 10, "t": 48, "b": 46},
        "legend": {"orientation": "h", "x": 0.0, "y": 1.02, "yanchor": "bottom"},
        **axes,
        "updatemenus": [
            {"type": "buttons", "direction": "left", "showactive": False, "x": 0.47, "xanchor": "right", "y": 1.02,
             "yanchor": "bottom", "pad": {"t": 0, "b": 0}, "buttons": buttons}
        ],
    }  # fmt: skip


def _narrow() -> dict[str, Any]:
    """Return what changes on a narrow screen: one view below the other."""
    return {
        "height": 760,
        "margin": {"l": 52, "r": 6, "t": 90, "b": 44},
        "updatemenus[0].x": 1.0,
        "updatemenus[0].y": 1.07,  # above the legend, which needs the whole width
        "xaxis.domain": [0.0, 1.0],
        "xaxis2.domain": [0.0, 1.0],
        "yaxis.domain": [0.56, 1.0],
        "yaxis2.domain": [0.0, 0.44],
    }

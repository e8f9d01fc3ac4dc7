"""The cell as a drawing: robot, reach, blank and path, from the side and from above."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
import scipy

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.report.data import CellDrawing
from counterflex.report.figure_data import numbers

_ROBOT: Final = "#e2701c"
_TOOL: Final = "#26384a"
_BLANK: Final = "#7c3aed"
_PATH: Final = "#15803d"
_REACH: Final = "#9aa5b0"


def cell_figure(drawing: CellDrawing) -> dict[str, Any]:
    """Plotly specification of two elevations with one scale: along the arm, and from above. Needs no WebGL.

    The view from the side lies in the vertical plane through axis 1 and the tool tip; lengths across it are not seen.
    """
    tip = drawing.links_m[-1, :2]
    along = tip / max(float(np.linalg.norm(tip)), 1e-9)
    data: list[dict[str, Any]] = []
    views: tuple[Callable[[Float], Float], ...] = (lambda points: _side(along, points), _above)
    for number, (view, reach) in enumerate(zip(views, (drawing.from_side(), _from_above(drawing)), strict=True)):
        data += [_line(curve, number, "reach of the flange, wrist stretched", _REACH, 1.2, "dot") for curve in reach]
        links = view(drawing.links_m)
        data.append(_links(links[: drawing.flange + 1], number, drawing.robot.split(" (")[0], _ROBOT))
        data.append(_links(links[drawing.flange :], number, "tool", _TOOL))
        data.append(_blank(view(drawing.blank_m), number))  # before the tool, which would hide a small one
        if len(drawing.path_m):
            data.append(_line(view(drawing.path_m), number, "tool path", _PATH, 1.0))
    seen: set[str] = set()
    for trace in data:
        trace["showlegend"] = trace["name"] not in seen
        seen.add(trace["name"])
    return {"data": data, "layout": _layout(), "narrow": _narrow()}


def _from_above(drawing: CellDrawing) -> list[Float]:
    """Circle of the largest horizontal distance."""
    if not drawing.reach_m:
        return []
    radius = max(float(np.max(np.abs(curve[:, 0]))) for curve in drawing.reach_m) / MM
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    return [radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)]


def _line(points: Float, view: int, name: str, colour: str, width: float, dash: str = "solid") -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "legendgroup": name,
        "x": numbers(points[:, 0], 1),
        "y": numbers(points[:, 1], 1),
        "xaxis": f"x{view + 1 if view else ''}",
        "yaxis": f"y{view + 1 if view else ''}",
        "line": {"color": colour, "width": width, "dash": dash},
        "hoverinfo": "name",
    }


def _links(points: Float, view: int, name: str, colour: str) -> dict[str, Any]:
    return {
        **_line(points, view, name, colour, 9.0),
        "mode": "lines+markers",
        "marker": {"size": 11, "color": "#ffffff", "line": {"color": colour, "width": 3}},
        "hovertemplate": "%{x:.0f}, %{y:.0f} mm<extra>" + name.replace("<", "&lt;") + "</extra>",
    }


def _blank(corners: Float, view: int) -> dict[str, Any]:
    """Outline of the blank as it is seen."""
    hull = corners[scipy.spatial.ConvexHull(corners).vertices]
    closed = np.vstack([hull, hull[:1]])
    return {**_line(closed, view, "blank", _BLANK, 1.5), "fill": "toself", "fillcolor": "rgba(124,58,237,0.35)"}


def _layout() -> dict[str, Any]:
    frame = {"zeroline": True, "zerolinecolor": "#c5cdd5", "showgrid": True, "gridcolor": "#eef1f4"}
    return {
        "height": 460,
        "margin": {"l": 60, "r": 10, "t": 44, "b": 46},
        "legend": {"orientation": "h", "x": 0.0, "y": 1.02, "yanchor": "bottom"},
        "xaxis": {**frame, "domain": [0.0, 0.47], "title": {"text": "distance from axis 1, mm"}, "constrain": "domain"},
        "yaxis": {**frame, "title": {"text": "height, mm"}, "scaleanchor": "x", "constrain": "domain"},
        "xaxis2": {
            **frame, "domain": [0.56, 1.0], "title": {"text": "x of the base, mm"}, "anchor": "y2",
            "constrain": "domain",
        },
        "yaxis2": {
            **frame, "title": {"text": "y of the base, mm"}, "anchor": "x2", "scaleanchor": "x2", "constrain": "domain",
        },
    }  # fmt: skip


def _narrow() -> dict[str, Any]:
    """Return what changes on a narrow screen: one view below the other."""
    return {
        "height": 760,
        "margin": {"l": 52, "r": 6, "t": 90, "b": 44},
        "xaxis.domain": [0.0, 1.0],
        "xaxis2.domain": [0.0, 1.0],
        "yaxis.domain": [0.56, 1.0],
        "yaxis2.domain": [0.0, 0.44],
    }


def _side(along: Float, points: Float) -> Float:
    return np.stack([points[:, :2] @ along, points[:, 2]], axis=1) / MM


def _above(points: Float) -> Float:
    out: Float = points[:, :2] / MM
    return out

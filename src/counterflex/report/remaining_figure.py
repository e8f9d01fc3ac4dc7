"""Predicted path error that compensation leaves: as a curve along the path, and on the path in space."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM, UM
from counterflex.report.data import PredictionData
from counterflex.report.figure_data import AFTER, BEFORE, numbers, thin

_POINTS: Final = 5000
_POINTS_3D: Final = 12_000


def remaining_figure(data: PredictionData) -> dict[str, Any]:
    """Predicted distance from the programmed path across the feed while material is cut, over the length of the path.

    Raises:
        ValueError: The page has no prediction of the error.
    """
    place = length_m(data.p_part_tcp)
    traces = []
    for name, colour, error in (
        ("before (model)", BEFORE, data.error_before_m),
        ("after (model)", AFTER, data.error_after_m),
    ):
        if error is None:
            raise ValueError("the error was not predicted")
        x, y = thin(place, error / UM, data.cutting, _POINTS)
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": name,
                "x": numbers(x, 4),
                "y": numbers(y, 1),
                "line": {"color": colour, "width": 1.4},
                "connectgaps": False,
            }
        )
    return {
        "data": traces,
        "layout": {
            "height": 340,
            "margin": {"l": 70, "r": 14, "t": 30, "b": 46},
            "hovermode": "x unified",
            "legend": {"orientation": "h", "x": 0.0, "y": 1.0, "yanchor": "bottom"},
            "xaxis": {"title": {"text": "length along the program, m"}, "zeroline": False},
            "yaxis": {"title": {"text": "predicted path error, µm"}, "rangemode": "tozero", "automargin": True},
        },
    }


_NARROWEST: Final = 0.3  # Sides of the box about a path, of the longest, at least
_LONGEST: Final = 2.0  # Length of its longest side in the picture


def _points(name: str, p: Float, mode: str) -> dict[str, Any]:
    """Trace of points (k, 3) in mm."""
    xyz = {axis: numbers(p[:, k], 2) for k, axis in enumerate("xyz")}
    return {"type": "scatter3d", "mode": mode, "name": name, **xyz}


def _box(p_mm: Float) -> dict[str, Any]:
    """Axes of a scene, alike in scale, about points (n, 3).

    A path on a line or in a plane has no width: its box would be as large as the picture along the others.
    """
    low, high = p_mm.min(axis=0), p_mm.max(axis=0)
    size_mm = np.maximum(1.05 * (high - low), _NARROWEST * max(float(np.max(high - low)), 10.0))
    ends = 0.5 * (low + high) + 0.5 * np.outer([-1.0, 1.0], size_mm)
    style = {"backgroundcolor": "#f4f6f8", "gridcolor": "#ffffff", "showbackground": True}
    return {
        "aspectmode": "manual",
        "aspectratio": dict(zip("xyz", numbers(_LONGEST * size_mm / size_mm.max(), 3), strict=True)),
    } | {
        f"{name}axis": {**style, "title": {"text": f"{name}, mm"}, "range": numbers(ends[:, k], 2)}
        for k, name in enumerate("xyz")
    }


def space_figure(data: PredictionData) -> dict[str, Any]:
    """The path in space, the cut coloured by what is predicted to remain (by the deflection where that was not)."""
    after = data.error_after_m
    size = after / UM if after is not None else np.linalg.norm(data.deflection_m, axis=1) / UM
    title = "error that remains (model), µm" if after is not None else "predicted deflection, µm"
    p = data.p_part_tcp / MM
    cut, air = _few(np.flatnonzero(data.cutting)), _few(np.arange(len(p)))
    return {
        "data": [
            _points("program", p[air], "lines")
            | {"line": {"color": "#b9c1c9", "width": 2}, "hoverinfo": "skip", "showlegend": False},
            _points("cut", p[cut], "markers")
            | {
                "customdata": [int(line) for line in data.line[cut]],
                "marker": {"size": 3.2, "color": numbers(size[cut], 1), "coloraxis": "coloraxis"},
                "hovertemplate": "line %{customdata}<br>%{x:.1f}, %{y:.1f}, %{z:.1f} mm<br>"
                "%{marker.color:.0f} µm<extra></extra>",
                "showlegend": False,
            },
        ],
        "layout": {
            "height": 520,
            "margin": {"l": 0, "r": 0, "t": 0, "b": 70},
            "coloraxis": {
                "colorscale": "Viridis",
                "cmin": 0.0,
                "cmax": _brightest(size[data.cutting]),
                "colorbar": {
                    "orientation": "h",
                    "x": 0.5,
                    "y": -0.02,
                    "yanchor": "top",
                    "len": 0.8,
                    "thickness": 12,
                    "title": {"text": title, "side": "top"},
                },
            },
            "scene": {
                **_box(p),
                "camera": {"eye": {"x": -1.0, "y": -1.9, "z": 1.3}, "center": {"x": 0.0, "y": 0.0, "z": -0.15}},
            },
        },
        "narrow": {
            "height": 420,
            "scene.camera.eye": {"x": -1.7, "y": -3.2, "z": 2.2},
            "scene.camera.center": {"x": 0.1, "y": 0.0, "z": -0.1},
            **{
                f"scene.{axis}axis.{key}": value
                for axis in "xyz"
                for key, value in (("nticks", 4), ("tickfont", {"size": 9}))
            },
        },
    }


def _brightest(size: Float) -> float:
    """End of the colours: one point that stands out does not make all others dark."""
    return max(float(np.percentile(size, 99.0)), 1.0) if len(size) else 1.0


def _few(rows: Any) -> Any:
    step = max(1, -(-len(rows) // _POINTS_3D))
    return rows[::step]


def length_m(p: Float) -> Float:
    """Length (n,) m along points (n, 3) m."""
    out: Float = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    return out

"""Pictures of a path test: bands of the attained paths about the commanded one, corners, velocity."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM, MM_PER_S, UM
from counterflex.evaluate.iso9283.path_cycles import CommandedPath, PathCycle
from counterflex.evaluate.iso9283.path_figures import IsoPathFigures, PathVelocity
from counterflex.report.data import Head
from counterflex.report.figure_data import numbers, thin
from counterflex.report.page import render

CYCLE_COLOURS: Final = ("#0369a1", "#c2410c", "#15803d", "#7c3aed", "#b45309", "#0f766e", "#be185d", "#4d7c0f")
GRID: Final = {"zeroline": True, "zerolinecolor": "#c5cdd5", "showgrid": True, "gridcolor": "#eef1f4"}


@dataclass(frozen=True)
class Section:
    """One part of the page."""

    title: str
    lead: str = ""
    figure: str = ""  # Name of its picture, or empty
    columns: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()

    @classmethod
    def conditions(cls, summary: Mapping[str, Any]) -> Section:
        """Return how the figures were made."""
        rows = [
            ["files", ", ".join(summary["files"])],
            ["commanded", summary["commanded"]],
            [
                "frame",
                summary["frame"] + (" (accuracies leave out what a frame absorbs)" if summary["frame_fitted"] else ""),
            ],
            ["filter", summary["filter"]],
            ["standard deviation of the tracker as stated", f"{summary['tracker_sigma_um']:g} um"],
        ]
        noise = (
            "The figures contain the noise of the instrument and the errors that all readings share: "
            "of frame and scale."
        )
        if "confidence" in summary:
            noise = (
                "Intervals hold the true figure with 95 % confidence, from the scatter of the cycles that were "
                "measured. They contain the noise of the instrument, not errors that all readings share: of the frame, "
                "of its scale."
            )
        return cls("How it was measured", noise, columns=["", ""], rows=rows)


def test_page(
    title: str, subtitle: str, verdict: str, sections: Sequence[Section], figures: Mapping[str, dict[str, Any]]
) -> str:
    """The page, as HTML text."""
    head = Head(title, subtitle)
    return render("robot_test.html.j2", dict(figures), [], data=head, verdict=verdict, sections=sections)


_DRAWN: Final = 0.06  # Largest deviation in the picture, as a share of the path's size
_POINTS: Final = 1500
_CORNERS: Final = 4


def plane_of(p: Float) -> Float:
    """(2, 3) the two directions in which points (n, 3) extend most; axes of the frame where they lie along them."""
    _, s, vt = np.linalg.svd(p - p.mean(axis=0), full_matrices=True)
    normal = vt[2] if len(s) > 1 and s[1] > 1e-6 * s[0] else np.eye(3)[int(np.argmin(np.abs(vt[0])))]
    drop = int(np.argmax(np.abs(normal)))
    if abs(normal[drop]) > 1.0 - 1e-6:
        return np.delete(np.eye(3), drop, axis=0)
    out: Float = vt[:2]
    return out


def magnified(path: CommandedPath, f: IsoPathFigures) -> float:
    """Factor by which deviations are drawn larger: 1, 2 or 5 times a power of ten."""
    size = float(np.ptp(path.p, axis=0).max())
    largest = float(np.linalg.norm(f.p_attained - f.command[:, None], axis=2).max())
    raw = _DRAWN * size / max(largest, 1e-9)
    power = 10.0 ** math.floor(math.log10(max(raw, 1.0)))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= max(raw, 1.0))


def path_band_figure(path: CommandedPath, f: IsoPathFigures) -> dict[str, Any]:
    """The commanded path, and the attained ones with their deviations drawn larger, in the plane of the path."""
    V, factor = plane_of(path.p), magnified(path, f)
    line = path.p @ V.T / MM
    data: list[dict[str, Any]] = [
        {"type": "scatter", "mode": "lines", "name": "commanded", "x": numbers(line[:, 0], 4),
         "y": numbers(line[:, 1], 4), "line": {"color": "#1b2530", "width": 1.5}}
    ]  # fmt: skip
    ends = np.searchsorted(f.length_m, [end for _, end in path.stretches])
    for j in range(f.p_attained.shape[1]):
        drawn = (f.command + factor * (f.p_attained[:, j] - f.command)) @ V.T / MM
        xy = np.insert(drawn, ends[:-1], np.nan, axis=0)
        data.append(
            {"type": "scatter", "mode": "lines", "name": f"cycle {j + 1}", "x": numbers(xy[:, 0], 4),
             "y": numbers(xy[:, 1], 4), "line": {"color": CYCLE_COLOURS[j % len(CYCLE_COLOURS)], "width": 1.2}}
        )  # fmt: skip
    layout = {
        "height": 520,
        "margin": {"l": 60, "r": 12, "t": 40, "b": 44},
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0.0},
        "xaxis": {**GRID, "title": {"text": "mm"}},
        "yaxis": {**GRID, "title": {"text": "mm"}, "scaleanchor": "x"},
    }
    return {"data": data, "layout": layout}


def band_figure(path: CommandedPath, f: IsoPathFigures) -> dict[str, Any]:
    """Barycentre of the attained paths across the commanded one, and the tube of radius RT about it, along the path."""
    gaps = np.searchsorted(f.length_m, [end for _, end in path.stretches])[:-1]
    x = np.insert(f.length_m / MM, gaps, np.nan)
    centre = (f.p_attained.mean(axis=1) - f.command) / UM
    tube = np.insert(f.by_place_rt_m / UM, gaps, 0.0)
    normal = np.cross(*plane_of(path.p))
    side = np.cross(normal, f.direction)
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-12)
    data = []
    for name, d, colour, fill in (
        ("in the plane of the path, to the left", np.sum(centre * side, axis=1), "#0369a1", "rgba(3,105,161,0.16)"),
        ("square to that plane", centre @ normal, "#c2410c", "rgba(194,65,12,0.16)"),
    ):
        d = np.insert(d, gaps, np.nan)
        data += [
            {"type": "scatter", "mode": "lines", "x": numbers(x, 3), "y": numbers(d + tube, 3), "line": {"width": 0},
             "showlegend": False, "hoverinfo": "skip"},
            {"type": "scatter", "mode": "lines", "x": numbers(x, 3), "y": numbers(d - tube, 3), "line": {"width": 0},
             "fill": "tonexty", "fillcolor": fill, "showlegend": False, "hoverinfo": "skip"},
            {"type": "scatter", "mode": "lines+markers", "name": name, "x": numbers(x, 3), "y": numbers(d, 3),
             "line": {"color": colour, "width": 1.6}, "marker": {"size": 4}},
        ]  # fmt: skip
    layout = {
        "height": 380,
        "margin": {"l": 60, "r": 12, "t": 40, "b": 44},
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0.0},
        "xaxis": {**GRID, "title": {"text": "along the commanded path, mm"}},
        "yaxis": {**GRID, "title": {"text": "um"}},
        "shapes": [
            {"type": "line", "xref": "x", "yref": "paper", "x0": end / MM, "x1": end / MM, "y0": 0, "y1": 1,
             "line": {"color": "#9aa5b0", "width": 1, "dash": "dot"}}
            for _, end in path.stretches[:-1]
        ],
    }  # fmt: skip
    return {"data": data, "layout": layout}


def corner_figure(path: CommandedPath, cycles: Sequence[PathCycle], reach_m: float) -> dict[str, Any]:
    """Attained paths around the first corners at true scale, the corner in the middle."""
    points = path.corners[:_CORNERS].tolist()
    V = plane_of(path.p)
    data, axes = [], {}
    width = 1.0 / len(points)
    length = path.length
    for n, k in enumerate(points):
        tail = "" if n == 0 else str(n + 1)
        line = (path.p - path.p[k]) @ V.T / MM
        axis = {"xaxis": f"x{tail}", "yaxis": f"y{tail}", "showlegend": False}
        data.append(
            {"type": "scatter", "mode": "lines", "x": numbers(line[:, 0], 4), "y": numbers(line[:, 1], 4), **axis,
             "line": {"color": "#1b2530", "width": 1.5}, "hoverinfo": "skip"}
        )  # fmt: skip
        for j, cycle in enumerate(cycles):
            near = np.abs(cycle.length_m - length[k]) < 3.0 * reach_m
            xy = (cycle.p[near] - path.p[k]) @ V.T / MM
            xy = xy[:: max(1, len(xy) // 400)]
            data.append(
                {"type": "scatter", "mode": "lines", "x": numbers(xy[:, 0], 4), "y": numbers(xy[:, 1], 4), **axis,
                 "name": f"cycle {j + 1}", "line": {"color": CYCLE_COLOURS[j % len(CYCLE_COLOURS)], "width": 1}}
            )  # fmt: skip
        span = [-reach_m / MM, reach_m / MM]
        axes[f"xaxis{tail}"] = {
            **GRID, "domain": [n * width + (0.02 if n else 0.0), (n + 1) * width], "anchor": f"y{tail}",
            "range": span, "title": {"text": f"corner {n + 1}, mm"}, "constrain": "domain",
        }  # fmt: skip
        axes[f"yaxis{tail}"] = {
            **GRID, "anchor": f"x{tail}", "range": span, "scaleanchor": f"x{tail}", "constrain": "domain",
            "showticklabels": n == 0,
        }  # fmt: skip
    return {"data": data, "layout": {"height": 340, "margin": {"l": 50, "r": 8, "t": 12, "b": 44}, **axes}}


def velocity_figure(v: PathVelocity) -> dict[str, Any]:
    """Path velocity of every cycle at the places where it is taken, against the commanded one."""
    x = v.length_m / MM
    data: list[dict[str, Any]] = [
        {"type": "scatter", "mode": "lines", "name": "commanded", "x": [float(x[0]), float(x[-1])],
         "y": [v.commanded_m_s / MM_PER_S] * 2, "line": {"color": "#1b2530", "width": 1.5, "dash": "dash"}}
    ]  # fmt: skip
    for j, row in enumerate(v.v):
        xs, ys = thin(x, row / MM_PER_S, np.ones(len(x), dtype=np.bool_), _POINTS)
        data.append(
            {"type": "scatter", "mode": "markers", "name": f"cycle {j + 1}", "x": numbers(xs, 2), "y": numbers(ys, 4),
             "marker": {"size": 5, "color": CYCLE_COLOURS[j % len(CYCLE_COLOURS)]}}
        )  # fmt: skip
    layout = {
        "height": 320,
        "margin": {"l": 60, "r": 12, "t": 40, "b": 44},
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0.0},
        "xaxis": {**GRID, "title": {"text": "along the commanded path, mm"}},
        "yaxis": {**GRID, "title": {"text": "path velocity, mm/s"}},
    }
    return {"data": data, "layout": layout}

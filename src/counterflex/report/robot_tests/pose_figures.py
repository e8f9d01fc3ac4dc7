"""Pictures of a pose test: clusters of attained poses about the commanded one, with their repeatability spheres."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from counterflex.core.units import UM
from counterflex.evaluate.iso9283.poses import PoseCycles
from counterflex.report.figure_data import numbers
from counterflex.report.robot_tests.section import CYCLE_COLOURS, GRID

MOST: Final = 6
_VIEWS: Final = (("x", "y", 0, 1), ("x", "z", 0, 2))


def cluster_figure(poses: Sequence[PoseCycles], radii_um: Sequence[float]) -> dict[str, Any]:
    """Deviations of the attained positions from the commanded one, in two views, all at one scale.

    The circle is the outline of the sphere of radius RP about the barycentre; the cross is the commanded position.

    Args:
        poses: Attained poses; the first :data:`MOST` are drawn.
        radii_um: RP of each, um.
    """
    drawn = list(poses[:MOST])
    d = [(one.p - one.command[:3, 3]) / UM for one in drawn]
    reach = max(float(np.abs(x.mean(axis=0)).max()) + r for x, r in zip(d, radii_um, strict=False))
    reach = 1.08 * max(reach, *(float(np.abs(x).max()) for x in d), 1e-3)
    data, axes, notes, shapes = [], {}, [], []
    width = 1.0 / len(drawn)
    for k, (x, radius) in enumerate(zip(d, radii_um, strict=False)):
        colour = CYCLE_COLOURS[k % len(CYCLE_COLOURS)]
        for v, (a, b, i, j) in enumerate(_VIEWS):
            n = 2 * k + v + 1
            tail = "" if n == 1 else str(n)
            centre = x.mean(axis=0)
            data += [
                {"type": "scatter", "mode": "markers", "x": numbers(x[:, i], 2), "y": numbers(x[:, j], 2),
                 "xaxis": f"x{tail}", "yaxis": f"y{tail}", "marker": {"size": 5, "color": colour, "opacity": 0.7},
                 "hovertemplate": f"{a} %{{x:.1f}}, {b} %{{y:.1f}} um<extra></extra>"},
                {"type": "scatter", "mode": "markers", "x": [0.0], "y": [0.0], "xaxis": f"x{tail}", "yaxis": f"y{tail}",
                 "marker": {"symbol": "cross-thin", "size": 14, "line": {"width": 2, "color": "#1b2530"}},
                 "hoverinfo": "skip"},
            ]  # fmt: skip
            shapes.append(
                {"type": "circle", "xref": f"x{tail}", "yref": f"y{tail}", "line": {"color": colour, "width": 1.5},
                 "x0": centre[i] - radius, "x1": centre[i] + radius, "y0": centre[j] - radius, "y1": centre[j] + radius}
            )  # fmt: skip
            first = k == 0
            axes[f"xaxis{tail}"] = {
                **GRID, "domain": [k * width + (0.0 if first else 0.02), (k + 1) * width], "anchor": f"y{tail}",
                "range": [-reach, reach], "title": {"text": f"{a}, um"}, "nticks": 5,
            }  # fmt: skip
            axes[f"yaxis{tail}"] = {
                **GRID, "domain": [0.56, 0.94] if v == 0 else [0.0, 0.38], "anchor": f"x{tail}", "nticks": 5,
                "range": [-reach, reach], "scaleanchor": f"x{tail}", "showticklabels": first,
                "title": {"text": f"{b}, um" if first else ""},
            }  # fmt: skip
        notes.append(
            {"text": f"<b>pose {k + 1}</b>", "xref": "paper", "yref": "paper", "x": (k + 0.5) * width, "y": 1.0,
             "showarrow": False}
        )  # fmt: skip
    layout = {
        "height": 560,
        "margin": {"l": 56, "r": 8, "t": 24, "b": 44},
        "showlegend": False,
        "shapes": shapes,
        "annotations": notes,
        **axes,
    }
    return {"data": data, "layout": layout}


def time_figure(poses: Sequence[PoseCycles]) -> dict[str, Any] | None:
    """Distance of every attained position from the commanded one over the cycles."""
    data = [
        {"type": "scatter", "mode": "lines+markers", "name": f"pose {k + 1}",
         "x": list(range(1, len(one.p) + 1)),
         "y": numbers(np.linalg.norm(one.p - one.command[:3, 3], axis=1) / UM, 2),
         "line": {"color": CYCLE_COLOURS[k % len(CYCLE_COLOURS)], "width": 1.4}, "marker": {"size": 5}}
        for k, one in enumerate(poses)
    ]  # fmt: skip
    layout = {
        "height": 340,
        "margin": {"l": 60, "r": 12, "t": 40, "b": 44},
        "legend": {"orientation": "h", "y": 1.03, "yanchor": "bottom", "x": 0.0},
        "xaxis": {**GRID, "title": {"text": "cycle"}},
        "yaxis": {**GRID, "title": {"text": "distance from the commanded position, um"}, "rangemode": "tozero"},
    }
    return {"data": data, "layout": layout}

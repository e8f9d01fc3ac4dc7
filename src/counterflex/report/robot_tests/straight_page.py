"""Page of straightness: what the least-squares line leaves of every stretch, and the figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM, UM
from counterflex.report.figure_data import numbers
from counterflex.report.robot_tests.section import CYCLE_COLOURS, GRID, Section, conditions, test_page

_POINTS: Final = 800
_MOST: Final = 8


def straight_page(summary: Mapping[str, Any], parts: Sequence[Float]) -> str:
    """The page, as HTML text.

    Args:
        parts: (n, 3) m, readings of every stretch, in the order of its rows.
    """
    largest = summary["largest"]
    verdict = (
        f"Largest straightness deviation: horizontal {largest['horizontal_um']:.1f} um, vertical "
        f"{largest['vertical_um']:.1f} um, in space {largest['cylinder_um']:.1f} um (diameter)."
    )
    names = ["horizontal", "horizontal_ls", "vertical", "vertical_ls", "cylinder", "cylinder_ls"]
    sections = [
        Section(
            "What the least-squares line leaves",
            f"Horizontal above, vertical below; at most {_MOST} stretches.",
            "rests",
        ),
        Section(
            "Each stretch, um",
            "Distance of two parallel lines (diameter of a cylinder) that hold the path, the least possible; ls: about "
            f"the least-squares line. Left out: {summary['ends_left_out']}.",
            columns=["stretch", "cycle", "length, mm", *(name.replace("_", " ") for name in names)],
            rows=[
                [
                    f"{row['stretch']} ({row['file']})",
                    str(row["cycle"]),
                    f"{row['length_mm']:.1f}",
                    *(f"{row[f'{name}_um']:.1f}" for name in names),
                ]
                for row in summary["stretches"]
            ],
        ),
        conditions(summary),
    ]
    title = f"Straightness by {summary['standard']}"
    return test_page(title, ", ".join(summary["files"][:3]), verdict, sections, {"rests": rest_figure(parts)})


def rests(p: Float) -> tuple[Float, Float, Float]:
    """Place along a line, and what its least-squares line leaves horizontally and vertically, m."""
    centre = p.mean(axis=0)
    line = np.linalg.svd(p - centre, full_matrices=False)[2][0]
    line = line * np.sign(line @ (p[-1] - p[0]))
    top = np.array([1.0, 0.0, 0.0]) if abs(line[2]) > 0.9 else np.array([0.0, 0.0, 1.0])
    vertical = top - (top @ line) * line
    vertical /= np.linalg.norm(vertical)
    side = np.cross(vertical, line)
    x, h, v = ((p - centre) @ axis for axis in (line, side, vertical))
    a = np.column_stack([np.ones(len(x)), x])
    h, v = (y - a @ np.linalg.lstsq(a, y, rcond=None)[0] for y in (h, v))
    return x, h, v


def rest_figure(parts: Sequence[Float]) -> dict[str, Any]:
    """Deviations along every stretch, horizontal and vertical."""
    data = []
    for k, p in enumerate(parts[:_MOST]):
        x, h, v = (values[:: max(1, len(p) // _POINTS)] for values in rests(p))
        for n, y in (("", h), ("2", v)):
            data.append(
                {"type": "scatter", "mode": "lines", "name": f"row {k + 1}", "showlegend": not n,
                 "legendgroup": str(k), "x": numbers(x / MM, 3), "y": numbers(y / UM, 2), "xaxis": "x",
                 "yaxis": f"y{n}", "line": {"color": CYCLE_COLOURS[k % len(CYCLE_COLOURS)], "width": 1.2}}
            )  # fmt: skip
    layout = {
        "height": 460,
        "margin": {"l": 60, "r": 12, "t": 40, "b": 44},
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0.0},
        "xaxis": {**GRID, "title": {"text": "along the stretch, from its middle, mm"}, "anchor": "y2"},
        "yaxis": {**GRID, "title": {"text": "horizontal, um"}, "domain": [0.54, 1.0]},
        "yaxis2": {**GRID, "title": {"text": "vertical, um"}, "domain": [0.0, 0.46]},
    }
    return {"data": data, "layout": layout}

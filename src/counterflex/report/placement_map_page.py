"""The page of maps over the working space: deflection of a program, stiffness and first natural frequency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.report.data import Head
from counterflex.report.page import render

_VIEWS: Final = {"level": ("x_mm", "y_mm", "x of the base, mm", "y of the base, mm"),
                 "upright": ("x_mm", "z_mm", "x of the base, mm", "height of the part frame, mm")}  # fmt: skip
_FIGURES: Final = {
    "deflection_um": ("Deflection by the program", "um"),
    "stiffness_n_per_um": ("Stiffness in the softest direction", "N/um"),
    "first_mode_hz": ("First natural frequency", "Hz"),
}
"""Title and unit."""


@dataclass(frozen=True, eq=False)
class MapData:
    """Everything on the page."""

    summary: Mapping[str, Any]
    rows: Sequence[Mapping[str, Any]]  # Of ``map.csv``

    def page(self) -> str:
        """The page, as HTML text."""
        summary = self.summary
        figures, listed = {}, []
        for key, (title, unit) in _FIGURES.items():
            for view in _VIEWS:
                name = f"{key}_{view}"
                figures[name] = map_figure(self.rows, summary["present"], view, key)
                place = "at the present height" if view == "level" else "at the present y"
                listed.append({"name": name, "title": f"{title}, {unit}, {place}"})
        best = summary["best"]["level"]
        present = summary["present"]["deflection_um"]
        verdict = "The program can be run in no place of the map."
        if best is not None:
            verdict = f"Least deflection by the model at this height: {best['deflection_um']:g} um"
            verdict += f" at x {best['x_mm']:g}, y {best['y_mm']:g} mm"
            verdict += "." if present is None else f"; {present:g} um in the present place."
        head = Head(f"Working space: {summary['program']}", f"{summary['cell']}, {summary['robot']}")
        return render("placement_map.html.j2", figures, [], data=head, summary=summary, verdict=verdict, listed=listed)


def _grid(at: Mapping[tuple[Any, Any], Mapping[str, Any]], x: list[Any], y: list[Any], key: str, missing: Any) -> Any:
    """Values by place, a row for each of y."""
    return [[at[a, b][key] if (a, b) in at else missing for a in x] for b in y]


def map_figure(rows: Sequence[Mapping[str, Any]], present: Mapping[str, Any], view: str, key: str) -> dict[str, Any]:
    """One map: places that are refused stay white; a cross marks the present place."""
    u, v, x_title, y_title = _VIEWS[view]
    at = {(row[u], row[v]): row for row in rows if row["view"] == view}
    x, y = sorted({a for a, _ in at}), sorted({b for _, b in at})
    z = _grid(at, x, y, key, None)
    known = np.array([value for row in z for value in row if value is not None], dtype=np.float64)
    high = float(np.percentile(known, 95.0)) if len(known) else 1.0
    unit = _FIGURES[key][1]
    refused = _grid(at, x, y, "refused", "")
    data = [
        {
            "type": "heatmap", "x": x, "y": y, "z": z, "text": refused, "colorscale": "Viridis",
            "zmin": float(known.min()) if len(known) else 0.0, "zmax": high, "colorbar": {"title": {"text": unit}},
            "hovertemplate": f"%{{x:.0f}}, %{{y:.0f}} mm: %{{z:.3g}} {unit} %{{text}}<extra></extra>",
            "hoverongaps": True,
        },
        {
            "type": "scatter", "mode": "markers", "x": [present[u]], "y": [present[v]], "name": "present place",
            "marker": {"symbol": "x", "size": 13, "color": "#b91c1c"}, "hoverinfo": "name",
        },
    ]  # fmt: skip
    layout = {
        "height": 460,
        "margin": {"l": 64, "r": 12, "t": 16, "b": 48},
        "showlegend": False,
        "xaxis": {"title": {"text": x_title}, "zeroline": False, "constrain": "domain"},
        "yaxis": {"title": {"text": y_title}, "zeroline": False, "scaleanchor": "x", "constrain": "domain"},
    }
    return {"data": data, "layout": layout}

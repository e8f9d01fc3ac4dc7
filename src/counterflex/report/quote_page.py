"""The page of a quotation: which tolerances will be held, how likely, and what raises it most."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from counterflex.core.arrays import Float
from counterflex.report.data import Head
from counterflex.report.figure_data import numbers
from counterflex.report.page import render

_SPAN = 3.0
"""Deviations are shown up to this many tolerances; what is further off counts at the ends."""


@dataclass(frozen=True, eq=False)
class QuoteData:
    """Everything on the page."""

    summary: Mapping[str, Any]
    off_mm: Sequence[Float]  # Of each feature, (draws,) mm

    def page(self) -> str:
        """The page, as HTML text."""
        summary = self.summary
        whole = summary["all_hold"]
        low, high = (100.0 * value for value in whole["probability_90"])
        verdict = (
            f"All tolerances that are looked at hold with a probability of {100.0 * whole['probability']:.0f} % "
            f"({low:.0f} to {high:.0f} % by {summary['draws']} drawn cells)."
        )
        head = Head(f"Quotation: {summary['part']}", f"{summary['program']} on {summary['cell']}, {summary['robot']}")
        figures = {"off": _figure(summary["features"], self.off_mm)}
        return render("quote.html.j2", figures, [], data=head, summary=summary, verdict=verdict)


def _figure(features: Sequence[Mapping[str, Any]], off_mm: Sequence[Float]) -> dict[str, Any]:
    """Deviation of each feature over the drawn cells, in its tolerances: between the lines it holds."""
    data = []
    for feature, off in zip(features, off_mm, strict=True):
        share = np.clip(off / feature["tolerance_mm"], -_SPAN, _SPAN)
        name = f"{feature['quantity']} of {feature['feature']}"
        data.append(
            {
                "type": "box",
                "x": numbers(np.quantile(share, np.linspace(0.0, 1.0, 101)), 3),
                "name": name,
                "boxpoints": False,
                "line": {"color": "#1d4ed8", "width": 1.5},
                "orientation": "h",
            }
        )
    line = {"type": "line", "y0": 0, "y1": 1, "yref": "paper", "line": {"color": "#b91c1c", "dash": "dot"}}
    layout = {
        "height": 80 + 28 * len(data),
        "margin": {"l": 170, "r": 12, "t": 8, "b": 44},
        "showlegend": False,
        "shapes": [{**line, "x0": end, "x1": end} for end in (-1.0, 1.0)],
        "xaxis": {"title": {"text": "× tolerance"}, "range": [-_SPAN, _SPAN], "zeroline": True},
        "yaxis": {"autorange": "reversed"},
    }
    return {"data": data, "layout": layout}

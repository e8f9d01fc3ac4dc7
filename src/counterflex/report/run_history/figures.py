"""Pictures of runs: curves along the path on one axis, figures from run to run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.units import MM, NS, UM
from counterflex.evaluate.run_curves import RunCurves, deviations
from counterflex.report.figure_data import numbers, thin

COLOURS: Final = (
    {"predicted": "#1d4ed8", "corrected": "#7c3aed", "remaining": "#c2410c", "measured": "#15803d",
     "measured force": "#334155", "planned force": "#a16207"},
    {"predicted": "#60a5fa", "corrected": "#d946ef", "remaining": "#fb7185", "measured": "#22c55e",
     "measured force": "#94a3b8", "planned force": "#eab308"},
)  # fmt: skip
"""One colour for each curve of the first and of the second run; those of the second are dashed too."""
_DASHES: Final = ("solid", "dash")
_SHOWN: Final = {"remaining": "remaining (model)", "predicted": "predicted (model)"}
_POINTS: Final = 4000
_GAP: Final = 0.06


def curves_figure(runs: Sequence[tuple[str, RunCurves, Float | None]], *, by_length: bool) -> dict[str, Any]:
    """Deviation across the feed and along the tool, and force, over the place along the program or over time.

    Args:
        runs: Name, curves and what the program contains (n, 2), m, or None.
        by_length: Over the place along the program; all runs have a plan.
    """
    titles = ["across the<br>feed, µm", "along the<br>tool, µm", "force, N"]
    traces: list[dict[str, Any]] = []
    for colours, dash, (name, curves, contained) in zip(COLOURS, _DASHES, runs, strict=False):
        before = f"{name}: " if len(runs) > 1 else ""
        x = curves.length_m / MM if by_length else NS * (curves.time_ns - curves.time_ns[0])
        for what, values in deviations(curves, contained).items():
            if not np.isfinite(values).any():
                continue
            mean = what == "measured"
            for row in range(2):
                seen = np.isfinite(values[:, row])
                at, y, keep = (
                    (x[seen], values[seen, row], curves.judged[seen]) if mean else (x, values[:, row], curves.judged)
                )
                shown = f"{before}{_SHOWN.get(what, what)}"
                traces.append(_trace(shown, colours[what], dash, row, at, y / UM, keep, legend=row == 0))
        for what, force in (("measured", curves.force_n), ("planned", curves.planned_n)):
            if np.isfinite(force).any():
                keep, shown = np.isfinite(force), f"{what} force"
                traces.append(_trace(f"{before}{shown}", colours[shown], dash, 2, x, force, keep, legend=True))
    return {"data": traces, "layout": _stacked(titles, "place along the program, mm" if by_length else "time, s")}


def trend_figure(figures: Mapping[str, Sequence[float | None]], titles: Mapping[str, str]) -> dict[str, Any] | None:
    """Figures from run to run, one below the other; None where no figure is known for two runs."""
    known = {name: v for name, v in figures.items() if sum(one is not None for one in v) > 1}
    if not known:
        return None
    traces = [
        {
            "type": "scatter",
            "mode": "lines+markers",
            "name": titles[name],
            "showlegend": False,
            "x": list(range(1, len(values) + 1)),
            "y": list(values),
            "xaxis": "x",
            "yaxis": f"y{k + 1 if k else ''}",
            "line": {"color": COLOURS[0]["predicted"], "width": 1.3},
        }
        for k, (name, values) in enumerate(known.items())
    ]
    layout = _stacked([titles[name].replace(": ", ":<br>").replace(", ", ",<br>") for name in known], "run")
    layout["height"] = 120 + 130 * len(known)
    return {"data": traces, "layout": layout}


def _trace(
    name: str, colour: str, dash: str, row: int, x: Float, y: Float, keep: Bool, *, legend: bool
) -> dict[str, Any]:
    x, y = thin(x, y, keep, _POINTS)
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "legendgroup": name,
        "showlegend": legend,
        "x": numbers(x, 3),
        "y": numbers(y, 1),
        "xaxis": "x",
        "yaxis": f"y{row + 1 if row else ''}",
        "line": {"color": colour, "width": 1.3, "dash": dash},
        "connectgaps": False,
    }


def _stacked(titles: Sequence[str], x_title: str) -> dict[str, Any]:
    n = len(titles)
    share = (1.0 - _GAP * (n - 1)) / n
    layout: dict[str, Any] = {
        "height": 620,
        "margin": {"l": 84, "r": 14, "t": 90, "b": 46},
        "legend": {"orientation": "h", "x": 0.0, "y": 1.02, "yanchor": "bottom"},
        "xaxis": {"title": {"text": x_title}, "anchor": f"y{n if n > 1 else ''}", "zeroline": False},
    }
    for row, title in enumerate(titles):
        top = 1.0 - row * (share + _GAP)
        layout[f"yaxis{row + 1 if row else ''}"] = {
            "domain": [max(round(top - share, 4), 0.0), round(top, 4)],
            "title": {"text": title, "font": {"size": 12}},
            "zeroline": True,
            "zerolinecolor": "#b8c0c8",
        }
    return layout

"""The page of a groove milled with several ways of correcting: figures by variant, error and force along the cut."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.units import MM
from counterflex.report.data import Head
from counterflex.report.figure_data import numbers, thin
from counterflex.report.page import render

COLOURS: Final = ("#6b7280", "#c2410c", "#d9a000", "#0369a1", "#7c3aed", "#15803d", "#be185d", "#0e7490")
_POINTS: Final = 900
_SHADES: Final = {"entering": "rgba(3, 105, 161, 0.08)", "leaving": "rgba(217, 169, 58, 0.16)"}
_EDGE: Final = "#1b2530"


@dataclass(frozen=True, eq=False)
class GrooveRun:
    """One groove."""

    variant: str
    edge: str  # Name of the edge that the tool leaves through
    seed: int
    place_m: Float  # (k,) place along the cut, 0 where the tool's centre enters the blank
    left_m: Float  # (k,) error across the feed to the left, seen from the spindle; m
    axis_m: Float  # (k,) error along the tool axis, positive is too little depth; m
    force_n: Float  # (k,) size of the process force
    cutting: Bool  # (k,) material is removed
    entering: Bool  # (k,) from first contact to the plateau, part of ``cutting``
    leaving: Bool  # (k,) where the tool leaves, likewise


@dataclass(frozen=True)
class Dot:
    """Largest errors of one groove."""

    variant: str
    edge: str
    seed: int
    path_mm: float
    exit_mm: float  # Where the tool leaves


@dataclass(frozen=True, kw_only=True)
class GrooveData(Head):
    """Everything on the page."""

    verdict: str
    cards: Sequence[tuple[str, str, str]]
    parts: Sequence[str]  # Names of the columns of the table under each edge
    rows: Sequence[tuple[str, Sequence[str], str, str]]  # Variant, cells, figure of the paper, runs counted
    refused: str  # What is said of runs that are not counted, or empty
    edges: Mapping[str, float]  # Length of the cut by name of the edge, m
    edge_titles: Mapping[str, str]
    dots: Sequence[Dot]  # Largest errors
    runs: Sequence[GrooveRun]
    first_seed: int
    paper: Mapping[str, float]  # Published figure by variant, mm
    goals: Mapping[str, float]  # Goal by variant, mm
    slender: Sequence[str] = ()  # Variants that are drawn only when asked for


def groove_page(data: GrooveData) -> str:
    """The page, as HTML text."""
    figures = {"dots": _dots(data)} | {f"along_{edge}": _along(data, edge) for edge in data.edges}
    return render("groove.html.j2", figures, [], package="counterflex_lab.reproduce", data=data)


def _variants(data: GrooveData) -> list[str]:
    return list(dict.fromkeys(dot.variant for dot in data.dots))


def _dots(data: GrooveData) -> dict[str, Any]:
    """Largest error of every groove by variant, an axis for each edge; the paper's figures and the goals as marks."""
    names, edges = _variants(data), list(data.edges)
    traces: list[dict[str, Any]] = []
    layout: dict[str, Any] = {
        "height": 120 + 40 * len(names),
        "margin": {"l": 130, "r": 12, "t": 58, "b": 44},
        "legend": {"orientation": "h", "y": 1.09, "yanchor": "bottom", "x": 0.0},
        "yaxis": {"categoryorder": "array", "categoryarray": names[::-1], "automargin": True},
        "annotations": [],
    }
    largest = max([dot.path_mm for dot in data.dots] + list(data.paper.values()), default=1.0)
    gap = 0.04
    width = (1.0 - gap * (len(edges) - 1)) / max(1, len(edges))
    for k, edge in enumerate(edges):
        suffix = "" if k == 0 else str(k + 1)
        low = k * (width + gap)
        layout[f"xaxis{suffix}"] = {
            "domain": [low, low + width],
            "title": {"text": "largest error across the feed, mm"},
            "range": [0.0, 1.06 * largest],
        }
        layout["annotations"].append(
            {
                "text": f"<b>{data.edge_titles[edge]}</b>",
                "showarrow": False,
                "xref": "paper",
                "yref": "paper",
                "x": low,
                "y": 1.0,
                "yanchor": "bottom",
                "xanchor": "left",
            }
        )
        here = [dot for dot in data.dots if dot.edge == edge]
        truths = [f"truth {dot.seed}" for dot in here]
        for name, values, symbol, colour in (
            ("whole cut", [d.path_mm for d in here], "circle", "#0369a1"),
            ("where the tool leaves", [d.exit_mm for d in here], "diamond-open", "#c2410c"),
        ):
            traces.append(
                _marks(name, suffix, values, [d.variant for d in here], symbol, colour, truths)
                | {"showlegend": k == 0, "legendgroup": name}
            )
        for name, values_of, symbol, colour in (
            ("Haehn2020, largest of one part", data.paper, "line-ns-open", "#1b2530"),
            ("goal", data.goals, "triangle-up-open", "#15803d"),
        ):
            known = [n for n in names if n in values_of]
            traces.append(
                _marks(name, suffix, [values_of[n] for n in known], known, symbol, colour, [name] * len(known))
                | {"showlegend": k == 0, "legendgroup": name}
            )
    return {"data": traces, "layout": layout}


def _marks(
    name: str, suffix: str, x: Sequence[float], y: Sequence[str], symbol: str, colour: str, text: Sequence[str]
) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "markers",
        "name": name,
        "x": numbers(np.array(x, dtype=np.float64), 4),
        "y": list(y),
        "xaxis": f"x{suffix}",
        "text": list(text),
        "hovertemplate": "%{y}: %{x} mm, %{text}<extra></extra>",
        "marker": {"symbol": symbol, "color": colour, "size": 15 if "line" in symbol else 9, "line": {"width": 2}},
    }


def _along(data: GrooveData, edge: str) -> dict[str, Any]:
    """Error to the left, error in depth and force along the cut; a truth is chosen by a menu."""
    runs = [run for run in data.runs if run.edge == edge]
    seeds = sorted({run.seed for run in runs})
    colours = dict(zip(_variants(data), _colours(_variants(data), data.slender), strict=True))
    traces: list[dict[str, Any]] = []
    shown: list[tuple[int, Any]] = []
    for run in runs:
        usual: Any = "legendonly" if run.variant in data.slender else True
        rows = (
            (run.left_m / MM, 4, run.cutting),
            (run.axis_m / MM, 4, run.cutting),
            (run.force_n, 1, np.ones(len(run.force_n), dtype=np.bool_)),
        )
        for row, (values, digits, keep) in enumerate(rows):
            x, y = thin(run.place_m / MM, values, keep, _POINTS)
            line: dict[str, Any] = {"color": colours[run.variant], "width": 1.6}
            if run.variant in data.slender:
                line["dash"] = "dot"
            traces.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "name": run.variant,
                    "legendgroup": run.variant,
                    "showlegend": row == 0,
                    "x": numbers(x, 2),
                    "y": numbers(y, digits),
                    "yaxis": "y" if row == 0 else f"y{row + 1}",
                    "line": line,
                    "visible": usual if run.seed == data.first_seed else False,
                }
            )
            shown.append((run.seed, usual))
    end = data.edges[edge] / MM
    layout: dict[str, Any] = {
        "height": 640,
        "margin": {"l": 78, "r": 12, "t": 40, "b": 44},
        "xaxis": {
            "title": {"text": "place of the tool's centre along the cut, mm (0: enters the blank)"},
            "range": [-12.0, end + 14.0],
            "anchor": "y3",
        },
        "hovermode": "x",
        "legend": {"orientation": "h", "y": 1.09, "x": 0.13},
        "shapes": _edges_and_leaving(runs, end),
    }
    for key, domain, title in (
        ("yaxis", [0.55, 1.0], "error left<br>of the feed, mm"),
        ("yaxis2", [0.28, 0.50], "error in depth<br>(+ too little), mm"),
        ("yaxis3", [0.0, 0.23], "process<br>force, N"),
    ):
        layout[key] = {"domain": domain, "title": {"text": title}, "zerolinecolor": "#9aa5b0"}
    if len(seeds) > 1:
        layout["updatemenus"] = [_menu(seeds, data.first_seed, shown)]
    return {"data": traces, "layout": layout}


def _menu(seeds: Sequence[int], first: int, shown: Sequence[tuple[int, Any]]) -> dict[str, Any]:
    """Menu that shows the runs of one truth."""
    buttons = [
        {
            "label": f"truth {seed}",
            "method": "restyle",
            "args": ["visible", [usual if s == seed else False for s, usual in shown]],
        }
        for seed in seeds
    ]
    return {"x": 0.0, "y": 1.13, "xanchor": "left", "active": seeds.index(first), "buttons": buttons}


def _colours(names: Sequence[str], slender: Sequence[str]) -> list[str]:
    """A colour for each; a slender variant has that of the one it is named after."""
    whole = [name for name in names if name not in slender]
    own = {name: COLOURS[k % len(COLOURS)] for k, name in enumerate(whole)}
    out = []
    for name in names:
        parent = max((w for w in whole if name.startswith(w)), key=len, default=name)
        out.append(own.get(parent, COLOURS[-1]))
    return out


def _edges_and_leaving(runs: Sequence[GrooveRun], end_mm: float) -> list[dict[str, Any]]:
    """Both edges of the blank as lines; where the tool enters and leaves, in the first run, as shades."""
    shapes = [
        {
            "type": "line",
            "xref": "x",
            "yref": "paper",
            "x0": x,
            "x1": x,
            "y0": 0.0,
            "y1": 1.0,
            "line": {"color": _EDGE, "width": 1, "dash": "dash"},
        }
        for x in (0.0, end_mm)
    ]
    for run, part in ((run, part) for run in runs[:1] for part in _SHADES):
        places = run.place_m[run.entering if part == "entering" else run.leaving] / MM
        if len(places) == 0:
            continue
        shapes.append(
            {
                "type": "rect",
                "xref": "x",
                "yref": "paper",
                "x0": round(float(places.min()), 2),
                "x1": round(float(places.max()), 2),
                "y0": 0.0,
                "y1": 1.0,
                "fillcolor": _SHADES[part],
                "line": {"width": 0},
                "layer": "below",
            }
        )
    return shapes

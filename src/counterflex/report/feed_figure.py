"""The feed along a program, coloured by the limit that binds."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from counterflex.core.units import MM_PER_MIN
from counterflex.report.data import FeedData
from counterflex.report.figure_data import numbers

COLOURS: Final = ("#b91c1c", "#1d4ed8", "#15803d", "#b45309", "#7e22ce", "#0e7490", "#be185d", "#4d7c0f", "#334155")


def feed_figure(data: FeedData) -> dict[str, Any]:
    """Programmed feed as a grey line, the written one in the colour of the limit that binds, black where none does."""
    way = data.way_m
    feed = data.feed_m_s / MM_PER_MIN
    traces: list[dict[str, Any]] = [
        _line("programmed", way, np.where(np.isnan(feed), np.nan, data.programmed_m_s / MM_PER_MIN), "#94a3b8", "dot")
    ]
    binds = np.array(data.binds)
    colours = dict(zip(sorted(set(data.binds) - {""}), COLOURS * 3, strict=False))
    for name, colour in {"": "#0f172a", **colours}.items():
        own = binds == name
        shown = own | np.append(own[1:], False)  # a row is the end of its segment: its beginning belongs to it
        if own.any():
            traces.append(_line(name or "no limit binds", way, np.where(shown, feed, np.nan), colour, "solid"))
    layout = {
        "height": 300,
        "margin": {"l": 64, "r": 12, "t": 8, "b": 48},
        "legend": {"orientation": "h", "y": 1.12},
        "xaxis": {"title": {"text": "way along the program, m"}, "zeroline": False},
        "yaxis": {"title": {"text": "feed, mm/min"}, "rangemode": "tozero"},
    }
    return {"data": traces, "layout": layout}


def _line(name: str, way_m: Any, feed: Any, colour: str, dash: str) -> dict[str, Any]:
    return {
        "type": "scatter", "mode": "lines", "name": name, "x": numbers(way_m, 4), "y": numbers(feed, 1),
        "line": {"color": colour, "dash": dash, "width": 1.5 if dash == "dot" else 2.5, "shape": "vh"},
        "connectgaps": False,
    }  # fmt: skip

"""The page of wrong plans: what each way of correcting leaves, as tables and as marks over the simulated cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from counterflex.report.data import Head
from counterflex.report.figure_data import numbers
from counterflex.report.page import render
from counterflex_lab.reproduce.groove_page import COLOURS


@dataclass(frozen=True)
class Mark:
    """One groove."""

    row: str
    way: str
    seed: int
    path_mm: float  # Path error, 99.7 %


@dataclass(frozen=True, kw_only=True)
class WrongPlansData(Head):
    """Everything on the page."""

    verdict: str
    ways: Sequence[str]
    about: Sequence[tuple[str, str]]  # Name and meaning of each way of correcting
    tables: Sequence[tuple[str, Sequence[Sequence[str]]]]  # Heading and rows, the first cell of a row what is wrong
    refused: str  # What is said of runs that are not counted, or empty
    marks: Sequence[Mark]  # Every groove


def wrong_plans_page(data: WrongPlansData) -> str:
    """The page, as HTML text."""
    return render("wrong_plans.html.j2", {"marks": _marks(data)}, [], package="counterflex_lab.reproduce", data=data)


def _marks(data: WrongPlansData) -> dict[str, Any]:
    """Path error of every groove by what is wrong, a colour for each way of correcting."""
    rows = list(dict.fromkeys(mark.row for mark in data.marks))
    traces = [
        {
            "type": "scatter",
            "mode": "markers",
            "name": way,
            "x": numbers(np.array([m.path_mm for m in data.marks if m.way == way], dtype=np.float64), 4),
            "y": [m.row for m in data.marks if m.way == way],
            "text": [f"truth {m.seed}" for m in data.marks if m.way == way],
            "hovertemplate": f"{way}: %{{x}} mm, %{{text}}<extra></extra>",
            "marker": {"color": COLOURS[k % len(COLOURS)], "size": 9},
        }
        for k, way in enumerate(data.ways)
    ]
    layout = {
        "height": 140 + 50 * len(rows),
        "margin": {"l": 130, "r": 12, "t": 40, "b": 44},
        "legend": {"orientation": "h", "y": 1.04, "yanchor": "bottom", "x": 0.0},
        "xaxis": {"title": {"text": "path error, 99.7 %, mm"}, "rangemode": "tozero"},
        "yaxis": {"categoryorder": "array", "categoryarray": rows[::-1], "automargin": True},
    }
    return {"data": traces, "layout": layout}

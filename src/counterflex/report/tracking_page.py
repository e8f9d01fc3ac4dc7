"""The page of a tracker in the loop: true error of the tool with each controller, on straights, corners and circle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.units import MM, UM
from counterflex.report.arrays_json import numbers, thin
from counterflex.report.page import render

COLOURS: Final = ("#8a8f98", "#c2410c", "#0369a1", "#15803d")
MAGNIFIED: Final = 250.0
"""Errors of the circle are drawn this much larger than the circle: 200 um are 50 mm."""
_POINTS: Final = 3000


@dataclass(frozen=True)
class TrackedRun:
    """One controller on one path.

    Attributes:
        name: Of the controller.
        time_s: (n,) s.
        p_command: (n, 3) m.
        p_actual: (n, 3) m.
        shown: (n,) samples that count.
    """

    name: str
    time_s: Float
    p_command: Float
    p_actual: Float
    shown: Bool


@dataclass(frozen=True)
class TrackingData:
    """Everything on the page.

    Attributes:
        title: Headline.
        subtitle: One line below it.
        created: Date as printed, or empty.
        verdict: The result in one sentence.
        columns: Header of the table of figures.
        rows: Its rows.
        margin_columns: Header of the table of margins.
        margin_rows: Its rows.
        paper: What the paper reports, one line each.
        square: Runs of the square, one truth.
        circle: Runs of the circle, the same truth.
        timing: See :class:`counterflex.report.data.ReportData`.
        versions: See there.
    """

    title: str
    subtitle: str
    created: str
    verdict: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    margin_columns: Sequence[str]
    margin_rows: Sequence[Sequence[str]]
    paper: Sequence[str]
    square: Sequence[TrackedRun]
    circle: Sequence[TrackedRun]
    timing: tuple[Any, ...] = ()
    versions: Mapping[str, str] = field(default_factory=dict)


def tracking_page(data: TrackingData) -> str:
    """The page, as HTML text."""
    figures = {
        "square": _over_time(data.square, "true distance from the set-point, um"),
        "circle": _magnified(data.circle),
        "turn": _over_time(data.circle, "true distance from the set-point, um"),
    }
    return render("tracking.html.j2", figures, [], data=data, magnified=f"{MAGNIFIED:g}")


def _over_time(runs: Sequence[TrackedRun], title: str) -> dict[str, Any]:
    lines = []
    for run, colour in zip(runs, COLOURS, strict=False):
        size = np.linalg.norm(run.p_actual - run.p_command, axis=1) / UM
        x, y = thin(run.time_s, size, run.shown, _POINTS)
        lines.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": run.name,
                "x": numbers(x, 3),
                "y": numbers(y, 1),
                "line": {"color": colour, "width": 1.2},
            }
        )
    layout = {
        "height": 340,
        "margin": {"l": 70, "r": 12, "t": 8, "b": 44},
        "xaxis": {"title": {"text": "time, s"}},
        "yaxis": {"title": {"text": title}, "type": "log"},
        "legend": {"orientation": "h", "y": 1.08},
        "hovermode": "x unified",
    }
    return {"data": lines, "layout": layout}


def _magnified(runs: Sequence[TrackedRun]) -> dict[str, Any]:
    """Circle with its radial error drawn larger, and the nominal circle."""
    lines: list[dict[str, Any]] = []
    for run, colour in zip(runs, COLOURS, strict=False):
        p = run.p_actual[run.shown][:, :2]
        command = run.p_command[run.shown][:, :2]
        if len(p) == 0:
            continue
        radius = float(np.mean(np.hypot(*command.T)))
        if not lines:
            angle = np.linspace(0.0, 2.0 * np.pi, 361)
            lines.append(_curve("nominal", "#1b2530", radius * np.cos(angle), radius * np.sin(angle), 0.8))
        angle, error = np.arctan2(p[:, 1], p[:, 0]), np.hypot(*p.T) - radius
        step = max(1, len(p) // _POINTS)
        drawn = radius + MAGNIFIED * error
        lines.append(_curve(run.name, colour, (drawn * np.cos(angle))[::step], (drawn * np.sin(angle))[::step], 1.4))
    layout = {
        "height": 620,
        "margin": {"l": 60, "r": 12, "t": 8, "b": 44},
        "xaxis": {"title": {"text": "x, mm"}, "scaleanchor": "y"},
        "yaxis": {"title": {"text": "y, mm"}},
        "legend": {"orientation": "h", "y": 1.05},
    }
    return {"data": lines, "layout": layout}


def _curve(name: str, colour: str, x: Float, y: Float, width: float) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "x": numbers(x / MM, 2),
        "y": numbers(y / MM, 2),
        "line": {"color": colour, "width": width},
    }

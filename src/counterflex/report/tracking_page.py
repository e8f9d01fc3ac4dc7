"""The page of a tracker in the loop: true error of the tool with each controller, on straights, corners and circle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from counterflex.core.arrays import Float
from counterflex.report.page import render
from counterflex.report.tracking_figures import FINELY, MAGNIFIED, OpenLoop, TrackedRun, figures


@dataclass(frozen=True)
class TrackingData:
    """Everything on the page."""

    title: str
    subtitle: str
    created: str  # Date as printed, or empty
    verdict: str
    comparison: tuple[Sequence[str], Sequence[Sequence[str]]]  # Header and rows of the table beside the paper's figures
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    margin_columns: Sequence[str]
    margin_rows: Sequence[Sequence[str]]
    paper: Sequence[str]  # What the paper reports, one line each
    square: Sequence[TrackedRun]  # Runs of the square, one truth, the controller of interest last
    circle: Sequence[TrackedRun]  # Runs of the circle, the same truth
    loops: Sequence[OpenLoop]
    p_part: Float  # (3,) m, the corner of the square that is shown
    reach_m: float  # Half of what is shown of it
    timing: tuple[Any, ...] = ()
    versions: Mapping[str, str] = field(default_factory=dict)


def tracking_page(data: TrackingData) -> str:
    """The page, as HTML text."""
    drawn = figures(data.circle, data.square, data.loops, data.p_part, data.reach_m)
    return render("tracking.html.j2", drawn, [], data=data, magnified=f"{MAGNIFIED:g}", finely=f"{FINELY:g}")

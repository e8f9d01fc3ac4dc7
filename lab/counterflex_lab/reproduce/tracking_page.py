"""The page of a tracker in the loop: true error of the tool with each controller, on straights, corners and circle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from counterflex.core.arrays import Float
from counterflex.report.data import Head
from counterflex.report.page import render
from counterflex_lab.reproduce.tracking_figures import FINELY, MAGNIFIED, OpenLoop, TrackedRun, figures


@dataclass(frozen=True, kw_only=True)
class TrackingData(Head):
    """Everything on the page."""

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


def tracking_page(data: TrackingData) -> str:
    """The page, as HTML text."""
    drawn = figures(data.circle, data.square, data.loops, data.p_part, data.reach_m)
    return render(
        "tracking.html.j2",
        drawn,
        [],
        package="counterflex_lab.reproduce",
        data=data,
        magnified=f"{MAGNIFIED:g}",
        finely=f"{FINELY:g}",
    )

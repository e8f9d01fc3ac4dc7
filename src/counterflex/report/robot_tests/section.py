"""A page of a standard test: sections with a picture, a table, or both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from counterflex.report.data import Head
from counterflex.report.page import render

CYCLE_COLOURS: Final = ("#0369a1", "#c2410c", "#15803d", "#7c3aed", "#b45309", "#0f766e", "#be185d", "#4d7c0f")
GRID: Final = {"zeroline": True, "zerolinecolor": "#c5cdd5", "showgrid": True, "gridcolor": "#eef1f4"}


@dataclass(frozen=True)
class Section:
    """One part of the page."""

    title: str
    lead: str = ""
    figure: str = ""  # Name of its picture, or empty
    columns: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()


def test_page(
    title: str, subtitle: str, verdict: str, sections: Sequence[Section], figures: Mapping[str, dict[str, Any]]
) -> str:
    """The page, as HTML text."""
    head = Head(title, subtitle)
    return render("robot_test.html.j2", dict(figures), [], data=head, verdict=verdict, sections=sections)


def conditions(summary: Mapping[str, Any]) -> Section:
    """Return how the figures were made."""
    rows = [
        ["files", ", ".join(summary["files"])],
        ["commanded", summary["commanded"]],
        [
            "frame",
            summary["frame"] + (" (accuracies leave out what a frame absorbs)" if summary["frame_fitted"] else ""),
        ],
        ["filter", summary["filter"]],
        ["standard deviation of the tracker as stated", f"{summary['tracker_sigma_um']:g} um"],
    ]
    noise = (
        "The figures contain the noise of the instrument and the errors that all readings share: of frame and scale."
    )
    if "confidence" in summary:
        noise = (
            "Intervals hold the true figure with 95 % confidence, from the scatter of the cycles that were measured. "
            "They contain the noise of the instrument, not errors that all readings share: of the frame, of its scale."
        )
    return Section("How it was measured", noise, columns=["", ""], rows=rows)

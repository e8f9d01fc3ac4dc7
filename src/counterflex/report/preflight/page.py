"""The page of a preflight: the table of checks, the joint margins, and what the robot does along the path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.report.figure_data import numbers, thin
from counterflex.report.page import render
from counterflex.report.preflight.path_figures import COLOURS, PathCurves

_POINTS: Final = 3000
_MARKS: Final = {"fail": "#b91c1c", "warning": "#c2410c"}
_HEIGHT: Final = 460


@dataclass(frozen=True, eq=False)
class PreflightData:
    """Everything on the page."""

    title: str
    subtitle: str
    checks: Sequence[Mapping[str, Any]]  # Rows of the table, see :func:`counterflex.app.preflight.shown`
    failed: bool
    time_s: Float  # (m,) at the programmed feed
    margin_deg: Float  # (m, 6) distance of each axis to its nearer limit
    least_deg: float  # Least margin
    line: Int  # (m,) line of the program
    points: Sequence[int | None]  # Row of the path by check, None for checks that have none
    cutting: Bool  # (m,) at feed
    bodies: Sequence[Mapping[str, Any]]  # Coarse bodies: name, frame, shape, assumed
    curves: PathCurves | None = None  # Along the path; None where nothing is reached
    created: str = ""  # Date as printed, or empty

    def page(self) -> str:
        """The page, as HTML text."""
        figures = {"margins": self.margin_figure()} if len(self.time_s) else {}
        if self.curves is not None:
            figures |= self.curves.figures()
        count = {
            verdict: sum(row["verdict"] == verdict for row in self.checks)
            for verdict in ("fail", "warning", "not looked at")
        }
        verdict = (
            f"{count['fail']} check{'s fail' if count['fail'] > 1 else ' fails'}: the program is not to be run on this "
            "cell as it is."
            if self.failed
            else "No hard check fails."
        )
        warnings = f"{count['warning']} warning{'' if count['warning'] == 1 else 's'}"
        verdict += f" {warnings}; {count['not looked at']} hazards are not looked at."
        return render("preflight.html.j2", figures, [], data=self, verdict=verdict, drawn=list(figures))

    def margin_figure(self) -> dict[str, Any]:
        """Margins of the six axes over time; checks that fail or warn are marked with their line of the program."""
        whole = np.ones(len(self.time_s), dtype=np.bool_)
        traces: list[dict[str, Any]] = []
        for axis, colour in enumerate(COLOURS):
            x, y = thin(self.time_s, self.margin_deg[:, axis], whole, _POINTS)
            traces.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "name": f"axis {axis + 1}",
                    "x": numbers(x, 3),
                    "y": numbers(y, 3),
                    "line": {"color": colour, "width": 1.6},
                }
            )
        high = float(max(np.max(self.margin_deg), self.least_deg))
        low = float(min(np.min(self.margin_deg), 0.0))
        shapes: list[dict[str, Any]] = [_level(0.0, "#1b2530", "solid"), _level(self.least_deg, "#b91c1c", "dash")]
        notes: list[dict[str, Any]] = [
            {
                "text": f"least margin {self.least_deg:g} deg",
                "xref": "paper",
                "x": 1.0,
                "xanchor": "right",
                "y": self.least_deg,
                "yanchor": "bottom",
                "showarrow": False,
                "font": {"size": 11, "color": "#b91c1c"},
            }
        ]
        marked = self._marked()
        for at, (time, text, colour) in enumerate(marked):
            shapes.append(
                {"type": "line", "x0": time, "x1": time, "yref": "paper", "y0": 0.0, "y1": 1.0,
                 "line": {"color": colour, "width": 1.2, "dash": "dot"}}
            )  # fmt: skip
            notes.append(
                {"text": text, "x": time, "yref": "paper", "y": 1.0 - 0.065 * (at % 6), "yanchor": "top",
                 "showarrow": False, "xanchor": "right" if time > 0.6 * float(self.time_s[-1]) else "left",
                 "bgcolor": "rgba(255,255,255,0.85)", "font": {"size": 11, "color": colour}}
            )  # fmt: skip
        room = 0.06 * (high - low)
        layout = {
            "height": _HEIGHT,
            "margin": {"l": 64, "r": 12, "t": 40, "b": 44},
            "hovermode": "x",
            "legend": {"orientation": "h", "y": 1.03, "yanchor": "bottom", "x": 0.0},
            "xaxis": {"title": {"text": "time at the programmed feed, s"}, "zeroline": False},
            "yaxis": {"title": {"text": "distance to the joint limit, deg"}, "range": [low - room, high + room]},
            "shapes": shapes,
            "annotations": notes,
        }
        narrow = {"height": _HEIGHT, "margin": {"l": 48, "r": 6, "t": 70, "b": 44}}
        narrow |= {f"annotations[{k + 1}].text": _short(text) for k, (_, text, _) in enumerate(marked)}
        return {"data": traces, "layout": layout, "narrow": narrow}

    def _marked(self) -> list[tuple[float, str, str]]:
        """Time, text and colour of what fails or warns, and of the smallest margin; one mark for each place."""
        marks: dict[int, tuple[list[str], str]] = {}
        for row, point in zip(self.checks, self.points, strict=True):
            if point is None or not (row["verdict"] in _MARKS or row["check"] == "joint limits"):
                continue
            texts, colour = marks.get(point, ([], "#1b2530"))
            colour = _MARKS.get(row["verdict"], colour) if colour != _MARKS["fail"] else colour
            marks[point] = ([*texts, str(row["check"])], colour)
        return [
            (round(float(self.time_s[point]), 3), f"line {int(self.line[point])}: {', '.join(texts)}", colour)
            for point, (texts, colour) in sorted(marks.items())
        ]


def _short(text: str) -> str:
    """The number of the line alone, for a narrow screen; the table says the rest."""
    return text.split(":")[0].removeprefix("line ")


def _level(y: float, colour: str, dash: str) -> dict[str, Any]:
    line = {"color": colour, "width": 1.2, "dash": dash}
    return {"type": "line", "xref": "paper", "x0": 0.0, "x1": 1.0, "y0": y, "y1": y, "line": line}

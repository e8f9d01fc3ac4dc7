"""Pages of runs that have ended, as HTML text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.units import MM, NS, UM
from counterflex.evaluate.run_curves import RunCurves, deviations
from counterflex.report.data import Head
from counterflex.report.figure_data import numbers, thin
from counterflex.report.page import render

COLOURS: Final = (
    {"predicted": "#1d4ed8", "corrected": "#7c3aed", "remaining": "#c2410c", "measured": "#15803d",
     "measured force": "#334155", "planned force": "#a16207"},
    {"predicted": "#60a5fa", "corrected": "#d946ef", "remaining": "#fb7185", "measured": "#22c55e",
     "measured force": "#94a3b8", "planned force": "#eab308"},
)  # fmt: skip
"""One colour for each curve of the first and of the second run; those of the second are dashed too."""
_DASHES: Final = ("solid", "dash")
_SHOWN_IN_FIGURE: Final = {"remaining": "remaining (model)", "predicted": "predicted (model)"}
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
                shown = f"{before}{_SHOWN_IN_FIGURE.get(what, what)}"
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


_SHOWN: Final = 200
_HISTORY: Final = {
    "begun": "begun (UTC)",
    "program": "program",
    "folder": "folder",
    "run": "run",
    "seconds": "s",
    "share_percent": "path, %",
    "predicted_um": "predicted, µm",
    "corrected_um": "corrected, µm",
    "remaining_um": "remaining (model), µm",
    "measured_um": "measured, µm",
    "force_peak_n": "force, N",
    "force_ratio": "measured / planned force",
    "incidents": "incidents",
    "reply_p99_us": "answer p99, µs",
    "reply_max_us": "answer max, µs",
    "telegrams_lost": "telegrams lost",
    "records_lost": "records lost",
}


@dataclass(frozen=True, eq=False)
class ShownRun:
    """A run on a page."""

    name: str
    figures: Mapping[str, float | None]  # By name; None: not known
    curves: RunCurves
    contained_m: Float | None  # (n, 2) m, correction that the program contains, or None
    incidents: Sequence[Mapping[str, Any]]
    actions: Sequence[Mapping[str, Any]]  # What operators did: time_s, who, from, action, done, refused
    facts: Mapping[str, str]
    verdict: str = ""

    def story(self) -> list[_Section]:
        """Return what happened in a run, and what it was made of."""
        out = []
        if self.incidents:
            keys = ("number", "time_s", "state", "cause")
            rows = tuple(tuple(_text(one[key]) for key in keys) for one in self.incidents[:_SHOWN])
            out.append(_Section(f"Holds and faults of {self.name}", "", ("number", "time, s", "state", "cause"), rows))
        if self.actions:
            rows = tuple(
                (
                    _text(one.get("time_s")),
                    str(one.get("who", "")),
                    str(one.get("from", "")),
                    str(one.get("action", one.get("text", ""))),
                    "done" if one.get("done") else str(one.get("refused", "")),
                )
                for one in self.actions[:_SHOWN]
            )
            out.append(_Section(f"Operators of {self.name}", "", ("time, s", "who", "from", "action", "outcome"), rows))
        out.append(
            _Section(f"What {self.name} was made of", "", ("", ""), tuple((k, v) for k, v in self.facts.items()))
        )
        return out


@dataclass(frozen=True)
class _Section:
    title: str
    lead: str = ""
    heads: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    figure: str = ""

    @classmethod
    def trends(cls, program: Mapping[str, Any], name: str, figures: dict[str, Any]) -> _Section:
        """Trends of a program; adds their picture."""
        titles = {
            one["figure"]: one["title"] + (f", {one['unit']}" if one["unit"] else "") for one in program["trends"]
        }
        trends = tuple(
            (
                titles[one["figure"]],
                _text(one["mean"]),
                f"{one['slope_per_run']:+.4g} ± {one['half_width95']:.2g}",
                "changes" if one["clear"] else "no change to be told",
                str(one["runs"]),
            )
            for one in program["trends"]
        )
        drawn = trend_figure({key: program["figures"][key] for key in titles}, titles)
        if drawn is not None:
            figures[name] = drawn
        lead = "Change from run to run, least squares, with its 95 % interval; from four runs on."
        heads = ("figure", "mean", "change per run", "verdict", "runs")
        title = f"{program['program'] or program['program_sha256'][:12]}: {len(program['runs'])} runs"
        return cls(title, lead, heads, trends, name if drawn is not None else "")


def history_page(summary: Mapping[str, Any]) -> str:
    """The page of all runs and of the trends over runs of the same program."""
    rows = []
    for row in summary["runs"]:
        reply = row["reply_us"] or {}
        flat = {**row, "reply_p99_us": reply.get("p99"), "reply_max_us": reply.get("max")}
        rows.append(tuple(_text(flat[name]) for name in _HISTORY))
    lead = (
        "Deviations: 99.7 % of the cut, across the feed and along the tool. Predicted: deflection under the force of"
        " the run. Corrected: by program and loop. Remaining: their sum, by the model, without the robot's lag."
        " Measured: by a tracker. –: not known."
    )
    sections = [_Section("Runs", lead, tuple(_HISTORY.values()), tuple(rows))]
    figures: dict[str, Any] = {}
    for k, program in enumerate(summary["programs"]):
        if len(program["runs"]) > 1:
            sections.append(_Section.trends(program, f"trend{k}", figures))
    notes = [f"{one['folder']} cannot be read: {one['why']}" for one in summary["unreadable"]]
    head = Head("Runs", summary["folder"], notes=notes)
    verdict = f"{len(summary['runs'])} runs of {len(summary['programs'])} known programs."
    return render("run_history.html.j2", figures, [], data=head, verdict=verdict, sections=sections)


def _compared(text: str, values: Sequence[float | None]) -> tuple[str, ...]:
    """A figure of one run, or of two with their difference."""
    known = [value for value in values if value is not None]
    change = f"{known[1] - known[0]:+.4g}" if len(known) == 2 else "–"
    return (text, *(_text(value) for value in values), *((change,) if len(values) == 2 else ()))


def runs_page(title: str, subtitle: str, runs: Sequence[ShownRun], names: Mapping[str, str], notes: list[str]) -> str:
    """The page of one run, or of two beside each other.

    Args:
        subtitle: One line below it: the cell and the log.
        names: Headings of the figures by name, in order.
    """
    heads = ("figure", *(one.name for one in runs), *(("difference",) if len(runs) == 2 else ()))
    rows = [_compared(text, [one.figures[name] for one in runs]) for name, text in names.items()]
    by_length = all(float(np.max(one.curves.length_m)) > 0.0 for one in runs)
    figures = {"curves": curves_figure([(one.name, one.curves, one.contained_m) for one in runs], by_length=by_length)}
    sections = [
        _Section("Figures", "", heads, tuple(rows)),
        _Section(
            "Curves",
            "Deviation in the cut only. What is predicted and what remains is the model's; a tracker alone measures. "
            "Click a name in the legend to hide its curve.",
            figure="curves",
        ),
    ]
    for one in runs:
        sections += one.story()
    head = Head(title, subtitle, notes=notes)
    verdict = " ".join(f"{one.name}: {one.verdict}" if len(runs) > 1 else one.verdict for one in runs)
    return render("run_history.html.j2", figures, [], data=head, verdict=verdict, sections=sections)


def _text(value: Any) -> str:
    if value is None:
        return "–"
    return f"{value:g}" if isinstance(value, float) else str(value).replace("_", " ")

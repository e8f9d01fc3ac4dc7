"""Curves over the program: path error, force and engagement on one axis, margins against chatter, lobes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.units import MM, UM
from counterflex.evaluate.path_deviation import PathDeviation
from counterflex.report.data import PredictionData, ReportData
from counterflex.report.figure_data import AFTER, BEFORE, numbers, thin
from counterflex.report.remaining_figure import length_m

_POINTS: Final = 5000
_MARGIN_POINTS: Final = 3000
_MARGIN_SHOWN: Final = 20.0  # Margins above are drawn at this height: nothing is to be read from them


@dataclass(frozen=True)
class _Line:
    row: int
    name: str
    colour: str
    x: Float
    y: Float
    digits: int
    keep: Bool
    legend: bool


def series_figure(data: ReportData) -> dict[str, Any]:
    """Path error across the feed, force and engagement over the programmed path; entries and exits shaded.

    Both machinings are at the same place at the same length, though the compensated one takes longer.
    """
    lines: list[_Line] = []
    variants = (("before", BEFORE, data.nominal), ("after", AFTER, data.compensated))
    for name, colour, variant in variants:
        result = variant.deviation
        lines.append(
            _Line(
                0, name, colour, result.length_m, result.across_m / MM, 4, result.cutting & ~result.broken, legend=True
            )
        )
        lines.append(
            _Line(
                2,
                name,
                colour,
                result.length_m,
                result.engagement * data.engagement_scale,
                3,
                ~result.broken,
                legend=False,
            )
        )
        if variant.force_n is not None:
            force = variant.force_n
            whole = np.ones(len(force.time_s), dtype=np.bool_)
            place = np.interp(force.time_s, result.time_s, result.length_m)
            lines.append(_Line(1, name, colour, place, force.value, 1, whole, legend=False))
    titles = ("path error<br>across feed, mm", "process<br>force, N", data.engagement_label)
    figure = _stacked(lines, titles, (0.46, 0.24, 0.18))
    figure["layout"]["shapes"] = data.nominal.shades()
    return figure


def prediction_figure(data: PredictionData) -> dict[str, Any]:
    """Predicted deflection, correction and force over the length of the program."""
    place = length_m(data.p_part_tcp)
    whole = np.ones(len(data.time_s), dtype=np.bool_)
    lines = []
    for axis, colour in zip(range(3), ("#b91c1c", "#15803d", "#1d4ed8"), strict=True):
        name = "xyz"[axis]
        lines.append(_Line(0, name, colour, place, data.deflection_m[:, axis] / MM, 4, whole, legend=True))
        lines.append(_Line(1, name, colour, place, data.correction_m[:, axis] / MM, 4, whole, legend=False))
    lines.append(_Line(2, "force", "#444444", place, data.force_n, 1, whole, legend=False))
    titles = ("predicted<br>deflection, mm", "correction<br>in program, mm", "predicted<br>force, N")
    return _stacked(lines, titles, (0.34, 0.34, 0.2))


def prediction_map(data: PredictionData) -> dict[str, Any]:
    """Programmed path seen from above, coloured by the magnitude of the predicted deflection."""
    size = np.linalg.norm(data.deflection_m, axis=1) / MM
    step = max(1, -(-len(size) // 6000))
    x, y = data.p_part_tcp[::step, 0] / MM, data.p_part_tcp[::step, 1] / MM
    order = np.argsort(size[::step], kind="stable")  # the largest are drawn last, on top
    return {
        "data": [
            {
                "type": "scatter",
                "mode": "markers",
                "x": numbers(x[order], 2),
                "y": numbers(y[order], 2),
                "marker": {"size": 5, "color": numbers(size[::step][order], 4), "coloraxis": "coloraxis"},
                "hovertemplate": "x %{x:.1f}, y %{y:.1f} mm<br>%{marker.color:.3f} mm<extra></extra>",
            }
        ],
        "layout": {
            "height": 460,
            "margin": {"l": 60, "r": 10, "t": 70, "b": 46},
            "coloraxis": {
                "colorscale": "Viridis",
                "cmin": 0.0,
                "colorbar": {
                    "orientation": "h",
                    "x": 0.5,
                    "y": 1.03,
                    "yanchor": "bottom",
                    "len": 0.8,
                    "thickness": 12,
                    "title": {"text": "predicted deflection, mm", "side": "top"},
                },
            },
            "xaxis": {"title": {"text": "x, mm"}, "zeroline": False, "constrain": "domain"},
            "yaxis": {"title": {"text": "y, mm"}, "scaleanchor": "x", "zeroline": False, "constrain": "domain"},
        },
    }


def signed_figure(deviation_before: PathDeviation, deviation_after: PathDeviation) -> dict[str, Any]:
    """Signed components across the feed over the length of the program: sideways and in depth."""
    return components_figure((("before", BEFORE, deviation_before), ("after", AFTER, deviation_after)))


def components_figure(paths: Sequence[tuple[str, str, PathDeviation]], *, along: bool = True) -> dict[str, Any]:
    """Signed components of paths, each with its name and colour, over the length of the program.

    Args:
        along: Whether the component along the feed is known.
    """
    lines = []
    for name, colour, result in paths:
        keep = result.cutting & ~result.broken
        lines.append(_Line(0, name, colour, result.length_m, result.across_left_m / UM, 1, keep, legend=True))
        lines.append(_Line(1, name, colour, result.length_m, result.across_axis_m / UM, 1, keep, legend=False))
        if along:
            lines.append(_Line(2, name, colour, result.length_m, result.along_m / UM, 1, keep, legend=False))
    titles = ("to the left<br>of feed, µm", "out of the<br>part, µm", "along feed, µm<br>(not counted)")
    shares = (0.3, 0.3, 0.28) if along else (0.46, 0.46)
    return _stacked(lines, titles[: len(shares)], shares)


def _stacked(
    lines: list[_Line], titles: tuple[str, ...], shares: tuple[float, ...], x_title: str = "length along the program, m"
) -> dict[str, Any]:
    """Rows of curves above each other on one x axis."""
    layout: dict[str, Any] = {
        "height": 520,
        "margin": {"l": 84, "r": 14, "t": 30, "b": 46},
        "hovermode": "x unified",
        "legend": {"orientation": "h", "x": 0.0, "y": 1.0, "yanchor": "bottom"},
        "xaxis": {"title": {"text": x_title}, "anchor": f"y{len(titles)}", "zeroline": False},
    }
    gap = (1.0 - sum(shares)) / (len(shares) - 1)
    top = 1.0
    for row, (title, share) in enumerate(zip(titles, shares, strict=True)):
        layout[f"yaxis{row + 1 if row else ''}"] = {
            "domain": [max(round(top - share, 4), 0.0), round(top, 4)],
            "title": {"text": title, "font": {"size": 12}},
            "rangemode": "tozero",
            "zeroline": True,
            "zerolinecolor": "#b8c0c8",
        }
        top -= share + gap
    out = []
    for line in lines:
        x, y = thin(line.x, line.y, line.keep, _POINTS)
        out.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": line.name,
                "legendgroup": line.name,
                "showlegend": line.legend,
                "x": numbers(x, 4),
                "y": numbers(y, line.digits),
                "xaxis": "x",
                "yaxis": f"y{line.row + 1 if line.row else ''}",
                "line": {"color": line.colour, "width": 1.3},
                "connectgaps": False,
            }
        )
    return {"data": out, "layout": layout}


def margin_figure(stretches: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Margins of robot and tool over time; the worst stretch is marked with its line of the program."""
    time = np.array([row["time_s"] for row in stretches])
    margin = np.array([row["margin"] for row in stretches])
    traces: list[dict[str, Any]] = []
    for key, name, colour in (
        ("robot_margin", "robot", "#0369a1"),
        ("tool_margin", "spindle and tool", "#7c3aed"),
        ("low_frequency_margin", "robot, low-frequency criterion", "#15803d"),
    ):
        values = np.array([np.nan if row[key] is None else row[key] for row in stretches])
        if np.all(np.isnan(values)):
            continue
        x, y = thin(time, np.minimum(values, _MARGIN_SHOWN), ~np.isnan(values), _MARGIN_POINTS)
        dash = "dot" if key == "low_frequency_margin" else "solid"
        traces.append(
            {"type": "scatter", "mode": "lines+markers", "name": name, "x": numbers(x, 3), "y": numbers(y, 3),
             "line": {"color": colour, "width": 1.6, "dash": dash}, "marker": {"size": 4}}
        )  # fmt: skip
    at = int(np.argmin(margin))
    low = min(float(margin[at]), 0.5)
    layout = {
        "height": 420,
        "margin": {"l": 64, "r": 12, "t": 40, "b": 44},
        "hovermode": "x",
        "legend": {"orientation": "h", "y": 1.03, "yanchor": "bottom", "x": 0.0},
        "xaxis": {"title": {"text": "time at the programmed feed, s"}, "zeroline": False},
        "yaxis": {
            "title": {"text": f"margin (drawn up to {_MARGIN_SHOWN:g})"},
            "type": "log",
            "range": [float(np.log10(0.8 * low)), float(np.log10(1.15 * _MARGIN_SHOWN))],
        },
        "shapes": [
            {"type": "line", "xref": "paper", "x0": 0.0, "x1": 1.0, "y0": 1.0, "y1": 1.0,
             "line": {"color": "#b91c1c", "width": 1.2, "dash": "dash"}}
        ],
        "annotations": [
            {"text": f"line {stretches[at]['line']}: {margin[at]:.3g}", "x": round(float(time[at]), 3),
             "y": float(np.log10(min(margin[at], _MARGIN_SHOWN))), "ax": 0, "ay": 28, "showarrow": True,
             "bgcolor": "rgba(255,255,255,0.85)", "font": {"size": 11, "color": "#1b2530"}}
        ],
    }  # fmt: skip
    return {"data": traces, "layout": layout}


def lobe_figure(rows: Sequence[Mapping[str, Any]], worst: Mapping[str, Any]) -> dict[str, Any]:
    """Deepest stable cut over the spindle speed, with the programmed depth and speed."""
    depth = float(worst["axial_depth_mm"])
    traces: list[dict[str, Any]] = []
    top = 2.5 * depth
    for method, mode, colour in (("zeroth order", "lines", "#0369a1"), ("semi-discretisation", "markers", "#c2410c")):
        own = [row for row in rows if row["method"] == method]
        x = np.array([row["spindle_rpm"] for row in own])
        y = np.array([np.nan if row["depth_mm"] is None else row["depth_mm"] for row in own])
        if np.any(~np.isnan(y)):
            top = max(top, 2.5 * float(np.nanmedian(y)))
        traces.append(
            {"type": "scatter", "mode": mode, "name": method, "x": numbers(x, 1), "y": numbers(y, 4),
             "line": {"color": colour, "width": 1.8}, "marker": {"color": colour, "size": 7}}
        )  # fmt: skip
    traces.append(
        {"type": "scatter", "mode": "markers", "name": f"program, line {worst['line']}", "x": [worst["spindle_rpm"]],
         "y": [depth], "marker": {"color": "#1b2530", "size": 12, "symbol": "x"}}
    )  # fmt: skip
    layout = {
        "height": 420,
        "margin": {"l": 64, "r": 12, "t": 40, "b": 44},
        "legend": {"orientation": "h", "y": 1.03, "yanchor": "bottom", "x": 0.0},
        "xaxis": {"title": {"text": "spindle speed, rpm"}, "zeroline": False},
        "yaxis": {"title": {"text": "axial depth, mm"}, "range": [0.0, top]},
    }
    return {"data": traces, "layout": layout}

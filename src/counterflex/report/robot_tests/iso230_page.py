"""Page of a circular test: the turns with their deviation drawn larger, and their figures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, UM
from counterflex.evaluate.iso230.circular_test import CLOCKWISE, Turn, least_squares_circle
from counterflex.evaluate.iso230.positioning import Positioning
from counterflex.report.figure_data import numbers
from counterflex.report.robot_tests.section import CYCLE_COLOURS, GRID, Section, test_page

_POINTS_STRAIGHT: Final = 800
_MOST_STRAIGHT: Final = 8


def straight_page(summary: Mapping[str, Any], parts: Sequence[Float]) -> str:
    """The page, as HTML text.

    Args:
        parts: (n, 3) m, readings of every stretch, in the order of its rows.
    """
    largest = summary["largest"]
    verdict = (
        f"Largest straightness deviation: horizontal {largest['horizontal_um']:.1f} um, vertical "
        f"{largest['vertical_um']:.1f} um, in space {largest['cylinder_um']:.1f} um (diameter)."
    )
    names = ["horizontal", "horizontal_ls", "vertical", "vertical_ls", "cylinder", "cylinder_ls"]
    sections = [
        Section(
            "What the least-squares line leaves",
            f"Horizontal above, vertical below; at most {_MOST_STRAIGHT} stretches.",
            "rests",
        ),
        Section(
            "Each stretch, um",
            "Distance of two parallel lines (diameter of a cylinder) that hold the path, the least possible; ls: about "
            f"the least-squares line. Left out: {summary['ends_left_out']}.",
            columns=["stretch", "cycle", "length, mm", *(name.replace("_", " ") for name in names)],
            rows=[
                [
                    f"{row['stretch']} ({row['file']})",
                    str(row["cycle"]),
                    f"{row['length_mm']:.1f}",
                    *(f"{row[f'{name}_um']:.1f}" for name in names),
                ]
                for row in summary["stretches"]
            ],
        ),
        Section.conditions(summary),
    ]
    title = f"Straightness by {summary['standard']}"
    return test_page(title, ", ".join(summary["files"][:3]), verdict, sections, {"rests": rest_figure(parts)})


def rests(p: Float) -> tuple[Float, Float, Float]:
    """Place along a line, and what its least-squares line leaves horizontally and vertically, m."""
    centre = p.mean(axis=0)
    line = np.linalg.svd(p - centre, full_matrices=False)[2][0]
    line = line * np.sign(line @ (p[-1] - p[0]))
    top = np.array([1.0, 0.0, 0.0]) if abs(line[2]) > 0.9 else np.array([0.0, 0.0, 1.0])
    vertical = top - (top @ line) * line
    vertical /= np.linalg.norm(vertical)
    side = np.cross(vertical, line)
    x, h, v = ((p - centre) @ axis for axis in (line, side, vertical))
    a = np.column_stack([np.ones(len(x)), x])
    h, v = (y - a @ np.linalg.lstsq(a, y, rcond=None)[0] for y in (h, v))
    return x, h, v


def rest_figure(parts: Sequence[Float]) -> dict[str, Any]:
    """Deviations along every stretch, horizontal and vertical."""
    data = []
    for k, p in enumerate(parts[:_MOST_STRAIGHT]):
        x, h, v = (values[:: max(1, len(p) // _POINTS_STRAIGHT)] for values in rests(p))
        for n, y in (("", h), ("2", v)):
            data.append(
                {"type": "scatter", "mode": "lines", "name": f"row {k + 1}", "showlegend": not n,
                 "legendgroup": str(k), "x": numbers(x / MM, 3), "y": numbers(y / UM, 2), "xaxis": "x",
                 "yaxis": f"y{n}", "line": {"color": CYCLE_COLOURS[k % len(CYCLE_COLOURS)], "width": 1.2}}
            )  # fmt: skip
    layout = {
        "height": 460,
        "margin": {"l": 60, "r": 12, "t": 40, "b": 44},
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0.0},
        "xaxis": {**GRID, "title": {"text": "along the stretch, from its middle, mm"}, "anchor": "y2"},
        "yaxis": {**GRID, "title": {"text": "horizontal, um"}, "domain": [0.54, 1.0]},
        "yaxis2": {**GRID, "title": {"text": "vertical, um"}, "domain": [0.0, 0.46]},
    }
    return {"data": data, "layout": layout}


NAMES: Final = {
    "A": "accuracy",
    "R": "repeatability",
    "E": "systematic deviation",
    "M": "mean bidirectional deviation",
    "B": "reversal",
}
"""Words for the letters of the standard."""


def positioning_page(summary: Mapping[str, Any], result: Positioning) -> str:
    """The page, as HTML text."""
    figures = summary["figures"]
    parts = [f"{letter} {figures[f'{letter}_um']:.1f} um" for letter in NAMES if figures[f"{letter}_um"] is not None]
    verdict = f"{', '.join(parts) or 'No figure of both directions'} over {summary['length_mm']:g} mm."
    missing = summary["not_by_standard"]
    head = ["target, mm", "mean up", "mean down", "s up", "s down", "B", "R"]
    keys = ("mean_up_um", "mean_down_um", "s_up_um", "s_down_um", "reversal_um", "repeatability_um")
    sections = [
        Section(
            "Figures, um",
            ("Not by the standard: " + "; ".join(missing) + ". " if missing else "")
            + "Not corrected to 20 °C. Up: towards larger targets.",
            columns=["figure", "both directions", "up", "down"],
            rows=[
                [f"{letter}, {name}", *(_text(figures.get(f"{letter}{way}_um")) for way in ("", "_up", "_down"))]
                for letter, name in NAMES.items()
            ]
            + [["mean of B", _text(figures["B_mean_um"]), "", ""]],
        ),
        Section("Deviation along the axis", "Mean deviations, and two standard deviations on both sides.", "bands"),
        Section(
            "Each target, um",
            "",
            columns=head,
            rows=[[f"{row['target_mm']:g}", *(_text(row[key]) for key in keys)] for row in summary["targets"]],
        ),
    ]
    title = f"Positioning by {summary['standard']}"
    return test_page(title, summary["file"], verdict, sections, {"bands": band_figure(result)})


def _text(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def band_figure(result: Positioning) -> dict[str, Any]:
    """Mean deviation of both directions over the axis, with two standard deviations on each side."""
    place = np.array([one.target_m for one in result.targets]) / MM
    data = []
    for k, way in enumerate(("up", "down")):
        mean = np.array([getattr(one, f"mean_{way}_m") for one in result.targets]) / UM
        s = np.nan_to_num(np.array([getattr(one, f"s_{way}_m") for one in result.targets])) / UM
        if not np.isfinite(mean).all():
            continue
        data.append(
            {"type": "scatter", "mode": "lines+markers", "name": way, "x": numbers(place, 3), "y": numbers(mean, 3),
             "line": {"color": CYCLE_COLOURS[k]}, "error_y": {"type": "data", "array": numbers(2.0 * s, 3)}}
        )  # fmt: skip
    layout = {
        "height": 380,
        "margin": {"l": 60, "r": 12, "t": 40, "b": 44},
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0.0},
        "xaxis": {**GRID, "title": {"text": "target, mm"}},
        "yaxis": {**GRID, "title": {"text": "deviation, um"}},
    }
    return {"data": data, "layout": layout}


_DRAWN: Final = 0.15
_POINTS: Final = 1440
_MOST: Final = 6
_COLOURS: Final = {CLOCKWISE: "#c2410c", "ccw": "#0369a1"}


def circle_page(summary: Mapping[str, Any], turns: Sequence[Turn]) -> str:
    """The page, as HTML text.

    Args:
        turns: In the order of its rows.
    """
    largest = summary["largest"]
    verdict = f"Largest circular deviation G {largest['G_um']:.1f} um"
    verdict += f"; bi-directional G(b) {largest['G_b_um']:.1f} um." if largest["G_b_um"] is not None else "."
    names = ["G_um", "G_lsc_um", "F_max_um", "F_min_um", "F_nominal_max_um", "F_nominal_min_um", "axial_um"]
    shown = [name for name in names if any(row.get(name) is not None for row in summary["turns"])]
    factor = _factor(turns)
    sections = [
        Section(
            "Turns",
            f"Radial deviations are drawn {factor:g} times larger, about the least-squares centre of each turn. "
            f"Clockwise orange, counter-clockwise blue; at most {_MOST} turns.",
            "circle",
        ),
        Section(
            "Each turn, um",
            "G: least radial separation of two concentric circles that hold the path; lsc: about the least-squares "
            "centre. F: radial deviation from the nominal circle about the least-squares centre, or about the nominal "
            "centre. axial: range out of the plane.",
            columns=[
                "turn",
                "direction",
                *(name.removesuffix("_um").replace("_", " ") for name in shown),
                "radius, mm",
            ],
            rows=[
                [
                    f"{row['turn']} ({row['file']})",
                    row["direction"],
                    *("" if row.get(name) is None else f"{row[name]:.1f}" for name in shown),
                    f"{row['radius_mm']:.4f}",
                ]
                for row in summary["turns"]
            ],
        ),
    ]
    if summary["bi_directional"]:
        sections.append(
            Section(
                "Both directions, um",
                "G(b): least radial separation of two concentric circles that hold both paths. D: radius of the "
                "least-squares circle of both minus the nominal radius. H (edition of 1996): largest difference of "
                "the two radii at one angle.",
                columns=["pair", "G(b)", "G(b) lsc", "D", "H"],
                rows=[
                    [
                        str(row["pair"]),
                        *("" if row[k] is None else f"{row[k]:.1f}" for k in ("G_b_um", "G_b_lsc_um", "D_um", "H_um")),
                    ]
                    for row in summary["bi_directional"]
                ],
            )
        )
    radius = summary["radius_mm"]
    sections.append(Section.conditions(summary))
    title = f"Circular test by {summary['standard']}"
    subtitle = f"{', '.join(summary['files'][:3])}" + ("" if radius is None else f", nominal radius {radius:g} mm")
    return test_page(title, subtitle, verdict, sections, {"circle": circle_figure(turns, factor)})


def _factor(turns: Sequence[Turn]) -> float:
    """Factor by which deviations are drawn larger: 1, 2 or 5 times a power of ten."""
    raw = math.inf
    for turn in turns[:_MOST]:
        c, radius = least_squares_circle(turn.points)
        deviation = float(np.abs(np.linalg.norm(turn.points - c, axis=1) - radius).max())
        raw = min(raw, _DRAWN * radius / max(deviation, 1e-9))
    power = 10.0 ** math.floor(math.log10(max(raw, 1.0)))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= max(raw, 1.0))


def circle_figure(turns: Sequence[Turn], factor: float) -> dict[str, Any]:
    """Paths of turns about their least-squares centres, radial deviations times ``factor``, with the mean circle."""
    data: list[dict[str, Any]] = []
    for k, turn in enumerate(turns[:_MOST]):
        c, radius = least_squares_circle(turn.points)
        away = (turn.points - c)[:: max(1, len(turn.points) // _POINTS)]
        rho = np.linalg.norm(away, axis=1)
        drawn = away / rho[:, None] * (radius + factor * (rho - radius))[:, None] / MM
        if k == 0:
            angle = np.arange(361) * DEG
            data.append(
                {"type": "scatter", "mode": "lines", "name": "least-squares circle",
                 "x": numbers(radius * np.cos(angle) / MM, 3),
                 "y": numbers(radius * np.sin(angle) / MM, 3),
                 "line": {"color": "#1b2530", "width": 1.2, "dash": "dot"}}
            )  # fmt: skip
        data.append(
            {"type": "scatter", "mode": "lines", "name": f"turn {k + 1}, {turn.direction}",
             "x": numbers(drawn[:, 0], 4), "y": numbers(drawn[:, 1], 4),
             "line": {"color": _COLOURS[turn.direction], "width": 1.2},
             "customdata": numbers((rho - radius) / UM, 1), "hovertemplate": "%{customdata} um<extra></extra>"}
        )  # fmt: skip
    layout = {
        "height": 620,
        "margin": {"l": 60, "r": 12, "t": 60, "b": 44},
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0.0},
        "xaxis": {**GRID, "title": {"text": "first axis of the plane, mm"}, "constrain": "domain"},
        "yaxis": {**GRID, "title": {"text": "second axis, mm"}, "scaleanchor": "x", "constrain": "domain"},
    }
    return {"data": data, "layout": layout}

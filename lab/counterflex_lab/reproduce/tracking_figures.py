"""Figures of a tracker in the loop: paths with errors drawn larger, errors over angle and time, margins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from counterflex.core.arrays import Bool, Float
from counterflex.core.units import DEG, MM, UM
from counterflex.report.figure_data import numbers, thin

COLOURS: Final = ("#8a8f98", "#c2410c", "#0369a1", "#15803d")
NOMINAL: Final = "#1b2530"
MAGNIFIED: Final = 250.0
"""Errors are drawn this much larger than the path: 200 um are 50 mm."""
FINELY: Final = 1500.0
"""The same for the last controller by itself: 20 um are 30 mm."""
_POINTS: Final = 3000
_WIDE: Final = {"l": 70, "r": 12, "t": 8, "b": 44}


@dataclass(frozen=True)
class TrackedRun:
    """One controller on one path."""

    name: str
    time_s: Float  # (n,) s
    p_command: Float  # (n, 3) m, where the tool should have been at that time
    p_actual: Float  # (n, 3) m, where it was
    p_path: Float  # (n, 3) m, point of the path nearest to that
    shown: Bool  # (n,) samples that count
    # Samples at which an axis turned round, and which axis, 1..6
    reversals: Sequence[tuple[int, int]] = field(default_factory=tuple)


@dataclass(frozen=True)
class OpenLoop:
    """Frequency response of a loop from deviation to correction and back."""

    name: str
    frequency_hz: Float  # (k,) rising
    response: NDArray[np.complex128]  # (k,) complex L


def over_time(runs: Sequence[TrackedRun]) -> dict[str, Any]:
    """True distance from the set-point over time."""
    lines = []
    for run, colour in zip(runs, COLOURS, strict=False):
        size = np.linalg.norm(run.p_actual - run.p_command, axis=1) / UM
        x, y = thin(run.time_s, size, run.shown, _POINTS)
        lines.append(_line(run.name, colour, numbers(x, 3), numbers(y, 1), 1.2))
    layout = _layout("time, s", "true distance from the set-point, um")
    layout["yaxis"] |= {"type": "log"}
    return {"data": lines, "layout": layout}


def over_angle(runs: Sequence[TrackedRun]) -> dict[str, Any]:
    """Radial error of a circle over the angle gone; dotted where an axis turns round."""
    lines, shapes, notes = [], [], []
    for run, colour in zip(runs, COLOURS, strict=False):
        turned = np.unwrap(np.arctan2(run.p_command[:, 1], run.p_command[:, 0]))
        turned = (turned - turned[0]) / DEG
        radial = (np.hypot(*run.p_actual[:, :2].T) - np.hypot(*run.p_path[:, :2].T)) / UM
        x, y = thin(turned, radial, run.shown, _POINTS)
        lines.append(_line(run.name, colour, numbers(x, 2), numbers(y, 1), 1.2))
        if run is not runs[-1]:
            continue
        for n, (row, axis) in enumerate(run.reversals):
            if not run.shown[row]:
                continue
            at = round(float(turned[row]), 2)
            shapes.append({"type": "line", "x0": at, "x1": at, "yref": "paper", "y0": 0, "y1": 1,
                           "line": {"color": "#9aa1ab", "width": 1, "dash": "dot"}})  # fmt: skip
            notes.append({"x": at, "yref": "paper", "y": 0.98 - 0.06 * (n % 3), "text": f"A{axis}", "showarrow": False,
                          "xanchor": "left", "font": {"size": 10}})  # fmt: skip
    layout = _layout("angle on the circle, deg", "radial error, um") | {"shapes": shapes, "annotations": notes}
    return {"data": lines, "layout": layout}


def magnified(runs: Sequence[TrackedRun], factor: float) -> dict[str, Any]:
    """Path seen from above with its contour error drawn larger by a factor, over the nominal path."""
    lines: list[dict[str, Any]] = []
    for k, run in enumerate(runs):
        shown = run.p_path[run.shown]
        if len(shown) == 0:
            continue
        step = max(1, len(shown) // _POINTS)
        if not lines:
            lines.append(_line("nominal", NOMINAL, *_mm(shown[::step]), 0.8))
        drawn = shown + factor * (run.p_actual - run.p_path)[run.shown]
        lines.append(_line(run.name, colour_of(k, runs), *_mm(drawn[::step]), 1.4))
    return {"data": lines, "layout": _square_layout()}


def corner(runs: Sequence[TrackedRun], p_part: Float, reach_m: float) -> dict[str, Any]:
    """Return what controllers make of a corner, seen from above at true scale.

    Args:
        p_part: (3,) m, the corner.
    """
    lines: list[dict[str, Any]] = []
    for k, run in enumerate(runs):
        near = np.flatnonzero(np.max(np.abs(run.p_command - p_part)[:, :2], axis=1) < 2.0 * reach_m)
        if len(near) == 0:
            continue
        if not lines:
            lines.append(_line("nominal", NOMINAL, *_mm(run.p_command[near] - p_part), 0.8))
        lines.append(_line(run.name, colour_of(k, runs), *_mm(run.p_actual[near] - p_part), 1.4))
    layout = _square_layout()
    span = [-reach_m / MM, reach_m / MM]
    layout["xaxis"] |= {"range": span, "title": {"text": "x from the corner, mm"}}
    layout["yaxis"] |= {"range": span, "title": {"text": "y from the corner, mm"}}
    return {"data": lines, "layout": layout}


def nyquist(loops: Sequence[OpenLoop]) -> dict[str, Any]:
    """Open loops in the complex plane, with the unit circle and the circle that Ms = 2 stays out of."""
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    lines = [
        _line("gain 1", "#9aa1ab", numbers(np.cos(turn), 3), numbers(np.sin(turn), 3), 0.8),
        _line("Ms 2", "#d9a0a0", numbers(0.5 * np.cos(turn) - 1.0, 3), numbers(0.5 * np.sin(turn), 3), 0.8),
    ]
    for loop, colour in zip(loops, COLOURS[1:], strict=False):
        value = loop.response[np.abs(loop.response) < 20.0]
        lines.append(_line(loop.name, colour, numbers(np.real(value), 4), numbers(np.imag(value), 4), 1.6))
    layout = _square_layout()
    layout["xaxis"] |= {"range": [-2.2, 1.2], "title": {"text": "real part"}}
    layout["yaxis"] |= {"range": [-2.6, 1.2], "title": {"text": "imaginary part"}}
    layout["annotations"] = [{"x": -1.0, "y": 0.0, "text": "-1", "ax": -18, "ay": -18}]
    return {"data": lines, "layout": layout}


def sensitivity(loops: Sequence[OpenLoop]) -> dict[str, Any]:
    """Return what a loop leaves of a deviation, ``|1 / (1 + L)|``, over its frequency."""
    lines = []
    for loop, colour in zip(loops, COLOURS[1:], strict=False):
        magnitude = np.abs(1.0 / (1.0 + loop.response))
        lines.append(_line(loop.name, colour, numbers(loop.frequency_hz, 5), numbers(magnitude, 5), 1.6))
    layout = _layout("frequency of the deviation, Hz", "remaining share")
    layout["xaxis"] |= {"type": "log", "range": [-2.0, 2.1]}
    layout["yaxis"] |= {"type": "log", "range": [-2.5, 0.5]}
    return {"data": lines, "layout": layout}


def colour_of(place: int, runs: Sequence[TrackedRun]) -> str:
    """Colour of a run by its place; a single run is the last controller and has the last colour in use."""
    return COLOURS[2] if len(runs) == 1 else COLOURS[place % len(COLOURS)]


def _mm(p: Float) -> tuple[list[float | None], list[float | None]]:
    return numbers(p[:, 0] / MM, 3), numbers(p[:, 1] / MM, 3)


def _line(name: str, colour: str, x: Sequence[Any], y: Sequence[Any], width: float) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "x": list(x),
        "y": list(y),
        "line": {"color": colour, "width": width},
    }


def _layout(x: str, y: str) -> dict[str, Any]:
    return {
        "height": 340,
        "margin": dict(_WIDE),
        "xaxis": {"title": {"text": x}},
        "yaxis": {"title": {"text": y}},
        "legend": {"orientation": "h", "y": 1.12},
        "hovermode": "x unified",
    }


def _square_layout() -> dict[str, Any]:
    return {
        "height": 560,
        "margin": dict(_WIDE),
        "xaxis": {"title": {"text": "x, mm"}, "scaleanchor": "y"},
        "yaxis": {"title": {"text": "y, mm"}},
        "legend": {"orientation": "h", "y": 1.06},
    }


def figures(
    circle: Sequence[TrackedRun], square: Sequence[TrackedRun], loops: Sequence[OpenLoop], p_part: Float, reach_m: float
) -> Mapping[str, Any]:
    """All figures of the page by name.

    Args:
        circle: Runs of the circle, the controller of interest last.
        p_part: (3,) m, the corner that is shown.
    """
    return {
        "circle": magnified(circle, MAGNIFIED),
        "finely": magnified(circle[-1:], FINELY),
        "angle": over_angle(circle),
        "turn": over_time(circle),
        "square": magnified(square, MAGNIFIED),
        "corner": corner(square, p_part, reach_m),
        "sides": over_time(square),
        "nyquist": nyquist(loops),
        "sensitivity": sensitivity(loops),
    }

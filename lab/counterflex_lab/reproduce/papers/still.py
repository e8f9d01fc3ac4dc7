"""Still pictures of curves and bars as SVG text: for pages of text that no script draws on.

The text is the same on every computer: coordinates have one decimal, fonts are named and not embedded. Colours are
legible on white and on dark paper, which stays white behind the picture.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from html import escape
from typing import Final, Literal

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError

Scale = Callable[[Float | float], Float]

WIDTH: Final = 720.0
HEIGHT: Final = {"low": 280.0, "normal": 320.0, "square": 520.0}
"""Of a picture, in its own units, by its shape."""
COLOURS: Final = ("#1d4ed8", "#b45309", "#15803d", "#9333ea", "#0e7490", "#be123c")
PRINTED: Final = "#111827"
"""Colour of what a paper prints."""
_LEFT, _RIGHT, _TOP, _BOTTOM = 64.0, 16.0, 14.0, 42.0
_LEGEND: Final = 18.0
_CHARACTER: Final = 7.2
"""Mean width of a character of the legend."""
_STEPS: Final = (1.0, 2.0, 2.5, 5.0, 10.0)
_GRID, _TEXT = "#d1d5db", "#374151"


@dataclass(frozen=True)
class Curve:
    """A curve or points."""

    name: str
    x: Float  # (n,)
    y: Float  # (n,); nan interrupts the line
    style: Literal["line", "dashed", "points"] = "line"  # ``line``, ``dashed`` or ``points``
    colour: str = ""  # CSS colour; empty takes the next of :data:`COLOURS`


@dataclass(frozen=True)
class Level:
    """A printed value, or a band of values, across the whole picture."""

    name: str
    low: float
    high: float | None = None  # Upper end of a band; None is a line


@dataclass(frozen=True)
class Still:
    """A picture."""

    name: str  # File name without extension
    title: str  # What it shows, for readers who do not see it
    caption: str
    x: str  # Label of the horizontal axis, with unit
    y: str  # Label of the vertical axis, with unit
    curves: Sequence[Curve] = field(default=())  # Drawn in this order
    levels: Sequence[Level] = field(default=())
    ticks: Sequence[str] = field(default=())  # Names of places 0, 1, 2 ... on the horizontal axis instead of numbers.
    equal: bool = False  # One unit is as long on both axes
    log: bool = False  # Vertical axis logarithmic; values > 0
    shape: Literal["low", "normal", "square"] = "normal"  # Of the picture, see :data:`HEIGHT`


def svg(still: Still) -> str:
    """The picture as SVG text. Raises InputError: nothing to draw."""
    legend, rows = _legend(still)
    top = _TOP + _LEGEND * rows
    (x0, x1), (y0, y1) = _range(still)
    height = HEIGHT[still.shape]
    wide, high = WIDTH - _LEFT - _RIGHT, height - top - _BOTTOM
    if still.equal:
        (x0, x1), (y0, y1) = _equal((x0, x1), (y0, y1), wide / high)
    px, py = partial(_across, x0, x1, wide), partial(_down, y0, y1, top, high, still.log)
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:.0f} {height:.0f}" '
        f'width="{WIDTH:.0f}" height="{height:.0f}" font-family="system-ui, sans-serif" font-size="12" '
        f'fill="{_TEXT}" role="img">',
        f"<title>{escape(still.title)}</title>",
        f'<rect width="{WIDTH:.0f}" height="{height:.0f}" fill="#ffffff"/>',
    ]
    for level in still.levels:
        if level.high is not None:
            upper, lower = max(float(py(level.high)), top), min(float(py(level.low)), top + high)
            out.append(
                f'<rect x="{_LEFT:.1f}" y="{upper:.1f}" width="{wide:.1f}" height="{lower - upper:.1f}" '
                f'fill="{PRINTED}" fill-opacity="0.10"/>'
            )
    out += _axes(still, (x0, x1), (y0, y1), px, py, top + high)
    for level in still.levels:
        if level.high is None:
            at = float(py(level.low))
            out.append(
                f'<path d="M{_LEFT:.1f} {at:.1f}H{WIDTH - _RIGHT:.1f}" stroke="{PRINTED}" stroke-width="1.5" '
                f'stroke-dasharray="7 4"/>'
            )
    for k, curve in enumerate(still.curves):
        out.append(_drawn(curve, _colour(still, k), px, py))
    return "\n".join([*out, *legend, "</svg>", ""])


def _across(x0: float, x1: float, wide: float, x: Float | float) -> Float:
    """Places in the picture, from left."""
    return np.asarray(_LEFT + (np.asarray(x) - x0) / (x1 - x0) * wide)


def _down(y0: float, y1: float, top: float, high: float, log: bool, y: Float | float) -> Float:
    """Places in the picture, from above."""
    value = np.log10(np.asarray(y)) if log else np.asarray(y)
    return np.asarray(top + (y1 - value) / (y1 - y0) * high)


def _colour(still: Still, k: int) -> str:
    own = [i for i, curve in enumerate(still.curves) if not curve.colour]
    return still.curves[k].colour or COLOURS[own.index(k) % len(COLOURS)]


def _finite(values: Sequence[Sequence[float] | Float]) -> Float:
    every: Float = np.concatenate([np.zeros(0), *(np.asarray(one, dtype=np.float64) for one in values)])
    return every[np.isfinite(every)]


def _range(still: Still) -> tuple[tuple[float, float], tuple[float, float]]:
    x = _finite([curve.x for curve in still.curves])
    levels = [(level.low, level.low if level.high is None else level.high) for level in still.levels]
    y = _finite([*(curve.y for curve in still.curves), *levels])
    if len(x) == 0 or len(y) == 0:
        raise InputError("there is nothing to draw", where=still.name)
    x_range = (-0.5, len(still.ticks) - 0.5) if still.ticks else (float(x.min()), float(x.max()))
    if still.log:
        return _wide(x_range), (float(np.log10(y).min()) - 0.1, float(np.log10(y).max()) + 0.1)
    low, high = float(y.min()), float(y.max())
    if low > 0.0 and low < 0.5 * high and not still.equal:
        low = 0.0
    pad = 0.06 * (high - low or abs(high) or 1.0)
    return _wide(x_range), (low - (0.0 if low == 0.0 else pad), high + pad)


def _wide(ends: tuple[float, float]) -> tuple[float, float]:
    return ends if ends[1] > ends[0] else (ends[0] - 0.5, ends[1] + 0.5)


def _equal(
    x: tuple[float, float], y: tuple[float, float], shape: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """The wider of the two ranges, so that a unit is as long on both axes."""
    tall = max(y[1] - y[0], (x[1] - x[0]) / shape)
    cx, cy = 0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1])
    return (cx - 0.5 * tall * shape, cx + 0.5 * tall * shape), (cy - 0.5 * tall, cy + 0.5 * tall)


def _places(low: float, high: float, count: int) -> list[float]:
    """Round places of a scale."""
    raw = (high - low) / count
    ten = 10.0 ** math.floor(math.log10(raw))
    step = next(s * ten for s in _STEPS if s * ten >= raw * (1.0 - 1e-9))
    first = math.ceil(low / step - 1e-9)
    return [k * step for k in range(first, math.floor(high / step + 1e-9) + 1)]


def _decades(low: float, high: float) -> list[float]:
    """1, 2 and 5 of each decade."""
    ends = range(math.floor(low), math.ceil(high))
    values = [step * 10.0**k for k in ends for step in (1.0, 2.0, 5.0)] + [10.0 ** math.ceil(high)]
    return [value for value in values if low <= math.log10(value) <= high]


def _axes(
    still: Still, x: tuple[float, float], y: tuple[float, float], px: Scale, py: Scale, bottom: float
) -> list[str]:
    out = []
    for value in _decades(*y) if still.log else _places(*y, 5):
        at = float(py(value))
        out.append(f'<path d="M{_LEFT:.1f} {at:.1f}H{WIDTH - _RIGHT:.1f}" stroke="{_GRID}"/>')
        out.append(f'<text x="{_LEFT - 6:.1f}" y="{at + 4:.1f}" text-anchor="end">{_number(value)}</text>')
    if still.ticks:
        marks = [(float(k), name) for k, name in enumerate(still.ticks)]
    else:
        marks = [(value, _number(value)) for value in _places(*x, 8)]
    for value, name in marks:
        at = float(px(float(value)))
        out.append(f'<path d="M{at:.1f} {bottom:.1f}v4" stroke="{_TEXT}"/>')
        out.append(f'<text x="{at:.1f}" y="{bottom + 17:.1f}" text-anchor="middle">{escape(name)}</text>')
    middle = _LEFT + 0.5 * (WIDTH - _LEFT - _RIGHT)
    out.append(f'<path d="M{_LEFT:.1f} {bottom:.1f}H{WIDTH - _RIGHT:.1f}" stroke="{_TEXT}"/>')
    out.append(f'<text x="{middle:.1f}" y="{bottom + 35:.1f}" text-anchor="middle">{escape(still.x)}</text>')
    height = 0.5 * (bottom + _TOP)
    out.append(
        f'<text x="16" y="{height:.1f}" text-anchor="middle" transform="rotate(-90 16 {height:.1f})">'
        f"{escape(still.y)}</text>"
    )
    return out


def _number(value: float) -> str:
    return f"{0.0 if abs(value) < 1e-12 else value:.6g}"


def _drawn(curve: Curve, colour: str, px: Scale, py: Scale) -> str:
    x, y = px(curve.x), py(curve.y)
    if curve.style == "points":
        dots = [
            f'<circle cx="{a:.1f}" cy="{b:.1f}" r="3.5"/>'
            for a, b in zip(np.atleast_1d(x), np.atleast_1d(y), strict=True)
            if math.isfinite(b)
        ]
        return f'<g fill="{colour}">{"".join(dots)}</g>'
    steps, down = [], False
    for a, b in zip(x, y, strict=True):
        if not (math.isfinite(a) and math.isfinite(b)):
            down = False
            continue
        steps.append(f"{'L' if down else 'M'}{a:.1f} {b:.1f}")
        down = True
    dash = ' stroke-dasharray="5 3"' if curve.style == "dashed" else ""
    return f'<path d="{"".join(steps)}" fill="none" stroke="{colour}" stroke-width="1.8"{dash}/>'


def _legend(still: Still) -> tuple[list[str], int]:
    """Entries above the picture, and how many rows they take."""
    entries = [(level.name, PRINTED, "band" if level.high is not None else "level") for level in still.levels]
    entries += [(curve.name, _colour(still, k), curve.style) for k, curve in enumerate(still.curves) if curve.name]
    out, at, row = [], _LEFT, 0
    for name, colour, style in entries:
        width = 34.0 + _CHARACTER * len(name)
        if at > _LEFT and at + width > WIDTH - _RIGHT:
            at, row = _LEFT, row + 1
        y = _TOP + _LEGEND * row
        out += [_sign(at, y, colour, style), f'<text x="{at + 26:.1f}" y="{y + 4:.1f}">{escape(name)}</text>']
        at += width
    return out, row + 1 if entries else 0


def _sign(x: float, y: float, colour: str, style: str) -> str:
    if style == "points":
        return f'<circle cx="{x + 11:.1f}" cy="{y:.1f}" r="3.5" fill="{colour}"/>'
    if style == "band":
        return f'<rect x="{x:.1f}" y="{y - 5:.1f}" width="22" height="10" fill="{colour}" fill-opacity="0.10"/>'
    dash = {"dashed": ' stroke-dasharray="5 3"', "level": ' stroke-dasharray="7 4"'}.get(style, "")
    return f'<path d="M{x:.1f} {y:.1f}h22" stroke="{colour}" stroke-width="1.8"{dash}/>'

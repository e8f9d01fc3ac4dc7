"""Sketches in space as SVG text: lines, arrows, frames and labels in a fixed oblique or side view."""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape
from typing import Final

import numpy as np

from counterflex.core.arrays import Float

WIDTH: Final = 720.0
AXES: Final = (("x", "#be123c"), ("y", "#15803d"), ("z", "#1d4ed8"))
INK, FAINT = "#111827", "#9ca3af"
_HEAD_PX: Final = 7.0


@dataclass
class Sketch:
    """A picture in the making."""

    title: str  # what it shows, for readers who do not see it
    view: Float  # (2, 3) rows: direction of the picture's right and up in space
    centre: Float  # (3,) m, the middle of the picture
    scale: float  # pixels per metre
    height: float  # of the picture, pixels
    parts: list[str] = field(default_factory=list)  # SVG elements so far

    def at(self, p: Float) -> tuple[float, float]:
        """Place of a point (3,) m in the picture, pixels."""
        right, up = self.view @ (np.asarray(p, dtype=np.float64) - self.centre)
        return 0.5 * WIDTH + self.scale * float(right), 0.5 * self.height - self.scale * float(up)

    def line(self, points: Float, colour: str = INK, width: float = 2.0, *, dashed: bool = False) -> None:
        """A polyline through points (n, 3) m."""
        text = "L".join(f"{x:.1f} {y:.1f}" for x, y in map(self.at, points))
        dash = ' stroke-dasharray="5 4"' if dashed else ""
        self.parts.append(
            f'<path d="M{text}" fill="none" stroke="{colour}" stroke-width="{width:g}" stroke-linecap="round" '
            f'stroke-linejoin="round"{dash}/>'
        )

    def dots(self, points: Float, colour: str = INK, radius: float = 4.0) -> None:
        """Dots at points (n, 3) m."""
        for x, y in map(self.at, points):
            self.parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:g}" fill="{colour}"/>')

    def arrow(self, start: Float, end: Float, colour: str, width: float = 2.0) -> None:
        """An arrow from one point to another, (3,) m each; one that points at the reader is a dot."""
        (x0, y0), (x1, y1) = self.at(start), self.at(end)
        length = float(np.hypot(x1 - x0, y1 - y0))
        if length < _HEAD_PX:
            self.dots(np.array([start]), colour, 3.0)
            return
        ux, uy = (x1 - x0) / length, (y1 - y0) / length
        base_x, base_y = x1 - _HEAD_PX * ux, y1 - _HEAD_PX * uy
        side = 0.45 * _HEAD_PX
        corners = (x1, y1), (base_x - side * uy, base_y + side * ux), (base_x + side * uy, base_y - side * ux)
        head = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
        self.parts.append(
            f'<path d="M{x0:.1f} {y0:.1f}L{base_x:.1f} {base_y:.1f}" stroke="{colour}" stroke-width="{width:g}"/>'
            f'<polygon points="{head}" fill="{colour}"/>'
        )

    def frame(self, T: Float, name: str, length: float, shift: tuple[float, float] = (8.0, -8.0)) -> None:
        """Axes of a frame (4, 4) and its name; ``shift`` of the name in pixels."""
        for k, (_, colour) in enumerate(AXES):
            self.arrow(T[:3, 3], T[:3, 3] + length * T[:3, k], colour)
        self.dots(T[None, :3, 3], INK, 2.5)
        self.text(T[:3, 3], name, shift, bold=True)

    def text(
        self, p: Float, words: str, shift: tuple[float, float] = (0.0, 0.0), colour: str = INK, *, bold: bool = False
    ) -> None:
        """Words that begin at a point (3,) m, shifted in pixels; left of it where the shift is negative."""
        x, y = self.at(p)
        self.words(x + shift[0], y + shift[1], words, colour, bold=bold, right=shift[0] < 0.0)

    def words(
        self, x: float, y: float, words: str, colour: str = INK, *, bold: bool = False, right: bool = False
    ) -> None:
        """Words at a place of the picture, pixels."""
        anchor, weight = ' text-anchor="end"' if right else "", ' font-weight="600"' if bold else ""
        self.parts.append(f'<text x="{x:.1f}" y="{y:.1f}" fill="{colour}"{anchor}{weight}>{escape(words)}</text>')

    def svg(self) -> str:
        """The picture as SVG text."""
        size = f'viewBox="0 0 {WIDTH:.0f} {self.height:.0f}" width="{WIDTH:.0f}" height="{self.height:.0f}"'
        font = 'font-family="system-ui, sans-serif" font-size="13"'
        head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} {font} role="img">'
        paper = f'<rect width="{WIDTH:.0f}" height="{self.height:.0f}" fill="#ffffff"/>'
        return "\n".join([head, f"<title>{escape(self.title)}</title>", paper, *self.parts, "</svg>", ""])

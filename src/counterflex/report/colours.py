"""Stepped colour scales of deviation maps: 15 steps, the middle one about zero."""

from __future__ import annotations

import math
from typing import Final

STEPS: Final = 15
# from the most removed (blue) over the zero band (green) to the most left (red), as metrology prints them
METROLOGY: Final = (
    "#08206e", "#123fa8", "#1e62d0", "#2f8be6", "#4fb2f0", "#86d0f2", "#bce6ef",
    "#3fae49",
    "#f6f0a0", "#fbdc5a", "#fbbd35", "#f6962a", "#ec6a22", "#d33a1e", "#9c1414",
)  # fmt: skip
# purple to orange over white: told apart with every common colour blindness
COLOUR_BLIND: Final = (
    "#2d004b", "#47126b", "#5f3a92", "#7d65ad", "#9b8ac0", "#b9add3", "#d8d2e6",
    "#ffffff",
    "#fde3c0", "#fdc98b", "#f6a956", "#e68a26", "#cb6d0d", "#a3530a", "#7f3b08",
)  # fmt: skip
NOT_MACHINED: Final = "#b9c1c9"
BEFORE: Final = "#c2410c"
AFTER: Final = "#0369a1"


def stepped(colours: tuple[str, ...]) -> list[list[float | str]]:
    """Colour scale in plotly's form whose colours change in steps, never gradually."""
    n = len(colours)
    return [[edge / n, colour] for k, colour in enumerate(colours) for edge in (k, k + 1)]


def scale_limit_mm(largest_mm: float) -> float:
    """Half range of a 15-step scale that holds a value: 7.5 steps of 1, 2, 4 or 5 times a power of ten, mm."""
    step = max(largest_mm, 1e-3) / (0.5 * STEPS)
    power = 10.0 ** math.floor(math.log10(step) + 1e-12)
    for factor in (1.0, 2.0, 4.0, 5.0, 10.0):
        if step <= factor * power * (1.0 + 1e-9):
            return float(f"{0.5 * STEPS * factor * power:.6g}")
    return 0.5 * STEPS * 10.0 * power


def edges_mm(limit_mm: float) -> list[float]:
    """The 16 edges of the steps, mm."""
    return [round(-limit_mm + 2.0 * limit_mm * k / STEPS, 6) for k in range(STEPS + 1)]

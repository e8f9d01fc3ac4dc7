"""What all figures share: rounded JSON numbers, compact base64 blocks for maps, and stepped colour scales."""

from __future__ import annotations

import base64
import json
import math
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Bool, Float

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


def block(values: Float) -> dict[str, str]:
    """A one- or two-dimensional array as plotly's typed-array specification (float32, little endian)."""
    data = np.ascontiguousarray(values, dtype="<f4")
    out = {"dtype": "f4", "bdata": base64.b64encode(data.tobytes()).decode("ascii")}
    if data.ndim == 2:
        out["shape"] = f"{data.shape[0]}, {data.shape[1]}"
    return out


def numbers(values: Float, digits: int) -> list[float | None]:
    """Rounded numbers; NaN becomes None, a gap in a line."""
    return [None if math.isnan(v) else round(float(v), digits) for v in values]


def script_json(value: Any) -> str:
    """JSON that may stand inside a script element: no ``<``, ``>`` or ``&`` survives unescaped."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False, ensure_ascii=True)
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def thin(x: Float, y: Float, keep: Bool, limit: int) -> tuple[Float, Float]:
    """Thin a curve to about ``limit`` points without losing its peaks; stretches that are not kept become gaps.

    Each bin of consecutive points gives its smallest and largest value, in order.

    Args:
        x: (n,).
        y: (n,).
        keep: (n,) False where the curve is to have a gap.
    """
    shown: Float = np.where(keep, y, np.nan)
    n = len(x)
    if n == 0 or n <= limit:
        return x, shown
    size = math.ceil(2.0 * n / limit)
    rows = math.ceil(n / size)
    padded = np.full(rows * size, np.nan)
    padded[:n] = shown
    bins = padded.reshape(rows, size)
    empty = np.isnan(bins).all(axis=1)
    low = np.where(empty, 0, np.argmin(np.where(np.isnan(bins), np.inf, bins), axis=1))
    high = np.where(empty, 0, np.argmax(np.where(np.isnan(bins), -np.inf, bins), axis=1))
    pick = np.sort(np.stack([low, high], axis=1), axis=1) + np.arange(rows)[:, None] * size
    index = np.minimum(pick.ravel(), n - 1)
    return x[index], shown[index]

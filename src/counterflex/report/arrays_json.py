"""Numbers for the page: rounded JSON, and compact base64 blocks for maps."""

from __future__ import annotations

import base64
import json
import math
from typing import Any

import numpy as np

from counterflex.core.arrays import Bool, Float


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
        limit: Points wanted.
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

"""Feed of corrected pieces, so that the tool keeps the programmed feed relative to the part."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Float

MOST_CHANGE: Final = 2.0
"""Largest factor, up or down. Steeper pieces take a correction back while the tool hardly moves: no chip depends on
their feed."""


def feed_factor(nominal_m: Float, commanded_m: Float) -> Float:
    """Factor for the feed of corrected pieces of path: commanded over nominal length.

    The loaded tool covers the nominal piece while the controller runs along the commanded one.

    Args:
        nominal_m: (k,) m.
        commanded_m: (k,) m.

    Returns:
        (k,) 0.5 to 2; 1 for pieces without nominal length.
    """
    whole = nominal_m > 0.0
    ratio = np.where(whole, commanded_m / np.where(whole, nominal_m, 1.0), 1.0)
    out: Float = np.clip(ratio, 1.0 / MOST_CHANGE, MOST_CHANGE)
    return out

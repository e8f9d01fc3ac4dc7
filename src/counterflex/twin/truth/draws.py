"""Numbers drawn from a seed, the same on every machine.

Every quantity has a random stream of its own, named by seed and quantity, so that adding one changes no other. The
uniform numbers come from the Mersenne generator, whose output is fixed, and values are rounded to twelve digits, so
that no library or processor shows in them.
"""

from __future__ import annotations

import math
import random
from statistics import NormalDist

import numpy as np

from counterflex.core.arrays import Float

_DIGITS = 12
_NORMAL = NormalDist()


def _uniform(seed: int, name: str) -> float:
    return random.Random(f"counterflex-truth-1:{seed}:{name}").random()


def draw(seed: int, name: str) -> float:
    """A standard normal number that depends on seed and name only; within 3 sigma."""
    low = _NORMAL.cdf(-3.0)
    return float(f"{_NORMAL.inv_cdf(low + _uniform(seed, name) * (1.0 - 2.0 * low)):.{_DIGITS}g}")


def factor(seed: int, name: str, sigma: float) -> float:
    """``exp(sigma draw)``."""
    return float(f"{math.exp(sigma * draw(seed, name)):.{_DIGITS}g}")


def vector(seed: int, name: str, sigma: float) -> Float:
    """(3,) independent normal numbers of standard deviation ``sigma``, in its unit."""
    return np.array([sigma * draw(seed, f"{name}.{c}") for c in "xyz"])


def between(seed: int, name: str, low: float, high: float) -> float:
    """A number from ``low`` to ``high``, every one as likely."""
    return float(f"{low + (high - low) * _uniform(seed, name):.{_DIGITS}g}")


def happens(seed: int, name: str, probability: float) -> bool:
    """True with a probability of 0 .. 1."""
    return _uniform(seed, name) < probability

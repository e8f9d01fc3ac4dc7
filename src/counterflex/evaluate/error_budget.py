"""Error budget: which cause makes how much of the deviation that was met."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError

REMAINDER: Final = "remainder"


@dataclass(frozen=True)
class BudgetLine:
    """One cause."""

    name: str  # cause, for example `axis 2`, `gravity`, `controller`
    share: float  # signed part of the met deviation that it explains; the shares of a budget add up to 1
    mean_m: float  # mean of its component along the met deviation, m; the means add up to the mean deviation met
    rms_m: float  # rms of the contribution itself, m, whatever its direction
    max_m: float  # its largest magnitude, m


def error_budget(met: Float, contributions: Mapping[str, Float]) -> tuple[BudgetLine, ...]:
    """Split a met deviation into the contributions that predict it, and what remains.

    At point i the contribution ``c_i`` explains ``c_i . m_i / |m_i|`` of the met deviation ``m_i``; the share is
    ``sum c_i . m_i / |m_i| / sum |m_i|``. The remainder ``m - sum c`` holds what no contribution predicts: model error,
    friction and play where those are not given on their own. Because shares are signed, a cause that works against
    the deviation has a negative one.

    Args:
        met: (n, 3) m, deviation met at points of equal weight (stations every 0.1 mm), part frame.
        contributions: Name to (n, 3) m predicted at the same points.

    Returns:
        One line per contribution in the order given, then :data:`REMAINDER`.

    Raises:
        InputError: Shapes differ, a contribution is called like the remainder, or no deviation to divide.
    """
    m = as_float("met", met, (None, 3))
    size = np.linalg.norm(m, axis=1)
    total = float(size.sum())
    if total <= 0.0:
        raise InputError("no deviation to divide")
    if REMAINDER in contributions:
        raise InputError("a contribution has the name of the remainder", value=REMAINDER)
    unit = m / np.where(size > 0.0, size, 1.0)[:, None]
    rest = m.copy()
    lines = []
    for name, value in contributions.items():
        part = as_float(f"contribution {name}", value, (len(m), 3))
        rest = rest - part
        lines.append(_line(name, part, unit, total))
    return (*lines, _line(REMAINDER, rest, unit, total))


def _line(name: str, part: Float, unit: Float, total: float) -> BudgetLine:
    explained = float(np.sum(part * unit))
    length = np.linalg.norm(part, axis=1)
    return BudgetLine(
        name=name,
        share=explained / total,
        mean_m=explained / len(part),
        rms_m=float(np.sqrt(np.mean(length**2))),
        max_m=float(length.max()),
    )

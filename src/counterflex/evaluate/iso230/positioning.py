"""Accuracy and repeatability of positioning a linear axis by ISO 230-2:2014, from both directions of approach.

With ``x_ij`` the deviation of approach j to target i, their mean and their estimator of the standard deviation are::

    x_i = sum_j x_ij / n,    s_i = sqrt(sum_j (x_ij - x_i)^2 / (n - 1))

in each direction (up: towards larger targets), and the figures::

    B_i = x_i up - x_i down,                 B = max |B_i|
    R_i up = 4 s_i up,                       R_i = max(2 s_i up + 2 s_i down + |B_i|, R_i up, R_i down)
    E up = max x_i up - min x_i up,          E = max of both - min of both
    M = max (x_i up + x_i down) / 2 - min of it
    A up = max(x_i up + 2 s_i up) - min(x_i up - 2 s_i up),    A = over both directions
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import MM

UP, DOWN = 1, -1
LEAST_RUNS: Final = 5
"""Approaches to each target in each direction that the standard asks for."""
LEAST_TARGETS: Final = 5
PER_METRE: Final = 5
LONG_M: Final = 2.0
"""Longer axes are tested otherwise: the standard asks for one approach in each direction there."""


@dataclass(frozen=True, eq=False)
class Approaches:
    """Approaches to targets along an axis."""

    target_m: Float
    deviation_m: Float  # (n,) attained minus target, m
    direction: Int  # (n,) 1 towards larger targets, -1 towards smaller ones

    def figures(self) -> Positioning:
        """Figures of ISO 230-2. Raises InputError: fewer than two targets."""
        places = np.unique(self.target_m)
        if len(places) < 2:
            raise InputError("a test of positioning needs targets", value=len(places), limit=">= 2, by ISO 230-2 >= 5")
        targets = tuple(TargetFigures.of(place, self) for place in places.tolist())
        up, s_up = _column(targets, "mean_up_m"), _column(targets, "s_up_m")
        down, s_down = _column(targets, "mean_down_m"), _column(targets, "s_down_m")
        reversal, repeat = _column(targets, "reversal_m"), _column(targets, "repeatability_m")
        middle = 0.5 * (up + down)
        return Positioning(
            targets=targets,
            accuracy_m=_range([up + 2.0 * s_up, down + 2.0 * s_down], [up - 2.0 * s_up, down - 2.0 * s_down]),
            accuracy_up_m=_range([up + 2.0 * s_up], [up - 2.0 * s_up]),
            accuracy_down_m=_range([down + 2.0 * s_down], [down - 2.0 * s_down]),
            repeatability_m=_largest(repeat) if np.isfinite(reversal).all() else None,
            repeatability_up_m=_largest(4.0 * s_up),
            repeatability_down_m=_largest(4.0 * s_down),
            systematic_m=_range([up, down], [up, down]),
            systematic_up_m=_range([up], [up]),
            systematic_down_m=_range([down], [down]),
            mean_deviation_m=_range([middle], [middle]),
            reversal_m=_largest(np.abs(reversal)),
            mean_reversal_m=float(reversal.mean()) if np.isfinite(reversal).all() else None,
            not_by_standard=_not_by_standard(places, targets),
        )


@dataclass(frozen=True)
class TargetFigures:
    """Figures of one target, m; nan where a direction has too few approaches."""

    target_m: float  # place
    mean_up_m: float  # mean deviation from below, and from above
    mean_down_m: float  # see mean_up_m
    s_up_m: float  # standard deviation from below, and from above
    s_down_m: float  # see s_up_m
    reversal_m: float  # b_i
    repeatability_m: float  # r_i; of the one direction where there is only one
    runs: tuple[int, int]  # approaches from below and from above

    @classmethod
    def of(cls, place: float, approaches: Approaches) -> TargetFigures:
        """Figures of one target from its approaches in both directions."""
        here = approaches.target_m == place
        mean, s, runs = [], [], []
        for way in (UP, DOWN):
            x = approaches.deviation_m[here & (approaches.direction == way)]
            mean.append(float(x.mean()) if len(x) else np.nan)
            s.append(float(x.std(ddof=1)) if len(x) > 1 else np.nan)
            runs.append(len(x))
        reversal = mean[0] - mean[1]
        each = np.array([4.0 * s[0], 4.0 * s[1]])
        # Of the one direction where there is only one; a direction with a single approach has an unknown scatter.
        whole = np.append(each, 2.0 * s[0] + 2.0 * s[1] + abs(reversal)) if min(runs) else each[np.array(runs) > 0]
        return cls(place, mean[0], mean[1], s[0], s[1], reversal, float(np.max(whole)), (runs[0], runs[1]))


@dataclass(frozen=True)
class Positioning:
    """Figures of an axis, m; None where the approaches do not give them."""

    targets: tuple[TargetFigures, ...]  # each target, in order
    accuracy_m: float | None  # A, of both directions
    accuracy_up_m: float | None  # A of the direction from below, and from above
    accuracy_down_m: float | None  # see accuracy_up_m
    repeatability_m: float | None  # R
    repeatability_up_m: float | None  # R from below, and from above
    repeatability_down_m: float | None  # see repeatability_up_m
    systematic_m: float | None  # E
    systematic_up_m: float | None  # E from below, and from above
    systematic_down_m: float | None  # see systematic_up_m
    mean_deviation_m: float | None
    reversal_m: float | None  # B, the largest
    mean_reversal_m: float | None  # mean of B_i
    not_by_standard: tuple[str, ...]  # what the standard asks for and the test does not have


def _column(targets: Sequence[TargetFigures], name: str) -> Float:
    return np.array([getattr(one, name) for one in targets])


def _range(high: Sequence[Float], low: Sequence[Float]) -> float | None:
    """Largest of the one less smallest of the other; None where a value is not known."""
    value = float(np.max(np.concatenate(high)) - np.min(np.concatenate(low)))
    return value if np.isfinite(value) else None


def _largest(values: Float) -> float | None:
    value = float(np.max(values))
    return value if np.isfinite(value) else None


def _not_by_standard(places: Float, targets: Sequence[TargetFigures]) -> tuple[str, ...]:
    """Conditions of the standard that a test does not meet."""
    length = float(places[-1] - places[0])
    runs = [count for one in targets for count in one.runs]
    out = []
    if min(runs) == 0:
        out.append("not every target was approached from both directions: B, M and figures of both are not given")
    if length > LONG_M:
        out.append(f"the axis is longer than {LONG_M:g} m, for which the standard has another test")
    elif min(runs) < LEAST_RUNS:
        out.append(f"{min(runs)} approaches to a target in one direction, {LEAST_RUNS} are asked for")
    if len(set(runs)) > 1:
        out.append("targets were approached unequally often")
    required = max(LEAST_TARGETS, int(np.ceil(PER_METRE * min(length, LONG_M) - 1e-9)))
    if len(targets) < required:
        out.append(f"{len(targets)} targets over {length / MM:.0f} mm, {required} are asked for")
    step = np.diff(places)
    if len(step) > 2 and float(np.ptp(step)) < 1e-3 * float(step.mean()):
        out.append("targets at equal steps: periodic errors of the axis may not show")
    return tuple(out)

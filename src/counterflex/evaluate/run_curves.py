"""Curves of a run log along the path: deviation across the feed, correction sent, force; and their figures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float
from counterflex.core.units import NS
from counterflex.runtime.record_ring import column
from counterflex.runtime.state.supervisor import State

LEAST_RUNS: Final = 4
"""Runs that a trend is told from: three would leave one degree of freedom."""


@dataclass(frozen=True)
class Trend:
    """A straight line through a figure of several runs, least squares."""

    runs: int  # with the figure
    mean: float
    slope: float  # change from one run to the next
    half_width: float  # half width of the 95 % interval of the slope, for runs that scatter independently

    @property
    def clear(self) -> bool:
        """Return whether the interval excludes that nothing changes."""
        return abs(self.slope) > self.half_width


def trend(values: Sequence[float | None]) -> Trend | None:
    """Trend over runs in their order, equally spaced; None with fewer than :data:`LEAST_RUNS` figures.

    Args:
        values: One per run; None where it has no such figure. Any unit.
    """
    known = [(k, float(v)) for k, v in enumerate(values) if v is not None and math.isfinite(v)]
    n = len(known)
    if n < LEAST_RUNS:
        return None
    x, y = np.array(known).T
    dx, mean = x - x.mean(), float(y.mean())
    square = float(dx @ dx)
    slope = float(dx @ y) / square
    rest = y - mean - slope * dx
    sigma = math.sqrt(float(rest @ rest) / (n - 2) / square)
    return Trend(n, mean, slope, sigma * float(scipy.special.stdtrit(n - 2, 0.975)))


_BASE: Final = 10  # Cycles to both sides over which the direction of the feed is taken
_STANDS_M_S: Final = 1e-3  # Below this speed of the commanded point the direction of the feed is the last one
_LEAST_N: Final = 50.0  # Force that counts as a cut where no plan says where it cuts
SHARE: Final = 0.997
_NEEDED: Final = (
    *("received_ns", "path_m", "cutting", "out_state", "w_good", "force_ratio", "flag_tracker_new"),
    *("nominal_x", "nominal_y", "nominal_z", "nominal_R02", "nominal_R12", "nominal_R22"),
    *(f"{name}_{axis}" for name in ("deflection", "correction", "deviation") for axis in "xyz"),
    *(f"{name}_f{axis}" for name in ("wrench", "predicted") for axis in "xyz"),
)
"""Columns of records that curves are made of."""


@dataclass(frozen=True, eq=False)
class RunCurves:
    """Curves of a run, one row per record.

    Pairs are across the feed (to its left, seen from the spindle) and along the tool (out of the spindle), m.
    """

    time_ns: Float  # (n,) when the telegram came, monotonic
    length_m: Float  # (n,) place along the program as the loop followed it; 0 without a plan
    cut: Bool  # (n,) material is cut: by the plan, without one where the force says so
    active: Bool  # (n,) the loop corrects, or would: state active
    sides: Float  # (n, 2, 3) the two directions, part axes
    # (n, 2) under the force that the correction is computed from: with a compensated program that by which the planned
    # force is missed
    deflection_m: Float
    sent_m: Float  # (n, 2) correction sent
    measured_m: Float  # (n, 2) deviation that a tracker measures; not a number between its samples
    force_n: Float  # (n,) size of the measured force on the tool; not a number while it is not good
    planned_n: Float  # (n,) size of the planned one; not a number without a plan
    ratio: Float  # (n,) measured by planned force; not a number where it is not known

    def __len__(self) -> int:
        """Records."""
        return len(self.time_ns)

    @property
    def judged(self) -> Bool:
        """(n,) where deviations count: in the cut; in a run that cuts nothing, while the loop is active."""
        return self.cut if self.cut.any() else self.active


def needed_of(rows: Float) -> Float:
    """Return the columns of records that curves are made of, (n, m): few, so that a run of hours fits into memory.

    Args:
        rows: (n, WIDTH) of :class:`counterflex.runtime.record_ring.RecordRing`.
    """
    return rows[:, [column(name) for name in _NEEDED]]


def _three(value: Mapping[str, Float], name: str, *axes: str) -> Float:
    return np.stack([value[f"{name}_{axis}"] for axis in axes or ("x", "y", "z")], axis=1)


def _along(sides: Float, values: Float) -> Float:
    out: Float = np.einsum("nij,nj->ni", sides, values)
    return out


def curves_of(parts: Sequence[Float], *, planned: bool) -> RunCurves:
    """Curves of a whole run: a feed is followed across the segments of its log.

    Args:
        parts: (n, m) each, :func:`needed_of` records that follow each other; at least one.
        planned: The run had a plan.
    """
    rows = np.concatenate(parts)
    value = dict(zip(_NEEDED, rows.T, strict=True))
    three = partial(_three, value)
    sides = _sides(value["received_ns"], three("nominal"), three("nominal", "R02", "R12", "R22"))
    force = np.linalg.norm(three("wrench", "fx", "fy", "fz"), axis=1)
    force = np.where(value["w_good"] > 0, force, np.nan)
    plan = np.linalg.norm(three("predicted", "fx", "fy", "fz"), axis=1) if planned else np.full(len(rows), np.nan)
    deviation, new = three("deviation"), value["flag_tracker_new"] > 0
    seen = new & np.any(deviation != 0.0, axis=1)
    ratio = value["force_ratio"]
    cut = value["cutting"] > 0.5 if planned else np.nan_to_num(force) > _LEAST_N
    return RunCurves(
        value["received_ns"],
        value["path_m"],
        cut,
        value["out_state"] == State.ACTIVE,
        sides,
        _along(sides, three("deflection")),
        _along(sides, three("correction")),
        np.where(seen[:, None], _along(sides, deviation), np.nan),
        force,
        plan,
        np.where(ratio > 0.0, ratio, np.nan),
    )


def _sides(time_ns: Float, place: Float, tool: Float) -> Float:
    """(n, 2, 3) directions across the feed, to its left seen from the spindle, and along the tool, part axes."""
    n = len(place)
    if n < 2:
        return np.stack([np.zeros((n, 3)), tool], axis=1)
    k = np.arange(n)
    before, after = np.maximum(k - _BASE, 0), np.minimum(k + _BASE, n - 1)
    step = place[after] - place[before]
    span = NS * (time_ns[after] - time_ns[before])
    moves = np.linalg.norm(step, axis=1) > _STANDS_M_S * np.maximum(span, 1e-9)
    last = np.maximum.accumulate(np.where(moves, k, -1))
    first = int(np.argmax(moves)) if moves.any() else 0
    feed = step[np.where(last < 0, first, last)]
    across = np.cross(-tool, feed)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.divide(across, length, out=np.zeros_like(across), where=length > 1e-12)
    return np.stack([across, tool], axis=1)


def largest_share(pairs_m: Float, where: Bool) -> float | None:
    """m, size below which 99.7 % lies; None where nothing is known.

    Args:
        pairs_m: (n, 2).
        where: (n,) what counts.
    """
    size = np.linalg.norm(pairs_m[where], axis=1)
    size = size[np.isfinite(size)]
    return float(np.quantile(size, SHARE)) if len(size) else None


def mean_pair(pairs_m: Float, where: Bool) -> Float | None:
    """(2,) m, mean where it counts; None where nothing is known."""
    rows = pairs_m[where]
    rows = rows[np.isfinite(rows).all(axis=1)]
    return rows.mean(axis=0) if len(rows) else None


def figures(curves: RunCurves, contained_m: Float | None) -> dict[str, Any]:
    """Figures of a run, SI; None where something was not measured or is not known.

    Args:
        contained_m: (n, 2) correction that the program contains, or None where it is not known.
    """
    judged, force = curves.judged, curves.force_n[np.isfinite(curves.force_n)]
    ratio = curves.ratio[judged & np.isfinite(curves.ratio)]
    pairs = deviations(curves, contained_m)
    return {
        **{f"{name}_m": largest_share(values, judged) for name, values in pairs.items()},
        "mean_sent_m": mean_pair(curves.sent_m, judged),
        "force_peak_n": float(force.max()) if len(force) else None,
        "ratio": float(np.median(ratio)) if len(ratio) else None,
    }


def deviations(curves: RunCurves, contained_m: Float | None) -> dict[str, Float]:
    """(n, 2) m: where the tool stands against the original program, as the loop computes it and as a tracker measures.

    ``predicted``: deflection, and the planned one that the program takes back. ``corrected``: what the program contains
    and the loop sends. ``remaining``: their sum, without the robot's lag. The first two are not a number where
    it is not known what the program contains.

    Args:
        contained_m: (n, 2), or None.
    """
    contained = np.full_like(curves.sent_m, np.nan) if contained_m is None else contained_m
    return {
        "predicted": curves.deflection_m - contained,
        "corrected": contained + curves.sent_m,
        "remaining": curves.deflection_m + curves.sent_m,
        "measured": curves.measured_m,
    }

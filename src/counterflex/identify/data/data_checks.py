"""Plain faults of measured data, found before anything is fitted: gaps, repeats that contradict, points on a line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Literal

import numpy as np
import scipy

from counterflex.core.arrays import Float, Int, rows_of_each
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.same_postures import leaders
from counterflex.identify.solver.parameters import Parameters
from counterflex.identify.solver.residuals import Residuals

SAME_POSE_RAD: Final = 1e-5
"""Joint angles nearer than this are the same pose."""
CONTRADICTION: Final = 1e-6
"""Probability, all repeated poses taken together, below which repeats contradict each other."""
THIN: Final = 1e-2
"""Spread across by spread along below which points are on a line (or in a plane)."""


def check_finite(data: Dataset, channels: Sequence[str]) -> None:
    """Refuse NaN and infinity.

    Raises:
        InputError: Names channel and line.
    """
    for name in channels:
        values = data.values(name).reshape(len(data), -1)
        bad = ~np.all(np.isfinite(values), axis=1)
        if np.any(bad):
            row = int(np.flatnonzero(bad)[0])
            raise InputError(
                f"channel '{name}' has {int(np.sum(bad))} rows that are not numbers",
                where=data.place(row),
                value=values[row].tolist(),
                hint="Remove the rows, or write drop_incomplete = true under [rows]",
            )


def check_moves(data: Dataset, channel: str, least: float) -> None:
    """Refuse a channel that stands still: a column that was copied down, or the wrong column.

    ``channel``: (n, k). ``least``: Spread (standard deviation of at least one component), SI, that any use has.

    Raises:
        InputError: No component varies by that much.
    """
    spread = np.std(data.values(channel).reshape(len(data), -1), axis=0)
    if float(np.max(spread)) < least:
        raise InputError(
            f"channel '{channel}' hardly changes",
            where=data.where or data.name,
            value=f"{float(np.max(spread)):.3g} in the most lively component",
            limit=f">= {least:.3g} (standard deviation, SI)",
            hint=f"Check the columns and the unit under [channels.{channel}]",
        )


def same_poses(q: Float, tolerance: float = SAME_POSE_RAD) -> Int:
    """(n,) one id for all rows whose joint angles (n, 6) agree within a tolerance, numbered as they first come."""
    return leaders(q / tolerance)


def check_repeats(data: Dataset, channel: str, *, same: Sequence[str] = ("q",), gross: float = 100.0) -> None:
    """Refuse repeated poses whose values contradict each other, and data that are one pose throughout.

    Within each set of rows that are alike in the channels ``same``, the squares of the deviations from the mean over
    the stated variances are chi-square distributed; single gross errors (rows beyond ``gross`` standard deviations of
    the set's median) are left to the robust fit unless every second row of the set is one.

    ``channel``: (n, k) values that must agree. ``same``: Channels (n, k) that make rows alike.

    Raises:
        InputError: Names lines, difference and standard deviation.
    """
    key = np.hstack([data.values(name).reshape(len(data), -1) for name in same])
    ids = same_poses(key)
    if len(data) > 1 and np.all(ids == 0):
        raise InputError(
            "all rows are one and the same pose",
            where=data.where or data.name,
            value=f"{len(data)} rows",
            hint=f"Check the columns of {', '.join(same)}, or measure in different poses",
        )
    values = data.values(channel).reshape(len(data), -1)
    sigma = data.channel(channel).need_sigma()
    if sigma.shape != values.shape:
        return
    squares, numbers = 0.0, 0
    worst, lines = 0.0, ""
    for _, rows in rows_of_each(ids):
        if len(rows) < 2:
            continue
        off = (values[rows] - np.median(values[rows], axis=0)) / sigma[rows]
        bad = np.max(np.abs(off), axis=1) > gross
        if len(rows) > 2 and np.sum(bad) < 0.5 * len(rows):
            rows, off = rows[~bad], off[~bad]
        if len(rows) < 2:
            continue
        centred = (values[rows] - np.mean(values[rows], axis=0)) / sigma[rows]
        squares += float(np.sum(centred**2))
        numbers += (len(rows) - 1) * values.shape[1]
        if float(np.max(np.abs(off))) > worst:
            worst = float(np.max(np.abs(off)))
            k = int(np.argmax(np.max(np.abs(off), axis=0)))
            ends = rows[[int(np.argmin(values[rows, k])), int(np.argmax(values[rows, k]))]]
            lines = " and ".join(str(int(line)) for line in sorted({int(data.line[r]) for r in ends}))
    # Stated standard deviations are often optimistic by a factor of two or three; that is the fit's business.
    if numbers and scipy.stats.chi2.sf(squares / 25.0, numbers) < CONTRADICTION:
        raise InputError(
            f"repeated poses contradict each other in channel '{channel}'",
            where=f"{data.where or data.name}: lines {lines}",
            value=f"{worst:.3g} standard deviations apart, {np.sqrt(squares / numbers):.3g} in the mean of all repeats",
            limit="about 1",
            hint="The rows of two files may be out of step, the tracker may have moved, or sigma is far too small",
        )


def check_enough(parameters: Parameters, blocks: Sequence[Residuals], needed: Sequence[str] = ()) -> None:
    """Refuse fewer measured numbers than parameters; rows of one group (repeats of a posture) count once.

    ``needed``: Names of parameters that have a prior so wide that the data must determine them (frames).

    Raises:
        InputError: Says how many numbers there are and how many are needed.
    """
    unknown = {p.name for p in parameters if p.free and not p.has_prior} | set(needed)
    free = {p.name for p in parameters if p.free} | unknown
    rows = sum(len(b.group) for b in blocks)
    groups = [len(np.unique(b.group)) for b in blocks]
    count = sum(n * len(b.components) for n, b in zip(groups, blocks, strict=True))
    if count < len(free) or count == 0:
        raise InputError(
            "there are too few measurements",
            value=f"{count} numbers in {sum(groups)} different postures ({rows} rows)",
            limit=f">= {max(len(free), 1)}, one for each number that is looked for, better twice as many",
            hint="Measure more poses (counterflex identify proposes them); repeats of a pose do not count",
        )


def check_spread(
    points: Float,
    what: str,
    *,
    where: str = "",
    shape: Literal["point", "line", "plane"] = "line",
    least_m: float = 10.0 * MM,
) -> None:
    """Refuse points that do not span what a frame needs.

    Args:
        points: (n, 3) m.
        what: For the message: ``fiducials``.
        where: For the message.
        shape: The worst shape that is refused: ``point`` refuses points in one place, ``line`` also points on one line,
            ``plane`` also points in one plane.
        least_m: Spread (standard deviation) along their longest direction below which points are in one place.

    Raises:
        InputError: Too few of them, in one place, on one line or in one plane.
    """
    fewest = {"point": 2, "line": 3, "plane": 4}[shape]
    if len(points) < fewest:
        raise InputError(f"there are too few {what}", where=where or None, value=len(points), limit=f">= {fewest}")
    spread = np.linalg.svd(points - np.mean(points, axis=0), compute_uv=False) / np.sqrt(len(points))
    spread = np.pad(spread, (0, 3 - len(spread)))
    figures = " x ".join(f"{s / MM:.3g}" for s in spread) + " mm"
    if spread[0] < least_m:
        raise InputError(f"the {what} are all in one place", where=where or None, value=figures, limit="spread apart")
    if shape != "point" and spread[1] < THIN * spread[0]:
        raise InputError(
            f"the {what} are on one line",
            where=where or None,
            value=f"spread {figures}",
            limit=f"second figure >= {THIN:g} of the first",
            hint="The rotation about that line is not determined; add a point well off it",
        )
    if shape == "plane" and spread[2] < THIN * spread[0]:
        raise InputError(
            f"the {what} are in one plane",
            where=where or None,
            value=f"spread {figures}",
            limit=f"third figure >= {THIN:g} of the first",
            hint="Add a point well off that plane",
        )

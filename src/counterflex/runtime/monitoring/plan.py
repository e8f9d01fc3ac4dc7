"""Plan as the monitor reads it, row by row: the force to be expected and how little or much it may be.

Where exactly the tool is, is not known: the controller smooths its path, the robot lags, the blank is larger or smaller
by some tenths. The least and the largest predicted force over all places that are possible bound the true one.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.core.records import Records, records
from counterflex.runtime.monitoring.records import PLAN_ROW
from counterflex.runtime.monitoring.settings import MonitorSettings

STEADY_SHARE: Final = 0.1
"""A force is steady where its size changes by no more than this share over the time it takes to see a drop."""
STEADY_COSINE: Final = 0.95


@kernel("void(float64[::1], float64[:, ::1], float64, int64, float64[::1])")
def _at(time: Float, force: Float, t: float, begin: int, out: Float) -> None:
    """Force at a time, linear between rows, the end rows beyond them; searched from row ``begin``."""
    n = time.shape[0]
    i = begin
    while i > 0 and time[i] > t:
        i -= 1
    while i < n - 1 and time[i + 1] < t:
        i += 1
    j = min(i + 1, n - 1)
    span = time[j] - time[i]
    u = min(1.0, max(0.0, (t - time[i]) / span)) if span > 0.0 else 0.0
    for k in range(3):
        out[k] = (1.0 - u) * force[i, k] + u * force[j, k]


@kernel("void(float64[::1], float64[::1], float64[:, ::1], float64, float64, float64, float64[:, ::1])", entry=True)
def bounds(time: Float, distance: Float, force: Float, late: float, time_s: float, place_m: float, out: Float) -> None:
    """Least and largest size of the force, and least cosine of its direction to the one here, about each row.

    All rows within ``time_s`` of the time ``late`` before the row, or within ``place_m`` of the row's place, and the
    force interpolated at the ends of that time.

    Args:
        time: (n,) s, not decreasing.
        distance: (n,) m, not decreasing.
        force: (n, 3) N.
        late: s.
        time_s: Half width.
        place_m: Half width.
        out: (n, 3) written: least N, largest N, least cosine; the cosine is -1 where a force is zero.
    """
    n = time.shape[0]
    here = np.empty(3)
    edge = np.empty(3)
    for i in range(n):
        middle = time[i] - late
        least, most, cosine = np.inf, 0.0, 1.0
        _at(time, force, middle, i, here)
        size_here = np.sqrt(here[0] * here[0] + here[1] * here[1] + here[2] * here[2])
        for side in (-1.0, 1.0):
            _at(time, force, middle + side * time_s, i, edge)
            size = np.sqrt(edge[0] * edge[0] + edge[1] * edge[1] + edge[2] * edge[2])
            least, most = min(least, size), max(most, size)
            dot = edge[0] * here[0] + edge[1] * here[1] + edge[2] * here[2]
            cosine = min(cosine, dot / (size * size_here) if size * size_here > 0.0 else -1.0)
        for step in (-1, 1):
            j = i if step < 0 else i + 1
            while 0 <= j < n:
                inside_time = abs(time[j] - middle) <= time_s
                inside_place = abs(distance[j] - distance[i]) <= place_m
                between = middle <= time[j] <= time[i]
                if not (inside_time or inside_place or between):
                    break
                if inside_time or inside_place:
                    size = np.sqrt(force[j, 0] ** 2 + force[j, 1] ** 2 + force[j, 2] ** 2)
                    least, most = min(least, size), max(most, size)
                    dot = force[j, 0] * here[0] + force[j, 1] * here[1] + force[j, 2] * here[2]
                    cosine = min(cosine, dot / (size * size_here) if size * size_here > 0.0 else -1.0)
                j += step
        out[i, 0], out[i, 1], out[i, 2] = least, most, cosine


def lost_tooth(teeth: Int, exponent: float) -> Float:
    """Share of the mean force that is lost when one tooth breaks: ``1 - (z - 2 + 2^p) / z``.

    The tooth behind the missing one takes twice the chip, and its force grows with the power p of it. A single tooth
    takes all with it.

    Args:
        teeth: (n,) number of teeth.
        exponent: p.
    """
    z = np.maximum(teeth, 1).astype(np.float64)
    out: Float = np.where(z > 1, 1.0 - (z - 2.0 + 2.0**exponent) / z, 1.0)
    return out


def monitor_plan(plan: Records, settings: MonitorSettings, turn_per_s: Float, teeth: Int, tool: Int) -> Records:
    """The plan as the monitor needs it.

    Args:
        plan: (n,) PLAN of :meth:`counterflex.runtime.loop.LoopPlan.packed`.
        turn_per_s: (n,) spindle speed, turns per second; 0 is not known.
        teeth: (n,) of the tool; 0 is not known.
        tool: (n,) its number.

    Returns:
        (n,) PLAN_ROW.
    """
    n = len(plan)
    out = records(PLAN_ROW, n)
    time = np.ascontiguousarray(plan["time"])
    cutting = plan["cut"] > 0.0
    touching = cutting.copy()
    touching[:-1] |= cutting[1:]
    force = np.ascontiguousarray(plan["wrench"][:, :3]) * touching[:, None]
    p: Float = plan["point"]
    step = np.linalg.norm(np.diff(p, axis=0, prepend=p[:1]), axis=1)
    distance = np.ascontiguousarray(np.cumsum(step))
    extremes = np.empty((n, 3))
    bounds(time, distance, force, settings.follow_s, settings.timing_s, settings.place_m, extremes)
    out["time"], out["distance"] = time, distance
    for k in range(3):
        out["force"][:, k] = np.interp(time - settings.follow_s, time, force[:, k])
    out["lowest"], out["highest"] = extremes[:, 0], extremes[:, 1]
    wide = settings.timing_s + 4.0 * settings.filter_s + settings.breakage_s
    bounds(time, distance, force, settings.follow_s, wide, settings.place_m, extremes)
    out["steady"] = (extremes[:, 0] >= (1.0 - STEADY_SHARE) * extremes[:, 1]) & (extremes[:, 2] >= STEADY_COSINE)
    out["turn_per_s"], out["teeth"], out["tool"] = turn_per_s, teeth, tool
    out["lost_tooth"] = lost_tooth(teeth, settings.exponent)
    out["speed"] = 1.0
    return out

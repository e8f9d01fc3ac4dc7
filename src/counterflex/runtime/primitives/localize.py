"""Place of the robot on the planned path, and what the plan says there and a little later.

A plan is an array of records, :data:`counterflex.runtime.state.planned.PLAN`, one per path point.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Records
from counterflex.runtime.primitives.loop_types import LOOP_TYPES

SEGMENTS_BACK: Final = 2
"""Segments behind the last place that are looked at."""
GIVE_UP_M: Final = 2e-3
"""The search ends where the distance has grown by this over the least one found."""
LOST_M: Final = 2.5e-3
"""Distance from which on the whole window is looked at: half of that at which the loop takes the plan for another's."""
ALIKE_M: Final = 20e-6
"""Of places this much alike the first call takes the earliest: a closed path begins at its beginning."""
STANDS_M: Final = 0.1e-3
"""The same of :func:`seek`, whose calls see poses of different cycles: so far the reported pose of a robot that stands
scatters at most. With 20 um a scatter of 30 um took the end of a closed path in one start of two."""


SEEK_ROWS: Final = 400
"""Segments that one call of :func:`seek` looks at: about 10 us."""


@kernel("Tuple((float64, float64))(Plan[::1], int64, float64, float64, float64)", **LOOP_TYPES)
def _on_segment(plan: Records, row: int, x: float, y: float, z: float) -> tuple[float, float]:
    """Squared distance of a point from segment ``row`` -> ``row + 1``, and the place 0..1 of its foot."""
    a, b = plan[row], plan[row + 1]
    ax, ay, az = a.point[0], a.point[1], a.point[2]
    bx, by, bz = b.point[0] - ax, b.point[1] - ay, b.point[2] - az
    dx, dy, dz = x - ax, y - ay, z - az
    length = bx * bx + by * by + bz * bz
    u = 0.0
    if length > 0.0:
        u = min(1.0, max(0.0, (dx * bx + dy * by + dz * bz) / length))
    ex, ey, ez = dx - u * bx, dy - u * by, dz - u * bz
    return ex * ex + ey * ey + ez * ez, u


@kernel("float64(Plan[::1], float64[::1], float64, float64, float64, int64)", entry=True, **LOOP_TYPES)
def follow(plan: Records, place: Float, x: float, y: float, z: float, window: int) -> float:
    """Bring the place on the path up to date.

    Looks from two segments behind the last place up to ``window`` ahead, and no farther once the distance has grown by
    2 mm over the least one: a path that comes back to the same spot later is not jumped to. Where that leaves the point
    more than :data:`LOST_M` away, the search goes on to the end of the window and takes what is less than half as far:
    a robot that has turned round, while nothing came from it, would else stay behind its turn. The first call (place
    below zero) looks at the whole path and takes the earliest place that is as near as any.

    Args:
        plan: (n,) PLAN, n >= 2.
        place: (2,) row and fraction of the segment that begins there; row -1 is unknown. Changed.
        x: Commanded position, part frame, m.
        window: Segments ahead.

    Returns:
        Distance from the path, m.
    """
    last = plan.shape[0] - 2
    row = int(place[0])
    begin, end = 0, last
    anywhere = row < 0
    if not anywhere:
        begin, end = max(0, row - SEGMENTS_BACK), min(last, row + window)
    best, nearest, at = math.inf, begin, 0.0
    looked = end + 1
    for i in range(begin, end + 1):
        d, u = _on_segment(plan, i, x, y, z)
        if d < best and (not anywhere or math.sqrt(d) < math.sqrt(best) - ALIKE_M):
            best, nearest, at = d, i, u
        elif not anywhere and i > row and math.sqrt(d) > math.sqrt(best) + GIVE_UP_M:
            looked = i + 1
            break
    # Less than half as far: a place that is merely a little nearer is a neighbouring pass, and the window holds many.
    if not anywhere and best > LOST_M * LOST_M:
        near = 0.25 * best
        for i in range(looked, end + 1):
            d, u = _on_segment(plan, i, x, y, z)
            if d < near and math.sqrt(d) < math.sqrt(best) - ALIKE_M:
                best, nearest, at = d, i, u
    if not anywhere and (nearest < row or (nearest == row and at < place[1])):
        nearest, at = row, place[1]  # a program does not run backwards; noise of the position must not
    place[0], place[1] = float(nearest), at
    return math.sqrt(best)


@kernel("void(Plan[::1], float64[::1], float64[::1], float64, float64, float64)", **LOOP_TYPES)
def seek(plan: Records, place: Float, sweep: Float, x: float, y: float, z: float) -> None:
    """Go on looking for the place on the whole path, some segments in a call, while the robot is not on its way yet.

    When the last segment has been looked at, the earliest place that was nearer than the present one is taken, and the
    search begins anew: a program that is started again is found at its beginning. A robot that stands where it stood,
    because its feed is held, keeps its place on a path that passes there more than once; only from the end of a closed
    path it goes to the beginning.

    ``place``: (2,) as for :func:`follow`; changed when a sweep is over. ``sweep``: (4,) next row, least distance so
    far, its row and fraction; changed. Zeros begin. ``x``: commanded position, part frame, m.
    """
    last = plan.shape[0] - 2
    begin = int(sweep[0])
    best = math.inf if begin == 0 else sweep[1]
    end = min(last, begin + SEEK_ROWS - 1)
    for i in range(begin, end + 1):
        d, u = _on_segment(plan, i, x, y, z)
        distance = math.sqrt(d)
        if distance < best - STANDS_M:
            best, sweep[2], sweep[3] = distance, float(i), u
    sweep[0], sweep[1] = float(end + 1), best
    if end < last:
        return
    sweep[0] = 0.0
    nearest, at = _on_segment(plan, int(sweep[2]), x, y, z)
    here = math.inf if place[0] < 0.0 else _on_segment(plan, int(place[0]), x, y, z)[0]
    ended = int(place[0]) == last and place[1] >= 1.0
    alike = math.sqrt(nearest) <= math.sqrt(here) + STANDS_M
    if math.sqrt(nearest) < math.sqrt(here) - STANDS_M or (alike and (ended or sweep[2] == place[0])):
        place[0], place[1] = sweep[2], at


@kernel("float64(Plan[::1], float64[::1], float64, boolean, float64[::1])", **LOOP_TYPES)
def wrench_at(plan: Records, place: Float, lead_s: float, ahead: bool, w: Float) -> float:
    """Predicted wrench some time after, or before, the present place.

    Args:
        plan: (n,) PLAN.
        place: (2,) of :func:`follow`.
        lead_s: How much later along the plan; below zero earlier.
        ahead: The wrench to be commanded there (``ahead``), not the predicted one.
        w: (6,) N, N m, part axes; written. Zero where nothing is cut.

    Returns:
        1 where material is cut there, else 0.
    """
    n = plan.shape[0]
    i = int(place[0])
    u = place[1]
    time = plan[i].time + u * (plan[i + 1].time - plan[i].time) + lead_s
    while i < n - 2 and plan[i + 1].time < time:
        i += 1
    while i > 0 and plan[i].time > time:
        i -= 1
    here, there = plan[i], plan[i + 1]
    span = there.time - here.time
    u = min(1.0, max(0.0, (time - here.time) / span)) if span > 0.0 else 1.0
    first, last = here.wrench[:], there.wrench[:]
    if ahead:
        first, last = here.ahead[:], there.ahead[:]
    for k in range(6):
        w[k] = (1.0 - u) * first[k] + u * last[k]
    return float(there.cut)


@kernel("void(Plan[::1], float64[::1], float64[::1])", **LOOP_TYPES)
def contained_at(plan: Records, place: Float, c: Float) -> None:
    """Correction that the program contains at the present place, (6,) written."""
    i, u = int(place[0]), place[1]
    first, last = plan[i].contained[:], plan[i + 1].contained[:]
    for k in range(6):
        c[k] = (1.0 - u) * first[k] + u * last[k]

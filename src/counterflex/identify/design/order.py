"""In which order to take poses: short ways, and every axis approached from the same side, so that play cancels.

An axis with play rests on one side of its dead band or the other, depending on how it came. An order cannot bring
every axis to every pose from the same side, but a good one does so far more often than chance.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG

BAND_RAD: Final = 0.1 * DEG
"""Move of an axis that surely takes up its play."""
REVERSAL_S: Final = 0.5
"""Time that an axis arriving from the wrong side counts for, against time of travel."""
STOP_S: Final = 0.3
"""Time that starting and stopping adds to every move."""
_STILL_RAD: Final = 1e-9
_STARTS: Final = 10


def wrong_sides(q: Float) -> Bool:
    """Axes that rest on the other side of their play than that of a growing angle, pose by pose.

    Every axis is taken to be on that side at the first pose. A move of less than :data:`BAND_RAD` upwards does not
    surely take up the play, any move downwards gives it up.

    Args:
        q: (n, 6) rad, in order.

    Returns:
        (n, 6).
    """
    q = as_float("q", q, (None, 6))
    right = np.ones(6, dtype=np.bool_)
    out = np.zeros(q.shape, dtype=np.bool_)
    for k, forward in enumerate(np.diff(q, axis=0, prepend=q[:1])):
        right = (forward > BAND_RAD) | (right & (forward >= -_STILL_RAD))
        out[k] = ~right
    return out


def order_of_poses(q: Float, speeds_rad_s: Float) -> Int:
    """An order with short travel in which few axes arrive with falling angle.

    Least sum over the moves of time of travel plus :data:`REVERSAL_S` times the axes that arrive with falling angle:
    nearest neighbour from several beginnings, improved by turning round and moving stretches (2-opt and or-opt on the
    directed costs) until neither helps.

    Args:
        q: (n, 6) rad poses; equal ones stay together.
        speeds_rad_s: (6,) rad/s.

    Returns:
        (n,) indices into ``q``, in order.

    Raises:
        InputError: A speed that is not above zero.
    """
    q = as_float("q", q, (None, 6))
    speeds = as_float("speeds_rad_s", speeds_rad_s, (6,))
    if not np.all(speeds > 0.0):
        raise InputError("the speed of an axis must be above zero", value=speeds.tolist())
    n = len(q)
    if n <= 2:
        return np.arange(n, dtype=np.int64)
    # Directed: an axis that arrives with falling angle going there arrives with growing angle going back. The first row
    # and column are a place to come from that costs nothing.
    cost = np.block([[np.zeros((1, 1)), np.zeros((1, n))], [np.full((n, 1), np.inf), _costs(q, speeds)]])
    starts = np.unique(np.linspace(1, n, min(n, _STARTS)).astype(np.int64))
    tours = [_improved(_nearest(cost, int(first)), cost) for first in starts]
    tours.append(_improved(_nearest(cost, None), cost))
    best = min(tours, key=lambda tour: _length(tour, cost))
    return np.array(best[1:], dtype=np.int64) - 1


def _costs(way: Float, speeds: Float) -> Float:
    """(m, m) of going from row to row."""
    move = way[None, :, :] - way[:, None, :]
    travel = np.max(np.abs(move) / speeds, axis=2)
    wrong = np.sum(move < -_STILL_RAD, axis=2)
    out: Float = travel + STOP_S * (travel > 0.0) + REVERSAL_S * wrong
    return out


def _nearest(cost: Float, first: int | None) -> list[int]:
    remaining = np.ones(len(cost), dtype=np.bool_)
    remaining[0] = False
    tour = [0]
    while np.any(remaining):
        here = int(np.argmin(np.where(remaining, cost[tour[-1]], np.inf))) if first is None or len(tour) > 1 else first
        tour.append(here)
        remaining[here] = False
    return tour


def _length(tour: list[int], cost: Float) -> float:
    return float(np.sum(cost[tour[:-1], tour[1:]]))


def _improved(tour: list[int], cost: Float) -> list[int]:
    for _ in range(20 * len(tour)):
        better = _turned(tour, cost) or _moved(tour, cost)
        if better is None:
            break
        tour = better
    return tour


def _turned(tour: list[int], cost: Float) -> list[int] | None:
    """The best turning round of a stretch i..j, where one helps (the first place stays)."""
    t = np.array(tour)
    n = len(t)
    ahead = np.concatenate([[0.0], np.cumsum(cost[t[:-1], t[1:]])])
    # From the free beginning nothing leads back to it; no stretch contains it.
    back = np.concatenate([[0.0, 0.0], np.cumsum(cost[t[2:], t[1:-1]])]) if n > 2 else np.zeros(n)
    i, j = np.triu_indices(n, 1)
    keep = i >= 1
    i, j = i[keep], j[keep]
    if len(i) == 0:
        return None
    after = np.minimum(j + 1, n - 1)
    ends = j + 1 < n
    old = cost[t[i - 1], t[i]] + (ahead[j] - ahead[i]) + np.where(ends, cost[t[j], t[after]], 0.0)
    new = cost[t[i - 1], t[j]] + (back[j] - back[i]) + np.where(ends, cost[t[i], t[after]], 0.0)
    best = int(np.argmin(new - old))
    if not new[best] - old[best] < -1e-9:
        return None
    a, b = int(i[best]), int(j[best])
    return [*tour[:a], *tour[a : b + 1][::-1], *tour[b + 1 :]]


def _moved(tour: list[int], cost: Float) -> list[int] | None:
    """The best move of a stretch of up to three poses elsewhere, as it stands, where one helps."""
    t = np.array(tour)
    n = len(t)
    step = cost[t[:-1], t[1:]]
    best_move: tuple[float, list[int]] | None = None
    for size in (1, 2, 3):
        first = np.arange(1, n - size + 1)  # of each stretch, one to a row
        if len(first) == 0:
            continue
        last = first + size - 1
        inside = last + 1 < n
        after = np.minimum(last + 1, n - 1)
        out = step[first - 1] + np.where(inside, step[np.minimum(last, n - 2)], 0.0)
        out -= np.where(inside, cost[t[first - 1], t[after]], 0.0)
        place = np.arange(n - size)
        rest = t[place + size * (place >= first[:, None])]
        into = cost[rest, t[first][:, None]]
        into[:, :-1] += cost[t[last][:, None], rest[:, 1:]] - cost[rest[:, :-1], rest[:, 1:]]
        k = np.argmin(into, axis=1)
        gain = out - into[first - 1, k]
        best = int(np.argmax(gain))
        if gain[best] > 1e-9 and (best_move is None or gain[best] > best_move[0]):
            a, cut = int(first[best]), int(k[best]) + 1
            others = rest[best].tolist()
            best_move = (float(gain[best]), [*others[:cut], *tour[a : a + size], *others[cut:]])
    return None if best_move is None else best_move[1]

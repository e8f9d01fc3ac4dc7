"""Lower the programmed feed where the arm would swing: at first contact, at the end of a cut, and where the path turns.

An arm of angular frequency w that is asked for a motion u(t) within less than its period swings about it. A step of the
velocity of u by dv starts a swing of ``dv / w``, a step of its acceleration by da one of ``da / w^2``. Asked for are

- the static deflection under the cutting force, whose velocity is ``v d|u|/ds``, where it grows (where the force ends,
  a slow tool would only show for longer where exactly it ends);
- the programmed motion itself, against the inertia of the arm: its velocity changes by ``2 v sin(theta/2)`` where the
  path turns by theta, by v at a stop, and its acceleration is at most what the feed may change by.

The feed v is therefore bounded such that none of them starts a swing of more than a limit e:

    v <= e w / (d|u|/ds),   2 v sin(theta/2) <= e w,   v <= e w at a stop,   v^2 kappa <= e w^2/2,   |dv/dt| <= e w^2/2

The last one makes the feed fall and rise before and behind such places. Compensation inverts the mode and takes back
most of what is left; how well depends on how well the mode is known, and a swing that was never started needs no
knowledge. Only rows that cut, and those within :data:`CALM_S` before, are slowed; the share of the feed never falls
below a least one (:data:`LEAST`, at a sharp corner :data:`LEAST_AT_CORNER`), and in the cut the chip never below
:data:`LEAST_CHIP_M`.

Singhose, W.: Command shaping for flexible systems, 2009 (what a lightly damped mode makes of steps and ramps).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.jit import kernel
from counterflex.core.units import MM, UM
from counterflex.path.toolpath import FEED, ToolPath

STEP: Final = 0.05
"""Shares of the feed are written in these steps."""
SWING_M: Final = 50.0 * UM
"""Largest swing that one change starts, unless the cell file says another."""
LEAST: Final = 0.4
"""Lowest share of the programmed feed in the cut: thinner chips make the force uneven."""
LEAST_AT_CORNER: Final = 0.25
"""The same within :data:`CORNER_M` of a sharp corner: too short a way for the force to become uneven."""
CORNER_M: Final = 1.0 * MM
"""Length of path on either side of a corner within which the tool brakes from one least speed to the other."""
LEAST_CHIP_M: Final = 5.0 * UM
"""Smallest feed per tooth in the cut: an edge that rubs cuts nothing and heats."""
CALM_S: Final = 0.5
"""So long before contact the motion is made gentle: a swing of 8 Hz with a damping ratio of 0.1 has died out then."""
SMOOTH_M: Final = 3.0 * MM
"""Length of path over which the slope of the deflection is taken: some cells of the stock's grid."""
ENOUGH: Final = 0.25
"""An arc has one feed: it is slowed as a whole where at least this share of its length asks for it."""
_STILL_M: Final = 1e-9


@dataclass(frozen=True, eq=False)
class FeedGroups:
    """Groups of rows whose feed can be changed; n rows of its path."""

    group: Int  # (n,) rows of one number have one feed: an arc, a canned cycle
    fixed: Bool  # (n,) rows whose feed cannot be changed


def at_feed(path: ToolPath, share: Float) -> ToolPath:
    """The same path at shares of its feed.

    Args:
        path: At the programmed feed.
        share: (n,) of the segment that ends at each row; 1 for rapids and rows where nothing moves.
    """
    time = path.time_s[:1] + np.cumsum(np.diff(path.time_s, prepend=path.time_s[:1]) / share)
    return replace(path, feed_m_s=path.feed_m_s * share, time_s=time)


def share_between(programmed: ToolPath, slowed: ToolPath) -> Float:
    """(n,) feed of one path over that of another with the same rows; 1 where nothing is fed."""
    moves = programmed.feed_m_s > 0.0
    return np.where(moves, slowed.feed_m_s / np.where(moves, programmed.feed_m_s, 1.0), 1.0)


def feed_share(
    path: ToolPath,
    deflection_part: Float,
    contact: Bool,
    feed_per_tooth_m: Float,
    omega_rad_s: float,
    swing_m: float,
    feeds: FeedGroups,
) -> Float:
    """Share of the programmed feed that keeps every swing within a limit.

    Args:
        path: At the programmed feed, n rows.
        deflection_part: (n, 3) m, static deflection under the force at each row.
        contact: (n,) rows that cut.
        feed_per_tooth_m: (n,) at the programmed feed.
        omega_rad_s: Of the lowest mode.
        swing_m: Largest swing e that one change starts; 0 leaves the feed as it is.
        feeds: Where the feed can be changed.

    Returns:
        (n,) of the segment that ends at each row, in steps of :data:`STEP`; 1 where the feed is left alone.
    """
    out: Float = np.ones(len(path))
    if swing_m == 0.0 or not contact.any():
        return out
    step = np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1])
    length = np.linalg.norm(step, axis=1)
    moves = (path.kind == FEED) & (length > _STILL_M)
    free = moves & ~feeds.fixed & _calm(path.time_s, path.kind, contact)
    velocity, acceleration = swing_m * omega_rad_s, 0.5 * swing_m * omega_rad_s**2
    feed = path.feed_m_s
    corner = _corner_speeds(step, length, moves, velocity, acceleration)
    sharp = _about(np.append(moves[1:], False) & moves & (corner < LEAST * feed), np.cumsum(length), CORNER_M)
    least = np.minimum(feed, _least_speed(feed, contact, feed_per_tooth_m, sharp))
    bound = _one_speed(_loading_speed(deflection_part, length, moves, velocity), feed)
    speed = np.where(free, np.clip(bound, least, feed), feed)
    point = np.minimum(corner, _lower_of_two(speed))
    # A node below the least speed of its segments would ask them for less than they may have.
    point = np.maximum(point, _lower_of_two(least))
    _within_acceleration(point, length, free, acceleration)
    speed = np.minimum(speed, 0.5 * (point + np.concatenate([point[:1], point[:-1]])))
    share = np.where(free, np.maximum(speed, least) / np.where(free, feed, 1.0), 1.0)
    stepped = np.where(free, np.clip(np.floor(share / STEP + 1e-9) * STEP, STEP, 1.0), 1.0)
    return np.where(free, _one_share(stepped, np.where(free, length, 0.0), feeds.group), 1.0)


def _one_share(share: Float, length: Float, group: Int) -> Float:
    """The lowest share of each group, where enough of its length asks for a lower feed; else 1."""
    count = int(group.max(initial=0)) + 1
    lowest, whole, slow = np.ones(count), np.zeros(count), np.zeros(count)
    np.minimum.at(lowest, group, share)
    np.add.at(whole, group, length)
    np.add.at(slow, group, np.where(share < 1.0, length, 0.0))
    return np.where(slow >= ENOUGH * whole, lowest, 1.0)[group]


def _about(points: Bool, station_m: Float, reach_m: float) -> Bool:
    """(n,) segments that end within a length of path of some of their end points."""
    on = station_m[points]
    low, high = np.searchsorted(on, station_m - reach_m), np.searchsorted(on, station_m + reach_m, side="right")
    out: Bool = high > low
    return out


def _least_speed(feed: Float, contact: Bool, feed_per_tooth_m: Float, sharp: Bool) -> Float:
    """(n,) lowest speed of each segment; in the cut by the chip too, and lower at a sharp corner."""
    chip = np.where(contact & (feed_per_tooth_m > 0.0), LEAST_CHIP_M / np.maximum(feed_per_tooth_m, 1e-12), 0.0)
    return feed * np.where(contact, np.maximum(np.where(sharp, LEAST_AT_CORNER, LEAST), chip), STEP)


def _lower_of_two(values: Float) -> Float:
    """At the end of each segment: the lower value of it and the next."""
    return np.minimum(values, np.append(values[1:], values[-1:]))


def _calm(time_s: Float, kind: Int, contact: Bool) -> Bool:
    """Rows in contact, and those that are run within :data:`CALM_S` before, without a rapid between."""
    run = np.cumsum(np.diff(kind, prepend=kind[:1]) != 0)
    on = np.flatnonzero(contact)
    following = np.searchsorted(on, np.arange(len(kind)))
    known = following < len(on)
    row = on[np.minimum(following, len(on) - 1)]
    out: Bool = known & (time_s[row] - time_s <= CALM_S) & (run[row] == run)
    return out


def _loading_speed(deflection: Float, length: Float, moves: Bool, velocity: float) -> Float:
    """(n,) speed at which the deflection grows by ``velocity``, taken over :data:`SMOOTH_M` about each segment."""
    station = np.cumsum(np.where(moves, length, 0.0))
    late, early = station + 0.5 * SMOOTH_M, station - 0.5 * SMOOTH_M
    size = np.linalg.norm(deflection, axis=1)
    growth = (np.interp(late, station, size) - np.interp(early, station, size)) / SMOOTH_M
    return np.where(growth > 0.0, velocity / np.where(growth > 0.0, growth, 1.0), np.inf)


def _one_speed(bound: Float, feed: Float) -> Float:
    """One speed, the lowest, for every stretch of path whose speed is bounded."""
    bounded = bound < feed
    run = np.cumsum(np.diff(bounded.astype(np.int64), prepend=0) != 0)
    lowest = np.full(int(run[-1]) + 1, np.inf)
    np.minimum.at(lowest, run, bound)
    out: Float = np.where(bounded, lowest[run], np.inf)
    return out


def _corner_speeds(step: Float, length: Float, moves: Bool, velocity: float, acceleration: float) -> Float:
    """(n,) highest speed at the end of each segment, by the turn to the next one or the stop there."""
    n = len(length)
    unit = step / np.maximum(length, _STILL_M)[:, None]
    turn = np.linalg.norm(unit[1:] - unit[:-1], axis=1)  # 2 sin(theta/2)
    joined = moves[1:] & moves[:-1]
    out: Float = np.full(n, velocity)
    curved = turn / np.maximum(0.5 * (length[1:] + length[:-1]), _STILL_M)
    fast = np.minimum(velocity / np.maximum(turn, 1e-12), np.sqrt(acceleration / np.maximum(curved, 1e-12)))
    out[:-1] = np.where(joined, fast, velocity)
    return out


@kernel("void(float64[::1], float64[::1], boolean[::1], float64)", entry=True)
def _within_acceleration(point: Float, length: Float, free: Bool, most: float) -> None:
    """Lower the speeds at the ends of free segments until none needs more acceleration; ``v1^2 <= v0^2 + 2 a L``."""
    n = point.shape[0]
    # Forwards for speeding up, backwards for braking: each pass leaves what the other one is for.
    for i in range(1, n):
        if free[i]:
            point[i] = min(point[i], math.sqrt(point[i - 1] ** 2 + 2.0 * most * length[i]))
    for i in range(n - 1, 0, -1):
        if free[i]:
            point[i - 1] = min(point[i - 1], math.sqrt(point[i] ** 2 + 2.0 * most * length[i]))

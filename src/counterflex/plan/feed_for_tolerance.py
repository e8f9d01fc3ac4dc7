"""Lower the programmed feed where the compensated path is predicted to stay outside a tolerance.

What compensation leaves is mostly a matter of time: corrections that are shaped for a lightly damped arm, an entry that
is over before the arm has followed. At a lower feed all of it happens more slowly, and the force is smaller. Where the
predicted error e exceeds the tolerance the feed is multiplied by ``(tolerance / e)^0.7``, from shortly before to
shortly after, the program is planned and cut anew at these feeds, and so on until it fits. A share of the feed never
falls below the least one, and the chip in the middle of the engagement never below the least chip: an edge that rubs
cuts nothing and heats. Shares change by no more than a rate per second, in steps of 5 %.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import UM, plain
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.feed_schedule import STEP, FeedGroups, at_feed
from counterflex.plan.plan import Plan, across
from counterflex.runtime.monitoring.override_plan import least_about, within_rate

ROUNDS: Final = 5
AROUND_S: Final = 0.12
"""So long before and after a place that is outside the feed is lowered too: an arm of 8 Hz swings that long."""
_POWER: Final = 0.7


@dataclass(frozen=True)
class FeedTolerance:
    """Tolerance that a feed is searched for, and the bounds of the search.

    Raises:
        InputError: A number is out of range.
    """

    tolerance_m: float  # largest predicted error across the feed, in the cut
    least: float = 0.3  # lowest share of the programmed feed
    least_chip_m: float = 10.0 * UM  # smallest chip in the middle of the engagement
    change_per_s: float = 2.0  # largest change of the share per second

    def __post_init__(self) -> None:
        """Check ranges."""
        as_positive("feed for tolerance: tolerance_m", self.tolerance_m)
        as_positive("feed for tolerance: least_chip_m", self.least_chip_m, zero=True)
        as_positive("feed for tolerance: change_per_s", self.change_per_s)
        if not STEP <= self.least <= 1.0:
            raise InputError("the least share of the feed is out of range", value=self.least, limit=f"{STEP:g} .. 1")


@dataclass(frozen=True)
class LineFeed:
    """Feed of one source line."""

    line: int  # in the source
    share: float  # lowest share of its programmed feed
    before_m: float  # largest predicted error at the programmed feed
    after_m: float  # the same at the lowered feed
    # why the tolerance is not reached: `least feed`, `least chip`, `fixed feed` (it cannot be changed here), `no gain`
    # (a lower feed does not help); empty where it is
    why: str

    def shown(self) -> dict[str, Any]:
        """Plain values."""
        return plain(self, "line feed_percent=share:1 before_um:1 after_um:1 why")


@dataclass(frozen=True, eq=False)
class LoweredFeed:
    """A plan at lowered feeds."""

    plan: Plan  # at these feeds
    extra_s: float  # time that it costs, accelerations left out
    before_m: float  # largest predicted error at the programmed feed
    after_m: float  # at the lowered feed
    lines: tuple[LineFeed, ...]  # lines that were slowed down or stay outside, in order
    rounds: int  # how often it was planned anew


def lower_feed(path: ToolPath, feeds: FeedGroups, wish: FeedTolerance, make: Callable[[ToolPath], Plan]) -> LoweredFeed:
    """Plan a path at feeds that keep the predicted error within a tolerance, as far as they can.

    ``path``: at the programmed feed; ``wish``: tolerance and limits; ``make``: plans a path, predictions included.

    Raises:
        CounterflexError: What planning raises.
    """
    moves = np.linalg.norm(np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1]), axis=1) > 0.0
    free = (path.kind == FEED) & moves & ~feeds.fixed
    share: Float = np.ones(len(path))
    plan = make(path)
    time_s = float(plan.path.time_s[-1])
    first = error = _error(plan)
    least, by_chip = least_share(plan, wish)
    best, rounds = (plan, share, error), 0
    for _ in range(ROUNDS):
        outside = free & (error > wish.tolerance_m) & (share > least * (1.0 + 1e-9))
        if not outside.any():
            break
        requested = np.where(
            outside, share * np.clip((wish.tolerance_m / np.maximum(error, 1e-12)) ** _POWER, 0.5, 1.0), 1.0
        )
        lowered = _stepped(path, feeds.group, free, np.minimum(share, np.maximum(requested, least)), least, wish)
        if np.all(lowered >= share):
            break
        share = np.minimum(share, lowered)
        plan = make(at_feed(path, share))
        error = _error(plan)
        rounds += 1
        # A lower feed may swing the arm more: the best round is kept, not the last.
        if _excess(error, wish) < _excess(best[2], wish):
            best = (plan, share, error)
    plan, share, error = best
    return LoweredFeed(
        plan,
        float(plan.path.time_s[-1]) - time_s,
        float(first.max(initial=0.0)),
        float(error.max(initial=0.0)),
        _lines(plan, share, first, error, least, by_chip, free, wish),
        rounds,
    )


def _error(plan: Plan) -> Float:
    """(n,) m, predicted error across the feed in the cut, else 0."""
    size = np.linalg.norm(across(plan.deviation_compensated_part, plan.path.p_part_tcp), axis=1)
    out: Float = np.where(plan.judged, size, 0.0)
    return out


def _excess(error: Float, wish: FeedTolerance) -> float:
    """Excess of a path over the tolerance: the largest excess, and a little of all."""
    over = np.maximum(error - wish.tolerance_m, 0.0)
    return float(over.max(initial=0.0) + 0.1 * over.mean())


def least_share(plan: Plan, wish: FeedTolerance) -> tuple[Float, Bool]:
    """Return the (n,) least share of the feed, rounded up to steps, and where it comes from the chip.

    Rows that cut again what springing back left have no chip of their own: theirs is that of the cut next to them.
    """
    chip = plan.feed_per_tooth_m * np.sin(0.5 * (plan.entry_rad + plan.exit_rad))
    known = plan.cutting & np.isfinite(chip) & (chip > 0.0)
    of_chip: Float = np.where(known, wish.least_chip_m / np.where(known, chip, 1.0), 0.0)
    again = np.flatnonzero(plan.judged & ~known)
    if known.any() and len(again):
        of_chip[again] = np.interp(again, np.flatnonzero(known), of_chip[known])
    least = np.maximum(wish.least, of_chip)
    out: Float = np.minimum(1.0, np.ceil(least / STEP - 1e-9) * STEP)
    return out, of_chip > wish.least


def _stepped(path: ToolPath, group: Int, free: Bool, share: Float, least: Float, wish: FeedTolerance) -> Float:
    """Shares widened in time, changing at the rate, in steps, one per group; 1 where the feed is not free."""
    time = np.ascontiguousarray(path.time_s)
    wide: Float = np.empty(len(path))
    least_about(time, np.where(free, share, 1.0), AROUND_S, AROUND_S, wide)
    wide = np.where(free, np.maximum(wide, least), 1.0)
    within_rate(time, wide, wish.change_per_s)
    stepped = np.maximum(np.floor(wide / STEP + 1e-9) * STEP, least)
    stepped = np.where(free, stepped, 1.0)
    lowest: Float = np.ones(int(group.max(initial=0)) + 1)
    np.minimum.at(lowest, group[free], stepped[free])
    floor: Float = np.zeros(len(lowest))
    np.maximum.at(floor, group[free], least[free])
    out: Float = np.where(free, np.maximum(lowest, floor)[group], 1.0)
    return out


def _lines(
    plan: Plan, share: Float, first: Float, error: Float, least: Float, by_chip: Bool, free: Bool, wish: FeedTolerance
) -> tuple[LineFeed, ...]:
    results = []
    order = np.argsort(plan.line, kind="stable")
    lines = np.unique(plan.line[(share < 1.0) | (error > wish.tolerance_m)])
    begin, end = (np.searchsorted(plan.line[order], lines, side=side) for side in ("left", "right"))
    for line, a, b in zip(lines.tolist(), begin.tolist(), end.tolist(), strict=True):
        rows = order[a:b]
        worst = int(rows[np.argmax(error[rows])])
        why = ""
        if error[worst] > wish.tolerance_m:
            why = "no gain"
            if not free[worst]:
                why = "fixed feed"
            elif share[worst] <= least[worst] * (1.0 + 1e-9):
                why = "least chip" if by_chip[worst] else "least feed"
        results.append(
            LineFeed(int(line), float(share[rows].min()), float(first[rows].max()), float(error[worst]), why)
        )
    return tuple(results)

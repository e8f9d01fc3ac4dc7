"""A force that is off the plan otherwise than in such cuts before: what came in the swing, or slowly. Pure kernels.

While the arm swings after an entry, a plunge, a corner or a change of speed, a step of the sensor's zero hides in the
swing, and a drift over seconds is never a step. Both stay. So what the calm cuts of the program have shown is kept:

- A period of the arm's lowest mode is *calm* where planned force and speed stay about the same and the mean residual
  is that of the period before: the swing has died out.
- Its means stand for a *kind* of cut: planned force p in feed axes (feed, across, along the tool), speed v and
  direction of feed. What a wrong plan is off by turns with the feed: behind a corner it is known already.
- The mean residual r is held against that of the kind most like it, r_k: off is
  ``|r - r_k| > L + 0.15 |p| + (0.5 + |r_k| / |p_k|) |p - p_k| + (|p| + max |r|) |v - v_k| / v + 30 N |f - f_k|``,
  with L the smallest step and f the direction of feed. Two such periods in a row are told.
- Where no kind is known yet only the plan itself can be asked: ``|r| > L + 2 |p|``. Cutting constants that are wrong
  by a factor of three pass, as they must: this is what the force is measured for.

What is not off is learnt: the mean of a minute. A drift of that time, thermal or by wear, is followed.

It can be another cut as well as the sensor's zero: deeper stock, harder material. The next way in air tells: a sensor
that shows nothing there has its zero, and what was told is a kind of cut that is known from then on; one that shows
something is found by the test in air, where a held feed leaves no mark.
"""

from __future__ import annotations

from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record
from counterflex.runtime.plausibility.force_change import (
    STANDS_M,
    add_cut,
    clear_cut,
    copy_cut,
    distance,
    divide_cut,
    mean_cut,
    size,
)
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.doubts import CALM_MOST

_EVEN: Final = 0.1
"""Share by which planned force and speed may change within a calm period, and be another kind."""
_EVEN_N: Final = 10.0
_ALIKE_N: Final = 15.0
"""By how much the mean residuals of two calm periods may differ, beyond 0.05 of the planned force."""
_ALIKE: Final = 0.05
_SCATTER: Final = 0.15
"""Share of the planned force by which cuts of one kind may differ."""
_OTHER: Final = 0.5
"""Share of a difference of the planned force that may be wrong, beside that by which the plan is."""
_UNKNOWN: Final = 2.0
"""Share of the planned force by which it may be wrong where nothing is known."""
_TURNED_N: Final = 30.0
"""What of the residual may stand still while the feed turns: twice the force that may be left in air."""
_KNOWN: Final = 4.0
"""Calm periods after which a kind is known."""
_MEMORY: Final = 500.0
_OFF: Final = 2


@kernel("void(Memory)", **LOOP_TYPES)
def forget_calm(memory: Record) -> None:
    """Forget the levels of calm cuts, to be learnt again."""
    memory.calm = memory.calm_long = memory.calm_off = memory.calm_rows = 0
    memory.calm_told = memory.calm_air = 0


@kernel("void(float64[::1], float64[::1], boolean)")
def _turn(frame: Float, x: Float, back: bool) -> None:
    """Turn the vectors of three of ``x`` into axes given by rows, or back out of them."""
    for begin in range(0, x.shape[0], 3):
        a, b, c = x[begin], x[begin + 1], x[begin + 2]
        for k in range(3):
            x[begin + k] = (
                frame[k] * a + frame[3 + k] * b + frame[6 + k] * c
                if back
                else frame[3 * k] * a + frame[3 * k + 1] * b + frame[3 * k + 2] * c
            )


@kernel("float64(Kind, Kind)", **LOOP_TYPES)
def _unlike(now: Record, kind: Record) -> float:
    """Force by which two cuts may differ because planned force, speed and direction of feed do, N."""
    residual, planned = size(now.cut.residual[:]), now.cut.planned[:]
    known, expected = size(kind.cut.residual[:]), kind.cut.planned[:]
    faster = max(now.cut.way, kind.cut.way)
    uneven = abs(now.cut.way - kind.cut.way) / faster if faster > 0.0 else 0.0
    # A plan that was off by a share here is believed to be off by the same share there: the one difference allowed.
    wrong = _OTHER + known / max(size(expected), _EVEN_N)
    measured = size(planned) + max(residual, known)
    turned = _TURNED_N * distance(now.feed[:], kind.feed[:])
    return float(wrong * distance(planned, expected) + measured * uneven + turned)


@kernel("int64(Kind, Memory, float64)", **LOOP_TYPES)
def _most_like(now: Record, memory: Record, least: float) -> int:
    """Row of the kind of cut most like this one, of those seen so often; -1 where there is none."""
    # Where the plan knows no difference between several, the one with the residual nearest to this one: a harder skin.
    smallest = nearest = -1.0
    best = -1
    for i in range(memory.calm_rows):
        if memory.kinds[i].seen >= least:
            unlike = _unlike(now, memory.kinds[i])
            smallest = unlike if smallest < 0.0 else min(smallest, unlike)
    for i in range(memory.calm_rows):
        kind = memory.kinds[i]
        if kind.seen >= least and _unlike(now, kind) <= smallest + _EVEN_N:
            off = distance(now.cut.residual[:], kind.cut.residual[:])
            if best < 0 or off < nearest:
                best, nearest = i, off
    return best


@kernel("void(float64[::1], float64[::1], float64)")
def _approach(now: Float, out: Float, seen: float) -> None:
    """Mean over so many periods: ``out += (now - out) / seen``."""
    for k in range(out.shape[0]):
        out[k] += (now[k] - out[k]) / seen


@kernel("void(int64, boolean, Cut, float64[::1], float64, Memory)", **LOOP_TYPES)
def _keep(i: int, new: bool, cut: Record, feed: Float, seen: float, memory: Record) -> None:
    """Into row i, or as a new kind that counts as seen so often."""
    # A full table gives up the kind seen least, not the oldest: a program of passes comes back to its kinds.
    if new and memory.calm_rows < CALM_MOST:
        i = memory.calm_rows
        memory.calm_rows += 1
    elif new:
        i = 0
        for j in range(1, CALM_MOST):
            if memory.kinds[j].seen < memory.kinds[i].seen:
                i = j
    kind = memory.kinds[i]
    if new:
        kind.seen = seen
        copy_cut(cut, kind.cut)
        for k in range(3):
            kind.feed[k] = feed[k]
        return
    # The cap turns the mean over all periods into one of the last minute, which follows wear and warmth.
    kind.seen = min(kind.seen + 1.0, _MEMORY)
    _approach(cut.residual[:], kind.cut.residual[:], kind.seen)
    _approach(cut.planned[:], kind.cut.planned[:], kind.seen)
    kind.cut.way += (cut.way - kind.cut.way) / kind.seen
    _approach(feed, kind.feed[:], kind.seen)


@kernel("void(Kind, Memory)", **LOOP_TYPES)
def _learn(now: Record, memory: Record) -> None:
    """Into its kind, or as a new one; where there are too many in place of the one seen least."""
    i = _most_like(now, memory, 0.0)
    new = i < 0 or _unlike(now, memory.kinds[i]) > _EVEN_N + _EVEN * size(now.cut.planned[:])
    _keep(i, new, now.cut, now.feed[:], 1.0, memory)


@kernel("void(boolean, Limits, Memory)", **LOOP_TYPES)
def known_in_air(right: bool, limits: Record, memory: Record) -> None:
    """Take what was told for a kind of cut that is known, once the sensor has shown in air that its zero is right.

    ``right``: it shows next to nothing where nothing is cut.
    """
    memory.calm_air = memory.calm_air + 1 if right and memory.calm_told == 1 else 0
    if memory.calm_air >= limits.step_back:
        _keep(-1, True, memory.differing, memory.differing_feed[:], _KNOWN, memory)
        memory.calm_told = memory.calm_air = 0


@kernel("boolean(float64[::1], Limits, Memory, Kind)", **LOOP_TYPES)
def _period_ends(feed: Float, limits: Record, memory: Record, now: Record) -> bool:
    """Take the newest sample into the running period; whether that ends, with its means in ``now``, feed axes."""
    cut, total = now.cut, memory.calm_sum
    mean_cut(memory, 0, 1, cut)
    _turn(feed, cut.residual[:], False)
    _turn(feed, cut.planned[:], False)
    if memory.calm == 0:
        memory.calm_spread_n = memory.calm_spread_way = 0.0
        clear_cut(total)
        for k in range(3):
            memory.calm_planned[k] = cut.planned[k]
        memory.calm_way = cut.way
    add_cut(cut, total)
    memory.calm_spread_n = max(memory.calm_spread_n, distance(cut.planned[:], memory.calm_planned[:]))
    memory.calm_spread_way = max(memory.calm_spread_way, abs(cut.way - memory.calm_way))
    memory.calm += 1
    if memory.calm < limits.step_period:
        return False
    copy_cut(total, cut)
    divide_cut(cut, memory.calm)
    for k in range(3):
        now.feed[k] = feed[k]
    memory.calm = 0
    return True


@kernel("boolean(Memory, Kind)", **LOOP_TYPES)
def _is_calm(memory: Record, now: Record) -> bool:
    """Return whether plan, speed and residual have stayed over two periods."""
    cut, last = now.cut, memory.calm_last
    load = size(cut.planned[:])
    even = memory.calm_spread_n < _EVEN_N + _EVEN * load and memory.calm_spread_way < _EVEN * cut.way
    even = even and cut.way > STANDS_M and load > 2.0 * _EVEN_N
    alike = distance(cut.residual[:], last.residual[:]) < _ALIKE_N + _ALIKE * load
    alike = alike and distance(cut.planned[:], last.planned[:]) < _EVEN_N + _EVEN * load
    copy_cut(cut, last)
    memory.calm_long = memory.calm_long + 1 if even and (alike or memory.calm_long == 0) else 0
    # One calm period can be the zero crossing of a slow swing; two in a row of alike residual cannot.
    if memory.calm_long < 2:
        memory.calm_off = 0
        return False
    return True


@kernel("float64(Limits, Memory, Kind)", **LOOP_TYPES)
def _expect(limits: Record, memory: Record, now: Record) -> float:
    """Write into ``cut_before`` what such cuts have shown; by how much the residual may differ from it, N."""
    before, load = memory.cut_before, size(now.cut.planned[:])
    copy_cut(now.cut, before)
    for k in range(6):
        before.residual[k] = 0.0
    # What is known may only narrow the bound: a kind that is unlike enough says less than the plan itself.
    largest = limits.step_n + _UNKNOWN * load
    like = _most_like(now, memory, _KNOWN)
    if like >= 0:
        known = limits.step_n + _SCATTER * load + _unlike(now, memory.kinds[like])
        if known < largest:
            largest = known
            copy_cut(memory.kinds[like].cut, before)
    return float(largest)


@kernel("boolean(float64[::1], Limits, Memory, Kind)", **LOOP_TYPES)
def off_in_calm(feed: Float, limits: Record, memory: Record, now: Record) -> bool:
    """Take the newest sample; whether the force has been off for two calm periods.

    Then ``calm_told`` is 1 until such a period is not off, or a way in air tells (:func:`known_in_air`), and
    ``cut_before`` holds what goes on in its place: the residual, planned force and way of its kind.

    ``feed``: (9,) rows: unit vectors along the feed, across it, along the tool, part axes.
    """
    if not _period_ends(feed, limits, memory, now) or not _is_calm(memory, now):
        return False
    largest, before = _expect(limits, memory, now), memory.cut_before
    if distance(now.cut.residual[:], before.residual[:]) <= largest:
        memory.calm_off = memory.calm_told = 0
        _learn(now, memory)
        return False
    memory.calm_off += 1
    if memory.calm_off < _OFF:
        return False
    memory.calm_told = 1
    copy_cut(now.cut, memory.differing)
    for k in range(3):
        memory.differing_feed[k] = now.feed[k]
    _turn(feed, before.residual[:], True)
    _turn(feed, before.planned[:], True)
    memory.calm_long = memory.calm_off = 0
    return True

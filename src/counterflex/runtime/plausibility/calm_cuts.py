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

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.runtime.plausibility.force_change import STANDS_M, apart, mean_rows, size
from counterflex.runtime.plausibility.kernel import (
    CALM_MOST,
    CALM_ROW,
    K_CALM,
    K_CALM_AIR,
    K_CALM_LONG,
    K_CALM_OFF,
    K_CALM_ROWS,
    K_CALM_TOLD,
    L_STEP_N,
    M_CALM,
    M_CALM_FIRST,
    M_CALM_LAST,
    M_CALM_OTHER,
    M_CALM_SPREAD,
    M_CALM_SUM,
    M_STEP_BEFORE,
    T_STEP_BACK,
    T_STEP_PERIOD,
)

_P: Final = 6  # in a row: planned force, way, direction of feed, periods
_WAY: Final = 9
_FEED: Final = 10
_SEEN: Final = 13
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


@kernel("void(int64[::1])")
def forget_calm(counts: Int) -> None:
    """What calm cuts have shown is learnt anew."""
    counts[K_CALM] = counts[K_CALM_LONG] = counts[K_CALM_OFF] = counts[K_CALM_ROWS] = 0
    counts[K_CALM_TOLD] = counts[K_CALM_AIR] = 0


@kernel("void(float64[::1], float64[::1], int64, boolean)")
def _turn(frame: Float, x: Float, begin: int, back: bool) -> None:
    """Turn the vector ``x[begin:begin+3]`` into axes given by rows, or back out of them."""
    a, b, c = x[begin], x[begin + 1], x[begin + 2]
    for k in range(3):
        x[begin + k] = (
            frame[k] * a + frame[3 + k] * b + frame[6 + k] * c
            if back
            else frame[3 * k] * a + frame[3 * k + 1] * b + frame[3 * k + 2] * c
        )


@kernel("float64(float64[::1], float64[::1])")
def _unlike(now: Float, kind: Float) -> float:
    """Force by which two cuts may differ because planned force, speed and direction of feed do, N."""
    faster = max(now[_WAY], kind[_WAY])
    uneven = abs(now[_WAY] - kind[_WAY]) / faster if faster > 0.0 else 0.0
    wrong = _OTHER + size(kind) / max(size(kind[_P:_WAY]), _EVEN_N)
    measured = size(now[_P:_WAY]) + max(size(now), size(kind))
    turned = _TURNED_N * apart(now[_FEED:_SEEN], kind[_FEED:_SEEN])
    return float(wrong * apart(now[_P:_WAY], kind[_P:_WAY]) + measured * uneven + turned)


@kernel("int64(float64[::1], float64[::1], int64[::1], float64)")
def _most_like(now: Float, memory: Float, counts: Int, least: float) -> int:
    """Row of the kind of cut most like this one, of those seen so often; -1 where there is none.

    Where the plan knows no difference between several, the one with the residual nearest to this one: a harder skin.
    """
    smallest = nearest = -1.0
    found = -1
    for i in range(counts[K_CALM_ROWS]):
        row = memory[M_CALM + CALM_ROW * i : M_CALM + CALM_ROW * (i + 1)]
        if row[_SEEN] >= least:
            unlike = _unlike(now, row)
            smallest = unlike if smallest < 0.0 else min(smallest, unlike)
    for i in range(counts[K_CALM_ROWS]):
        row = memory[M_CALM + CALM_ROW * i : M_CALM + CALM_ROW * (i + 1)]
        if row[_SEEN] >= least and _unlike(now, row) <= smallest + _EVEN_N:
            off = apart(now, row)
            if found < 0 or off < nearest:
                found, nearest = i, off
    return found


@kernel("void(int64, boolean, float64[::1], float64, float64[::1], int64[::1])")
def _keep(i: int, new: bool, now: Float, seen: float, memory: Float, counts: Int) -> None:
    """Into row i, or as a new kind that counts as seen so often."""
    if new and counts[K_CALM_ROWS] < CALM_MOST:
        i = counts[K_CALM_ROWS]
        counts[K_CALM_ROWS] += 1
    elif new:
        i = 0
        for j in range(1, CALM_MOST):
            if memory[M_CALM + CALM_ROW * j + _SEEN] < memory[M_CALM + CALM_ROW * i + _SEEN]:
                i = j
    row = memory[M_CALM + CALM_ROW * i : M_CALM + CALM_ROW * (i + 1)]
    row[_SEEN] = seen if new else min(row[_SEEN] + 1.0, _MEMORY)
    for k in range(_SEEN):
        row[k] = now[k] if new else row[k] + (now[k] - row[k]) / row[_SEEN]


@kernel("void(float64[::1], float64[::1], int64[::1])")
def _learn(now: Float, memory: Float, counts: Int) -> None:
    """Into its kind, or as a new one; where there are too many in place of the one seen least."""
    i = _most_like(now, memory, counts, 0.0)
    new = i < 0 or _unlike(now, memory[M_CALM + CALM_ROW * i : M_CALM + CALM_ROW * (i + 1)]) > _EVEN_N + _EVEN * size(
        now[_P:_WAY]
    )
    _keep(i, new, now, 1.0, memory, counts)


@kernel("void(boolean, int64[::1], float64[::1], int64[::1])")
def known_in_air(right: bool, times: Int, memory: Float, counts: Int) -> None:
    """Take what was told for a kind of cut that is known, once the sensor has shown in air that its zero is right.

    Args:
        right: It shows next to nothing where nothing is cut.
        times: (TIMES,).
        memory: (REMEMBERED,); changed.
        counts: (COUNTS,); changed.
    """
    counts[K_CALM_AIR] = counts[K_CALM_AIR] + 1 if right and counts[K_CALM_TOLD] == 1 else 0
    if counts[K_CALM_AIR] >= times[T_STEP_BACK]:
        _keep(-1, True, memory[M_CALM_OTHER : M_CALM_OTHER + _SEEN], _KNOWN, memory, counts)
        counts[K_CALM_TOLD] = counts[K_CALM_AIR] = 0


@kernel("boolean(float64[::1], float64[::1], int64[::1], float64[::1], int64[::1], float64[::1])")
def off_in_calm(feed: Float, limits: Float, times: Int, memory: Float, counts: Int, work: Float) -> bool:
    """Take the newest sample; whether the force has been off for two calm periods.

    Then K_CALM_TOLD is 1 until such a period is not off, or a way in air tells (:func:`known_in_air`), and
    ``M_STEP_BEFORE`` holds what goes on in its place: the residual, planned force and way of its kind.

    Args:
        feed: (9,) rows: unit vectors along the feed, across it, along the tool, part axes.
        limits: (LIMITS,).
        times: (TIMES,).
        memory: (REMEMBERED,) with the ring of samples; changed.
        counts: (COUNTS,); changed.
        work: (CALM_ROW,) work space.
    """
    now = work[:_SEEN]
    total, first = memory[M_CALM_SUM : M_CALM_SUM + 10], memory[M_CALM_FIRST : M_CALM_FIRST + 4]
    spread, last = memory[M_CALM_SPREAD : M_CALM_SPREAD + 2], memory[M_CALM_LAST : M_CALM_LAST + 10]
    mean_rows(memory, counts, 0, 1, 0, now[:10])
    for begin in range(0, _WAY, 3):
        _turn(feed, now, begin, False)
    if counts[K_CALM] == 0:
        spread[0] = spread[1] = 0.0
        for k in range(10):
            total[k] = 0.0
        for k in range(4):
            first[k] = now[_P + k]
    for k in range(10):
        total[k] += now[k]
    spread[0] = max(spread[0], apart(now[_P:_WAY], first))
    spread[1] = max(spread[1], abs(now[_WAY] - first[3]))
    counts[K_CALM] += 1
    if counts[K_CALM] < times[T_STEP_PERIOD]:
        return False
    for k in range(10):
        now[k] = total[k] / counts[K_CALM]
    for k in range(3):
        now[_FEED + k] = feed[k]
    counts[K_CALM] = 0
    load = size(now[_P:_WAY])
    even = spread[0] < _EVEN_N + _EVEN * load and spread[1] < _EVEN * now[_WAY] and now[_WAY] > STANDS_M
    even = even and load > 2.0 * _EVEN_N
    alike = apart(now, last) < _ALIKE_N + _ALIKE * load and apart(now[_P:_WAY], last[_P:_WAY]) < _EVEN_N + _EVEN * load
    for k in range(10):
        last[k] = now[k]
    counts[K_CALM_LONG] = counts[K_CALM_LONG] + 1 if even and (alike or counts[K_CALM_LONG] == 0) else 0
    if counts[K_CALM_LONG] < 2:
        counts[K_CALM_OFF] = 0
        return False
    like = _most_like(now, memory, counts, _KNOWN)
    before = memory[M_STEP_BEFORE : M_STEP_BEFORE + 10]
    largest = limits[L_STEP_N] + _UNKNOWN * load
    for k in range(10):
        before[k] = now[k] if k >= _P else 0.0
    if like >= 0:
        row = memory[M_CALM + CALM_ROW * like : M_CALM + CALM_ROW * (like + 1)]
        known = limits[L_STEP_N] + _SCATTER * load + _unlike(now, row)
        if known < largest:
            largest = known
            for k in range(10):
                before[k] = row[k]
    if apart(now, before) <= largest:
        counts[K_CALM_OFF] = counts[K_CALM_TOLD] = 0
        _learn(now, memory, counts)
        return False
    counts[K_CALM_OFF] += 1
    if counts[K_CALM_OFF] < _OFF:
        return False
    counts[K_CALM_TOLD] = 1
    for k in range(_SEEN):
        memory[M_CALM_OTHER + k] = now[k]
    for begin in range(0, _WAY, 3):
        _turn(feed, before, begin, True)
    counts[K_CALM_LONG] = counts[K_CALM_OFF] = 0
    return True

"""Place of a run on its plan and delay of its force: the log's place by path, the rest by correlation.

The place is that of the commanded pose on the points that the program sent, found as the loop finds it. The tool is
behind its command, and the sensor's reading behind the force: the sum of both is one delay, found at each entry and
each exit of a cut as the shift at which the measured size of the force correlates best with the planned one, by a
parabola through the best three. Their mean is used; its standard deviation is that of their scatter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import MM, MS, UM
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.primitives.localize import follow

# What a plan says of each of its rows, as far as a measured force is compared with it. The planner's mean force is
# linear in the constants: for a power term ``k h^p`` it is ``B(p) (k_c, k_r, k_a)`` with a map B (3 x 3) that depends
# on the exponent, the engagement booked in the plan's blank, and the feed per tooth. Kept are maps without the size of
# the chip, ``U(p) = B(p) h0^-p`` in m, at the exponents :data:`EXPONENTS`; between them U is the polynomial through
# these, exact to 0.03 % for chips within a factor of three of h0 (tests).

EXPONENTS: Final = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Exponents p of the terms whose maps are kept: 0 is the edge force, 1 the linear law."""
CHIP_M: Final = 50.0 * UM
"""h0, a chip thickness in the middle of those that milling has."""

_ORDERS: Final = np.arange(len(EXPONENTS), dtype=np.float64)
_BASIS: Final = np.linalg.inv(np.vander(np.array(EXPONENTS), increasing=True))
"""Row j: share of the monomial p^j in the polynomial that is 1 at each node and 0 at the others."""


@dataclass(frozen=True, eq=False)
class PlannedCut:
    """A plan as production identification reads it; n rows, row i: the segment that ends there. Part axes, SI."""

    p_part: Float  # (n, 3) points as the program sends them, the correction it contains included
    time_s: Float  # (n,) planned time
    tool: Int  # (n,) number of the tool
    motion: Int  # (n,) motion of the program
    cutting: Bool  # (n,) rows at feed that take material
    direction: Float  # (n, 3) unit vector of the feed, zero where the tool stands
    axis_z: Float  # (n,) z of the unit vector along the tool, in part axes
    feed_m_s: Float  # (n,) planned feed
    spindle_rad_s: Float
    feed_tooth_m: Float  # (n,) feed per tooth
    depth_m: Float  # (n,) largest engaged axial depth
    entry_rad: Float  # (n,) where the engagement begins, NaN out of the cut
    exit_rad: Float  # (n,) where it ends
    volume_m3: Float  # (n,) removed
    f_part: Float  # (n, 3) N, force that the plan predicts
    maps_m: Float  # (n, 3, 3, k) U at EXPONENTS: force x, y, z by the constants c, r, a; zero out of the cut
    contained_part: Float  # (n, 3) m, correction that the program contains
    cell_m: float  # grid of the plan's blank: how well a width is known


@dataclass(frozen=True, eq=False)
class AlignedRunRecord:
    """A run as its log has it, m cycles of one run in order. Part axes, SI."""

    name: str  # of the run, for messages
    time_s: Float  # (m,) of the controller's clock, rising
    p_part: Float  # (m, 3) m, commanded place, without what was corrected online
    # (m, 6) N, N m, wrench of the process on the tool about its tip: the weight behind the sensor and the zero before
    # the cut are taken off
    w_part: Float
    q: Float  # (m, 6) rad
    online_part: Float  # (m, 3) m, correction that was sent
    good: Bool  # (m,) cycles with a telegram and a good reading of the force
    saturated: Bool  # (m,) cycles in which the force sensor was beyond its range
    period_s: float  # of the controller

    def stations(self, plan: PlannedCut) -> Float:
        """(m,) place of each cycle on the plan. Raises InputError: the run was elsewhere: another program."""
        n = len(plan.p_part)
        rows = LoopPlan(plan.p_part, plan.time_s, np.zeros((n, 6)), np.zeros(n), np.zeros((n, 6))).packed()
        place = np.array([-1.0, 0.0])
        out, off = np.empty(len(self.time_s)), np.empty(len(self.time_s))
        for i, (x, y, z) in enumerate(self.p_part.tolist()):
            off[i] = follow(rows, place, x, y, z, _WINDOW_ROWS)
            out[i] = place[0] + place[1]
        share = float(np.mean(off > OFF_PATH_M))
        if share > _MOST_OFF:
            raise InputError(
                "the run was not on the path of the plan",
                where=self.name,
                value=f"{100.0 * share:.0f} % of the cycles farther than {OFF_PATH_M / MM:g} mm, at most "
                f"{float(np.max(off)) / MM:.1f} mm",
                limit=f"at most {100.0 * _MOST_OFF:g} %",
                hint="Give the plan that this run was made with",
            )
        return out

    def aligned(self, plan: PlannedCut) -> Aligned:
        """Find place and delay. Raises InputError: another program, or a force that does not follow the plan."""
        station = self.stations(plan)
        expected = np.linalg.norm(plan.f_part, axis=1)
        now = np.interp(station, np.arange(len(expected)), expected)
        air = (now < 0.02 * float(np.max(expected, initial=0.0))) & self.good
        zero = np.median(self.w_part[air, :3], axis=0) if np.any(air) else np.zeros(3)
        size = np.linalg.norm(self.w_part[:, :3] - zero, axis=1)
        shifts = (self._shift(size, now, first, last) for first, last in _edges(now, self.time_s))
        delays = np.array([shift for shift in shifts if shift is not None])
        if not len(delays):
            raise InputError(
                "the force of the run does not follow the force that the plan predicts",
                where=self.name,
                value="no entry or exit of a cut correlates",
                limit=f"correlation of {LEAST_CORRELATION:g}",
                hint="Is it the right plan, was material in the way, and was the force sensor connected?",
            )
        delay = float(np.median(delays))
        # Edges that correlate with something else are far off: they are left out before the mean.
        near = delays[np.abs(delays - delay) <= max(0.03, 3.0 * 1.4826 * float(np.median(np.abs(delays - delay))))]
        delay, count = float(np.mean(near)), len(near)
        spread = float(np.std(near, ddof=1)) * _widened(count) if count > 1 else 10.0 * MS
        sigma = math.hypot(spread / math.sqrt(count), self.period_s / math.sqrt(12.0))
        ahead = np.interp(self.time_s - delay, self.time_s, station, left=-1.0)
        return Aligned(station, delay, sigma, count, np.where(ahead < 0.0, -1, np.ceil(ahead)).astype(np.int64))

    def _shift(self, size: Float, expected: Float, first: int, last: int) -> float | None:
        """Delay at one edge, s, or None where measured and planned force do not correlate."""
        rows = np.arange(first, last)
        rows = rows[self.good[rows]]
        if len(rows) < 20 or float(np.ptp(size[rows])) < _LEAST_FORCE_N:
            return None
        shifts = np.arange(EARLIEST_S, LATEST_S, 0.5 * self.period_s)
        score = np.array(
            [_correlation(size[rows], np.interp(self.time_s[rows] - s, self.time_s, expected)) for s in shifts]
        )
        best = int(np.argmax(score))
        # A best shift at the end of the range is no best: the true one lies beyond, or there is none.
        if score[best] < LEAST_CORRELATION or best in (0, len(shifts) - 1):
            return None
        a, b, c = score[best - 1 : best + 2]
        bend = a - 2.0 * b + c
        return float(shifts[best] + (0.5 * (a - c) / bend if bend < 0.0 else 0.0) * (shifts[1] - shifts[0]))

    def steady(self, cycles: int) -> Bool:
        """(m,) cycles around which the tool keeps its speed: what it carries then pulls by weight only."""
        speed = np.gradient(self.p_part, self.time_s, axis=0)
        change = np.linalg.norm(np.diff(speed, axis=0, prepend=speed[:1]), axis=1) > 1.0 * MM
        near = np.convolve(change.astype(np.float64), np.ones(2 * cycles + 1), mode="same") > 0.0
        return np.array(~near, dtype=np.bool_)


def weights_at(p: float) -> tuple[Float, Float]:
    """(k,) Lagrange weights of the nodes :data:`EXPONENTS` at an exponent, and their derivatives by it."""
    power = p**_ORDERS
    slope = np.concatenate([[0.0], _ORDERS[1:] * power[:-1]])
    return power @ _BASIS, slope @ _BASIS


def force_of(maps_m: Float, terms: Float) -> Float:
    """Force of a law: (n, 3) N.

    Args:
        maps_m: (n, 3, 3, k), see :class:`PlannedCut`.
        terms: (t, 4) rows (p, k_c, k_r, k_a), as :meth:`counterflex.cutting.coefficients.ForceLaw.terms` gives them.
    """
    out = np.zeros(maps_m.shape[:2])
    for p, *k in terms:
        out += (maps_m @ weights_at(float(p))[0] @ np.array(k)) * CHIP_M ** float(p)
    return out


OFF_PATH_M: Final = 2.0 * MM
"""Distance from the plan from which on a cycle is of no use."""
_MOST_OFF: Final = 0.05
_WINDOW_ROWS: Final = 400
EARLIEST_S: Final = -0.02
LATEST_S: Final = 0.30
"""Delays that are looked for."""
_AROUND_S: Final = 0.35
LEAST_CORRELATION: Final = 0.8
"""Of measured and planned force at an edge, below which it says nothing about the delay."""
_LEAST_FORCE_N: Final = 10.0


@dataclass(frozen=True, eq=False)
class Aligned:
    """A run on its plan."""

    station: Float  # (m,) row of the plan with the fraction of the segment behind it, at each cycle
    delay_s: float  # how late the force comes after the command
    delay_sigma_s: float  # standard deviation of that
    edges: int  # entries and exits that it rests on
    row: Int  # (m,) row of the plan whose segment made the force of the cycle, -1 before the beginning


def _widened(count: int) -> float:
    """Factor on a standard deviation that was estimated from a few values only."""
    return float(scipy.stats.t.ppf(0.8413, count - 1))


def _edges(expected: Float, time_s: Float) -> list[tuple[int, int]]:
    """Cycles around each entry and exit: (first, last)."""
    high = expected > 0.5 * float(np.max(expected, initial=0.0))
    low = expected > 0.05 * float(np.max(expected, initial=0.0))
    out = []
    for k in np.flatnonzero(np.diff(low.astype(np.int8))):
        begin, end = np.searchsorted(time_s, [time_s[k] - 2.0 * _AROUND_S, time_s[k] + 2.0 * _AROUND_S])
        if end - begin > 20 and np.any(high[begin:end]) and not np.all(low[begin:end]):
            out.append((int(begin), int(end)))
    return out


def _correlation(a: Float, b: Float) -> float:
    a, b = a - a.mean(), b - b.mean()
    size = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / size if size > 0.0 else 0.0

"""Axes that turn round, and drives that are unloaded, while the tool cuts: there gear play is passed through.

Berger2013 asks for paths without reversals and unloading of the axes; what they cost is the play of the axis times its
lever to the tool. Both are counted on the predicted cut of the tool that does not yield.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.plan.preflight.row import NOT_LOOKED_AT, Row
from counterflex.robot.elasticity.chain import ElasticChain, jacobian
from counterflex.robot.elasticity.play import axis_torque

LEAST_RAD: Final = 1e-5
"""An axis turned round when it went back by that: 20 um at 2 m. Less is rounding of the program."""
LEAST_NM: Final = 5.0
"""A drive is unloaded when its torque passes from beyond this on one side to beyond it on the other."""
_ADVICE: Final = "Turn the tool about its axis (counterflex plan posture), move the part, or cut in another direction"


@dataclass(frozen=True, eq=False)
class ReversalEvent:
    """One reversal or one unloading."""

    axis: int  # 0..5
    point: int  # row of the path
    torque_nm: float  # of the cutting force about the axis, its size, N m
    lost_m: float  # twice the half play times the lever of the axis to the tool tip, m; NaN where no play is known


def turning_points(angle: Float, least_rad: float = LEAST_RAD) -> Int:
    """Rows where one axis turns round, and where it has gone back by ``least_rad``.

    A turn is an extremum that the axis leaves again by at least ``least_rad`` after having come to it by as much.

    Args:
        angle: (n,) rad.
        least_rad: > 0.

    Returns:
        (k, 2) row of the extremum, and first row at which the axis is back by ``least_rad``.
    """
    step = np.diff(angle)
    moving = np.flatnonzero(step)
    sense = np.sign(step[moving])
    extremes = moving[np.flatnonzero(sense[1:] != sense[:-1])] + 1
    out: list[tuple[int, int]] = []
    low = high = 0
    direction, best = 0.0, 0
    for row in (*extremes.tolist(), len(angle) - 1):
        value = angle[row]
        if direction == 0.0:
            low, high = (row if value < angle[low] else low), (row if value > angle[high] else high)
            if angle[high] - angle[low] >= least_rad:
                direction, best = (1.0, high) if high > low else (-1.0, low)
        elif direction * (value - angle[best]) >= 0.0:
            best = row
        elif direction * (angle[best] - value) >= least_rad:
            back = best + 1 + int(np.argmax(direction * (angle[best] - angle[best + 1 : row + 1]) >= least_rad))
            out.append((best, back))
            direction, best = -direction, row
    return np.array(out, dtype=np.int64).reshape(-1, 2)


def _lost(chain: ElasticChain, J: Float, axis: int) -> float:
    entry = None if chain.play is None else chain.play[axis]
    return float("nan") if entry is None else 2.0 * entry.half_band_rad * float(np.linalg.norm(J[:3, axis]))


def reversals(chain: ElasticChain, q: Float, w_tcp_base: Float, contact: Bool) -> list[ReversalEvent]:
    """Reversals of an axis in the cut: the axis goes back while material is removed.

    Args:
        chain: For levers and play.
        q: (n, 6) rad, in order.
        w_tcp_base: (n, 6) N, N m, predicted wrench about the tip in base axes.
        contact: (n,) the segment that ends here removes material.

    Returns:
        Events in the order of the axes, then of the path.
    """
    events = []
    for axis in range(6):
        for row, back in turning_points(q[:, axis]).tolist():
            if not np.any(contact[row + 1 : back + 1]):
                continue
            J = jacobian(chain, q[row : back + 1])
            torque = np.abs(np.einsum("nij,ni->nj", J, w_tcp_base[row : back + 1])[:, axis])
            events.append(ReversalEvent(axis, row, float(torque.max()), _lost(chain, J[0], axis)))
    return events


def unloadings(chain: ElasticChain, q: Float, w_tcp_base: Float, contact: Bool) -> list[ReversalEvent]:
    """Drives whose torque (weight and cutting force) changes its sign in the cut, first contact included.

    Args:
        chain: With masses; without them only axes without weight are right.
        q: (n, 6) rad, in order.
        w_tcp_base: (n, 6) N, N m.
        contact: (n,).
    """
    torque = axis_torque(chain, q, w_tcp_base)
    weight = axis_torque(chain, q)
    events = []
    for axis in range(6):
        loaded = np.flatnonzero(np.abs(torque[:, axis]) > LEAST_NM)
        sign = np.sign(torque[loaded, axis])
        for row in loaded[np.flatnonzero(sign[1:] != sign[:-1]) + 1]:
            # An unloading in the air costs nothing: its play is passed before the tool meets the part.
            if contact[row]:
                J = jacobian(chain, q[row : row + 1])[0]
                size = float(abs(torque[row, axis] - weight[row, axis]))
                events.append(ReversalEvent(axis, int(row), size, _lost(chain, J, axis)))
    return events


def event_row(check: str, events: list[ReversalEvent], limit_m: float) -> Row:
    """Return the event with the largest lost motion at the tool; where no play is known its size is not looked at.

    ``events``: of one kind; ``limit_m``: largest lost motion that may stay in the part.
    """
    if not events:
        return Row(check, "ok", 0.0, limit_m, "m", what="none")
    counts = {axis: sum(event.axis == axis for event in events) for axis in sorted({event.axis for event in events})}
    named = ", ".join(f"axis {axis + 1}: {count}" for axis, count in counts.items())
    known = [event for event in events if not np.isnan(event.lost_m)]
    worst = max(known, key=lambda e: (e.lost_m, e.torque_nm)) if known else max(events, key=lambda e: e.torque_nm)
    what = f"{named}; worst axis {worst.axis + 1} at {worst.torque_nm:.0f} N m of the cutting force"
    if known and worst.lost_m > limit_m:
        return Row(check, "warning", worst.lost_m, limit_m, "m", worst.point, what, advice=_ADVICE)
    if len(known) < len(events):
        free = ", ".join(f"{axis + 1}" for axis in sorted({e.axis for e in events if np.isnan(e.lost_m)}))
        return Row(check, NOT_LOOKED_AT, None, limit_m, "m", worst.point, f"{what}; play of axis {free} not known",
                   "robot.play")  # fmt: skip
    return Row(check, "ok", worst.lost_m, limit_m, "m", worst.point, what)

"""Dynamic programming over the postures of one branch of the arm.

State at a station: rotation of the grid, full turns of axes 4 and 6, and in which sense the tool turned on the edge
before. With that sense in the state, what happens *at* a station (a joint that turns round, a change of the rate of
turning) is known from the states of two stations alone, and the optimum is exact on the grid.
"""

from __future__ import annotations

import math
from typing import Annotated, Final, NamedTuple

import numpy as np

from counterflex.core.arrays import Bool, Float, Float1, Float2, Float3, Int, Int1
from counterflex.core.jit import bundle, kernel

TURNS: Final = 3
"""Full turns -1, 0, 1 of an axis beside the angle within its limits."""
SENSES: Final = 3
"""The tool turned back, not at all, forth."""
PER_ROTATION: Final = TURNS * TURNS * SENSES
STILL_RAD: Final = 1e-4
"""Motion of an axis over an edge below which it has no direction."""
_TURN = 2.0 * math.pi


class Edges(NamedTuple):
    """Costs of one branch; m edges, r rotations. Costs without unit."""

    early: Float2  # (m, r) of an edge, by the rotation at its beginning; infinite where impossible
    late: Float2  # (m, r) by that at its end
    q: Float3  # (m + 1, r, 6) rad at the stations; NaN where impossible
    lost: Float3  # (m + 1, r, 6) of lost motion of each axis
    torque: Float3  # (m + 1, r, 6) N m on each axis
    contact: Annotated[Bool, "boolean[::1]"]  # (m,) material is cut on the edge
    duration: Float1
    steps: Int1  # (m,) steps of the grid that the tool may turn: 0 or 1 in contact, any number in the air


class Rules(NamedTuple):
    """Limits and costs of a way through the postures."""

    limits: Float2  # (6, 2) rad
    speed: Float1  # (6,) rad/s
    turning: float  # cost of a step of the grid
    winding: float  # cost of axes 4 and 6 at the ends of their ranges, at every station


_EDGES = bundle(Edges)
_RULES = bundle(Rules)


@kernel("float64(Rules, float64[::1], int64, int64)", Rules=_RULES, entry=True)
def winding(rules: Rules, q: Float, four: int, six: int) -> float:
    """Cost of the turns of axes 4 and 6, infinite outside their limits."""
    total = 0.0
    for axis, turn in ((3, four), (5, six)):
        angle = q[axis] + _TURN * (turn - 1)
        low, high = rules.limits[axis, 0], rules.limits[axis, 1]
        if not low <= angle <= high:
            return math.inf
        share = (2.0 * angle - low - high) / (high - low)
        total += share * share
    return 0.5 * rules.winding * total


@kernel("void(float64[::1], float64[::1], float64[::1], int64[::1])")
def motion(q: Float, to: Float, move: Float, carry: Int) -> None:
    """Motion of the axes from one posture to another, axes 4 and 6 the short way.

    Args:
        q: (6,) rad.
        to: (6,) rad.
        move: (6,) rad, written.
        carry: (2,) full turns that were left out of axes 4 and 6, written.
    """
    for j in range(6):
        move[j] = to[j] - q[j]
    for k in range(2):
        axis = 3 + 2 * k
        carry[k] = math.floor(move[axis] / _TURN + 0.5)
        move[axis] -= _TURN * carry[k]


@kernel("float64(Edges, int64, int64, float64[::1], float64[::1])", Edges=_EDGES)
def turning_round(edges: Edges, station: int, rotation: int, before: Float, move: Float) -> float:
    """Cost of the axes that turn round at a station."""
    cost = 0.0
    for j in range(6):
        if before[j] * move[j] < 0.0 and abs(before[j]) > STILL_RAD and abs(move[j]) > STILL_RAD:
            cost += edges.lost[station, rotation, j]
    return cost


@kernel("float64(Edges, int64, int64, int64)", Edges=_EDGES)
def unloading(edges: Edges, edge: int, rotation: int, to: int) -> float:
    """Cost of the axes whose torque changes its sign along an edge."""
    cost = 0.0
    for j in range(6):
        if edges.torque[edge, rotation, j] * edges.torque[edge + 1, to, j] < 0.0:
            cost += edges.lost[edge + 1, to, j]
    return cost


@kernel("void(Edges, Rules, int64, float64[::1], int64[::1], int64[::1])", Edges=_EDGES, Rules=_RULES)
def turn_in_the_air(edges: Edges, rules: Rules, station: int, value: Float, back: Int, hop: Int) -> None:
    """Let the tool turn at the end of an edge in the air, step by step, through postures that are possible.

    Args:
        edges: Costs.
        rules: What is allowed.
        station: End of the edge.
        value: (states,) best cost, improved.
        back: (states,) state at the station before, follows.
        hop: (states,) steps turned, follows.
    """
    count = edges.q.shape[1]
    move, carry = np.empty(6), np.empty(2, np.int64)
    for r in range(count):
        for t in range(TURNS * TURNS):
            s = r * PER_ROTATION + t * SENSES
            # In the air the sense of turning is forgotten: to turn round there costs nothing.
            for d in (0, 2):
                if value[s + d] < value[s + 1]:
                    value[s + 1], back[s + 1], hop[s + 1] = value[s + d], back[s + d], hop[s + d]
                value[s + d] = math.inf
    for _ in range(min(edges.steps[station - 1], count)):
        old, old_back, old_hop = value.copy(), back.copy(), hop.copy()
        changed = False
        for r in range(count):
            if math.isnan(edges.q[station, r, 0]):
                continue
            for step in (-1, 1):
                to = (r + step) % count
                if math.isnan(edges.q[station, to, 0]):
                    continue
                motion(edges.q[station, r], edges.q[station, to], move, carry)
                # Full turns are taken out of axes 4 and 6. Where another axis moves by more than half a turn it is
                # another winding of the pose, not a motion.
                if max(abs(move[0]), abs(move[1]), abs(move[2]), abs(move[4])) > math.pi:
                    continue
                for four in range(TURNS):
                    for six in range(TURNS):
                        f, x = four - carry[0], six - carry[1]
                        s = ((r * TURNS + four) * TURNS + six) * SENSES + 1
                        if old[s] == math.inf or not (0 <= f < TURNS and 0 <= x < TURNS):
                            continue
                        cost = old[s] + rules.turning
                        end = ((to * TURNS + f) * TURNS + x) * SENSES + 1
                        if cost < value[end] and winding(rules, edges.q[station, to], f, x) < math.inf:
                            value[end], back[end], hop[end] = cost, old_back[s], old_hop[s] + step
                            changed = True
        if not changed:
            break


@kernel(
    "int64(Edges, Rules, int16[:, ::1], int16[:, ::1], float64[::1])",
    waits=True,
    Edges=_EDGES,
    Rules=_RULES,
    entry=True,
)
def walk(edges: Edges, rules: Rules, back: Int, hop: Int, value: Float) -> int:
    """Cheapest way to every state of the last station.

    Args:
        edges: Costs of a branch.
        rules: What is allowed.
        back: (m, states) state before, written.
        hop: (m, states) steps of the grid that the tool turned, written.
        value: (states,) cost, written; infinite where there is no way.

    Returns:
        Edges that could be passed: m, or the first one that no state passes.
    """
    m: int = edges.early.shape[0]
    count: int = edges.early.shape[1]
    states = count * PER_ROTATION
    move, before, carry = np.empty(6), np.empty(6), np.empty(2, np.int64)
    other = np.empty(2, np.int64)
    value[:] = math.inf
    new, back_now, hop_now = np.empty(states), np.zeros(states, np.int64), np.zeros(states, np.int64)
    for r in range(count):
        if not math.isnan(edges.q[0, r, 0]):
            for four in range(TURNS):
                for six in range(TURNS):
                    s = ((r * TURNS + four) * TURNS + six) * SENSES + 1
                    value[s] = winding(rules, edges.q[0, r], four, six)
    for e in range(m):
        new[:] = math.inf
        alive = False
        contact = edges.contact[e]
        for r in range(count):
            if math.isnan(edges.q[e, r, 0]) or edges.early[e, r] == math.inf:
                continue
            for sense in range(SENSES):
                if sense != 1 and (edges.steps[e] == 0 or not contact):
                    continue
                to = (r + sense - 1) % count
                if math.isnan(edges.q[e + 1, to, 0]) or edges.late[e, to] == math.inf:
                    continue
                motion(edges.q[e, r], edges.q[e + 1, to], move, carry)
                fast = False
                for j in range(6):
                    fast = fast or abs(move[j]) > rules.speed[j] * edges.duration[e]
                # In the air the controller takes the time that it needs; in the cut the feed would fall.
                if fast and contact:
                    continue
                if max(abs(move[0]), abs(move[1]), abs(move[2]), abs(move[4])) > math.pi:
                    continue
                cost = edges.early[e, r] + edges.late[e, to] + (rules.turning if sense != 1 else 0.0)
                if contact:
                    cost += unloading(edges, e, r, to)
                for last in range(SENSES):
                    if abs(last - sense) > 1:
                        continue
                    here = cost
                    if contact and e > 0:
                        motion(edges.q[e - 1, (r - last + 1) % count], edges.q[e, r], before, other)
                        here += turning_round(edges, e, r, before, move)
                    for four in range(TURNS):
                        for six in range(TURNS):
                            s = ((r * TURNS + four) * TURNS + six) * SENSES + last
                            f, x = four - carry[0], six - carry[1]
                            if value[s] == math.inf or not (0 <= f < TURNS and 0 <= x < TURNS):
                                continue
                            end = ((to * TURNS + f) * TURNS + x) * SENSES + sense
                            total = value[s] + here + winding(rules, edges.q[e + 1, to], f, x)
                            if total < new[end]:
                                new[end], back_now[end], hop_now[end] = total, s, sense - 1
                                alive = True
        if not alive:
            return e
        if not contact and edges.steps[e] > 0:
            turn_in_the_air(edges, rules, e + 1, new, back_now, hop_now)
        for s in range(states):
            back[e, s], hop[e, s] = back_now[s], hop_now[s]
            value[s] = new[s]
    return m

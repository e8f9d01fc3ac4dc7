"""The way through the postures beside every way there is: small grids, all constraints and costs by other means."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.plan.posture.walk_kernel import PER_ROTATION, STILL_RAD, Edges, Rules, walk

TURN = 2.0 * math.pi
LIMITS = np.tile([-math.radians(350), math.radians(350)], (6, 1))


def _edges(seed: int, m: int, r: int, *, wide: float = 0.02) -> Edges:
    """Random costs; axes 4 and 6 go once round over the grid, as they do about a tool."""
    rng = np.random.default_rng(seed)
    q = rng.normal(0.0, wide, (m + 1, r, 6))
    q[:, :, 5] += TURN * np.arange(r) / r
    q -= TURN * np.round(q / TURN)
    q[rng.random((m + 1, r)) < 0.1] = np.nan
    early, late = rng.random((m, r)), rng.random((m, r))
    early[rng.random((m, r)) < 0.05] = np.inf
    contact = rng.random(m) < 0.7
    steps = np.where(contact, 1, rng.integers(0, 3, m))
    lost, torque = rng.random((m + 1, r, 6)) * 0.3, rng.normal(size=(m + 1, r, 6))
    return Edges(early, late, q, lost, torque, contact, np.ones(m), steps)


def _rules(speed: float = 10.0) -> Rules:
    return Rules(LIMITS, np.full(6, speed), 0.1, 0.2)


def _walked(edges: Edges, rules: Rules) -> tuple[int, float]:
    m, r = edges.early.shape
    back, hop = (np.zeros((m, r * PER_ROTATION), dtype=np.int16) for _ in range(2))
    value = np.empty(r * PER_ROTATION)
    passed = walk(edges, rules, back, hop, value)
    return passed, float(value.min())


def _winding(rules: Rules, q: Float) -> float:
    """Cost of continuous angles; infinite beyond the limits."""
    share = [(2.0 * q[a] - rules.limits[a].sum()) / np.ptp(rules.limits[a]) for a in (3, 5)]
    return math.inf if max(map(abs, share)) > 1.0 else 0.5 * rules.winding * sum(s * s for s in share)


def _toward(q: Float, to: Float) -> Float:
    """Angles of a posture, axes 4 and 6 turned the short way from where they are."""
    out = to.copy()
    for axis in (3, 5):
        out[axis] += TURN * round((q[axis] - to[axis]) / TURN)
    return out


def _exhaustive(edges: Edges, rules: Rules) -> float:
    """Cheapest of all ways, each priced from its angles alone."""
    r = edges.early.shape[1]
    best = math.inf
    hops = [range(-s, s + 1) for s in edges.steps.tolist()]
    for start, (four, six) in itertools.product(range(r), itertools.product((-1, 0, 1), repeat=2)):
        if np.isnan(edges.q[0, start, 0]):
            continue
        q0 = edges.q[0, start].copy()
        q0[3] += TURN * four
        q0[5] += TURN * six
        for way in itertools.product(*hops):
            best = min(best, _price(edges, rules, start, q0, way))
    return best


def _price(edges: Edges, rules: Rules, start: int, q: Float, way: tuple[int, ...]) -> float:
    r = edges.early.shape[1]
    here, cost, last_hop = start, _winding(rules, q), 0
    for e, hop in enumerate(way):
        contact = bool(edges.contact[e])
        if contact and abs(hop - last_hop) > 1:
            return math.inf
        to = (here + hop) % r if contact else here
        target = edges.q[e + 1, to]
        if np.isnan(target[0]) or np.isnan(edges.q[e, here, 0]):
            return math.inf
        new = _toward(q, target)
        move = new - q
        if contact and np.any(np.abs(move) > rules.speed * edges.duration[e]):
            return math.inf
        cost += edges.early[e, here] + edges.late[e, to] + _winding(rules, new)
        if contact:
            cost += rules.turning * abs(hop)
            crossed = edges.torque[e, here] * edges.torque[e + 1, to] < 0.0
            cost += float(np.sum(edges.lost[e + 1, to] * crossed))
            if e > 0:
                came = edges.q[e, here] - edges.q[e - 1, (here - last_hop) % r]
                came[[3, 5]] -= TURN * np.round(came[[3, 5]] / TURN)
                round_ = (came * move < 0.0) & (np.abs(came) > STILL_RAD) & (np.abs(move) > STILL_RAD)
                cost += float(np.sum(edges.lost[e, here] * round_))
        else:
            for _ in range(abs(hop)):
                to = (to + (1 if hop > 0 else -1)) % r
                target = edges.q[e + 1, to]
                if np.isnan(target[0]):
                    return math.inf
                new = _toward(new, target)
                if _winding(rules, new) == math.inf:
                    return math.inf
                cost += rules.turning
        if cost == math.inf:
            return math.inf
        here, q, last_hop = to, new, (hop if contact else 0)
    return cost


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), m=st.integers(1, 4))
def test_the_way_is_the_cheapest_of_all(seed: int, m: int) -> None:
    edges, rules = _edges(seed, m, 4), _rules()
    passed, cost = _walked(edges, rules)
    expected = _exhaustive(edges, rules)
    if math.isinf(expected):
        assert passed < m or math.isinf(cost)
    else:
        assert passed == m
        assert cost == pytest.approx(expected, rel=1e-12)


@settings(max_examples=10)
@given(seed=st.integers(0, 10_000))
def test_the_speed_of_the_joints_is_kept(seed: int) -> None:
    edges, rules = _edges(seed, 3, 4, wide=0.3), _rules(speed=0.9)
    passed, cost = _walked(edges, rules)
    expected = _exhaustive(edges, rules)
    assert (passed < 3 or math.isinf(cost)) == math.isinf(expected)
    if passed == 3 and not math.isinf(expected):
        assert cost == pytest.approx(expected, rel=1e-12)


def _plain(m: int, r: int) -> Edges:
    flat = np.zeros((m + 1, r, 6))
    contact, steps = np.ones(m, dtype=np.bool_), np.ones(m, dtype=np.int64)
    return Edges(np.zeros((m, r)), np.zeros((m, r)), flat, flat.copy(), flat.copy(), contact, np.ones(m), steps)


def test_a_reversal_is_avoided_where_it_costs_more_than_the_deflection() -> None:
    edges = _plain(2, 8)
    edges.steps[:] = 0
    edges.early[:, 3] = -1.0  # the stiffer rotation
    edges.q[:, :, 1] = np.array([0.0, 0.1, 0.2])[:, None]
    edges.q[:, 3, 1] = [0.0, 0.1, 0.0]  # in it axis 2 turns round
    assert _walked(edges, _rules())[1] == pytest.approx(-2.0, abs=0.1)
    edges.lost[1, 3, 1] = 5.0
    assert _walked(edges, _rules())[1] > -0.1


def test_the_tool_does_not_turn_back_at_once() -> None:
    """From forth to back it passes through a rest: a change of the rate of turning by one step at a station."""
    edges = _plain(2, 8)
    edges.early[:] = 1.0
    edges.late[:] = 1.0
    edges.early[0, 2] = edges.late[0, 3] = edges.early[1, 3] = edges.late[1, 2] = 0.0
    assert _walked(edges, _rules())[1] > 0.9
    edges.late[1, 3] = 0.0
    assert _walked(edges, _rules())[1] == pytest.approx(0.1)


def test_the_wound_up_axis_ends_the_way() -> None:
    m, r = 12, 4  # the stiff rotation runs round the tool three times: axis 6 is at its limit before
    edges = _plain(m, r)
    edges.q[:, :, 5] = TURN * np.arange(r) / r - math.pi
    for e in range(m):
        edges.early[e] = edges.late[e] = np.inf
        edges.early[e, e % r], edges.late[e, (e + 1) % r] = 0.0, 0.0
    passed, cost = _walked(edges, _rules(speed=100.0))
    assert passed == 5  # -180 deg is where axis 6 can begin, the sixth step of 90 deg would end at 360 deg
    assert math.isinf(cost) or passed < m

"""A force that is off the plan otherwise than in such cuts before: told in the next calm cut, with what it came by."""

from __future__ import annotations

import numpy as np
import pytest
from tests.runtime.test_force_step import _doubted
from tests.runtime.test_plausibility import FEED, FORCE, Plant, straight

from counterflex.core.arrays import Float
from counterflex.core.records import records
from counterflex.core.units import MM
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.plausibility import kernel as pk
from counterflex.runtime.plausibility.calm_cuts import forget_calm, known_in_air, off_in_calm
from counterflex.runtime.plausibility.limits import Plausibility
from counterflex.runtime.settings import ForceMode, ForceOffset
from counterflex.runtime.state.doubts import CALM_MOST, CUT_KIND, LIMITS, MEMORY
from counterflex.runtime.state.supervisor import Cause, State

_MODES = (ForceMode.MEASURED, ForceMode.PILOT, ForceMode.FUSED)
_ALONG_X = np.eye(3)
_ALONG_Y = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_STEP = np.array([0.0, 150.0, 0.0])


def _slot_with_a_gap(share: float = 1.0) -> LoopPlan:
    """Two cuts with 4 mm of air between them, the second with a share of the force of the first."""
    plan = straight()
    x = plan.p_part[:, 0]
    plan.w_tcp_part[(x > 0.1) & (x < 0.104)] = 0.0
    plan.w_tcp_part[x >= 0.104] *= share
    return plan


def _differs(plant: Plant) -> bool:
    return bool(plant.loop.result.doubt & pk.DOUBT_DIFFERS)


def _load(x: float, share: float = 1.0) -> Float:
    if not 0.03 < x < 0.17 or 0.1 < x < 0.104:
        return np.zeros(3)
    return FORCE if x < 0.1 else share * FORCE


def _second_cut(plant: Plant, sensed: Float, share: float = 1.0) -> float:
    """Cut to the end of the second one, where the sensor shows something more; seconds until that is told."""
    entered, told = -1, -1
    while plant.x < 0.168:
        load = _load(plant.x, share)
        plant.cycle(load, sensed=load + sensed if plant.x >= 0.104 else load)
        entered = plant.k if entered < 0 and plant.x >= 0.104 else entered
        told = plant.k if told < 0 and (_doubted(plant) or _differs(plant)) else told
        assert told < 0 or entered > 0
    return (told - entered) * 4e-3 if told > 0 else -1.0


@pytest.mark.parametrize(
    ("mode", "reaction"),
    [*((mode, ForceOffset.PLAN) for mode in _MODES), (ForceMode.FUSED, ForceOffset.HOLD)],
)
def test_a_step_that_hides_in_an_entry_is_told_and_not_followed_any_more(
    mode: ForceMode, reaction: ForceOffset
) -> None:
    """It comes with the load itself. What the first cut has shown tells in the second one (R17)."""
    plant = Plant(_slot_with_a_gap(), force=mode, force_offset=reaction).ready()
    assert 0 < _second_cut(plant, _STEP) < 1.5
    assert _doubted(plant)
    assert plant.loop.state == State.ACTIVE
    if mode == ForceMode.MEASURED:
        right = plant.loop.correction[:3].copy()
        clean = Plant(_slot_with_a_gap(), force=mode).ready()
        while clean.k < plant.k:
            clean.cycle(_load(clean.x))
        assert np.linalg.norm(right - clean.loop.correction[:3]) < 0.1 * MM


@pytest.mark.parametrize("mode", [ForceMode.MEASURED, ForceMode.PILOT])
def test_what_may_be_another_cut_holds_no_feed_in_the_cut_but_in_the_air_behind(mode: ForceMode) -> None:
    """R17, the pair: the zero is off, or the stock is deeper. Told in both; the way in air tells which, and holds."""
    for zero_n, share in ((_STEP, 1.0), (np.zeros(3), 1.6)):
        plant = Plant(_slot_with_a_gap(), force=mode, force_offset=ForceOffset.HOLD).ready()
        assert 0 < _second_cut(plant, zero_n, share) < 1.5
        assert plant.loop.result.degraded == Cause.FORCE_DIFFERS
        assert (plant.loop.state, plant.loop.result.feed_hold) == (State.ACTIVE, 0)
        while plant.x < 0.195 and plant.loop.state == State.ACTIVE:
            plant.cycle(_load(plant.x, share), sensed=_load(plant.x, share) + zero_n)
        assert not _differs(plant) or share == 1.0
        assert plant.loop.state == (State.HOLD if share == 1.0 else State.ACTIVE)
        assert plant.loop.cause == (Cause.FORCE_OFFSET if share == 1.0 else Cause.NONE)


@pytest.mark.parametrize("mode", _MODES)
def test_a_drift_over_two_seconds_is_told_while_it_lasts(mode: ForceMode) -> None:
    """150 N in 2 s are no step. One over a minute is followed, see test_what_is_no_step_is_not_told."""
    plant = Plant(straight(), force=mode, force_offset=ForceOffset.PLAN).ready()
    begin, told = -1, -1
    while plant.x < 0.165:
        load = _load(plant.x) if not 0.1 < plant.x < 0.104 else FORCE
        begin = plant.k if begin < 0 and plant.x > 0.075 else begin
        share = min(1.0, (plant.k - begin) * 4e-3 / 2.0) if begin >= 0 else 0.0
        plant.cycle(load, sensed=load + share * _STEP)
        told = plant.k if told < 0 and _doubted(plant) else told
    assert 0 < (told - begin) * 4e-3 < 2.5


@pytest.mark.long
@pytest.mark.parametrize("factor", [0.5, 0.7, 1.5, 2.0])
@pytest.mark.parametrize("share", [0.3, 0.6, 1.0])
@pytest.mark.parametrize("other", [0.9, 1.0, 1.1])
def test_wrong_cutting_constants_are_no_offset(factor: float, share: float, other: float) -> None:
    """The measured force is there for them: another factor than the plan's, and in another cut 10 % another one."""
    plant = Plant(_slot_with_a_gap(share), force=ForceMode.MEASURED, force_offset=ForceOffset.HOLD).ready()
    while plant.x < 0.195:
        plant.cycle(factor * (1.0 if plant.x < 0.102 else other) * _load(plant.x, share))
        assert not _doubted(plant), plant.x
        assert plant.loop.state == State.ACTIVE


class _Calm:
    """The kernel alone, with samples of a given residual and planned force, part axes."""

    def __init__(self) -> None:
        self.limits, self.memory, self.now = (records(kind)[0] for kind in (LIMITS, MEMORY, CUT_KIND))
        Plausibility().pack(self.limits, 4e-3, (8.0, 0.1))

    def cut(self, residual: Float, planned: Float, feed: Float, seconds: float, way: float = FEED * 16e-3) -> bool:
        """Whether it has been told."""
        found = False
        for _ in range(round(seconds / 4e-3)):
            cut = self.memory.samples[0].cut
            cut.residual[:3], cut.planned[:], cut.way = residual, planned, way
            self.memory.sample_row = 1
            found |= off_in_calm(feed.reshape(9).copy(), self.limits, self.memory, self.now)
        return found


def test_what_a_wrong_plan_is_off_by_turns_with_the_feed() -> None:
    """Behind a corner it is known already; the same residual as in front of it would be one that stands still."""
    along = np.array([-100.0, 280.0, -40.0])
    for residual, off in ((_ALONG_Y.T @ (0.8 * along), False), (0.8 * along, True)):
        calm = _Calm()
        assert not calm.cut(0.8 * along, along, _ALONG_X, 2.0)
        assert calm.cut(residual, _ALONG_Y.T @ along, _ALONG_Y, 1.0) == off


def test_another_kind_of_cut_is_learnt_and_one_that_comes_back_is_known() -> None:
    """A slot, a thin cut, the slot again; then the slot with 100 N more."""
    calm, slot, thin = _Calm(), np.array([-110.0, 320.0, -60.0]), np.array([40.0, 60.0, -10.0])
    for _ in range(2):
        assert not calm.cut(0.4 * slot, slot, _ALONG_X, 1.5)
        assert not calm.cut(0.2 * thin, thin, _ALONG_X, 1.5)
    assert calm.memory.calm_rows == 2
    more = np.array([0.0, 0.0, 100.0])
    assert calm.cut(0.4 * slot + more, slot, _ALONG_X, 1.0)
    assert calm.memory.cut_before.residual[:3] == pytest.approx(0.4 * slot)


def test_where_no_cut_is_known_the_plan_alone_is_asked() -> None:
    """Three times a small force passes, 150 N on it do not."""
    thin = np.array([0.0, 40.0, 0.0])
    assert not _Calm().cut(2.0 * thin, thin, _ALONG_X, 1.0)
    assert _Calm().cut(0.2 * thin + _STEP, thin, _ALONG_X, 1.0)


def test_a_change_of_speed_explains_the_force_that_goes_with_it() -> None:
    """At a third of the feed half the force is missing, which the plan does not know."""
    calm, slot = _Calm(), np.array([-110.0, 320.0, -60.0])
    assert not calm.cut(0.0 * slot, slot, _ALONG_X, 1.5)
    assert not calm.cut(-0.55 * slot, slot, _ALONG_X, 1.5, way=0.33 * FEED * 16e-3)
    assert calm.cut(-0.55 * slot, slot, _ALONG_X, 1.0)


def test_more_kinds_than_are_kept_replace_the_one_seen_least() -> None:
    """Nothing is written beyond the table, and the slot that was cut longest is still known."""
    calm, slot = _Calm(), np.array([-110.0, 320.0, -60.0])
    calm.cut(0.0 * slot, slot, _ALONG_X, 3.0)
    for k in range(2 * CALM_MOST):
        assert not calm.cut(np.zeros(3), np.array([0.0, 0.0, 60.0 * 1.3**k]), _ALONG_X, 0.6)
    assert calm.memory.calm_rows == CALM_MOST
    assert calm.cut(_STEP, slot, _ALONG_X, 1.0)


def test_a_cut_whose_air_behind_shows_the_zero_is_known_from_then_on() -> None:
    """Deeper stock is told once, not in each cut of it; the shallow one stays known beside it."""
    calm, slot, deeper = _Calm(), np.array([-110.0, 320.0, -60.0]), np.array([-80.0, 200.0, -40.0])
    calm.cut(0.1 * slot, slot, _ALONG_X, 2.0)
    assert calm.cut(deeper, slot, _ALONG_X, 1.0)
    assert calm.memory.calm_told == 1
    for k in range(calm.limits.step_back):
        assert calm.memory.calm_told == 1
        known_in_air(k != 0, calm.limits, calm.memory)
    known_in_air(True, calm.limits, calm.memory)
    assert calm.memory.calm_told == 0
    assert not calm.cut(deeper, slot, _ALONG_X, 2.0)
    assert not calm.cut(0.1 * slot, slot, _ALONG_X, 2.0)
    assert calm.cut(deeper + np.array([0.0, 0.0, 150.0]), slot, _ALONG_X, 1.0)


def test_what_is_told_ends_where_the_cut_is_as_before() -> None:
    """The stock is deeper for a second only: nothing is told behind it, without any air."""
    calm, slot = _Calm(), np.array([-110.0, 320.0, -60.0])
    calm.cut(0.1 * slot, slot, _ALONG_X, 2.0)
    assert calm.cut(0.1 * slot + _STEP, slot, _ALONG_X, 1.0)
    assert not calm.cut(0.1 * slot, slot, _ALONG_X, 1.0)
    assert calm.memory.calm_told == 0


def test_it_is_learnt_anew_once_forgotten() -> None:
    """What was shown before says nothing any more."""
    calm, slot = _Calm(), np.array([-110.0, 320.0, -60.0])
    calm.cut(0.0 * slot, slot, _ALONG_X, 2.0)
    forget_calm(calm.memory)
    assert not calm.cut(_STEP, slot, _ALONG_X, 2.0)

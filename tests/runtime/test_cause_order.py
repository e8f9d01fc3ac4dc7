"""A sensor that the estimator of all sources does without: what else is wrong is found as if the sensor were good."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import counterflex
from counterflex.core.records import records
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.estimator.fusion import FusionTuning
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.monitoring.monitor_kernel import hand_over
from counterflex.runtime.monitoring.records import MEMORY
from counterflex.runtime.primitives.causes import can_yield, next_cause
from counterflex.runtime.settings import Delays, ForceMode, Lost, OnlineSettings
from counterflex.runtime.state.chosen import SETTINGS
from counterflex.runtime.state.given import GIVEN
from counterflex.runtime.state.supervisor import Cause, State

CELL: Cell = read_cell(Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml")
Q = np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])
R = rotation.about_x(np.pi)
FEED, STEP_M = 0.025, 1e-4
FORCE = np.array([0.0, 300.0, 0.0, 0.0, 0.0, 0.0])
OF_SENSORS = (
    Cause.FORCE_STALE,
    Cause.FORCE_INVALID,
    Cause.FORCE_SATURATED,
    Cause.FORCE_OFFSET,
    Cause.TRACKER_LOST,
)


def made(tracker_lost: Lost = Lost.FALLBACK) -> Loop:
    x = np.linspace(0.0, 0.4, 1601)
    cuts = ((x > 0.03) & (x < 0.37)).astype(np.float64)
    plan = LoopPlan(np.stack([x, 0 * x, 0 * x], axis=1), x / FEED, FORCE * cuts[:, None], cuts, np.zeros((len(x), 6)))
    chosen = OnlineSettings(
        force=ForceMode.FUSED,
        delays=Delays(dead_s=16e-3, tracker_s=0.0),
        fusion=FusionTuning(mode=(8.0, 0.1)),
        tracker_lost=tracker_lost,
    )
    return Loop(CELL.chain, chosen, CELL.T_base_part, plan)


LOOPS = {lost: made(lost) for lost in Lost}


class Job:
    """A program through a cut as planned; from cycle 400 on a sensor is bad, 50 cycles later something else too."""

    def __init__(self, soft: Cause, tracker_lost: Lost = Lost.FALLBACK) -> None:
        self.loop, self.soft, self.x = LOOPS[tracker_lost], soft, 0.0
        self.loop.reset()
        for arm, enable in ((False, False), (True, False), (False, True)):
            self.cycle(Cause.NONE, arm=arm, enable=enable)
        for k in range(450):
            assert self.cycle(Cause.NONE if k < 400 else soft) == State.ACTIVE

    def cycle(self, soft: Cause | None = None, *, aside_m: float = 0.0, times: float = 1.0, **inputs: Any) -> State:
        self.x += STEP_M * times
        T = pose.make(R, np.array([self.x, aside_m, 0.0]))
        w = FORCE if 0.03 < self.x < 0.37 else np.zeros(6)
        soft = self.soft if soft is None else soft
        tracked = soft != Cause.TRACKER_LOST
        shown = {
            "force_age": 9 if soft in OF_SENSORS[:3] else 0,
            "T_part_actual": pose.make(R, T[:3, 3] + self.loop.in_effect[:3]) if tracked else None,
            "tracker_age": 0 if tracked else 10_000,
            "tracker_late_s": 0.0,
            "enable": True,
        }
        self.loop.feed(CycleInputs(T_part_tcp=T, q=Q, w_tcp_part=w, soft=soft, **(shown | inputs)))
        self.loop.run()
        return State(self.loop.state)

    def held_after(self, most: int, **inputs: Any) -> tuple[int, Cause]:
        """Cycles until it holds, and by which cause."""
        for k in range(1, most):
            if self.cycle(**inputs) != State.ACTIVE:
                assert self.loop.state == State.HOLD
                return k, Cause(self.loop.cause)
        return most, Cause.NONE


OTHERS: dict[str, tuple[dict[str, Any], int, Cause]] = {
    "telegrams lost": ({"elapsed": 0}, 9, Cause.TELEGRAMS_LATE),
    "off its path": ({"aside_m": 0.02}, 9, Cause.OFF_PATH),
    "another plan in the cut": ({"aside_m": 2e-3}, 400, Cause.OFF_PATH),
    "a reported pose that is no number": ({"T_part_reported": np.full((4, 4), np.nan)}, 9, Cause.TELEGRAM_MALFORMED),
}
"""By name: what happens, within how many cycles, and the cause."""


@pytest.mark.parametrize("soft", OF_SENSORS)
@pytest.mark.parametrize("name", OTHERS)
def test_it_holds_as_early_and_by_the_same_cause_as_with_a_good_sensor(name: str, soft: Cause) -> None:
    inputs, most, cause = OTHERS[name]
    good = Job(Cause.NONE).held_after(most, **inputs)
    assert good[1] == cause
    assert Job(soft).held_after(most, **inputs) == good


@pytest.mark.parametrize("soft", OF_SENSORS)
def test_another_feed_than_planned_holds_whatever_the_sensors_show(soft: Cause) -> None:
    """While the force sensor showed nothing, nobody looked at the feed."""
    good = Job(Cause.NONE).held_after(400, times=2.0)
    assert good[1] == Cause.FEED_DIFFERS
    assert Job(soft).held_after(400, times=2.0) == good


def test_a_place_that_is_only_told_hides_no_feed_that_holds() -> None:
    """0.7 mm off the plan is told, twice its feed holds: both together held by neither."""
    assert Job(Cause.NONE).held_after(400, aside_m=0.7e-3) == (400, Cause.NONE)
    assert Job(Cause.NONE).held_after(400, times=2.0, aside_m=0.7e-3)[1] == Cause.FEED_DIFFERS


def test_a_force_that_is_not_read_is_not_told_by_its_former_ratio() -> None:
    job = Job(Cause.NONE)
    assert job.loop.monitor.results.ratio > 0.5
    for _ in range(20):
        job.cycle(Cause.FORCE_STALE)
        assert job.loop.monitor.results.ratio == 0.0
    job.cycle(Cause.NONE)
    assert job.loop.monitor.results.ratio > 0.5


def test_three_telegrams_lost_hold() -> None:
    assert Job(Cause.FORCE_INVALID).held_after(9, elapsed=0)[0] == LOOPS[Lost.FALLBACK].settings.lost_cycles


@pytest.mark.parametrize("soft", OF_SENSORS)
def test_a_sensor_alone_is_done_without_and_told(soft: Cause) -> None:
    job = Job(soft)
    assert job.held_after(200) == (200, Cause.NONE)
    assert job.loop.result.degraded == soft


@pytest.mark.parametrize("soft", OF_SENSORS[:4])
def test_a_tracker_whose_loss_is_to_hold_holds_also_behind_a_bad_force(soft: Cause) -> None:
    after = {lost: Job(soft, lost).held_after(200, T_part_actual=None, tracker_age=10_000) for lost in Lost}
    good = Job(Cause.NONE, Lost.HOLD).held_after(200, T_part_actual=None, tracker_age=10_000)
    assert after == {Lost.FALLBACK: (200, Cause.NONE), Lost.HOLD: good}
    assert good[1] == Cause.TRACKER_LOST


def test_a_monitor_that_holds_is_handed_over_behind_a_bad_sensor() -> None:
    settings = LOOPS[Lost.FALLBACK]._loop["settings"][0]
    memory, given = records(MEMORY)[0], records(GIVEN)[0]
    memory.hold_cause = int(Cause.PROCESS_MISSING_CUT)
    for soft, then in ((Cause.FORCE_INVALID, Cause.PROCESS_MISSING_CUT), (Cause.OFF_PATH, Cause.OFF_PATH)):
        given.soft = int(soft)
        hand_over(memory, settings, given)
        assert given.soft == then


@pytest.mark.parametrize("tracker_holds", [0, 1])
@pytest.mark.parametrize("mode", ForceMode)
def test_of_two_causes_the_first_stands_unless_its_sensor_is_done_without(mode: ForceMode, tracker_holds: int) -> None:
    settings = records(SETTINGS)[0]
    settings.force, settings.tracker_lost_holds = int(mode), tracker_holds
    yielding = {cause for cause in Cause if can_yield(settings, int(cause))}
    spared = set(OF_SENSORS) - ({Cause.TRACKER_LOST} if tracker_holds else set())
    assert yielding == (spared if mode == ForceMode.FUSED else set())
    for first, second in itertools.product(Cause, Cause):
        found = next_cause(settings, int(first), int(second))
        yields = first == Cause.NONE or first in yielding
        assert found == (second if yields and second != Cause.NONE else first)

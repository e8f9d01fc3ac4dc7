"""The correction in each state, from any size and speed: it grows while correcting only, and a ramp comes to zero."""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.records import record, records
from counterflex.runtime.loop_constants import pack_settings
from counterflex.runtime.settings import ForceMode, OnlineSettings
from counterflex.runtime.state.chosen import SETTINGS
from counterflex.runtime.state.cycle import CYCLE
from counterflex.runtime.state.memory import STATE
from counterflex.runtime.state.result import RESULT
from counterflex.runtime.state.states import State
from counterflex.runtime.step.limit import limit

ONLINE: Final = OnlineSettings(force=ForceMode.MEASURED, normal_only=False)
PERIOD_S: Final = ONLINE.period_s
RADIUS_M: Final = ONLINE.translation.radius
SPEED_M_S: Final = ONLINE.translation.speed
ACCELERATION: Final = 1.25  # m/s2, of the settings
RAMP_M_S: Final = ONLINE.ramp_m_s
BRAKES_M: Final = SPEED_M_S**2 / (2.0 * ACCELERATION) + SPEED_M_S * PERIOD_S
"""Way in which the fastest correction stands, and one cycle of it."""
WAYS: Final = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.6, 0.0, -0.8], [-0.577, 0.577, 0.578]])
STANDING: Final = tuple(state for state in State if state != State.ACTIVE)


class Limiter:
    """The compiled limits of the step in one state, with the largest correction wanted all the time."""

    def __init__(self, state: State, y: Float, v: Float) -> None:
        memory = records(record(settings=SETTINGS, state=STATE, cycle=CYCLE, result=RESULT))
        self.memory = memory
        self.settings, self.state = memory[0].settings, memory[0].state
        self.of_cycle, self.result = memory[0].cycle, memory[0].result
        pack_settings(memory["settings"][0], ONLINE, np.eye(4), None)
        self.state.supervisor.state = state
        self.state.correction[:3], self.state.correction_rate[:3] = y, v

    def cycle(self, elapsed: int = 1) -> Float:
        self.of_cycle.elapsed = elapsed
        self.result.wanted[:3] = RADIUS_M, 0.0, 0.0
        limit(1.0, self.settings, self.state, self.of_cycle, self.result)
        out: Float = self.state.correction[:3].copy()
        return out


def beginnings() -> list[tuple[Float, Float]]:
    """Corrections of any size with any speed in and against their direction and across, within the limits."""
    out = []
    for way, size, speed, turn in itertools.product(
        WAYS, (0.0, 1e-9, 1e-5, 0.5, 1.0), (0.0, 1e-6, 0.3, 1.0), (1.0, -1.0, 0.0)
    ):
        across = np.cross(way, [0.0, 0.6, 0.8])
        along = turn * way if turn else across / np.linalg.norm(across)
        brakes = RADIUS_M - (speed * SPEED_M_S) ** 2 / (2.0 * ACCELERATION) - speed * SPEED_M_S * PERIOD_S
        out.append((way * min(size * RADIUS_M, brakes), along * speed * SPEED_M_S))
    return out


@pytest.mark.long
@pytest.mark.parametrize("state", STANDING)
@pytest.mark.parametrize("elapsed", [1, 4])
def test_it_does_not_grow_but_by_the_way_in_which_it_brakes(state: State, elapsed: int) -> None:
    for y, v in beginnings():
        limiter = Limiter(state, y, v)
        least, size = np.linalg.norm(y), 0.0
        for _ in range(60):
            size = float(np.linalg.norm(limiter.cycle(elapsed)))
            assert size <= least + BRAKES_M
            assert size <= RADIUS_M * (1.0 + 1e-9)
            assert np.all(np.isfinite(limiter.state.correction))


@pytest.mark.parametrize("state", [State.HOLD, State.FAULT])
def test_it_stands_in_a_hold_and_in_a_fault(state: State) -> None:
    for y, v in beginnings():
        limiter = Limiter(state, y, v)
        for _ in range(round(SPEED_M_S / ACCELERATION / PERIOD_S) + 2):
            limiter.cycle()
        stood = limiter.cycle()
        for _ in range(20):
            assert np.array_equal(limiter.cycle(), stood)
        assert np.linalg.norm(stood - y) <= BRAKES_M


@pytest.mark.long
def test_a_ramp_comes_to_zero_in_its_time_and_no_faster_than_it_may() -> None:
    """The end that the exploration of the supervisor takes for granted."""
    for y, v in beginnings():
        limiter = Limiter(State.RAMP_OUT, y, v)
        most = (np.linalg.norm(y) + BRAKES_M) / RAMP_M_S / PERIOD_S
        brakes = round(SPEED_M_S / ACCELERATION / PERIOD_S) + 2
        before = y
        for k in range(round(most) + 2 * brakes + 60):
            now = limiter.cycle()
            if k > brakes:
                assert np.linalg.norm(now - before) <= RAMP_M_S * PERIOD_S * (1.0 + 1e-9)
            before = now
        assert np.linalg.norm(before) < 1e-7
        assert np.linalg.norm(limiter.state.correction_rate[:3]) * PERIOD_S < 1e-7


def test_without_a_telegram_nothing_moves_in_any_state() -> None:
    for state in State:
        for y, v in beginnings()[::7]:
            assert np.array_equal(Limiter(state, y, v).cycle(0), y)


def test_while_correcting_it_grows_to_what_is_wanted() -> None:
    limiter = Limiter(State.ACTIVE, np.zeros(3), np.zeros(3))
    sizes = [float(np.linalg.norm(limiter.cycle())) for _ in range(200)]
    assert sizes[-1] == pytest.approx(RADIUS_M, rel=1e-3)
    assert max(sizes) <= RADIUS_M * (1.0 + 1e-9)

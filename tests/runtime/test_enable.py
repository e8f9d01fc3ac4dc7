"""The program's Enable: a flicker is none; a correction that is away in the cut holds the feed, and that is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import counterflex
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.settings import ForceMode, OnlineSettings
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.runtime.step.supervise import DEBOUNCE

CELL: Cell = read_cell(Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml")
Q = np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])
R = rotation.about_x(np.pi)
FORCE = np.array([-120.0, 300.0, -90.0])
CUT = (0.02, 0.18)


class Program:
    """A program with a cut in its middle, 0.1 mm a cycle; the force of the plan acts in it."""

    def __init__(self, *, planned: bool = True) -> None:
        x = np.linspace(0.0, 0.2, 801)
        cuts = ((x > CUT[0]) & (x < CUT[1])).astype(np.float64)
        w = np.zeros((len(x), 6))
        w[:, :3] = FORCE * cuts[:, None]
        p = np.stack([x, 0.0 * x, 0.0 * x], axis=1)
        plan = LoopPlan(p, x / 0.025, w, cuts, np.zeros((len(x), 6)))
        settings = OnlineSettings(force=ForceMode.MEASURED, normal_only=planned)
        self.loop = Loop(CELL.chain, settings, CELL.T_base_part, plan if planned else None)
        self.x = 0.0

    def cycle(
        self,
        *,
        enable: bool = True,
        arm: bool = False,
        reset: bool = False,
        moves: bool = True,
        soft: Cause = Cause.NONE,
    ) -> State:
        self.x += 1e-4 * moves
        w = np.zeros(6)
        w[:3] = FORCE if CUT[0] < self.x < CUT[1] and moves else 0.0
        T = pose.make(R, np.array([self.x, 0.0, 0.0]))
        self.loop.feed(CycleInputs(T_part_tcp=T, q=Q, w_tcp_part=w, enable=enable, arm=arm, reset=reset, soft=soft))
        self.loop.run()
        return self.loop.state

    def go(self, x: float, *, enable: bool = True) -> Program:
        while self.x < x:
            self.cycle(enable=enable)
        return self

    def begin(self) -> Program:
        for arm in (False, False, True):
            self.cycle(enable=False, arm=arm)
        assert self.cycle() == State.ACTIVE
        return self

    def arm(self) -> None:
        """A person arms the program that stands, its Enable off for as long as an off takes."""
        for _ in range(DEBOUNCE):
            self.cycle(enable=False, arm=True, moves=False)

    @property
    def held(self) -> bool:
        return bool(self.loop.result.feed_hold)

    @property
    def told_to_stop(self) -> bool:
        return bool(self.loop.result.stop)


@pytest.mark.parametrize("planned", [True, False])
@pytest.mark.parametrize("low", range(1, DEBOUNCE))
def test_a_flicker_changes_nothing(low: int, planned: bool) -> None:
    """One cycle without Enable ramped the correction out, and the rest was cut without it."""
    plain, flickering = Program(planned=planned).begin(), Program(planned=planned).begin()
    for k in range(1000):
        plain.cycle()
        assert flickering.cycle(enable=k % 20 >= low) == State.ACTIVE
        np.testing.assert_array_equal(flickering.loop.correction, plain.loop.correction)
        assert not flickering.held


@pytest.mark.parametrize("planned", [True, False])
def test_what_is_switched_off_in_the_cut_holds_the_feed_until_a_person_has_seen_it(planned: bool) -> None:
    program = Program(planned=planned).begin().go(0.06)
    for _ in range(DEBOUNCE):
        program.cycle(enable=False)
    assert program.loop.state == State.HOLD
    assert program.loop.cause == Cause.ENABLE_LOST
    assert program.held
    while int(program.cycle(moves=False)) in (State.HOLD, State.RAMP_OUT):  # the signal is back: nothing is armed by it
        assert program.held
    assert int(program.loop.state) == State.READY
    assert program.told_to_stop
    for _ in range(300):
        program.cycle(moves=False, arm=True)
        assert program.held
        assert int(program.loop.state) == State.READY
    assert not program.told_to_stop
    program.cycle(enable=False, reset=True, moves=False)
    assert not program.held
    program.arm()
    assert int(program.cycle(moves=False)) == State.ACTIVE


def test_a_program_that_has_left_the_cut_is_not_held() -> None:
    program = Program().begin().go(0.19)
    for _ in range(100):
        program.cycle(enable=False)
        assert not program.held
    assert program.loop.state == State.READY
    assert program.loop.cause == Cause.PROGRAM


def test_a_program_that_wants_it_again_without_having_been_armed_is_held() -> None:
    """Switched off in the air, on again for the next cut: it would be cut without a correction."""
    program = Program().begin().go(0.018)
    for _ in range(DEBOUNCE):
        program.cycle(enable=False)
    assert program.loop.cause == Cause.PROGRAM
    assert not program.held
    for _ in range(DEBOUNCE):
        program.cycle()
    assert program.held
    assert program.loop.cause == Cause.ENABLE_LOST


@pytest.mark.parametrize("planned", [True, False])
@pytest.mark.parametrize(("on", "off"), [(1, 5), (4, 9), (1, 40)])
def test_an_enable_that_flickers_does_not_let_the_next_cut_be_uncorrected(on: int, off: int, planned: bool) -> None:
    """Off in the air for as long as an off takes, then now and then on: neither corrected nor held."""
    program = Program(planned=planned).begin().go(CUT[0] - 100e-4)
    for _ in range(DEBOUNCE):
        program.cycle(enable=False)
    assert program.loop.cause == Cause.PROGRAM
    cut = 0
    while not program.held and cut < 100:
        for k in range(on + off):
            program.cycle(enable=k < on)
            cut += program.x > CUT[0]
            if program.held:
                break
    assert cut <= DEBOUNCE + (0 if planned else 12)  # without a plan the filtered force shows the cut
    assert program.loop.state < State.ARMED
    assert int(program.loop.cause) == Cause.ENABLE_LOST


def test_a_program_that_is_off_and_stays_so_cuts_without_the_correction() -> None:
    program = Program().begin().go(0.01)
    while program.x < 0.1:
        program.cycle(enable=False)
        assert not program.held


def test_nobody_arms_a_program_whose_enable_flickers() -> None:
    """Armed in a gap of the signal, the next telegram with it began the correction wherever the program was."""
    program = Program()
    for k in range(200):
        program.cycle(enable=k % DEBOUNCE == 0, arm=True, moves=False)
        assert program.loop.state < State.ARMED
    program.arm()
    assert int(program.loop.state) == State.ARMED


@pytest.mark.parametrize("enable", [True, False])
def test_an_acknowledgment_in_the_cycle_of_the_disarming_is_none_of_it(enable: bool) -> None:
    """The person who acknowledged had seen an armed loop; the next cut was neither corrected nor held."""
    program = Program()
    for arm in (False, False, True):
        program.cycle(enable=False, arm=arm)
    assert program.cycle(enable=False, reset=True, soft=Cause.FORCE_STALE) == State.READY
    program.go(CUT[0] + 0.001, enable=enable)
    assert program.held


@pytest.mark.parametrize("gap", [0, 3 * DEBOUNCE])
def test_an_acknowledgment_in_a_gap_of_enable_is_none_of_the_cut(gap: int) -> None:
    program = Program().begin()
    for k in range(4 * DEBOUNCE):
        program.cycle(enable=k == 2 * DEBOUNCE)
    assert program.loop.state == State.READY
    program.cycle()
    for _ in range(gap):
        program.cycle(enable=False)
    program.cycle(enable=False, reset=True)
    while program.x < CUT[0] + 0.001:
        program.cycle(enable=round(program.x / 1e-4) % DEBOUNCE == 0)
    assert program.held


def test_a_loop_that_only_watches_holds_nobody() -> None:
    program = Program()
    for k in range(600):
        program.cycle(enable=k % 50 > 10)
        assert not program.held
    assert program.loop.state == State.READY


@pytest.mark.parametrize("planned", [True, False])
def test_an_acknowledgment_on_the_way_to_the_cut_is_none_of_the_cut(planned: bool) -> None:
    """Disarmed in air, acknowledged there; the program went through the cut uncorrected, and nothing held it."""
    program = Program(planned=planned)
    for arm in (False, False, True):
        program.cycle(enable=False, arm=arm)
    assert program.cycle(soft=Cause.WRONG_JOB) == State.READY
    program.cycle(reset=True)
    assert not program.held
    program.go(CUT[0] + 0.004)
    assert program.held
    program.cycle(reset=True)
    program.go(CUT[0] + 0.005)
    assert not program.held  # seen: a person lets it go on


def test_a_hold_that_the_program_has_left_in_air_does_not_let_the_next_cut_be_uncorrected() -> None:
    """Held in air for a reason, Enable off there and on again: the next cut ran without its correction, and no hold."""
    program = Program().begin()
    assert program.cycle(soft=Cause.RUN_LOST) == State.HOLD
    for _ in range(2 * DEBOUNCE):
        program.cycle(enable=False, soft=Cause.RUN_LOST, moves=False)
    assert program.loop.state < State.ARMED
    assert not program.held
    program.go(CUT[0] + 0.002)
    assert program.held


@pytest.mark.parametrize("planned", [True, False])
@pytest.mark.parametrize("enable", [True, False])
def test_behind_a_loop_that_did_not_end_by_itself_a_program_in_the_cut_is_held(enable: bool, planned: bool) -> None:
    """Started again in the cut it only watched: it had never been armed itself."""
    program = Program(planned=planned)
    program.x = 0.06
    for _ in range(DEBOUNCE if enable else 60):  # without its word the cut must be seen, and that it goes on
        program.cycle(enable=enable, soft=Cause.NOT_CLOSED, arm=True)
    assert program.held
    assert program.told_to_stop
    assert (program.loop.state, program.loop.cause) == (State.IDLE, Cause.NOT_CLOSED)
    for _ in range(100):
        program.cycle(enable=enable, soft=Cause.NOT_CLOSED, arm=True, moves=False)
    assert program.held
    assert program.loop.state == State.IDLE
    program.cycle(enable=False, reset=True, moves=False)
    assert not program.held
    program.arm()
    assert int(program.cycle()) == State.ACTIVE


def test_behind_such_a_loop_a_program_that_waits_is_not_held_and_not_armed() -> None:
    program = Program()
    for _ in range(200):
        program.cycle(enable=False, moves=False, soft=Cause.NOT_CLOSED, arm=True)
        assert not program.held
        assert program.loop.state == State.IDLE
    program.cycle(enable=False, moves=False, reset=True)
    program.arm()
    assert program.cycle() == State.ACTIVE

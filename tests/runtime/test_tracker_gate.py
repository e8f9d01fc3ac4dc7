"""A tracker's sample against what the tool can have done: jumps, repeats, wrong stamps, silence, in every mode."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import counterflex
from counterflex.core.units import MM, UM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.online import OnlineTable
from counterflex.geometry import pose, rotation
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.estimator.fusion import Source
from counterflex.runtime.loop import Loop
from counterflex.runtime.plausibility import kernel as pk
from counterflex.runtime.settings import ForceMode
from counterflex.runtime.state.supervisor import Cause, State

CELL: Cell = read_cell(Path(counterflex.__file__).parent / "app" / "demo" / "cell.toml")
Q = np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])
R = rotation.about_x(np.pi)
OFF = np.array([0.0, 0.15, -0.1]) * MM
MODES = ["integrator", "observer", "designed", "fused"]
"""Of the tracker; the last one is the estimator of all sources, which takes the tracker itself."""


class Tracked:
    """A robot that goes along x, answers as thought, is off by some tenths of a millimetre, and is tracked."""

    def __init__(self, tracker: str, *, force: str = "none", noise_m: float = 10.0 * UM, **changes: Any) -> None:
        if tracker == "fused":
            tracker, force, changes = "none", "fused", {"tracker_stale_ms": 100.0, **changes}
        table = OnlineTable(tracker=tracker, force=force, along_feed=True, tracker_age_ms=0.0, **changes)  # type: ignore[arg-type]
        self.loop = Loop(CELL.chain, table.settings(None, compensated=False, mode=(8.5, 0.1)), CELL.T_base_part)
        self.k, self.noise_m, self.sources = 0, noise_m, Source.FORCE | Source.TRACKER
        self.rng = np.random.default_rng(5)
        self.pose = np.eye(4)

    def cycle(
        self,
        jump: Any = 0.0,
        *,
        seen: bool = True,
        frozen: bool = False,
        late_s: float | None = 0.0,
        speed: float = 0.025,
        turn: float = 0.0,
    ) -> State:
        self.k += 1
        nominal = pose.make(R, np.array([speed * 4e-3 * self.k, 0.0, 0.0]))
        actual = nominal[:3, 3] + self.loop.in_effect[:3] + OFF + jump + self.noise_m * self.rng.standard_normal(3)
        if not frozen:
            self.pose = pose.make(rotation.about_z(turn) @ R, actual)
        self.loop.feed(CycleInputs(
            T_part_tcp=nominal, q=Q, w_tcp_part=np.zeros(6), T_part_actual=self.pose if seen else None,
            arm=self.k == 70, enable=self.k > 80, tracker_age=0 if seen else 5, tracker_late_s=late_s,
            sources=self.sources,
        ))  # fmt: skip
        self.loop.run()
        return self.loop.state

    def settled(self) -> Tracked:
        for _ in range(1000):
            self.cycle()
        assert self.loop.state == State.ACTIVE
        assert self.rejected == 0
        return self

    @property
    def rejected(self) -> int:
        return int(self.loop.result.rejected)

    @property
    def doubt(self) -> int:
        return int(self.loop.result.doubt)

    def learnt(self) -> Any:
        """What the tracker's samples have moved so far."""
        state = self.loop.step_state
        offset = self.loop.offset if self.loop.settings.force == ForceMode.FUSED else state.offset
        return np.r_[state.tracker_integral, offset]


@pytest.mark.parametrize("tracker", MODES)
@pytest.mark.parametrize("jump_mm", [0.5, 2.0, 1000.0])
@pytest.mark.parametrize("axis", [1, 2])
def test_one_sample_that_jumps_moves_nothing_and_is_counted(tracker: str, jump_mm: float, axis: int) -> None:
    """A jump of 1 m drove the correction by 2 mm in 160 ms, one of 0.5 mm was followed silently."""
    robot = Tracked(tracker).settled()
    before = robot.learnt()
    robot.cycle(np.eye(3)[axis] * jump_mm * MM)
    np.testing.assert_array_equal(robot.learnt(), before)
    assert robot.doubt & pk.DOUBT_JUMP
    assert robot.rejected == 1
    assert robot.loop.result.degraded == Cause.TRACKER_JUMP
    robot.cycle()
    assert robot.rejected == 1
    assert robot.loop.state == State.ACTIVE
    assert robot.loop.result.degraded == Cause.NONE


@pytest.mark.parametrize("tracker", MODES)
@pytest.mark.parametrize("jump_mm", [0.5, 1000.0])
def test_a_jump_that_stays_is_never_followed_and_holds(tracker: str, jump_mm: float) -> None:
    robot = Tracked(tracker).settled()
    before, correction = robot.learnt(), robot.loop.correction.copy()
    begin, most = robot.k, 27 if tracker == "fused" else 5  # beside a force it may be silent for 0.1 s
    while robot.cycle(np.array([0.0, jump_mm, 0.0]) * MM) != State.HOLD:
        assert robot.k <= begin + most
    assert robot.loop.cause == Cause.TRACKER_JUMP
    assert robot.loop.result.feed_hold == 1
    np.testing.assert_array_equal(robot.learnt(), before)
    assert np.linalg.norm(robot.loop.correction[:3] - correction[:3]) < 20 * UM


@pytest.mark.parametrize("lost", ["hold", "fallback"])
@pytest.mark.parametrize("fault", ["jump", "turn", "frozen", "stamp", "silent"])
@pytest.mark.parametrize("tracker", MODES)
def test_beside_a_force_a_tracker_that_is_lost_holds_or_is_left_out_as_set(tracker: str, fault: str, lost: str) -> None:
    """Told in any case; the part of the correction that came from it stands still in any case."""
    robot = Tracked(tracker, force="measured", tracker_lost=lost).settled()
    before = robot.learnt()
    cause = {
        "jump": Cause.TRACKER_JUMP,
        "turn": Cause.TRACKER_JUMP,
        "frozen": Cause.TRACKER_FROZEN,
        "stamp": Cause.TRACKER_STAMP,
        "silent": Cause.TRACKER_LOST,
    }[fault]
    begin = robot.k
    for _ in range(60):
        state = robot.cycle(
            np.array([0.0, 0.5, 0.0]) * MM if fault == "jump" else 0.0,
            seen=fault != "silent",
            frozen=fault == "frozen",
            late_s=4.0 if fault == "stamp" else 0.0,
            turn=0.01 if fault == "turn" else 0.0,
        )
        if state != State.ACTIVE:
            break
    assert robot.loop.result.degraded == cause
    if lost == "hold":
        assert (robot.loop.state, robot.loop.cause) == (State.HOLD, cause)
        assert robot.k <= begin + 27
    else:
        assert robot.loop.state == State.ACTIVE
    np.testing.assert_allclose(robot.learnt(), before, atol=3 * UM)


@pytest.mark.parametrize("tracker", MODES)
def test_stamps_that_go_back_are_not_believed(tracker: str) -> None:
    robot = Tracked(tracker).settled()
    robot.cycle(late_s=0.004)
    robot.cycle(late_s=0.05)
    assert robot.doubt & pk.DOUBT_STAMP
    assert robot.rejected == 1


@pytest.mark.parametrize("tracker", MODES)
def test_what_the_tool_can_do_is_let_pass_pair(tracker: str) -> None:
    """Forces that come and go within 20 ms, noise, stamps that jitter by a cycle."""
    robot = Tracked(tracker, noise_m=20.0 * UM).settled()
    for k in range(300):
        bump = np.clip(min(k % 100, 50 - k % 100) / 5.0, 0.0, 1.0) * 0.6
        robot.cycle(np.array([0.0, bump, 0.0]) * MM, late_s=0.004 * (k % 2))
        assert robot.loop.state == State.ACTIVE
    assert robot.rejected <= 3


def test_a_pose_that_repeats_itself_at_rest_is_no_frozen_tracker() -> None:
    robot = Tracked("integrator", force="measured", noise_m=0.0)
    for _ in range(400):
        robot.cycle(speed=0.0)
    for _ in range(100):
        robot.cycle(speed=0.0, frozen=True)
    assert not robot.doubt & pk.DOUBT_FROZEN


@pytest.mark.parametrize("tracker", MODES)
def test_a_robot_that_was_moved_between_two_sessions_is_no_frozen_tracker(tracker: str) -> None:
    """It stood where it had been moved to, and its tracker was called frozen for as long as it stood: never armed."""
    rng, loop = np.random.default_rng(4), Tracked(tracker).loop

    def cycle(seen_m: float, commanded_m: float, **given: Any) -> None:
        nominal = pose.make(R, np.array([commanded_m, 0.0, 0.0]))
        seen = pose.make(R, np.array([seen_m, 0.0, 0.0]) + 10.0 * UM * rng.standard_normal(3))
        loop.feed(
            CycleInputs(
                T_part_tcp=nominal, q=Q, w_tcp_part=np.zeros(6), T_part_actual=seen, tracker_late_s=0.0, **given
            )
        )
        loop.run()

    for _ in range(200):
        cycle(0.0, 0.0)
    assert loop.state == State.READY
    for _ in range(50):
        cycle(0.1, 0.0, elapsed=0)
    cycle(0.1, 0.1, hard=int(Cause.SESSION_RESTARTED))
    for k in range(400):
        cycle(0.1, 0.1, reset=k == 0)
    assert Cause(int(loop.result.cause)) == Cause.NONE
    assert loop.state == State.READY


@pytest.mark.parametrize("tracker", MODES)
@pytest.mark.parametrize("earlier", ["telegrams lost", "sooner than thought"])
def test_a_robot_that_has_come_to_rest_is_no_frozen_tracker(tracker: str, earlier: str) -> None:
    """Its first sample at rest was held against a place that it had left; it was called frozen for as long as it stood.

    Because it went there while telegrams were lost, or because it follows its program sooner than was identified.
    """
    rng, loop = np.random.default_rng(4), Tracked(tracker).loop
    ahead = 20 if earlier == "sooner than thought" else 0

    def cycle(seen_m: float, commanded_m: float, **given: Any) -> bool:
        nominal = pose.make(R, np.array([commanded_m, 0.0, 0.0]))
        seen = pose.make(R, np.array([seen_m, 0.0, 0.0]) + 10.0 * UM * rng.standard_normal(3))
        loop.feed(CycleInputs(
            T_part_tcp=nominal, q=Q, w_tcp_part=np.zeros(6), T_part_actual=seen, tracker_late_s=0.0, **given
        ))  # fmt: skip
        loop.run()
        return bool(int(loop.result.doubt) & pk.DOUBT_FROZEN)

    way = np.r_[np.zeros(200), 2e-4 * np.arange(300), np.full(400, 0.06)]
    for k in range(491 if ahead == 0 else len(way) - 20):
        cycle(way[k + ahead], way[k])
    if ahead == 0:
        for k in range(491, 499):
            cycle(way[k], way[490], elapsed=0)
        cycle(0.06, 0.06, elapsed=9)
    assert not any([cycle(0.06, 0.06) for _ in range(300)][50:])
    assert loop.state == State.READY


@pytest.mark.parametrize("tracker", MODES)
def test_a_nan_is_not_used(tracker: str) -> None:
    robot = Tracked(tracker).settled()
    before = robot.learnt()
    robot.cycle(np.array([0.0, np.nan, 0.0]))
    np.testing.assert_array_equal(robot.learnt(), before)
    assert (robot.loop.state, robot.loop.cause) == (State.HOLD, Cause.TRACKER_LOST)


@pytest.mark.parametrize("tracker", MODES)
@pytest.mark.parametrize("jump", [(0.3, 0.4, 0.0), (0.0, 0.0, 0.4), (0.0, -0.5, 0.0)])
def test_what_was_rejected_is_not_believed_later_because_time_has_passed(tracker: str, jump: Any) -> None:
    """Of 0.4 mm across the feed the first sample was rejected and the second followed, all the way."""
    robot = Tracked(tracker, force="measured", tracker_lost="fallback").settled()
    before = robot.learnt()
    for _ in range(700):
        assert robot.cycle(np.array(jump) * MM) == State.ACTIVE
    np.testing.assert_allclose(robot.learnt(), before, atol=3 * UM)
    assert robot.rejected == 700
    assert robot.loop.result.degraded == Cause.TRACKER_JUMP
    for _ in range(100):  # until their share is small
        robot.cycle()
    assert robot.rejected <= 703  # three in a row where they should be
    assert robot.loop.result.degraded == Cause.NONE


@pytest.mark.parametrize("tracker_lost", ["fallback", "hold"])
@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        ({"jump": np.array([0.0, 0.66, 0.0]) * MM}, Cause.TRACKER_JUMP),
        ({"frozen": True}, Cause.TRACKER_FROZEN),
        ({"late_s": 30.0}, Cause.TRACKER_STAMP),
    ],
)
def test_a_tracker_that_is_the_only_source_holds_by_why_its_samples_are_rejected(
    fault: dict[str, Any], cause: Cause, tracker_lost: str
) -> None:
    """It was called lost although it went on, where it was to fall back on other sources."""
    robot = Tracked("fused", tracker_lost=tracker_lost)
    robot.sources = Source.TRACKER
    robot.settled()
    held = [robot.cycle(**fault) for _ in range(100)]
    assert held[-1] == State.HOLD
    assert robot.loop.cause == robot.loop.result.degraded == cause


def test_the_estimator_holds_samples_of_any_age_and_pause_against_their_own_time_pair() -> None:
    """25 Hz and 100 ms late, while a correction is on its way: none is rejected; of a jump of 0.5 mm every one."""
    robot = Tracked("fused", tracker_lost="fallback", tracker_stale_ms=400.0)
    poses: list[Any] = []

    def seldom(cycles: int, jump: Any) -> None:
        for _ in range(cycles):
            robot.k += 1
            nominal = pose.make(R, np.array([1e-4 * robot.k, 0.0, 0.0]))
            shown = pose.make(R, nominal[:3, 3] + robot.loop.in_effect[:3] + OFF + jump)
            shown[:3, 3] += robot.noise_m * robot.rng.standard_normal(3)
            poses.append(shown)
            seen = robot.k % 10 == 0 and robot.k > 25
            robot.loop.feed(CycleInputs(
                T_part_tcp=nominal, q=Q, w_tcp_part=np.zeros(6), T_part_actual=poses[-26] if seen else None,
                arm=robot.k == 70, enable=robot.k > 80, tracker_age=0 if seen else 5, tracker_late_s=0.1,
            ))  # fmt: skip
            robot.loop.run()

    seldom(1000, 0.0)
    assert (robot.loop.state, robot.rejected) == (State.ACTIVE, 0)
    np.testing.assert_allclose(robot.loop.offset[1:3], OFF[1:], atol=15 * UM)
    learnt = robot.learnt()
    seldom(25, np.array([0.0, 0.5, 0.0]) * MM)
    assert robot.rejected <= 1
    before = robot.rejected
    seldom(500, np.array([0.0, 0.5, 0.0]) * MM)
    assert robot.rejected - before == 50
    np.testing.assert_allclose(robot.learnt(), learnt, atol=10 * UM)
    assert robot.loop.result.degraded == Cause.TRACKER_JUMP

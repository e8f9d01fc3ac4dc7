"""The robot in motion: statics, frequencies and laws against other ways of computing them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from counterflex.app.inputs import setting_of
from counterflex.app.proof.truth import knowing, truth_of
from counterflex.core.arrays import Float
from counterflex.core.errors import ModelError
from counterflex.core.units import DEG, UM
from counterflex.files.cell.cell import Cell
from counterflex.path.toolpath import FEED, RAPID, ToolPath
from counterflex.plan import elastic_motion
from counterflex.plan.elastic_motion import commanded, inertia, jacobians, matrices, motion_along, postures
from counterflex.plan.elastic_motion_kernel import advance, rest
from counterflex.plan.modes import lowest_mode
from counterflex.plan.relative_motion import tool_carried
from counterflex.plan.tool_deviation import answered_late, shaken_rows
from counterflex.robot.elasticity import compliance, play
from counterflex.robot.elasticity.chain import ElasticChain, forward, frames, jacobian
from counterflex.robot.model.description import Play, Servo

CellOf = Callable[..., Cell]
BASE = tool_carried(np.eye(4))
Q = np.array([-3.0, -92.0, 123.0, -174.0, 31.0, 175.0]) * DEG
LOAD = np.array([-200.0, 500.0, -100.0, 0.0, 0.0, 0.0])
PER_S = 2000
ENDS = np.array([0.0, 4.0])
SERVO = Servo(speed_gain_nm_s=1e5, position_gain_per_s=20.0, integral_time_s=0.06, friction_nm=0.0, slip_rad=1e-5)


@pytest.fixture(scope="module")
def plain(cell_of: CellOf) -> ElasticChain:
    """The demonstration robot without play, friction and yielding drives."""
    return replace(setting_of(cell_of()).chain, play=None, servo=None)


def answer(chain: ElasticChain, seconds: float, load: Float) -> Float:
    """Deviation (n, 6) of the tool at every step under a load that sets in at 0.1 s and stays; base axes."""
    time = np.array([0.0, seconds])
    q = np.tile(Q, (2, 1))
    motion = motion_along(chain, BASE, q, q, time)
    rest(motion, 0)
    steps = round(seconds * PER_S)
    out, one, none = np.zeros((steps, 6)), np.zeros(6), np.zeros(6)
    for k in range(steps):
        acting = load if k > 0.1 * PER_S else none
        advance(motion, 1, (k + 1) / PER_S, acting, one)
        out[k] = one
    return out


def test_jacobian_is_that_of_the_rigid_robot(plain: ElasticChain) -> None:
    assert matrices(plain, Q)[2][:, :6] == pytest.approx(jacobian(plain, Q[None])[0], abs=1e-12)


def test_drives_turn_about_their_axes_where_gears_give_way_beside_them(cell_of: CellOf) -> None:
    """A truth's bearings lie up to some centimetres beside its axes; a command moves the tool as rigid links would."""
    cell = cell_of()
    chain = replace(knowing(cell, truth_of(cell, 2))[0], play=None, servo=None)
    assert np.max(np.abs(matrices(chain, Q)[3][:3])) > 1e-3
    asked = np.array([0.3, -0.2, 0.4, -0.5, 0.6, 0.2]) * 1e-3
    time = np.array([0.0, 4.0])
    motion = motion_along(chain, BASE, np.tile(Q, (2, 1)), Q + np.outer([1.0, 1.0], asked), time)
    rest(motion, 0)
    out = np.zeros(6)
    for k in range(8000):
        advance(motion, 1, (k + 1) / PER_S, np.zeros(6), out)
    moved = forward(chain, (Q + asked)[None])[0, :3, 3] - forward(chain, Q[None])[0, :3, 3]
    np.testing.assert_allclose(out[:3], moved, atol=2.0 * UM)


def test_a_correction_is_answered_late_and_the_feed_is_not() -> None:
    time = np.linspace(0.0, 1.0, 201)
    q = np.outer(time, np.ones(6))
    correction = np.outer(np.sin(9.0 * time), np.arange(6.0))
    found = answered_late(time, q, q + correction, 0.01) - q
    np.testing.assert_allclose(found[2:], correction[:-2], atol=1e-12)
    np.testing.assert_array_equal(answered_late(time, q, q + correction, 0.0), q + correction)


def test_stiffness_is_that_of_the_static_model(plain: ElasticChain) -> None:
    _, stiffness, J, _ = matrices(plain, Q)
    assert (J / stiffness) @ J.T == pytest.approx(compliance.cartesian_compliance(plain, Q[None])[0], rel=1e-9)


def test_kinetic_energy_of_a_turn_of_axis_one(plain: ElasticChain) -> None:
    """Inertia about the vertical axis is the sum of masses times squared distances plus the spheres' own."""
    T = frames(plain, Q[None])[0]
    at = np.stack([(T[i] @ np.append(plain.com[i], 1.0))[:2] for i in range(plain.n)])
    radius = (0.75 * plain.mass / (np.pi * 3000.0)) ** (1.0 / 3.0)
    wanted = np.sum(plain.mass * np.sum(at**2, axis=1)) + np.sum(0.4 * plain.mass * radius**2)
    assert matrices(plain, Q)[0][0, 0] == pytest.approx(wanted, rel=1e-9)


def test_comes_to_rest_where_statics_say(plain: ElasticChain) -> None:
    settled = answer(plain, 6.0, LOAD)[-1]
    assert settled == pytest.approx(compliance.cartesian_compliance(plain, Q[None])[0] @ LOAD, rel=2e-3, abs=1e-7)


def test_stays_at_rest_under_its_own_weight(plain: ElasticChain) -> None:
    """Own weight bends the arm, but the sag of the programmed path is counted elsewhere: nothing moves."""
    assert np.abs(answer(plain, 0.5, np.zeros(6))).max() < 1e-9


def test_drives_hold_an_unbalanced_arm_where_it_is(plain: ElasticChain) -> None:
    """Their integrators carry the weight from the start: a drive that yields does not know it from no load."""
    assert np.abs(play.axis_torque(plain, Q[None])).max() > 500.0
    motion = motion_along(replace(plain, servo=(SERVO,) * 6), BASE, np.tile(Q, (2, 1)), np.tile(Q, (2, 1)), ENDS)
    rest(motion, 0)
    out = np.zeros(6)
    for k in range(PER_S):
        advance(motion, 1, (k + 1) / PER_S, np.zeros(6), out)
        assert np.abs(motion.drives[0]).max() < 1e-12
    assert np.abs(out).max() < 1e-9


def test_the_process_load_reaches_the_motors(plain: ElasticChain) -> None:
    """Without an integrator a drive yields by ``J^T w / (speed gain x position gain)`` of its axis, in its sense."""
    servo = replace(SERVO, integral_time_s=1e9)
    motion = motion_along(replace(plain, servo=(servo,) * 6), BASE, np.tile(Q, (2, 1)), np.tile(Q, (2, 1)), ENDS)
    rest(motion, 0)
    out = np.zeros(6)
    for k in range(4 * PER_S):
        advance(motion, 1, (k + 1) / PER_S, LOAD, out)
    given = jacobian(plain, Q[None])[0].T @ LOAD / (servo.speed_gain_nm_s * servo.position_gain_per_s)
    assert np.abs(given).max() > 1e-4
    np.testing.assert_allclose(motion.drives[0], given, atol=0.01 * np.abs(given).max())


@pytest.mark.parametrize("share", [0.25, 0.5, 0.8])
def test_weight_that_changes_along_a_row_is_no_deviation_within_it(share: float, plain: ElasticChain) -> None:
    """Sag of the programmed path is counted elsewhere, between two rows as at them."""
    time = np.array([0.0, 8.0])
    motion = motion_along(plain, BASE, np.tile(Q, (2, 1)), np.tile(Q, (2, 1)), time)
    other = motion.weight.copy()
    other[1] += np.array([0.0, 900.0, -600.0, 50.0, -40.0, 10.0])
    motion = motion._replace(weight=other)
    rest(motion, 0)
    out = np.zeros(6)
    for k in range(round(8.0 * share * PER_S)):
        advance(motion, 1, (k + 1) / PER_S, np.zeros(6), out)
    _, stiffness, J, _ = matrices(plain, Q)
    sag = J[:, :6] @ ((other[1] - other[0]) / stiffness[:6])
    assert np.linalg.norm(sag[:3]) > 100 * UM
    assert np.linalg.norm(out[:3]) < 0.02 * np.linalg.norm(sag[:3])


def test_swings_with_the_lowest_mode(plain: ElasticChain) -> None:
    mode = lowest_mode(*matrices(plain, Q)[:2], 1.5e-3, (None,) * 6)
    y = answer(plain, 3.0, LOAD)[:, 1]
    swing = y - y[-1]
    crossings = np.flatnonzero((swing[:-1] < 0.0) & (swing[1:] >= 0.0))
    late = crossings[crossings > 0.5 * PER_S]
    found = 2.0 * np.pi * PER_S / np.mean(np.diff(late))
    assert found == pytest.approx(mode.omega_rad_s * np.sqrt(1.0 - mode.damping_ratio**2), rel=0.02)


def test_drives_give_way_and_come_back(plain: ElasticChain) -> None:
    """Yielding drives let the load push further at first; their integrators leave nothing of it."""
    yielding = replace(plain, servo=(SERVO,) * 6)
    stiff, soft = answer(plain, 6.0, LOAD), answer(yielding, 6.0, LOAD)
    window = slice(round(0.15 * PER_S), round(0.4 * PER_S))
    assert soft[window, 1].max() > 1.1 * stiff[-1, 1]
    assert soft[-1] == pytest.approx(stiff[-1], rel=1e-2, abs=1.0 * UM)


def test_friction_takes_energy(plain: ElasticChain) -> None:
    rough = replace(plain, play=(Play(0.0, (300.0,), (10e-6,)),) * 3 + (Play(0.0, (40.0,), (10e-6,)),) * 3)
    last = slice(round(0.6 * PER_S), round(0.9 * PER_S))
    free, held = (np.ptp(answer(chain, 1.0, 0.2 * LOAD)[last, 1]) for chain in (plain, rough))
    assert held < 0.8 * free


def test_no_masses_no_modes(plain: ElasticChain) -> None:
    M, stiffness, *_ = matrices(replace(plain, mass=np.zeros(plain.n)), Q)
    with pytest.raises(ModelError, match="no masses"):
        lowest_mode(M, stiffness, 1.5e-3, (None,) * 6)


def test_postures_are_near_their_rows() -> None:
    q = np.linspace(0.0, 10.0, 500)[:, None] * np.ones(6) * DEG
    number, rows = postures(q, 0.5 * DEG)
    assert np.abs(q - q[rows][number]).max() <= 0.5 * DEG + 1e-12
    assert len(rows) == pytest.approx(20, abs=2)


def plain_postures(q: Float, apart_rad: float) -> tuple[list[int], list[int]]:
    """The definition, as slow as it reads: whoever is further from the one that stands becomes the next to stand."""
    stands: list[int] = []
    number = []
    for i, row in enumerate(q):
        if not stands or np.max(np.abs(row - q[stands[-1]])) > apart_rad:
            stands.append(i)
        number.append(len(stands) - 1)
    return number, stands


@pytest.mark.parametrize("seed", range(4))
def test_postures_are_those_of_the_definition(seed: int) -> None:
    """Also where a path comes back, stands still, or changes by exactly the limit."""
    rng = np.random.default_rng(seed)
    q = np.asarray(
        np.cumsum(rng.integers(-3, 4, (400, 6)) * (rng.random((400, 1)) < 0.7), axis=0) * 0.25, dtype=np.float64
    )
    number, rows = postures(q, 2.0)
    assert (number.tolist(), rows.tolist()) == plain_postures(q, 2.0)


def test_postures_of_no_rows_and_of_one() -> None:
    assert [part.tolist() for part in postures(np.zeros((0, 6)), 0.1)] == [[], []]
    assert [part.tolist() for part in postures(np.zeros((1, 6)), 0.1)] == [[0], [0]]


def test_many_postures_at_once_are_those_one_by_one(plain: ElasticChain) -> None:
    q = Q + np.random.default_rng(3).uniform(-0.4, 0.4, (7, 6))
    J, J_drive = jacobians(plain, q)
    for row, M in enumerate(inertia(plain, q)):
        one = matrices(plain, q[row])
        for found, wanted in ((M, one[0]), (J[row], one[2]), (J_drive[row], one[3])):
            np.testing.assert_array_equal(found, wanted)


def test_postures_are_worked_out_together(plain: ElasticChain, monkeypatch: pytest.MonkeyPatch) -> None:
    """A path of many postures asks for frames a thousand postures at a time: not one by one, not all in one array."""
    asked: list[int] = []

    def counted(chain: ElasticChain, q: Float) -> Float:
        asked.append(len(q))
        return frames(chain, q)

    monkeypatch.setattr(elastic_motion, "frames", counted)
    count = 5000
    q = Q + np.linspace(0.0, 0.2 * count * DEG, count)[:, None] * np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    motion = motion_along(plain, BASE, q, q, np.linspace(0.0, 5.0, count))
    assert len(motion.J_tcp_part) == count
    assert len(asked) < count / 500
    assert max(asked) <= 1024


def test_another_command_on_the_same_path_is_a_motion_of_its_own(plain: ElasticChain) -> None:
    """What the trials of a path share must not carry anything from one trial to the next."""
    time = np.linspace(0.0, 0.2, 5)
    q, added = np.tile(Q, (5, 1)), np.outer(np.linspace(0.0, 1e-3, 5), np.ones(6))
    shared = motion_along(plain, BASE, q, q, time)
    found = []
    for motion in (
        commanded(shared, q + 2.0 * added),
        commanded(shared, q + added),
        motion_along(plain, BASE, q, q + added, time),
    ):
        rest(motion, 0)
        out = np.zeros((4, 6))
        for row in range(4):
            advance(motion, row + 1, time[row + 1], LOAD, out[row])
        found.append(out)
    np.testing.assert_array_equal(found[1], found[2])
    assert np.abs(found[0] - found[1]).max() > 1.0 * UM
    assert not np.any(shared.clock)


def turned(chain: ElasticChain, rate: Float, acceleration_m_s2: float) -> Float:
    """Deviation (n, 3) m of the tool, from where the programmed angles begin to move at ``rate`` rad/s; 0.2 s."""
    time = np.array([0.0, 0.1, 0.2, 0.5])
    q = Q + np.outer(np.maximum(time - 0.2, 0.0), rate)
    fed = np.array([False, True, True, True])
    motion = motion_along(chain, BASE, q, q, time, shaken=fed, acceleration_m_s2=acceleration_m_s2)
    rest(motion, 0)
    out, one = np.zeros((round(0.4 * PER_S), 6)), np.zeros(6)
    for k in range(len(out)):
        at = (k + 1) / PER_S
        advance(motion, int(np.searchsorted(time, at)), at, np.zeros(6), one)
        out[k] = one
    return out[round(0.2 * PER_S) :, :3]


def test_a_change_of_the_programmed_speed_swings_the_arm_as_its_equation_of_motion_says(plain: ElasticChain) -> None:
    """``M x'' + D x' + K x = -M q''``: a step of q' is a step of -x', and what follows is the matrix exponential."""
    rate = np.array([0.01, -0.008, 0.012, 0.0, 0.02, 0.0])
    M, stiffness, J, _ = matrices(plain, Q)
    n = len(stiffness)
    inverse = np.linalg.inv(M)
    damping = np.append(elastic_motion.DAMPING_S * stiffness[:6], elastic_motion.DAMPING_S * stiffness[6:])
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse * stiffness, -inverse * damping]])
    state = np.concatenate([np.zeros(n), -rate, np.zeros(n - 6)])
    at = 0.05 * np.arange(1, 5)
    wanted = np.array([J[:3] @ (expm(A * t) @ state)[:n] for t in at])
    found = turned(plain, rate, np.inf)[np.rint(at * PER_S).astype(int) - 1]
    assert np.abs(wanted).max() > 50.0 * UM
    np.testing.assert_allclose(found, wanted, atol=0.03 * np.abs(wanted).max())


def test_a_gentle_change_of_the_programmed_speed_bends_the_arm_by_its_inertia(plain: ElasticChain) -> None:
    """Over many periods the mean deviation is that of the load -M q'' at rest; rapids shake nothing."""
    rate = np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.0])
    M, stiffness, J, _ = matrices(plain, Q)
    speed = float(np.linalg.norm(J[:3, :6] @ rate))
    load = -M[:, 0] * rate[0] / 0.4  # all of the 0.2 s lie in the change that takes 0.4 s
    found = turned(plain, rate, speed / 0.4)
    assert np.mean(found, axis=0) == pytest.approx(J[:3] @ (load / stiffness), rel=0.15, abs=5.0 * UM)


def test_what_is_shaken_is_what_is_fed_behind_a_fed_row(path_of: Callable[..., ToolPath]) -> None:
    path = path_of("G0 X0 Y0 Z50\nG1 X5 F1500\nG0 Z60\nG0 X0\nG1 X2\nY2")
    found = shaken_rows(path)
    first = np.flatnonzero((path.kind == FEED) & (np.roll(path.kind, 1) == RAPID))
    assert len(first) == 2
    assert not found[first].any()
    assert not found[path.kind == RAPID].any()
    assert np.count_nonzero(found) == np.count_nonzero(path.kind == FEED) - 2

"""Choices of a strategy: limits that bind are named, doubt widens, resonances, torques and chatter are the theory's."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from counterflex.app.inputs import setting_of
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import GPA, MM, RPM, UM
from counterflex.cutting.coefficients import KienzleLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stability.modes import modes_along
from counterflex.files.cell.cell import Cell
from counterflex.plan.elastic_motion import matrices
from counterflex.plan.inputs import part_compliance
from counterflex.plan.process_limits import ProcessLimits, axis_torques, tool_stiffness
from counterflex.plan.relative_motion import tool_carried
from counterflex.plan.stability.criterion import LARGEST
from counterflex.plan.stability.robot_modes import robot_modes
from counterflex.plan.strategy.advise import Choices, CutPlace, Demands, Doubt, grid, outcomes
from counterflex.plan.strategy.chatter import Swing, WallPosture, depth_used, swing_of, worst
from counterflex.plan.strategy.side_cut import SideCuts
from counterflex.robot.elasticity.chain import forward
from counterflex.signals.preview import Mode

MILL = Cutter(diameter_m=16 * MM, flutes=3, helix_rad=0.5, flute_length_m=35 * MM)
Q = np.radians([0.0, -95.0, 125.0, 0.0, -30.0, 0.0])
MODE = Mode(2.0 * math.pi * 8.0, 0.1)


def single(mode: Mode) -> Swing:
    """One mode that carries the whole displacement, in any direction."""
    return Swing(np.array([mode.omega_rad_s]), np.array([mode.damping_ratio]), np.ones(1))


ANY = ProcessLimits()
SOME = Doubt(0.3, 0.3, 0.3, 0.3)


@pytest.fixture(scope="module")
def place(cell_of: Callable[..., Cell]) -> CutPlace:
    setting = setting_of(cell_of())
    relative = tool_carried(setting.T_base_part)
    C = part_compliance(setting, relative, Q[None])[0]
    normal = np.array([0.0, 1.0, 0.0])
    standing = WallPosture(robot_modes(setting.chain, Q, relative.to_part[0], None, setting.damping.ratio), normal)
    return CutPlace(setting.chain, Q, C, relative.to_part[0], normal, 6 * MM, (standing,), (single(MODE),))


def cuts(ups: tuple[bool, ...], ae_mm: Float, ap_mm: tuple[float, ...] = (6.0,), fz_mm: float = 0.05) -> SideCuts:
    rows = np.array(list(product(ups, ae_mm, ap_mm)))
    return SideCuts(MILL, rows[:, 0] > 0.5, rows[:, 1] * MM, rows[:, 2] * MM, np.full(len(rows), fz_mm * MM))


def tried(
    law: KienzleLaw, place: CutPlace, limits: ProcessLimits = ANY, doubt: Doubt = SOME, **demands: float
) -> Choices:
    some, speed = grid([cuts((True, False), np.linspace(0.5, 8.0, 12), (3.0, 6.0))], np.array([8000.0, 13000.0]) * RPM)
    return outcomes(some, speed, law, place, limits, doubt, Demands())


def test_up_milling_near_the_width_without_force_comes_first(law: KienzleLaw, place: CutPlace) -> None:
    choices = tried(law, place)
    best = choices.best(3)
    assert all(choices.cuts.up[best])
    same = np.flatnonzero(
        ~choices.cuts.up
        & (choices.cuts.ae_m == choices.cuts.ae_m[best[0]])
        & (choices.cuts.ap_m == choices.cuts.ap_m[best[0]])
    )
    assert choices.high_m[best[0]] < 0.7 * choices.high_m[same].min()


def test_what_nine_of_ten_stay_below_counts_what_is_not_known(law: KienzleLaw, place: CutPlace) -> None:
    sure, doubtful = tried(law, place, doubt=Doubt()), tried(law, place)
    assert sure.high_m == pytest.approx(np.abs(sure.error_m))
    assert sure.error_m == pytest.approx(doubtful.error_m)
    assert np.all(doubtful.high_m > sure.high_m)
    zero = int(np.argmin(np.abs(sure.error_m)))
    assert doubtful.high_m[zero] > 3.0 * abs(sure.error_m[zero])


@pytest.mark.parametrize(
    ("name", "limits"),
    [
        ("spindle power", lambda c: ProcessLimits(power_w=0.3 * c.power_w[c.best(1)[0]])),
        ("spindle torque", lambda c: ProcessLimits(torque_nm=0.7 * c.torque_nm[c.best(1)[0]])),
        ("force", lambda c: ProcessLimits(force_n=0.5 * c.force_n[c.best(1)[0]])),
        ("highest spindle speed", lambda _: ProcessLimits(spindle_max_rad_s=9000.0 * RPM)),
    ],
)
def test_a_limit_that_keeps_a_better_choice_out_is_named(
    name: str, limits: Callable[[Choices], ProcessLimits], law: KienzleLaw, place: CutPlace
) -> None:
    free = tried(law, place, doubt=Doubt())
    bound = tried(law, place, limits(free), Doubt())
    assert name in bound.use
    assert name not in free.use
    assert np.all(bound.use[name][bound.best(5)] <= 1.0 + 1e-9)
    better = bound.allowed(name) & (bound.high_m < 0.98 * bound.high_m[bound.best(1)[0]])
    assert (name in bound.binding()) == bool(better.any())
    if name != "highest spindle speed":
        assert name in bound.binding()
        assert bound.high_m[bound.best(1)[0]] > free.high_m[free.best(1)[0]]


def test_the_torque_of_the_spindle_is_that_at_the_speed_of_the_choice(law: KienzleLaw, place: CutPlace) -> None:
    free = tried(law, place, doubt=Doubt())
    falls = ProcessLimits(torque_by_speed=((8000.0 * RPM, 2.0), (13000.0 * RPM, 1.0)))
    used = tried(law, place, falls, Doubt()).use["spindle torque"]
    assert used == pytest.approx(free.torque_nm / np.where(free.spindle_rad_s > 10000.0 * RPM, 1.0, 2.0))


def test_a_program_that_is_beyond_a_wide_limit_is_the_measure(law: KienzleLaw, place: CutPlace) -> None:
    thick = replace(law, h_max_m=2 * UM)
    assert not tried(thick, place).best(1)
    one = cuts((False,), np.array([4.0]))
    present = outcomes(one, np.array([13000.0]) * RPM, thick, place, ProcessLimits(), SOME, Demands())
    some, speed = grid([cuts((True,), np.linspace(0.5, 8.0, 12))], np.array([13000.0]) * RPM)
    held = outcomes(some, speed, thick, place, ProcessLimits(), SOME, Demands(present=present))
    best = held.best(1)[0]
    assert held.cuts.mean_chip_m[best] <= present.cuts.mean_chip_m[0]


def test_time_is_that_of_all_levels(law: KienzleLaw, place: CutPlace) -> None:
    choices = tried(law, place)
    speed = 0.05 * MM * 3 * 13000.0 / 60.0
    two = (choices.cuts.ap_m == 3 * MM) & (choices.spindle_rad_s == 13000.0 * RPM)
    assert choices.time_s_per_m[two] == pytest.approx(2.0 / speed)
    assert set(choices.levels[two].tolist()) == {2}


def test_nothing_to_choose_from_is_said() -> None:
    with pytest.raises(InputError, match="nothing to choose from"):
        grid([], np.ones(1))


def test_a_tool_bends_as_a_cantilever() -> None:
    d, length = 0.8 * 6 * MM, 20 * MM
    expected = 3.0 * 600 * GPA * (math.pi * d**4 / 64.0) / length**3
    assert tool_stiffness(6 * MM, 20 * MM) == pytest.approx(expected)
    limits = ProcessLimits(overhang_m=length)
    assert limits.bending(6 * MM, np.array([100.0]))[0] == pytest.approx(100.0 / expected)


def test_torques_on_the_axes_do_the_work_of_the_force(place: CutPlace) -> None:
    force, step = np.array([120.0, -50.0, 80.0]), 1e-6
    torques = axis_torques(place.chain, Q[None], np.concatenate([force, np.zeros(3)])[None])[0]
    for axis in range(6):
        there, back = (forward(place.chain, Q + sign * step * np.eye(6)[axis])[:3, 3] for sign in (1.0, -1.0))
        assert torques[axis] == pytest.approx(force @ (there - back) / (2.0 * step), rel=1e-5, abs=1e-4)


def test_a_mode_magnifies_as_an_oscillator() -> None:
    w = MODE.omega_rad_s
    assert single(MODE).magnification(np.array([0.0, w, 100.0 * w])) == pytest.approx([1.0, 5.0, 1e-4], rel=1e-3)


def test_modes_together_move_the_tip_as_the_elastic_equations_do(place: CutPlace, cell_of: Callable[..., Cell]) -> None:
    """Off resonance, hardly damped: ``n' J (K - w^2 M)^-1 J' n`` of the chain over ``n' C n``, all modes taken."""
    chain, R = place.chain, place.to_part[:3, :3].T
    to_part = np.asarray(np.kron(np.eye(2), R.T), dtype=np.float64)
    swing = swing_of(chain, Q, to_part, place.compliance_part, place.normal_part, 1e-6, None)
    M, stiffness, J, _ = matrices(chain, Q)
    springs = np.isfinite(stiffness)
    force = J[:3].T @ (R @ place.normal_part)
    at_rest = force[springs] @ (force[springs] / stiffness[springs])
    for hz in (3.0, 12.5, 45.0):
        w = 2.0 * math.pi * hz
        A = np.diag(stiffness[springs]) - w**2 * M[np.ix_(springs, springs)]
        exact = abs(force[springs] @ np.linalg.solve(A, force[springs])) / at_rest
        assert swing.magnification(np.array([w]))[0] == pytest.approx(exact, rel=0.03)


def test_a_mode_that_hardly_moves_the_tool_hardly_counts() -> None:
    w = np.array([10.0, 60.0])
    swing = Swing(w, np.array([0.05, 0.05]), np.array([0.98, 0.001]))
    assert swing.magnification(w[:1])[0] > 9.0
    assert swing.magnification(w[1:])[0] < 0.1
    assert worst((single(MODE), swing), w[:1])[0] == pytest.approx(
        max(swing.magnification(w[:1])[0], single(MODE).magnification(w[:1])[0])
    )


def test_a_slot_damps_and_the_limiting_depth_is_the_published_one() -> None:
    """Aluminium, D16 z3 at 13 000 rpm, half immersion, k = 390 N/mm, 10 Hz, 3 %: 3.2 mm (low-frequency criterion)."""
    plain = KienzleLaw(600e6, 0.0, 180e6, 0.0, 1e6, 0.0, 1e-5, 1e-6, 1e-3, "test", "test")
    normal, speed = np.array([0.0, 1.0, 0.0]), np.array([13000.0]) * RPM
    robot = modes_along(np.array([10.0]), np.array([0.03]), np.array([390e3]), normal[None])
    standing = (WallPosture(robot, normal),)
    slot = depth_used(cuts((True,), np.array([16.0])), plain, speed, standing)
    assert slot[0, 0] <= 1.0 / LARGEST
    half = depth_used(cuts((True,), np.array([8.0])), plain, speed, standing)
    k, a = 390e3, 3 / (2.0 * math.pi) * (600e6 / 2.0 - 180e6 * math.pi / 4.0)
    expected = 2.0 * 0.03 * k / (2.0 * math.pi * 10.0 * 60.0 / 39000.0 * a)
    assert 6 * MM / half[0, 0] == pytest.approx(expected, rel=5e-3)


def test_choices_of_the_same_error_are_ranked_by_force(law: KienzleLaw, place: CutPlace) -> None:
    """Two choices of which draws tell no difference: the lighter one comes first, a clearly better one before both."""
    choices = tried(law, place)
    one, other, third = (int(row) for row in np.flatnonzero(choices.cuts.up)[:3])
    high, force = np.full(len(choices.cuts), 900.0 * UM), choices.force_n.copy()
    high[[one, other, third]], force[[one, other, third]] = (100.0 * UM, 103.0 * UM, 120.0 * UM), (200.0, 150.0, 10.0)
    alike = replace(choices, high_m=high, force_n=force)
    keys = [(row, choices.cuts.ae_m[row], choices.cuts.up[row]) for row in (one, other)]
    assert alike.best(1) == [other], keys
    high[other] = 106.0 * UM
    assert replace(alike, high_m=high).best(1) == [one]

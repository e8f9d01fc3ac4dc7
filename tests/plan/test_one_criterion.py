"""Strategy, stability, placement and trial say the same of one cut: random robots, arcs, speeds and depths."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from counterflex.app.inputs import setting_of
from counterflex.core.arrays import Float
from counterflex.core.progress import silent
from counterflex.core.units import MM
from counterflex.cutting.coefficients import KienzleLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stability import semi_discretisation
from counterflex.cutting.stability.modes import TipModes
from counterflex.cutting.stability.process import process_of_side_cut
from counterflex.files.cell.cell import Cell
from counterflex.path.toolpath import ToolPath
from counterflex.plan.compensate import _cuts, chattering, limit_of_row
from counterflex.plan.inputs import CompensationInputs, solve_joints
from counterflex.plan.lowest_mode import ASSUMED, ASSUMED_DAMPING, DAMPING_INTERVAL, Damping
from counterflex.plan.placement import chatter as placement_chatter
from counterflex.plan.placement.chatter import Feeding, feeding
from counterflex.plan.stability.along import Structure, margins
from counterflex.plan.stability.criterion import LARGEST, SharedLimits, least_damping, robot_limit
from counterflex.plan.static_correction import loaded_robot
from counterflex.plan.strategy.chatter import WallPosture, depth_used
from counterflex.plan.strategy.side_cut import SideCuts, feed_axes
from counterflex.plan.undisturbed_cut import undisturbed_cut

MILL = Cutter(0.016, flutes=3, flute_length_m=0.035)
NORMAL = np.array([0.0, 1.0, 0.0])


def _robot(rng: np.random.Generator) -> TipModes:
    n = int(rng.integers(2, 9))
    omega = 2.0 * np.pi * np.sort(rng.uniform(6.0, 140.0, n))
    return TipModes(omega, np.full(n, ASSUMED_DAMPING), 0.12 * rng.normal(size=(3, n)))


def _cases(count: int) -> list[tuple[TipModes, SideCuts, Float]]:
    rng = np.random.default_rng(41)
    out = []
    for _ in range(count):
        one = np.ones(1)
        cuts = SideCuts(
            MILL, np.array([bool(rng.integers(2))]), one * rng.uniform(0.2, 15.5) * MM,
            one * rng.uniform(0.5, 12.0) * MM, one * rng.uniform(0.02, 0.12) * MM,
        )  # fmt: skip
        out.append((_robot(rng), cuts, one * rng.uniform(3000.0, 18000.0) / 60.0 * 2.0 * np.pi))
    return out


def test_strategy_stability_and_placement_agree_on_random_processes(law: KienzleLaw) -> None:
    sides = [0, 0]
    for robot, cuts, speed in _cases(120):
        process = process_of_side_cut(
            MILL, law, float(cuts.entry_rad[0]), float(cuts.exit_rad[0]), float(cuts.ap_m[0]), float(cuts.fz_m[0])
        )
        R = feed_axes(cuts.up, NORMAL)[0]
        A, T = R @ process.mean @ R.T, 2.0 * math.pi / (3.0 * float(speed[0]))
        margin = robot_limit(robot, A, T).factor
        used = float(depth_used(cuts, law, speed, (WallPosture(robot, NORMAL),))[0, 0])
        assert used == pytest.approx(1.0 / min(margin, 100.0), rel=0.02)  # matrices within half a percent are one
        if abs(margin - 1.0) > 0.02:
            left = least_damping(robot, A, T)
            assert (margin > 1.0) == (left > 0.0), (margin, left)
            sides[margin > 1.0] += 1
    assert min(sides) > 20


def test_semi_discretisation_agrees_where_the_engagement_is_wide(law: KienzleLaw) -> None:
    """A judge that shares neither the mean coefficients nor the frequency domain."""
    off = []
    for robot, cuts, speed in _cases(40):
        if cuts.ae_m[0] < 5 * MM:
            continue
        process = process_of_side_cut(
            MILL, law, float(cuts.entry_rad[0]), float(cuts.exit_rad[0]), float(cuts.ap_m[0]), float(cuts.fz_m[0])
        )
        T = 2.0 * math.pi / (3.0 * float(speed[0]))
        margin = robot_limit(robot, process.mean, T).factor
        if math.isfinite(margin) and margin < 6.0:
            other = semi_discretisation.limit(robot, process, T, most=1.6 * margin, least=0.6 * margin, tolerance=5e-3)
            off.append(abs(other / margin - 1.0))
    assert len(off) >= 8
    assert np.median(off) < 0.06
    assert (
        np.mean(np.array(off) < 0.15) > 0.6
    )  # deep cuts of three teeth double their period, which the mean does not show


@pytest.fixture(scope="module")
def walls(path_of: Callable[..., ToolPath]) -> ToolPath:
    """Up- and down-milled walls of 3 and of 9 mm depth, half immersion, and a slot."""
    return path_of(
        "G0 Z60\nG0 X-12 Y0\nG0 Z37\nG1 X72 F900\nG0 Z60\nG0 X72 Y60\nG0 Z31\nG1 X-12 F900\nG0 Z60\n"
        "G0 X-12 Y30\nG0 Z38\nG1 X72 F900\nG0 Z60"
    )


def test_placement_and_trial_say_of_a_program_what_stability_says(
    walls: ToolPath, cell_of: Callable[..., Cell], monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = cell_of(
        part={"stock": {"box_min_mm": [0, 0, 0], "box_max_mm": [60, 60, 40], "cell_mm": 0.5}},
        material={"law": "linear_edge", "ktc_n_mm2": 1800, "krc_n_mm2": 540, "kac_n_mm2": 200, "kte_n_mm": 10,
                  "kre_n_mm": 10, "kae_n_mm": 1, "chip_min_um": 1, "chip_max_um": 300},
    )  # fmt: skip
    setting = setting_of(cell)
    judged = margins(walls, cell.stock(), setting, Structure(setting.damping, None), cell.blank_box())
    line = walls.motion
    q = solve_joints(walls, line, setting).q
    inputs = CompensationInputs(walls, line, cell.stock(), setting, q)
    loaded = loaded_robot(inputs, undisturbed_cut(inputs, silent))
    compared = 0
    for at in judged[5::4]:
        row = at.stretch.row
        if not 0.01 < walls.p_part_tcp[row, 0] < 0.05 or abs(at.robot_margin - 1.0) < 0.15:
            continue
        trial = limit_of_row(loaded, row)
        assert (trial > 1.0) == (at.robot_margin > 1.0), (row, trial, at.robot_margin)
        monkeypatch.setattr(placement_chatter, "MARGIN", 1.0)
        monkeypatch.setattr(placement_chatter, "STIFFNESS_SIGMA", 0.0)
        A = at.R_part_feed @ at.process.mean @ at.R_part_feed.T
        fed = Feeding(np.array([row]), A[None], np.array([at.stretch.period_s]), None, setting.damping)
        left = fed.least_damping(setting.chain, q, setting.relative_motion(walls).to_part)
        assert (left > 0.0) == (at.robot_margin > 1.0), (row, left, at.robot_margin)
        compared += 1
    assert compared >= 6
    verdicts = {at.robot_margin > 1.0 for at in judged}
    assert verdicts == {True, False}
    # a trial that leaves all of the deflection: only the cuts that chatter by the criterion are left as they are
    everywhere = chattering(loaded, loaded.deflection_part, _cuts(loaded))
    worst = min(judged, key=lambda one: one.robot_margin)
    assert everywhere[worst.stretch.row]
    slot = [at for at in judged if abs(walls.p_part_tcp[at.stretch.row, 1] - 0.03) < 1e-6]
    assert not any(everywhere[at.stretch.row] for at in slot)
    assert not chattering(loaded, 0.05 * loaded.deflection_part, _cuts(loaded)).any()
    # a swing of a quarter of the deflection was not looked at, and its offset was commanded against
    np.testing.assert_array_equal(chattering(loaded, 0.24 * loaded.deflection_part, _cuts(loaded)), everywhere)
    some = feeding([at.stretch for at in judged], np.arange(len(walls)), setting, setting.law)
    assert some.damping == setting.damping


def test_one_damping_is_assumed_and_its_interval_is_stated(cell_of: Callable[..., Cell]) -> None:
    cell = cell_of()
    damping = setting_of(cell).damping
    assert (damping.ratio, damping.low, damping.high) == (ASSUMED_DAMPING, *DAMPING_INTERVAL)
    assert damping.origin == ASSUMED
    tapped = Damping.of(0.04)
    assert (tapped.low, tapped.ratio, tapped.high) == (0.04, 0.04, 0.04)
    assert Damping.of(0.04, stated_ratio=0.2).ratio == 0.2


def test_a_cut_that_regenerates_nothing_has_no_limit() -> None:
    """It divided by the size of the directional matrix, which is 0 where nothing is engaged."""
    assert SharedLimits()(0, _robot(np.random.default_rng(1)), np.zeros((3, 3)), 5e-3).factor == LARGEST

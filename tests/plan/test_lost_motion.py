"""Play and friction in the plan: memory of the path, the touched frame, the corrected path, and the tool that lands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from counterflex.app.inputs import setting_of
from counterflex.core.arrays import Int
from counterflex.core.units import MM, UM, URAD
from counterflex.files.cell.cell import Cell
from counterflex.path.toolpath import ToolPath
from counterflex.plan.compensate import plan
from counterflex.plan.inputs import Setting, solve_joints
from counterflex.plan.relative_motion import RelativeMotion, tool_carried
from counterflex.plan.sag_and_play import corrected_joints, play_deviation, touched_points
from counterflex.robot.elasticity.chain import forward
from counterflex.robot.model.description import Play
from counterflex.signals.preview import Mode, Shaping

PathOf = Callable[..., ToolPath]
CellOf = Callable[..., Cell]
BACK_AND_FORTH = "G0 Z60\nG0 X10 Y10\nG0 Z42\nG1 X40 F1500\nG1 X10\nG1 X40\nG0 Z60"
SLIP = (10 * URAD, 25 * URAD, 60 * URAD)
BIG, SMALL = Play(20 * URAD, (75.0, 105.0, 120.0), SLIP), Play(50 * URAD, (12.5, 17.5, 20.0), SLIP)
TAPPED = Mode(2.0 * np.pi * 8.0, 0.1)
LOSSY = (BIG, BIG, BIG, SMALL, SMALL, SMALL)


def standing(setting: Setting) -> RelativeMotion:
    return tool_carried(setting.T_base_part)


@pytest.fixture(scope="module")
def setting(cell_of: CellOf) -> Setting:
    cell = cell_of()
    found = replace(setting_of(cell, chain=cell.chain), mode=TAPPED)
    return replace(found, chain=replace(found.chain, play=LOSSY))


def lines(path: ToolPath) -> Int:
    return np.arange(1, int(path.motion.max()) + 2)


def test_there_and_back_differ_by_the_reversal(path_of: PathOf, setting: Setting) -> None:
    """The same points in air, once forward and once backward: friction has turned round, nothing else has."""
    path = path_of(BACK_AND_FORTH, step_mm=0.5)
    q = solve_joints(path, lines(path), setting).q
    w = np.zeros((len(path), 6))
    deviation = play_deviation(
        setting.chain,
        standing(setting),
        path.p_part_tcp,
        q,
        w,
        path.time_s,
        touched_points(setting),
        TAPPED,
    )
    x = path.p_part_tcp[:, 0]
    runs = [np.flatnonzero((path.motion == m) & (np.abs(x - 25 * MM) < 3 * MM)) for m in np.unique(path.motion)[-4:-1]]
    forth, back, again = (deviation[rows].mean(axis=0) for rows in runs)
    assert forth == pytest.approx(again, abs=0.5 * UM)  # a closed loop
    assert 30 * UM < float(np.linalg.norm(forth - back)) < 400 * UM
    assert (back - forth)[0] > 20 * UM  # friction holds the tool back: it lags behind each direction


def test_no_play_is_exactly_nothing(path_of: PathOf, setting: Setting) -> None:
    path = path_of(BACK_AND_FORTH)
    q = solve_joints(path, lines(path), setting).q
    w, touched = np.zeros((len(path), 6)), touched_points(setting)
    chain = replace(setting.chain, play=None)
    assert np.all(play_deviation(chain, standing(setting), path.p_part_tcp, q, w, path.time_s, touched, TAPPED) == 0.0)
    none = replace(setting.chain, play=(Play(),) * 6)
    assert play_deviation(
        none, standing(setting), path.p_part_tcp, q, w, path.time_s, touched, TAPPED
    ) == pytest.approx(0.0, abs=1e-9)


def test_play_of_the_touched_points_is_in_the_frame(path_of: PathOf, setting: Setting) -> None:
    """A dead band that weight keeps to one side shifts all points alike: seen from outside, not after touching."""
    path = path_of(BACK_AND_FORTH)
    chain = replace(setting.chain, play=(None, Play(50 * URAD), Play(50 * URAD), None, None, None))
    q, w = solve_joints(path, lines(path), setting).q, np.zeros((len(path), 6))
    outside = play_deviation(chain, standing(setting), path.p_part_tcp, q, w, path.time_s, None, TAPPED)
    touched = play_deviation(
        chain, standing(setting), path.p_part_tcp, q, w, path.time_s, touched_points(setting), TAPPED
    )
    assert np.linalg.norm(outside, axis=1).min() > 50 * UM
    assert np.linalg.norm(touched, axis=1).max() < 0.03 * np.linalg.norm(outside, axis=1).min()


def test_corrected_joints_reach_the_corrected_point(path_of: PathOf, setting: Setting) -> None:
    path = path_of(BACK_AND_FORTH)
    q = solve_joints(path, lines(path), setting).q
    u = np.tile([0.8 * MM, -1.2 * MM, 0.4 * MM], (len(path), 1))
    u[:5] = 0.0
    got = corrected_joints(setting.controller_chain, standing(setting), q, u, np.zeros_like(u))
    assert np.array_equal(got[:5], q[:5])
    T = forward(setting.controller_chain, q), forward(setting.controller_chain, got)
    moved = (T[1][:, :3, 3] - T[0][:, :3, 3]) @ setting.T_base_part[:3, :3]
    assert moved == pytest.approx(u, abs=3 * UM)
    assert T[1][:, :3, :3] == pytest.approx(T[0][:, :3, :3], abs=1e-5)


def test_the_plan_takes_lost_motion_back(path_of: PathOf, cell_of: CellOf, setting: Setting) -> None:
    """Without shaping in time the correction is that of the plan without play, less what the corrected path loses."""
    cell = cell_of()
    setting = replace(setting, shaping=Shaping(smoothing_s=0.0, lead_s=0.0))
    path = path_of("G0 Z60\nG0 X-12 Y15\nG0 Z36\nG1 X52 F1500\nG0 Z60", step_mm=0.5)
    with_play = plan(path, lines(path), cell.stock(), setting)
    bare = replace(setting, chain=replace(setting.chain, play=None))
    without = plan(path, lines(path), cell.stock(), bare)
    assert np.all(without.play_part == 0.0)
    x = path.p_part_tcp[:, 0]
    steady = with_play.cutting & (x > 12 * MM) & (x < 28 * MM)
    extra = with_play.correction_part[steady] - without.correction_part[steady]
    lost = with_play.play_part[steady]
    assert np.linalg.norm(lost, axis=1).min() > 20 * UM
    assert extra == pytest.approx(-lost, abs=2 * UM)
    # asked again of the path that was decided on: a fixed point
    q = corrected_joints(
        setting.controller_chain,
        standing(setting),
        with_play.q,
        with_play.correction_part,
        with_play.rotvec_part,
    )
    again = play_deviation(
        setting.chain,
        standing(setting),
        path.p_part_tcp,
        q,
        with_play.w_tcp_part,
        path.time_s,
        touched_points(setting),
        TAPPED,
    )
    assert again == pytest.approx(with_play.play_part, abs=0.1 * UM)
    # the prediction knows what is lost: before compensation it is in the deviation
    gap = with_play.deviation_nominal_part[steady] - without.deviation_nominal_part[steady]
    assert float(np.median(np.linalg.norm(gap, axis=1))) > 20 * UM

"""Correction that undoes play online: passed through the robot's delay and lag, it must leave less than play does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from counterflex.app.inputs import setting_of
from counterflex.core.arrays import Float, Int
from counterflex.core.units import MM, MS, UM, URAD
from counterflex.files.cell.cell import Cell
from counterflex.path.toolpath import ToolPath
from counterflex.plan.inputs import Setting, solve_joints
from counterflex.plan.play_compensation import play_compensation
from counterflex.plan.relative_motion import RelativeMotion, tool_carried
from counterflex.plan.sag_and_play import corrected_joints, play_deviation, swing, touched_points
from counterflex.robot.model.description import Play
from counterflex.signals.preview import Mode

PathOf = Callable[..., ToolPath]
CellOf = Callable[..., Cell]
SLIP = (10 * URAD, 25 * URAD, 60 * URAD)
BIG, SMALL = Play(20 * URAD, (75.0, 105.0, 120.0), SLIP), Play(50 * URAD, (12.5, 17.5, 20.0), SLIP)
TURN = "G0 X10 Y10 Z42\nG2 X10 Y10 I12 J0 F300"
TAPPED = Mode(2.0 * np.pi * 8.0, 0.1)
LAG, DEAD_S = Mode(2.0 * np.pi * 8.2, 2.4), 10.0 * MS


def standing(setting: Setting) -> RelativeMotion:
    return tool_carried(setting.T_base_part)


@pytest.fixture(scope="module")
def setting(cell_of: CellOf) -> Setting:
    found = replace(setting_of(cell_of()), mode=TAPPED)
    return replace(found, chain=replace(found.chain, play=(BIG, BIG, BIG, SMALL, SMALL, SMALL), servo=None))


def circle(path_of: PathOf, setting: Setting) -> tuple[ToolPath, Float]:
    path = path_of(TURN, step_mm=0.1)
    lines: Int = np.arange(1, int(path.motion.max()) + 2)
    return path, solve_joints(path, lines, setting).q


def left(setting: Setting, path: ToolPath, q: Float, sent: Float) -> Float:
    """Deviation (n, 3) m of the tool: what the robot makes of what is sent, and the play of the axes so moved."""
    late = np.stack([np.interp(path.time_s - DEAD_S, path.time_s, column) for column in sent.T], axis=1)
    moved = swing(swing(late, path.time_s, LAG), path.time_s, TAPPED)
    axes = corrected_joints(setting.controller_chain, standing(setting), q, moved, np.zeros_like(moved))
    lost = play_deviation(
        setting.chain, standing(setting), path.p_part_tcp, axes, np.zeros((len(path), 6)), path.time_s,
        touched_points(setting), TAPPED,
    )  # fmt: skip
    on = path.time_s > path.time_s[-1] - 0.9 * (2.0 * np.pi * 12.0 * MM / (300.0 * MM / 60.0))
    found: Float = (moved + lost)[on]
    return found


def rms(x: Float) -> float:
    return float(np.sqrt(np.mean(np.sum(x * x, axis=1))))


def test_less_is_left_than_by_nothing_and_by_its_late_opposite(path_of: PathOf, setting: Setting) -> None:
    """Reversals on a circle: the plain opposite, read ahead by the whole delay, passes the play twice as slowly."""
    path, q = circle(path_of, setting)
    w = np.zeros((len(path), 6))
    plain = -play_deviation(
        setting.chain,
        standing(setting),
        path.p_part_tcp,
        q,
        w,
        path.time_s,
        touched_points(setting),
        TAPPED,
    )
    whole_s = DEAD_S + 2.0 * LAG.damping_ratio / LAG.omega_rad_s
    ahead = np.stack([np.interp(path.time_s + whole_s, path.time_s, column) for column in plain.T], axis=1)
    nothing = rms(left(setting, path, q, np.zeros_like(plain)))
    late = rms(left(setting, path, q, ahead))
    found = rms(left(setting, path, q, play_compensation(setting, path, q, w, LAG, DEAD_S)))
    assert nothing > 30.0 * UM
    assert found < 0.2 * nothing
    assert found < 0.8 * late


def test_a_cell_without_play_and_servo_sends_exactly_nothing(path_of: PathOf, setting: Setting) -> None:
    bare = replace(setting, chain=replace(setting.chain, play=None, servo=None))
    path, q = circle(path_of, bare)
    assert not np.any(play_compensation(bare, path, q, np.zeros((len(path), 6)), LAG, DEAD_S))


def test_a_dead_time_is_sent_ahead(path_of: PathOf, setting: Setting) -> None:
    """The same command, earlier by the dead time: sent late or not moved, it takes back far less."""
    path, q = circle(path_of, setting)
    w, dead_s = np.zeros((len(path), 6)), 60.0 * MS
    prompt = play_compensation(setting, path, q, w, LAG, 0.0)
    ahead = play_compensation(setting, path, q, w, LAG, dead_s)
    inside = (path.time_s > path.time_s[0] + 0.3) & (path.time_s < path.time_s[-1] - 0.3)

    def apart(lead_s: float) -> float:
        moved = np.stack([np.interp(path.time_s + lead_s, path.time_s, column) for column in prompt.T], axis=1)
        return rms((ahead - moved)[inside])

    assert apart(dead_s) < 0.05 * rms(prompt[inside])
    assert apart(dead_s) < 0.1 * min(apart(0.0), apart(-dead_s))

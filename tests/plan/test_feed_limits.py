"""Feeds within limits: each limit alone lowers the feed until it is kept, is named, and leaves the rest alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from counterflex.app.inputs import setting_of
from counterflex.core.progress import silent
from counterflex.cutting.coefficients import KienzleLaw
from counterflex.files.cell.cell import Cell
from counterflex.path.toolpath import ToolPath
from counterflex.plan.feed_limits import LimitedFeed, curvature, known, limit_feed, uses
from counterflex.plan.feed_schedule import LEAST, FeedGroups
from counterflex.plan.inputs import CompensationInputs, solve_joints
from counterflex.plan.process_limits import ProcessLimits
from counterflex.plan.undisturbed_cut import undisturbed_cut

GROOVE = "G0 Z60\nG0 X-12 Y15\nG0 Z36\nG1 X52 F1500\nG0 Z60"
ARC = "G0 Z60\nG0 X-12 Y15\nG0 Z45\nG1 X10 F6000\nG3 X10 Y25 I0 J5\nG1 X-12\nG0 Z60"
HIGH = ProcessLimits(
    power_w=1.0,
    torque_nm=1.0,
    force_n=1.0,
    axis_torque_nm=np.ones(6),
    bending_m=1e-6,
    overhang_m=0.04,
    deflection_m=1e-6,
    acceleration_m_s2=1.0,
)


@pytest.fixture(scope="module")
def groove(path_of: Callable[..., ToolPath], cell_of: Callable[..., Cell]) -> CompensationInputs:
    return made(path_of(GROOVE), cell_of())


def made(path: ToolPath, cell: Cell) -> CompensationInputs:
    line = path.motion + 4
    setting = setting_of(cell)
    return CompensationInputs(path, line, cell.stock(), setting, solve_joints(path, line, setting).q)


def groups(path: ToolPath) -> FeedGroups:
    return FeedGroups(np.arange(len(path)), np.zeros(len(path), dtype=np.bool_))


def limited(inputs: CompensationInputs, limits: ProcessLimits) -> LimitedFeed:
    return limit_feed(inputs, groups(inputs.path), lambda _: limits)


@pytest.mark.parametrize(
    ("name", "limits"),
    [
        ("force", lambda most: ProcessLimits(force_n=most)),
        ("spindle torque", lambda most: ProcessLimits(torque_nm=most)),
        ("spindle power", lambda most: ProcessLimits(power_w=most)),
        ("tool bending", lambda most: ProcessLimits(bending_m=most * 1e-6, overhang_m=0.04)),
        ("torque of axis 2", lambda most: ProcessLimits(axis_torque_nm=np.array([1e9, most, 1e9, 1e9, 1e9, 1e9]))),
        ("deflection", lambda most: ProcessLimits(deflection_m=most * 1e-6)),
    ],
)
def test_a_limit_alone_is_kept_and_named(
    name: str, limits: Callable[[float], ProcessLimits], groove: CompensationInputs
) -> None:
    most = float(uses(groove, undisturbed_cut(groove, silent), lambda _: HIGH)[name].max())
    result = limited(groove, limits(0.75 * most))
    (line,) = result.lines
    assert line.limit == name
    assert line.before == pytest.approx(1.0 / 0.75, rel=1e-6)
    assert 0.9 < line.after_share <= 1.001
    assert 0.6 < line.share < 0.8
    assert result.extra_s > 0.0
    assert np.all(result.share[result.path.p_part_tcp[:, 0] < -9e-3] == 1.0)  # through air at the programmed feed
    free = limited(groove, limits(1.01 * most))
    assert free.lines == ()
    assert np.all(free.share == 1.0)


def test_what_the_least_feed_does_not_reach_is_told(groove: CompensationInputs) -> None:
    result = limited(groove, ProcessLimits(force_n=20.0))
    assert result.share.min() == pytest.approx(LEAST)
    assert result.lines[0].after_share > 1.5


@pytest.mark.parametrize("allowed", [False, True])
def test_chips_stay_within_the_range_of_the_constants(allowed: bool, groove: CompensationInputs) -> None:
    """The least feed leaves it, and such a plan would be refused; unless the cell file allows that."""
    cut = undisturbed_cut(groove, silent)
    thinnest = 0.72 * float(np.median(cut.cut.chip_m[cut.contact]))
    setting = groove.setting
    assert isinstance(setting.law, KienzleLaw)
    law = replace(setting.law, h_min_m=thinnest)
    changed = replace(groove, setting=replace(setting, law=law, allow_extrapolation=allowed))
    result = limited(changed, ProcessLimits(force_n=20.0))
    kept = undisturbed_cut(replace(changed, path=result.path), silent).cut.chip_m[cut.contact]
    share = float(np.median(result.share[cut.contact]))
    assert share == pytest.approx(LEAST if allowed else 0.75)
    assert (float(np.median(kept)) >= thinnest) != allowed


def test_of_several_limits_the_hardest_binds(groove: CompensationInputs) -> None:
    full = uses(groove, undisturbed_cut(groove, silent), lambda _: HIGH)
    most = {name: float(values.max()) for name, values in full.items()}
    result = limited(groove, ProcessLimits(force_n=0.9 * most["force"], power_w=0.7 * most["spindle power"]))
    assert {line.limit for line in result.lines} == {"spindle power"}
    assert [bool(name) for name in result.binds] == (result.share < 1.0).tolist()
    assert set(result.binds) == {"", "spindle power"}
    assert np.all(result.path.feed_m_s <= result.programmed_m_s + 1e-12)


def test_an_arc_is_run_at_the_speed_that_the_acceleration_lets_it(
    path_of: Callable[..., ToolPath], cell_of: Callable[..., Cell]
) -> None:
    inputs = made(path_of(ARC), cell_of())
    arc = curvature(inputs.path)
    assert np.max(arc) == pytest.approx(200.0, rel=0.01)
    result = limited(inputs, ProcessLimits(acceleration_m_s2=1.0))
    on_arc = arc > 100.0
    speed = result.path.feed_m_s[on_arc]
    assert np.all(speed**2 * 200.0 <= 1.02)
    assert np.all(speed**2 * 200.0 >= 0.8)
    assert {line.limit for line in result.lines} == {"acceleration"}
    straight = (inputs.path.p_part_tcp[:, 0] < 5e-3) & (inputs.path.feed_m_s > 0.0)
    assert np.all(result.share[straight] == 1.0)


def test_without_limits_there_is_nothing_to_do() -> None:
    assert not known(ProcessLimits())
    assert not known(ProcessLimits(bending_m=1e-5))  # without the length of the tool
    assert known(ProcessLimits(force_n=1.0))

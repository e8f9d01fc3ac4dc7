"""The posture of a program: beside the single poses of the inverse kinematics, its margins, its errors, its gain."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.inputs import Job, read_job, setting_of
from counterflex.app.posture import loaded_path, robot_of, surroundings_of
from counterflex.core.errors import ModelError, ReachError
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.geometry import pose, rotation
from counterflex.path.toolpath import tool_orientation, tool_poses
from counterflex.plan.posture.choose import ChosenPosture, Freedom, choose
from counterflex.plan.posture.cut_path import LoadedPath, fractions, stations, surface_normals
from counterflex.plan.posture.held import PostureTask
from counterflex.plan.posture.survey import RobotHere, constant_costs, survey_path
from counterflex.plan.posture.survey_kernel import JOINT_LIMIT, OUT_OF_REACH, WRIST_SINGULAR
from counterflex.plan.posture.way import Weights
from counterflex.plan.preflight.joints import at_feed, joint_accelerations, joint_speeds
from counterflex.robot.elasticity.compliance import cartesian_compliance
from counterflex.robot.kinematics.inverse import inverse_all
from counterflex.robot.model.opw import BRANCHES

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
CELL, PROGRAM = EXAMPLES / "cells" / "kr300_d16_small.toml", EXAMPLES / "programs" / "groove.ngc"


@pytest.fixture(scope="module")
def cell() -> Cell:
    return read_cell(CELL)


@pytest.fixture(scope="module")
def job(cell: Cell) -> Job:
    return read_job(PROGRAM, cell)


@pytest.fixture(scope="module")
def task(cell: Cell, job: Job) -> PostureTask:
    setting, line = setting_of(cell), job.line_of_motion[job.machined.motion]
    cut = loaded_path(job.machined, line, cell.stock(), setting, "both")
    return PostureTask(job.machined, line, cut, setting, robot_of(cell, setting))


@pytest.fixture(scope="module")
def chosen(task: PostureTask) -> ChosenPosture:
    return choose(task, Freedom())


def _moved(task: PostureTask, x_mm: float = 0.0, z_mm: float = 0.0, **limits: Any) -> PostureTask:
    T = task.robot.T_base_part @ pose.make(p=np.array([x_mm * MM, 0.0, z_mm * MM]))
    bounds = replace(task.robot.limits, **limits)
    setting = replace(task.setting, T_base_part=T, limits=bounds)
    return replace(task, setting=setting, robot=replace(task.robot, T_base_part=T, limits=bounds))


def test_every_posture_is_that_of_the_inverse_kinematics(task: PostureTask) -> None:
    """Which branches of a pose are possible, and the deflection in each, pose by pose by the general solver."""
    rows = np.array([0, 150, 220])
    few = LoadedPath(*(np.ascontiguousarray(getattr(task.cut, name)[rows]) for name in LoadedPath.__dataclass_fields__))
    rotations = np.array([20.0, 95.0, 180.0, 285.0]) * DEG
    few.weight_m[:] = 1.0
    R_base_part = rotation.about_z(0.3) @ rotation.about_x(0.2)
    T_base_part = pose.make(R_base_part, task.robot.T_base_part[:3, 3])
    robot = replace(task.robot, T_base_part=T_base_part)
    survey = survey_path(few, robot, rotations, np.arange(3))
    margin, wrist = robot.limits.joint_margin_rad, np.sin(robot.limits.wrist_rad)
    for row, turn in itertools.product(range(3), range(4)):
        R = tool_orientation(few.axis_part[row : row + 1], float(rotations[turn]))
        T = tool_poses(T_base_part, few.p_part[row : row + 1], R)[0]
        solutions = inverse_all(task.robot.controller_chain, T, within_limits=False)
        good = {s.branch: s for s in solutions if s.limit_margin_rad >= margin and s.wrist >= wrist}
        possible = ~np.isnan(survey.q[row, turn, :, 0])
        assert {BRANCHES[slot] for slot in np.flatnonzero(possible)} == set(good)
        for slot in np.flatnonzero(possible):
            q = survey.q[row, turn, slot]
            off = q - good[BRANCHES[slot]].q
            np.testing.assert_allclose(off - 2 * np.pi * np.round(off / (2 * np.pi)), 0.0, atol=1e-9)
            if row == 0:
                continue
            w = np.concatenate([R_base_part @ few.w_tcp_part[row, :3], R_base_part @ few.w_tcp_part[row, 3:]])
            d = few.normals_part[row] @ R_base_part.T @ (cartesian_compliance(task.robot.chain, q) @ w)[:3]
            assert survey.late[row - 1, turn, slot] == pytest.approx(np.linalg.norm(d) ** 4, rel=1e-9)


def test_the_chosen_posture_is_the_stiffest_that_is_possible(task: PostureTask) -> None:
    plain = choose(task, Freedom(weights=Weights(0.0, 0.0, 0.0)))
    index, slot = np.unravel_index(int(np.argmin(plain.costs_m)), plain.costs_m.shape)
    assert plain.costs_m[plain.way.index[0], plain.way.slot] == pytest.approx(plain.costs_m[index, slot], rel=1e-12)
    assert np.all(plain.way.index == plain.way.index[0])
    assert plain.bound_m <= plain.costs_m.min()


def test_what_is_chosen_bends_less_than_the_present_posture(chosen: ChosenPosture) -> None:
    assert chosen.present is not None
    assert chosen.best.share_m < 0.85 * chosen.present.share_m
    assert chosen.best.limit_margin_rad >= 2.0 * DEG


def test_turning_is_never_worse_than_holding_still(task: PostureTask, chosen: ChosenPosture) -> None:
    turning = choose(task, Freedom(rate_rad_s=20 * DEG, air_rate_rad_s=60 * DEG))
    assert turning.way.cost <= chosen.way.cost + 1e-12
    assert turning.way.cost >= 1.0 - 1e-12


def test_another_surface_is_another_posture_problem(task: PostureTask) -> None:
    normals = surface_normals(task.path, "both")
    t = np.diff(task.path.p_part_tcp, axis=0, prepend=task.path.p_part_tcp[:1])
    moving = np.linalg.norm(t, axis=1) > 0.0
    np.testing.assert_allclose(np.einsum("nki,ni->nk", normals, t)[moving], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(normals[moving], axis=2), 1.0, atol=1e-12)
    wall, floor = surface_normals(task.path, "wall"), surface_normals(task.path, "floor")
    np.testing.assert_array_equal(np.concatenate([wall, floor], axis=1), normals)


def test_the_points_of_the_part_frame_can_be_touched(task: PostureTask, chosen: ChosenPosture) -> None:
    """Datum points far out forbid postures that the path itself allows."""
    far = np.array([[0.0, 0.0, 0.04], [0.0, 0.4, 0.04], [0.4, 0.0, 0.04]])
    other = choose(replace(task, setting=replace(task.setting, datum_points_part=far)), Freedom())
    assert np.isfinite(other.costs_m).sum() < np.isfinite(chosen.costs_m).sum()


def test_bodies_that_come_too_close_leave_a_posture_out(
    cell: Cell, job: Job, task: PostureTask, chosen: ChosenPosture
) -> None:
    around = surroundings_of(job, cell)
    free = choose(replace(task, around=around), Freedom())
    assert free.way.index[0] != chosen.way.index[0]
    assert free.best.share_m > chosen.best.share_m
    with pytest.raises(ReachError, match="bodies come too close") as fault:
        choose(replace(task, around=replace(around, clearance_m=0.5)), Freedom(rotations=12))
    assert "limits.clearance_mm" in str(fault.value)


@pytest.mark.parametrize(
    ("change", "reason", "words"),
    [
        ({"x_mm": 1500.0}, OUT_OF_REACH, "no posture reaches the point"),
        ({"joint_margin_rad": 60 * DEG}, JOINT_LIMIT, "joint_margin_deg"),
        ({"wrist_rad": 88 * DEG}, WRIST_SINGULAR, "wrist_singularity_deg"),
    ],
)
def test_where_nothing_is_possible_it_says_where_and_why(
    task: PostureTask, change: dict[str, float], reason: int, words: str
) -> None:
    with pytest.raises(ReachError, match=words) as fault:
        choose(_moved(task, **change), Freedom(rotations=12))
    assert fault.value.data["reason"] == reason
    assert fault.value.where is not None
    assert fault.value.where.startswith("line ")


def test_points_that_no_posture_joins_are_told(task: PostureTask) -> None:
    """Every point can be reached, but in rotations that the tool would have to turn between."""
    tight = replace(task.robot, cables_rad={5: 0.2})
    p = task.cut.p_part.copy()
    p[len(p) // 2 :] += np.array([0.0, 0.9, 0.0])
    with pytest.raises(ReachError, match=r"without turning the tool.*postures there fail: \d+ ") as fault:
        choose(replace(task, robot=tight, cut=replace(task.cut, p_part=p)), Freedom())
    assert fault.value.where is not None


def test_a_robot_without_closed_form_is_refused(task: PostureTask) -> None:
    bare = replace(task.robot.controller_chain, opw=None)
    with pytest.raises(ModelError, match="closed-form"):
        choose(replace(task, robot=replace(task.robot, controller_chain=bare)), Freedom())


def test_cables_narrow_the_axes(task: PostureTask) -> None:
    robot = replace(task.robot, cables_rad={5: 1.0})
    assert np.all(np.abs(robot.joint_limits_rad[5]) <= 1.0)
    q = survey_path(task.cut, robot, Freedom(rotations=24).grid_rad, np.array([0, len(task.cut) - 1])).q
    assert np.nanmax(np.abs(q[..., 5])) <= 1.0


def test_stations_are_the_ends_of_the_runs_and_apart_in_time(task: PostureTask) -> None:
    rows = stations(task.cut, 0.3, 1000)
    assert rows[0] == 0
    assert rows[-1] == len(task.cut) - 1
    assert set(np.flatnonzero(np.diff(task.cut.run))) <= set(rows.tolist())
    f = fractions(task.cut.time_s, rows)
    assert f.min() > 0.0
    np.testing.assert_array_equal(f[rows], 1.0)
    assert len(stations(task.cut, 0.0, 3)) >= 2


def test_a_placement_is_priced_by_the_same_function(task: PostureTask) -> None:
    """Another pose of the part is another robot; costs are those of the survey there."""
    here = task.robot
    there = RobotHere(here.chain, here.controller_chain, _moved(task, 80.0).robot.T_base_part, here.limits)
    rows, grid = np.array([0, len(task.cut) - 1]), Freedom(rotations=8).grid_rad
    before, after = (constant_costs(survey_path(task.cut, robot, grid, rows)) for robot in (here, there))
    both = np.isfinite(before) & np.isfinite(after)
    assert both.any()
    assert not np.allclose(before[both], after[both])


def test_an_axis_that_is_too_slow_rules_postures_out_as_preflight_would(
    task: PostureTask, chosen: ChosenPosture
) -> None:
    """The limit lies just below what the free choice asks for: another posture keeps it, or the line is named."""
    path, robot = task.path, replace(task.robot, acceleration_m_s2=5.0)

    def asked(q: np.ndarray) -> np.ndarray:
        size = np.abs(joint_accelerations(path, joint_speeds(path, q), robot.acceleration_m_s2))
        return np.asarray((size * at_feed(path)[:, None]).max(axis=0))

    free = asked(chosen.best.q)
    limits = np.full(6, np.inf)
    axis = int(np.argmax(free))
    limits[axis] = 0.9 * free[axis]
    slow = replace(task, robot=replace(robot, joint_accelerations_rad_s2=limits))
    best = choose(slow, Freedom()).best
    assert asked(best.q)[axis] <= limits[axis]
    assert best.share_m >= chosen.best.share_m
    none = replace(slow, robot=replace(slow.robot, joint_accelerations_rad_s2=np.full(6, 1e-3)))
    with pytest.raises(ReachError, match=r"line \d+, at .*an axis is too slow.*joint_acceleration_deg_s2"):
        choose(none, Freedom(rotations=12))


def test_a_posture_can_be_asked_for_about_one_that_is_known(task: PostureTask, chosen: ChosenPosture) -> None:
    other = next(branch for branch in BRANCHES if np.isfinite(chosen.costs_m[:, BRANCHES.index(branch)]).any())
    rotation = float(np.nanargmin(chosen.costs_m[:, BRANCHES.index(other)])) * Freedom().step_rad
    best = choose(task, Freedom(about=(other, rotation))).best
    assert best.branch == other
    assert abs((best.rotation_rad - rotation + np.pi) % (2.0 * np.pi) - np.pi) <= 10.0 * DEG + 1e-9

"""A tool that turns about its axis along the program: planner, simulated controller and written program agree."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.compensation.compensate import compensate
from counterflex.app.inputs import read_job, setting_of
from counterflex.app.posture import loaded_path, robot_of
from counterflex.app.proof.simulate import controller
from counterflex.core.errors import FileFormatError, InputError, ReachError
from counterflex.core.units import DEG
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.update import text_with_posture
from counterflex.path.tool_rotation import ToolRotation
from counterflex.plan.inputs import solve_joints
from counterflex.plan.posture.choose import Freedom, choose
from counterflex.plan.posture.held import Task
from counterflex.robot.elasticity.chain import forward
from counterflex.twin.plant.controller import interpolate

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
CELL, GROOVE = EXAMPLES / "cells" / "kr300_d16_small.toml", EXAMPLES / "programs" / "groove.ngc"
ROWS = [[0.0, 180.0], [20.0, 180.0], [90.0, 215.0]]


def _turning_cell(folder: Path) -> Cell:
    file = folder / "cell.toml"
    file.write_text(text_with_posture(CELL, "front up noflip", 180.0, folder, ROWS))
    return read_cell(file)


def test_rotation_is_linear_over_the_length_of_the_path() -> None:
    turning = ToolRotation((0.0, 2.0), (1.0, 3.0))
    p = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 1.0, 9.0]])
    np.testing.assert_allclose(turning.along(p), [1.0, 2.0, 2.0, 3.0, 3.0])
    with pytest.raises(InputError, match="do not rise"):
        ToolRotation((0.0, 0.0), (1.0, 2.0))


def test_planner_and_simulated_controller_turn_alike(tmp_path: Path) -> None:
    cell = _turning_cell(tmp_path)
    job, setting = read_job(GROOVE, cell), setting_of(cell)
    q = solve_joints(job.machined, job.line_of_motion[job.machined.motion], setting).q
    reference = interpolate(job.machined, controller(cell))
    chain = setting.controller_chain
    T_planned, T_run = forward(chain, q), forward(chain, reference.q_ref)
    assert np.arccos((np.trace(T_planned[0, :3, :3].T @ T_planned[-1, :3, :3]) - 1.0) / 2.0) == pytest.approx(35 * DEG)
    for row in range(0, len(q), 40):
        near = int(
            np.argmin(np.linalg.norm(T_run[:, :3, 3] - T_planned[row, :3, 3], axis=1) + 1e-9 * np.arange(len(T_run)))
        )
        moved = np.linalg.norm(T_run[near, :3, 3] - T_planned[row, :3, 3])
        turned = np.linalg.norm(T_run[near, :3, :3] - T_planned[row, :3, :3])
        assert turned < 0.01 + 15.0 * moved  # 0.5 deg per mm, on a path whose corners are rounded


def test_the_turning_is_written_into_the_program(tmp_path: Path) -> None:
    files = compensate(GROOVE, _turning_cell(tmp_path), language="krl", predict=False).files
    angles = [float(line.split(",A ")[1].split(",")[0]) for line in files["groove.src"].splitlines() if ",A " in line]
    assert np.ptp(np.unwrap(angles, period=360.0)) == pytest.approx(35.0, abs=0.2)


def test_a_turning_that_goes_back_or_begins_elsewhere_is_refused(tmp_path: Path) -> None:
    for rows, words in (
        ([[0.0, 180.0], [0.0, 190.0]], "do not rise"),
        ([[0.0, 90.0], [9.0, 95.0]], "expected the same"),
    ):
        file = tmp_path / "bad.toml"
        file.write_text(text_with_posture(CELL, "front up noflip", 180.0, tmp_path, rows))
        with pytest.raises(FileFormatError, match=words):
            read_cell(file)


def test_a_tool_that_turns_runs_what_no_posture_held_still_runs() -> None:
    """Axis 6 is held by its cables, and the part leads axis 1 round: the tool has to follow."""
    cell = read_cell(CELL)
    job, setting = read_job(GROOVE, cell), setting_of(cell)
    p = job.machined.p_part_tcp.copy()
    p[:, 1] += np.linspace(0.0, 0.9, len(p))
    path = replace(job.machined, p_part_tcp=p, time_s=job.machined.time_s * 20.0)
    line = job.line_of_motion[path.motion]
    cut = loaded_path(job.machined, line, cell.stock(), setting, "both")
    cut = replace(cut, p_part=p, time_s=path.time_s)
    robot = replace(robot_of(cell, setting), cables_rad={5: 0.2})
    task = Task(path, line, cut, replace(setting, datum_points_part=None), robot)
    with pytest.raises(ReachError, match="without turning the tool"):
        choose(task, Freedom())
    best = choose(task, Freedom(rate_rad_s=20 * DEG, air_rate_rad_s=20 * DEG)).best
    assert best.turning is not None
    assert np.all(np.abs(best.q[:, 5]) <= 0.2 + 5 * DEG)

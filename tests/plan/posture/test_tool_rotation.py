"""A tool that turns about its axis along the program: planner, simulated controller and written program agree."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from counterflex.app.compensation.compensate import compensate
from counterflex.app.inputs import read_job, setting_of
from counterflex.app.posture import loaded_path, robot_of
from counterflex.app.proof.simulate import controller
from counterflex.core.errors import FileFormatError, InputError, ReachError
from counterflex.core.units import DEG
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.set_up import text_with_posture
from counterflex.path.tool_rotation import ToolRotation
from counterflex.plan.inputs import solve_joints
from counterflex.plan.posture.choose import Freedom, choose
from counterflex.plan.posture.held import PostureTask
from counterflex.robot.elasticity.chain import forward
from counterflex.twin.plant.controller import CommandedReference

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
CELL, GROOVE = EXAMPLES / "cells" / "kr300_d16_small.toml", EXAMPLES / "programs" / "groove.ngc"
CORNER = EXAMPLES / "programs" / "corner.ngc"
TURNING = ToolRotation((0.0, 0.02, 0.09), (180.0 * DEG, 180.0 * DEG, 215.0 * DEG))


def _turning_cell(folder: Path) -> Cell:
    file = folder / "cell.toml"
    placed = TURNING.placed(read_job(GROOVE, read_cell(CELL)).machined.p_part_tcp)
    file.write_text(text_with_posture(CELL, "front up noflip", 180.0, folder, placed))
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
    reference = CommandedReference.interpolated(job.machined, controller(cell))
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


def test_the_turning_of_another_program_is_refused(tmp_path: Path) -> None:
    """That of the groove serves the groove as programmed and as compensated, and nothing else."""
    cell = _turning_cell(tmp_path)
    with pytest.raises(FileFormatError, match=r"another program than this one.*mm away"):
        read_job(CORNER, cell)
    files = compensate(GROOVE, cell, language="gcode", predict=False).files
    compensated = tmp_path / "compensated.ngc"
    compensated.write_text(files["groove.ngc"])
    read_job(compensated, cell)
    moved = tmp_path / "moved.ngc"
    moved.write_text(GROOVE.read_text().replace("Y", "Y-7"))
    with pytest.raises(FileFormatError, match="another program"):
        read_job(moved, cell)


@given(
    length=st.floats(0.02, 2.0), aside=st.floats(0.0, 0.02), along=st.floats(-0.02, 0.02), turned=st.floats(0.0, 6.28)
)  # fmt: skip
def test_distance_to_another_program(length: float, aside: float, along: float, turned: float) -> None:
    """A straight line shifted along itself is the same program, one shifted aside by more than a correction is not."""
    way = np.array([np.cos(turned), np.sin(turned), 0.0])
    p = np.linspace(0.0, length, 50)[:, None] * way
    rotation = ToolRotation((0.2 * length, 0.6 * length), (0.0, 1.0)).placed(p)
    assert rotation.distance(p)[0] < 1e-3
    shifted = p + aside * np.array([-way[1], way[0], 0.0]) + min(along, 0.2 * length) * way
    short = max(0.0, abs(along) - 0.2 * length)  # a point that falls off the end of the line
    assert aside - 1e-9 <= rotation.distance(shifted)[0] <= np.hypot(aside, short + 1e-3)


def test_a_turning_that_goes_back_or_begins_elsewhere_is_refused(tmp_path: Path) -> None:
    text = _turning_cell(tmp_path).path.read_text()
    for old, new, words in (
        ("[20.0, 180.0]", "[0.0, 180.0]", "do not rise"),
        ("[0.0, 180.0]", "[0.0, 90.0]", "expected the same"),
        ("[90.0, 215.0]", "[90.0, 215.0], [95.0, 215.0]", "turning_at_mm has 3 points"),
    ):
        file = tmp_path / "bad.toml"
        assert old in text
        file.write_text(text.replace(old, new))
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
    task = PostureTask(path, line, cut, replace(setting, datum_points_part=None), robot)
    with pytest.raises(ReachError, match="without turning the tool"):
        choose(task, Freedom())
    best = choose(task, Freedom(rate_rad_s=20 * DEG, air_rate_rad_s=20 * DEG)).best
    assert best.turning is not None
    assert np.all(np.abs(best.q[:, 5]) <= 0.2 + 5 * DEG)

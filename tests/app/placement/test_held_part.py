"""The robot holds the part: the spindle that stands is what is placed, with the bodies that belong to it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.coarse_bodies import coarse_bodies
from counterflex.app.compensation.compensate import compensate
from counterflex.app.inputs import AS_IT_IS, read_job
from counterflex.app.placement import placement, placement_map
from counterflex.app.placement.region import Mounting, Wish
from counterflex.app.posture import PostureOf
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import pose
from counterflex.plan.inputs import part_compliance
from counterflex.plan.placement.candidate import judge, site_of, worth
from counterflex.plan.posture.survey_kernel import POWER
from counterflex.plan.stability.criterion import least_damping
from counterflex.plan.stability.robot_modes import robot_modes
from counterflex.robot.elasticity.chain import forward, jacobian

HELD = Path(__file__).resolve().parents[3] / "examples" / "cells" / "kr300_held_part.toml"
SHORT = "G21 G17 G90\nM6 T1\nM3 S13000\nG0 X-12 Y15 Z42\nG1 Z34 F3000\nG1 X24 F1500\nG0 Z60\nM5\nM2\n"
RAIL = (
    '\n[[external_axes]]\nname = "E1"\nkind = "linear"\ncarries = "robot"\ndirection = [0, 1, 0]\nat_mm = 100\n'
    "min_mm = -400\nmax_mm = 500\n"
)
BODIES = (
    '\n[[cell.body]]\nname = "fence"\nshape = "box"\nx_mm = -1500\nsize_mm = [20, 4000, 2000]\n'
    '\n[[cell.body]]\nname = "column of the spindle"\nframe = "tcp"\nshape = "box"\nz_mm = -500\n'
    "size_mm = [200, 200, 300]\n"
)
NEAR = Wish((1350.0, 1550.0, -150.0, 150.0, 850.0, 1000.0))
"""About the present tip of the spindle."""


def written(folder: Path, more: str = "") -> tuple[Path, Path]:
    (folder / "part.ngc").write_text(SHORT, encoding="ascii")
    (folder / "cell.toml").write_text(HELD.read_text(encoding="utf-8") + more, encoding="utf-8")
    return folder / "part.ngc", folder / "cell.toml"


@pytest.mark.long
def test_the_spindle_is_placed_and_the_part_stays_in_the_hand(tmp_path: Path) -> None:
    """The file's own spindle, read anew, has the posture and the deflection that the search names."""
    program, file = written(tmp_path)
    summary = placement.run(program, file, tmp_path / "out", count=64, wish=NEAR)
    before, after, chosen = read_cell(file), read_cell(tmp_path / "out" / "cell.toml"), summary["chosen"]
    assert after.part == before.part
    assert [after.tables.tcp.x_mm, after.tables.tcp.y_mm, after.tables.tcp.z_mm] == [
        chosen[key] for key in ("x_mm", "y_mm", "z_mm")
    ]
    assert 1350.0 <= chosen["x_mm"] <= 1550.0
    assert chosen["damping_in_cut"] >= summary["least_damping"] - 0.01
    assert chosen["error_um"] < summary["present"]["error_um"]
    anew = PostureOf.of(program, after).summary["present"]
    assert anew["branch"] == chosen["branch"]
    for key in ("rotation_about_tool_deg", "deflection_um", "limit_margin_deg"):
        assert anew[key] == pytest.approx(chosen[key], rel=1e-9, abs=1e-9)
    rapid = "".join(compensate(program, after, predict=False, language="rapid").files.values())
    assert f":=[FALSE,[[{chosen['x_mm']:g}" in rapid


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Any:
    program, file = written(tmp_path_factory.mktemp("held"), RAIL + BODIES)
    _, cell, task = placement.task_of(program, read_cell(file), AS_IT_IS, "both")
    return program, file, cell, task


def test_a_candidate_is_seen_as_the_cell_file_with_its_values(case: Any, tmp_path: Path) -> None:
    """Spindle, what belongs to it and what stands on the floor are those of a cell that is read anew."""
    program, file, cell, task = case
    frame = placement.frame_of(task, cell)
    place = frame.here.copy()
    np.testing.assert_allclose(frame.seen(place).T_base_standing, task.robot.T_base_standing, atol=1e-12)
    place[:] = [1400.0 * MM, 120.0 * MM, 870.0 * MM, 30.0 * DEG, -300.0 * MM]
    seen, stand = frame.at(frame.stand(place)), frame.stand(place)
    text = file.read_text(encoding="utf-8").replace("at_mm = 100", "at_mm = -300")
    text = text.replace("x_mm = 1500\ny_mm = 0\nz_mm = 900", "x_mm = 1400\ny_mm = 120\nz_mm = 870\na_deg = 30")
    (tmp_path / "there.toml").write_text(text, encoding="utf-8")
    there = read_cell(tmp_path / "there.toml")
    assert stand.part == pytest.approx({"x_mm": 1400.0, "y_mm": 120.0, "z_mm": 870.0, "a_deg": 30.0, "b_deg": 0.0,
                                        "c_deg": 0.0})  # fmt: skip
    assert there.T_base_tcp is not None
    np.testing.assert_allclose(seen.T_base_standing, there.T_base_tcp, atol=1e-12)
    moved = task.around.facing(task.robot, task.robot.facing(seen.T_base_standing), seen.T_base_before)
    bodies = {body.name: body.T_frame_body for body in moved.bodies}
    anew = coarse_bodies(read_job(program, there), there, there.stock())
    assert {"spindle", "tool T1", "fence", "column of the spindle"} < {body.name for body in anew}
    for body in anew:
        np.testing.assert_allclose(bodies[body.name], body.T_frame_body, atol=1e-9)


def test_motion_of_the_tool_in_the_part_is_that_of_the_kinematics(case: Any) -> None:
    """Independent of levers: the tool in the part before and after small turns of the axes."""
    robot = case[3].robot
    q = np.array([[0.1, -1.2, 1.4, 0.2, 0.9, -0.3], [-0.2, -1.0, 1.3, -0.1, 1.1, 0.8]])
    turn = 1e-7 * np.array([1.0, -2.0, 1.5, 3.0, -1.0, 2.0])
    before, after = (pose.inverse(forward(robot.chain, v)) @ robot.T_base_tcp for v in (q, q + turn))
    said = robot.relative_motion(q).displacement(jacobian(robot.chain, q) @ turn)
    np.testing.assert_allclose(said[:, :3], (after - before)[:, :3, 3], atol=1e-12)


def test_a_candidate_has_the_deflection_of_the_compliance_between_tool_and_part(case: Any) -> None:
    _, _, cell, task = case
    site = site_of(task, placement.stretches_of_task(task, cell), rotations=12)
    done = judge(site, task.robot.T_base_standing)
    assert done.q is not None
    relative = site.robot.relative_motion(done.q)
    bent = (part_compliance(task.setting, relative, done.q) @ site.cut.w_tcp_part[..., None])[:, :3, 0]
    size = np.linalg.norm(np.einsum("nki,ni->nk", site.cut.normals_part, bent), axis=1)
    mean = np.average(size**POWER, weights=site.cut.weight_m) ** (1.0 / POWER)
    assert done.deflection_m == pytest.approx(mean, rel=1e-3)
    assert done.error_m > done.deflection_m
    assert site.feeding is not None
    values = [
        least_damping(
            robot_modes(
                site.robot.chain, done.q[row], relative.to_part[row], task.setting.mode, task.setting.damping.ratio
            ),
            1.5 * A,
            T,
        )
        for row, A, T in zip(site.feeding.rows, site.feeding.A_part, site.feeding.period_s, strict=True)
    ]
    drawn = worth(site, site.robot, done.q)[2]
    assert drawn < min(task.setting.damping.ratio, max(values))
    assert drawn == pytest.approx(done.least_damping)


def test_the_place_does_not_depend_on_where_the_world_begins(case: Any) -> None:
    """Robot and spindle turned together about axis 1: the same deflection, another angle of axis 1."""
    task = case[3]
    site = site_of(task, rotations=8)
    turn = pose.from_xyz_zyx(np.zeros(3), np.array([0.3, 0.0, 0.0]))
    here, there = judge(site, task.robot.T_base_standing), judge(site, turn @ task.robot.T_base_standing)
    assert here.q is not None
    assert there.q is not None
    assert there.error_m == pytest.approx(here.error_m, rel=1e-6)
    np.testing.assert_allclose(np.cos(there.q[:, 0] - here.q[:, 0]), np.cos(0.3), atol=1e-9)
    np.testing.assert_allclose(there.q[:, 1:3], here.q[:, 1:3], atol=1e-9)


def test_a_vertical_spindle_is_not_turned_and_a_tilted_one_is(tmp_path: Path) -> None:
    """About a vertical axis turning the spindle is turning the tool, which the posture does already."""
    program, file = written(tmp_path)
    for angle, free in ((0.0, False), (90.0, True)):
        cell = Mounting("tcp", "b_deg", ()).cell(read_cell(file), angle)
        _, cell, task = placement.task_of(program, cell, AS_IT_IS, "both")
        region = Wish().region(placement.frame_of(task, cell))
        assert (region.high[3] > region.low[3]) is free


@pytest.mark.long
def test_the_tilt_of_the_spindle_is_a_choice_and_the_file_has_all_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("counterflex.plan.placement.search.POPULATION", 8)
    program, file = written(tmp_path)
    made = Mounting("tcp", "b_deg", (-20.0,))
    summary = placement.run(program, file, tmp_path / "out", mounting=made, count=8, wish=NEAR)
    tcp, chosen = read_cell(tmp_path / "out" / "cell.toml").tables.tcp, summary["chosen"]
    assert len(summary["mountings"]) == 2
    assert tcp.b_deg == summary["mounting"]["chosen_deg"] == chosen["b_deg"]
    assert [tcp.x_mm, tcp.a_deg] == [chosen["x_mm"], chosen["a_deg"]]


def test_maps_show_the_stiffness_between_tool_and_part(tmp_path: Path) -> None:
    program, file = written(tmp_path)
    summary = placement_map.run(program, file, tmp_path / "map", wish=NEAR, points=2)
    task = placement.task_of(program, read_cell(file), AS_IT_IS, "both")[2]
    q = judge(site_of(task), task.robot.T_base_standing).q
    assert q is not None
    q = q[len(q) // 2][None]
    C = part_compliance(task.setting, task.robot.relative_motion(q), q)[0]
    softest = 1e-6 / np.linalg.eigvalsh(C[:3, :3])[-1]
    assert summary["present"]["stiffness_n_per_um"] == pytest.approx(softest, rel=1e-3)

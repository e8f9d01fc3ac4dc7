"""Whole programs on a small cell: each fault in a pair with the program or cell that does not have it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app import preflight as job
from counterflex.app.compensation import program_size
from counterflex.core.units import DEG
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.controller import SpindleTable
from counterflex.files.cell.tables import ToolTable
from counterflex.geometry import pose
from counterflex.integrations.kuka.language.writer import KrlSettings, KrlWriter
from counterflex.path.path_speed import build_track
from counterflex.path.toolpath import FEED, RAPID, tool_orientation, tool_poses
from counterflex.plan.preflight.hazards import HAZARDS
from counterflex.plan.preflight.joints import at_feed, joint_accelerations, joint_speeds
from counterflex.plan.preflight.rapids import STEP_M, with_points_in_rapids
from counterflex.programs.language import LANGUAGES
from counterflex.robot.elasticity.chain import jacobian
from counterflex.robot.kinematics.inverse import inverse_path

HEAD = "G21 G17 G90 G94 G43\nT1 M6\nM3 S13000\n"
GROOVE = "G0 X-12 Y15 Z60\nG0 Z42\nG1 Z37 F3000\nG1 X20 F1500\nG0 Z60"
CORNERED = "G0 X-12 Y10 Z60\nG0 Z42\nG1 Z37 F3000\nG1 X20 F1500\nG1 Y20\nG1 X5\nG0 Z60"
CellOf = Callable[..., Cell]
PROCESS_LIMITS = {
    "spindle_run_up_s": 0.2, "spindle_min_rpm": 3000, "spindle_max_rpm": 24000,
        "spindle_power_w": 8000, "spindle_torque_nm": 6,
    "force_n": 2000, "axis_torque_nm": [5000] * 6, "tool_bending_um": 100, "deflection_um": 2000,
    "acceleration_mm_s2": 3000,
}  # fmt: skip
TOOL = {
    "overhang_mm": 60, "centre_cutting": True, "feed_per_tooth_mm": [0.02, 0.2], "cutting_speed_m_min": [200, 1000],
    "max_rpm": 20000, "coolant": False, "holder_mm": [[60, 40], [120, 60]],
}  # fmt: skip
"""Everything that the cell file can state of the cut, wide enough for the programs below."""


@pytest.fixture
def checked(tmp_path: Path, cell_of: CellOf) -> Callable[..., dict[str, Any]]:
    def run(body: str = GROOVE, **changes: Any) -> dict[str, Any]:
        """Rows of the table by check, and the whole result as ``result``."""
        tool = changes.pop("tool", {})
        cell = cell_of(**changes)
        if tool:
            table = ToolTable.model_validate(cell.tables.tools[0].model_dump() | tool)
            cell = replace(cell, tables=cell.tables.model_copy(update={"tools": (table,)}))
        program = tmp_path / "part.ngc"
        program.write_text(f"{HEAD}{body}\nM5 (T1: end mill D16)\nM30\n")
        done = job.check(program, cell)
        return {row["check"]: row for row in done.summary["checks"]} | {"done": done}

    return run


def test_a_good_program_fails_nothing(checked: Any) -> None:
    rows = checked()
    assert not rows["done"].result.failed
    assert rows["reach"]["verdict"] == "ok"
    assert rows["done"].summary["counts"]["fail"] == 0
    assert rows["done"].summary["points_reached"] == rows["done"].summary["points"]
    left_out = [row for row in rows["done"].summary["checks"] if row["verdict"] == "not looked at"]
    needed = {hazard.check: hazard.needed for hazard in HAZARDS}
    assert {row["missing"] for row in left_out} > {"limits.cable_axis4_deg", "controller.look_ahead_blocks"}
    assert all(row["missing"] in needed[row["check"]] for row in left_out)
    assert checked(CORNERED)["corner error of the approximation"]["missing"] == "limits.corner_error_um"


def test_all_is_looked_at_where_the_cell_file_says_it(checked: Any) -> None:
    limits = {"joint_acceleration_deg_s2": [500.0] * 6, "cable_axis4_deg": 270, "cable_axis6_deg": 90}
    limits["corner_error_um"] = 200
    monitor = {"force_limit_n": 2000}
    rows = checked(
        limits=limits, controller={"look_ahead_blocks": 50}, process_limits=PROCESS_LIMITS, tool=TOOL, monitor=monitor
    )
    assert [row for row in rows["done"].summary["checks"] if row["verdict"] == "not looked at"] == []
    assert rows["cable wind-up, axis 4"]["verdict"] == "ok"
    assert (rows["cable wind-up, axis 6"]["verdict"], rows["cable wind-up, axis 6"]["limit"]) == ("fail", 90.0)


def test_margins_and_wrist_are_those_of_the_angles(checked: Any, cell_of: CellOf) -> None:
    """By their definitions from the angles of the path; axes 4 and 6 of this arm are as far apart as A5 is from 0."""
    rows = checked()
    q, chain = rows["done"].result.q, cell_of().controller_chain
    room = np.minimum(q - chain.joint_limits_rad[:, 0], chain.joint_limits_rad[:, 1] - q) / DEG
    assert rows["joint limits"]["value"] == pytest.approx(room.min(), rel=1e-5)
    assert rows["joint limits"]["what"] == f"axis {int(np.argmin(room.min(axis=0))) + 1}"
    angle = np.degrees(np.arcsin(np.abs(np.sin(q[:, 4]))))
    assert rows["wrist singularity"]["value"] == pytest.approx(angle.min(), rel=1e-5)
    assert rows["joint limits"]["line"] in (5, 6, 7)


def test_accelerations_are_those_of_a_controller_that_rounds_the_corners(checked: Any, cell_of: CellOf) -> None:
    """Angles of a run by the model of the controller, which brakes and rounds by itself, differentiated twice."""
    body = "G0 X-12 Y15 Z60\nG0 Z42\nG1 Z41 F3000\nG1 X20 F1500\nG1 Y40\nG1 X0 Y60\nG0 Z60"
    done, cell, cycle_s = checked(body)["done"], cell_of(), 0.004
    path, controller = done.result.path, cell.tables.controller
    track = build_track(
        done.job.machined,
        blending_m=controller.blending_m,
        rapid_m_s=controller.rapid_m_s,
        acceleration_m_s2=controller.acceleration_m_s2,
    )
    _, p, axis, row = track.timed(controller.acceleration_m_s2, cycle_s)
    Rs = tool_orientation(axis, cell.tables.posture.rotation_about_tool_rad)
    run = inverse_path(cell.controller_chain, tool_poses(cell.T_base_part, p, Rs), cell.tables.posture.branch).q
    second = np.abs(np.diff(run, 2, axis=0)) / cycle_s**2
    feed = (done.job.machined.kind == FEED)[row]
    inside = np.convolve(feed, np.ones(5), mode="same")[1:-1] == 5
    exact = np.where(inside[:, None], second, 0.0).max(axis=0)
    speeds = joint_speeds(path, done.result.q)
    ours = np.abs(joint_accelerations(path, speeds, controller.acceleration_m_s2)) * at_feed(path)[:, None]
    assert ours.max(axis=0) == pytest.approx(exact, rel=0.05)


def test_a_part_out_of_reach_says_line_and_by_how_much(checked: Any) -> None:
    """4 m away: the wrist's centre at the first point is beyond the arm by its distance from axis 2 less the reach."""
    rows = checked(part={"x_mm": 4000})
    row = rows["reach"]
    assert (row["verdict"], row["line"]) == ("fail", 4)
    assert "out of reach" in row["what"]
    assert "100 % of the path" in row["what"]
    assert "mm beyond the arm" in row["what"]
    assert row["value"] < -1000.0
    assert rows["joint limits"]["verdict"] == "not looked at"
    assert rows["rapids into the stock"]["verdict"] == "ok"  # what needs no robot is checked all the same
    assert rows["done"].summary["points_reached"] == 0


def test_a_program_that_leaves_the_reach_is_checked_up_to_there(checked: Any) -> None:
    rows = checked(f"{GROOVE}\nG0 X2000")
    row = rows["reach"]
    assert (row["verdict"], row["line"]) == ("fail", 9)
    assert "too close to a singularity" in row["what"]  # axis 5 passes zero where the arm reaches out
    assert "Axis 5 near zero" in row["advice"]
    assert "of the path's points are out of reach" in row["what"]
    done = rows["done"]
    assert 0 < done.summary["points_reached"] < done.summary["points"]
    assert rows["joint limits"]["verdict"] == "ok"
    assert rows["robot and spindle to surroundings"]["value"] is not None


def test_an_arm_that_is_too_short_is_said_to_be_so(checked: Any) -> None:
    """The tool along the forearm, away from the wrist singularity of the other test."""
    row = checked(f"{GROOVE}\nG0 X2000", tcp={"x_mm": 0, "z_mm": 300, "b_deg": 0})["reach"]
    assert (row["verdict"], row["line"]) == ("fail", 9)
    assert "mm beyond the arm" in row["what"]


def test_a_branch_that_does_not_reach_is_the_reason(checked: Any) -> None:
    """Low and close to the foot the arm reaches backward over its shoulder only."""
    row = checked(part={"x_mm": 700, "z_mm": 300})["reach"]
    assert (row["verdict"], row["line"]) == ("fail", 4)
    assert "not reached in branch 'front up noflip'" in row["what"]
    assert "back up noflip" in row["what"]


def test_limits_left_are_told_by_how_much(checked: Any) -> None:
    """Reached over the shoulder, axis 3 leaves its range; the angles are there all the same."""
    rows = checked(posture={"shoulder": "back"}, part={"x_mm": 1000, "z_mm": 400})
    assert rows["reach"]["verdict"] == "ok"
    assert (rows["joint limits"]["verdict"], rows["joint limits"]["what"]) == ("fail", "axis 3 is out of its range")
    assert rows["joint limits"]["value"] < -10.0
    assert "branch" in rows["joint limits"]["advice"]


def test_margin_asked_for_is_kept(checked: Any) -> None:
    assert checked()["joint limits"]["verdict"] == "ok"
    row = checked(limits={"joint_margin_deg": 60})["joint limits"]
    assert (row["verdict"], row["limit"]) == ("fail", 60.0)


def test_a_rapid_through_the_stock_fails_and_one_above_it_does_not(checked: Any) -> None:
    through = checked("G0 X-12 Y15 Z60\nG0 Z37\nG0 X30\nG0 Z60")
    row = through["rapids into the stock"]
    assert (row["verdict"], row["line"], row["unit"]) == ("fail", 6, "mm3")
    assert "moves through it" in row["what"]
    assert row["value"] == pytest.approx(3.0 * (16 * 30 + np.pi / 4 * 16**2 / 2), rel=0.05)  # a slot 3 mm deep
    assert checked("G0 X-12 Y15 Z60\nG0 Z42\nG0 X30\nG0 Z60")["rapids into the stock"]["verdict"] == "ok"


def test_a_plunge_at_rapid_is_called_one(checked: Any) -> None:
    row = checked("G0 X20 Y15 Z60\nG0 Z38\nG1 X25 F1500\nG0 Z60")["rapids into the stock"]
    assert (row["verdict"], row["line"]) == ("fail", 5)
    assert "plunges straight down" in row["what"]
    assert row["value"] == pytest.approx(2.0 * np.pi / 4 * 16**2, rel=0.05)


def test_a_cut_deeper_than_the_flutes_fails(checked: Any) -> None:
    """A slot 38 mm deep, cut with flutes of 35 mm, and of 45 mm."""
    slot = "G0 X-12 Y15 Z60\nG1 Z2 F3000\nG1 X30 F300\nG0 Z60"
    row = checked(slot)["depth of cut to flutes"]
    assert (row["verdict"], row["line"], row["limit"]) == ("fail", 6, 35.0)
    assert row["value"] == pytest.approx(38.0, rel=0.02)
    assert checked(slot.replace("Z2", "Z10"))["depth of cut to flutes"]["verdict"] == "ok"


def test_a_cut_without_spindle_is_a_row(checked: Any) -> None:
    rows = checked("M5\nG0 X-12 Y15 Z60\nG0 Z42\nG1 Z37 F3000\nG1 X20 F1500\nG0 Z60")
    row = rows["spindle in the cut"]
    assert (row["verdict"], row["line"]) == ("fail", 8)
    assert "spindle stopped" in row["what"]
    assert rows["removed material"]["value"] > 1000.0  # what needs no force is looked at all the same
    assert (rows["spindle torque"]["verdict"], rows["joint limits"]["verdict"]) == ("not looked at", "ok")


def test_without_masses_of_links_unloadings_are_unknown(checked: Any) -> None:
    """The end effector's mass alone says nothing of the weight that the drives bear."""
    robot = {"catalog": "kuka_kr150_2"}
    row = checked(robot=robot)["unloadings in the cut"]
    assert (row["verdict"], row["missing"]) == ("not looked at", "mass_kg of [[robot.elastic]]")
    assert checked()["unloadings in the cut"]["verdict"] == "ok"


def test_a_pillar_beside_the_part_is_hit_and_one_far_away_is_not(checked: Any) -> None:
    """A fixture where the spindle passes; its distance is that of the tool tip's path in the part frame."""
    post = {"name": "pillar", "shape": "box", "frame": "part", "size_mm": [20, 20, 400]}
    free = checked(cell={"body": [post | {"x_mm": 20, "y_mm": 1000}]})
    assert free["robot and spindle to surroundings"]["verdict"] == "ok"
    hit = checked(cell={"body": [post | {"x_mm": 20, "y_mm": 60}]})["robot and spindle to surroundings"]
    assert hit["verdict"] == "fail"
    assert "to pillar" in hit["what"]


def test_spindle_above_the_stock_is_as_far_as_its_nose_is_high(checked: Any) -> None:
    """The nose is assumed 51 mm above the tip, which is 3 mm below the top of the blank."""
    row = checked()["robot and spindle to surroundings"]
    assert row["what"] == "spindle to stock"
    assert row["value"] == pytest.approx(48.0, abs=0.6)


def test_without_a_table_nothing_stands_below(checked: Any) -> None:
    deep = "G0 X-12 Y15 Z60\nG0 Z42\nG1 Z-3 F3000\nG0 Z60"
    assert checked(deep)["tool to surroundings"]["verdict"] == "fail"
    a_little = checked(deep.replace("Z-3", "Z-0.5"))["tool to surroundings"]
    assert a_little["verdict"] == "warning"
    assert a_little["value"] == pytest.approx(-0.5, abs=0.02)
    gone = checked(deep, cell={"body": [{"name": "table", "shape": "none"}]})
    assert gone["tool to surroundings"]["verdict"] == "not looked at"


def test_a_line_up_and_down_turns_axes_in_the_cut_and_in_the_air_it_does_not(checked: Any) -> None:
    there_and_back = "G0 X-12 Y15 Z60\nG0 Z42\nG1 Z{z} F3000\nG1 X25 F1500\nG1 Y19\nG1 X5\nG0 Z60"
    cutting = checked(there_and_back.format(z=37))["reversals in the cut"]
    assert (cutting["verdict"], cutting["missing"]) == ("not looked at", "robot.play")
    assert cutting["line"] in (7, 8, 9)
    assert checked(there_and_back.format(z=41))["reversals in the cut"]["value"] == 0.0
    for half_band, verdict in ((100.0, "warning"), (1.0, "ok")):
        loose = {"play": [{"axis": axis, "dead_band_half_urad": half_band} for axis in range(1, 7)]}
        assert checked(there_and_back.format(z=37), robot=loose)["reversals in the cut"]["verdict"] == verdict


def test_path_speed_at_a_corner_in_the_cut_is_that_of_its_rounding(checked: Any) -> None:
    """0.1 mm before a right angle at 1 m/s2: v^2 = a 2 d cos^2(45 deg) / sqrt 2, 504 of 1500 mm/min."""
    row = checked(CORNERED, controller={"blending_mm": 0.1, "acceleration_mm_s2": 1000})["path speed held"]
    speed = np.sqrt(2.0 * 1e-4 * 0.5 / np.sqrt(2.0)) * 60e3
    assert (row["verdict"], row["limit"], row["unit"]) == ("ok", 1500.0, "mm/min")  # on less than 5 % of the cut
    assert row["value"] == pytest.approx(speed, rel=0.01)
    assert row["line"] in (7, 8, 9)
    assert "acceleration of the tool" in row["what"]
    assert "assumed" not in row["what"]
    assert "joint_acceleration_deg_s2" in row["what"]
    numbers = checked(CORNERED, controller={"blending_mm": 0.1, "acceleration_mm_s2": 1000})["done"].summary[
        "path_speed"
    ]
    assert numbers["lowest_mm_min"] == pytest.approx(row["value"], abs=0.01)
    assert f"{numbers['slower_percent']:.1f} % of the cutting path" in row["what"]
    assert sum(numbers["causes_percent"].values()) == pytest.approx(100.0, abs=0.1)
    assumed = checked(CORNERED)["path speed held"]
    assert "controller.blending_mm 0.5" in assumed["what"]
    assert "assumed: controller.acceleration_mm_s2 1000" in assumed["what"]


def test_path_speed_is_that_of_the_model_of_the_controller(checked: Any, path_of: Any) -> None:
    """Run with whole blocks as sides: slowest at the corner, and as long altogether.

    The parabola of a right angle is shorter than its sides by ``d (2 - (sqrt 2 + asinh 1) / sqrt 2)``; three and a half
    of them lie in the feed.
    """
    changes = {"blending_mm": 0.3, "acceleration_mm_s2": 600}
    done = checked(CORNERED, controller=changes)["done"].result
    held = done.along.held
    path = path_of(CORNERED, step_mm=1000.0)
    track = build_track(path, blending_m=0.3e-3, rapid_m_s=0.25, acceleration_m_s2=0.6)
    _, p, _, row = track.timed(0.6, 0.001)
    speed = np.linalg.norm(np.diff(p, axis=0), axis=1) / 0.001
    corner = path.p_part_tcp[np.flatnonzero(path.motion == path.motion.max() - 3)[-1]]
    near = np.linalg.norm(p[1:] - corner, axis=1) < 0.25e-3
    at = np.linalg.norm(done.path.p_part_tcp - corner, axis=1) < 1e-6
    assert held.at_m_s[at].min() == pytest.approx(speed[near].min(), rel=0.02)
    shorter = 0.3e-3 * (2.0 - (np.sqrt(2.0) + np.arcsinh(1.0)) / np.sqrt(2.0)) / speed[near].min()
    fed = held.duration_s[done.path.kind == FEED].sum() - 3.5 * shorter
    assert fed == pytest.approx(0.001 * np.sum(path.kind[row] == FEED), rel=0.01)


def test_speed_near_a_singularity_is_that_of_the_inverse_jacobian(checked: Any, cell_of: CellOf) -> None:
    """A half circle past axis 5 near zero: at each row the axes allow ``min(limit / |J^-1 (u, 0)|)``."""
    upright = {"tcp": {"x_mm": 0, "z_mm": 300, "b_deg": 0}, "limits": {"joint_speed_deg_s": [2.0] * 6}}
    body = "G0 X0 Y15 Z60\nG1 Z45 F3000\nG3 X40 Y15 I20 J0 F3000\nG0 Z60"
    changes = {"acceleration_mm_s2": 100_000}
    result = checked(body, controller=changes, **upright)["done"].result
    held, path, q = result.along.held, result.path, result.q
    rows = np.flatnonzero((path.kind == FEED) & (path.motion == path.motion[path.kind == FEED].max()))[2:-1]
    J = jacobian(cell_of(**upright).controller_chain, 0.5 * (q[rows] + q[rows - 1]))
    R = cell_of(**upright).T_base_part[:3, :3]
    step = (path.p_part_tcp[rows] - path.p_part_tcp[rows - 1]) @ R.T
    twist = np.concatenate([step / np.linalg.norm(step, axis=1, keepdims=True), np.zeros_like(step)], axis=1)
    rate = np.linalg.solve(J, twist[..., None])[..., 0]
    allowed = np.min(np.radians(2.0) / np.abs(rate), axis=1)
    assert allowed.min() < 0.7 * allowed.max()
    assert held.mean_m_s[rows] == pytest.approx(np.minimum(allowed, 0.05), rel=0.02)


def test_an_axis_that_is_slow_at_feed_is_named(checked: Any) -> None:
    rows = checked(GROOVE, limits={"joint_speed_deg_s": [0.1] * 6}, controller={"acceleration_mm_s2": 20000})
    row, speeds = rows["path speed held"], rows["joint speed at feed"]
    assert speeds["verdict"] == "fail"
    assert row["value"] < 1500.0
    assert "joint speed of axis" in row["what"]


def test_corners_in_the_cut_are_held_against_their_tolerance(checked: Any) -> None:
    """0.5 mm before a right angle: 177 um."""
    rows = checked(CORNERED, limits={"corner_error_um": 100})
    row = rows["corner error of the approximation"]
    assert (row["verdict"], row["limit"]) == ("warning", 0.1)
    assert row["value"] == pytest.approx(0.25 * np.sqrt(0.5), rel=1e-4)
    assert rows["approximation to points"]["verdict"] == "ok"
    assert checked(CORNERED, limits={"corner_error_um": 200})["corner error of the approximation"]["verdict"] == "ok"
    exact = checked(CORNERED.replace("G1 Z37", "G61 G1 Z37"))
    assert exact["corner error of the approximation"]["value"] is None
    assert exact["path speed held"]["value"] == 0.0


def test_program_of_a_kuka_counts_as_krl_and_is_divided(checked: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """As many points and parts as the writer makes."""
    row = checked(CORNERED)["program size"]
    assert row["verdict"] == "ok"
    assert row["what"] == "motions in KRL without corrections: one file, part"
    krl = LANGUAGES["krl"]
    few = replace(krl, limits=replace(krl.limits, points_per_file=2))
    monkeypatch.setattr(LANGUAGES.own["krl"].replace(":", "."), few)
    divided = checked(CORNERED)["program size"]
    assert divided["value"] == row["value"]
    assert f"part calls {-(-int(row['value']) // 2)} files" in divided["what"]


def test_a_robot_of_its_own_has_the_language_of_its_spindle(checked: Any, cell_of: CellOf) -> None:
    """Not of the catalogue: the one table in ``[controller.spindle]``, else the program as it stands."""
    done, cell = checked()["done"], cell_of()
    assert program_size.language_of(done.job, cell) == "krl"
    for given, expected in (({"fanuc"}, "fanuc"), ({"krl", "rapid"}, "linuxcnc"), ({"wait_s"}, "linuxcnc")):
        spindle = SpindleTable.model_validate({key: 5.0 if key == "wait_s" else {} for key in given})
        controller = cell.tables.controller.model_copy(update={"spindle": spindle})
        robot = cell.tables.robot.model_copy(update={"catalog": None})
        other = replace(cell, tables=cell.tables.model_copy(update={"controller": controller, "robot": robot}))
        assert program_size.language_of(done.job, other) == expected


def test_written_points_are_those_of_the_writer(checked: Any, cell_of: CellOf) -> None:
    done, cell = checked(CORNERED)["done"], cell_of()
    path = done.job.path
    poses = pose.make(tool_orientation(path.axis_part, cell.tables.posture.rotation_about_tool_rad), path.p_part_tcp)
    settings = KrlSettings(name="part", start_axes_rad=[0.0] * 6, cycle_s=cell.tables.controller.cycle_s,
                           rapid_m_s=cell.tables.controller.rapid_m_s)  # fmt: skip
    text = KrlWriter(done.job.program, path, poses, settings, tolerance_m=program_size.TOLERANCE_M,
                     block_lines=cell.machine_functions("krl").lines).text()  # fmt: skip
    row = next(row for row in done.summary["checks"] if row["check"] == "program size")
    assert row["value"] == text.points


def test_rapids_get_points_between_and_nothing_else_changes(path_of: Any) -> None:
    path = path_of("G0 X0 Y0 Z10\nG0 X33\nG4 P1\nG1 X40 F600\nG0 Y7 Z30")
    fine = with_points_in_rapids(path)
    step = np.linalg.norm(np.diff(fine.p_part_tcp, axis=0), axis=1)
    assert np.max(step[fine.kind[1:] == RAPID]) <= STEP_M * (1 + 1e-9)
    assert fine.time_s[-1] == path.time_s[-1]
    ends = np.searchsorted(fine.time_s, path.time_s, side="left")
    assert len(fine) > len(path)
    kept = {tuple(row) for row in np.round(fine.p_part_tcp, 12).tolist()}
    assert all(tuple(row) in kept for row in np.round(path.p_part_tcp, 12).tolist())
    assert np.all(np.diff(ends) >= 0)

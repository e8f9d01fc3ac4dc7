"""The robot holds the part against a spindle that stands: corrected over sockets, and every sign on the way."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import counterflex
from counterflex.app.compensation.compensate import run as compensate
from counterflex.app.inputs import read_job, setting_of
from counterflex.app.proof import simulate
from counterflex.app.proof.truth import make_truth
from counterflex.app.run import session as online_session
from counterflex.app.simulated_cell import cell as live
from counterflex.core.errors import InputError
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.sensing import SensorTable, flange_sensor
from counterflex.files.summary_file import read_run
from counterflex.geometry import pose, rotation
from counterflex.plan.inputs import solve_joints
from counterflex.plan.relative_motion import part_carried
from counterflex.robot.elasticity.chain import forward
from counterflex.robot.elasticity.compliance import cartesian_compliance
from counterflex.runtime.cycle_inputs import CycleInputs
from counterflex.runtime.loop import Loop
from counterflex.runtime.plausibility.axis_check import AxisCheck
from counterflex.runtime.sensing.sensor_wrench import SensorWrench
from counterflex.runtime.settings import ForceMode, OnlineSettings, Output, require_for_held_part
from counterflex.runtime.state.supervisor import State
from counterflex.sensing.carrier import carrier_to_tcp
from counterflex.twin.plant.force_sensor import force_sensor
from counterflex_lab.reproduce import closed_loop

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
RSI = Path(counterflex.__file__).parent / "app" / "demo" / "rsi.xml"
PROGRAM = EXAMPLES / "programs" / "groove.ngc"
CELL = EXAMPLES / "cells" / "kr300_held_part.toml"
ONLINE = '\n[online]\nforce = "scale"\noutput = "axes"\ncorrection_mm = 3\nspeed_mm_s = 40\nacceleration_mm_s2 = 2500\n'
SENSOR = (
    '[[end_effector]]\nname = "sensor"\nz_mm = 30\nmass_kg = 6\nrx_urad_per_knm = 303.0\nry_urad_per_knm = 303.0\n\n'
)
FORCE_ONLY = OnlineSettings(force=ForceMode.MEASURED, output=Output.AXES, normal_only=False, orientation=True)


def held_cell(folder: Path, more: str = "") -> Path:
    """The example with a force sensor between flange and gripper."""
    text = CELL.read_text(encoding="utf-8")
    assert text.count('[[end_effector]]\nname = "gripper"\nz_mm = 60') == 1
    text = text.replace(
        '[[end_effector]]\nname = "gripper"\nz_mm = 60', SENSOR + '[[end_effector]]\nname = "gripper"\nz_mm = 30'
    )
    file = folder / "held.toml"
    file.write_text(text + more, encoding="utf-8")
    return file


def somewhere(cell: Cell) -> tuple[Any, Any]:
    """A pose of the tool in the part, off the part's origin, and the axis angles there."""
    job = read_job(PROGRAM, cell)
    setting = setting_of(cell, part_may_be_held=True)
    row = len(job.path) // 2
    q = solve_joints(job.path, job.line_of_motion[job.path.motion], setting).q[row]
    return setting.poses_in_part(job.path)[row], q


def test_deflection_is_that_of_the_planner() -> None:
    """Force along each axis of the part and a moment: the loop's Newton model against C and the matrices X."""
    cell = read_cell(CELL)
    T_part_tcp, q = somewhere(cell)
    assert cell.T_base_tcp is not None
    loop = Loop(cell.chain, FORCE_ONLY, np.eye(4), T_base_tcp=cell.T_base_tcp)
    C = part_carried(cell.T_base_tcp, T_part_tcp[None]).compliance(cartesian_compliance(cell.chain, q[None]))[0]
    for k in range(6):
        w = np.zeros(6)
        w[k] = 50.0 if k < 3 else 5.0
        loop.reset()
        for _ in range(400):
            loop.feed(CycleInputs(T_part_tcp=T_part_tcp, q=q, w_tcp_part=w))
            loop.run()
        assert np.allclose(loop.result.deflection, C @ w, rtol=2e-3, atol=2e-3 * np.abs(C @ w).max())


def test_axis_correction_moves_the_tool_where_it_is_wanted(tmp_path: Path) -> None:
    """The axes sent, through the rigid chain, shift the tool in the part by the correction."""
    cell = read_cell(CELL)
    T_part_tcp, q = somewhere(cell)
    assert cell.T_base_tcp is not None
    loop = Loop(cell.chain, FORCE_ONLY, np.eye(4), T_base_tcp=cell.T_base_tcp)
    w = np.array([-120.0, 80.0, 150.0, 0.0, 0.0, 0.0])
    for cycle in range(1500):
        loop.feed(CycleInputs(T_part_tcp=T_part_tcp, q=q, w_tcp_part=w, arm=cycle > 50, enable=cycle > 60))
        loop.run()
    assert loop.result.state == State.ACTIVE
    correction = loop.correction.copy()
    assert np.linalg.norm(correction[:3]) > 50e-6
    T_before, T_after = (pose.inverse(forward(cell.chain, angles)) @ cell.T_base_tcp for angles in (q, q + loop.axes))
    moved = np.r_[T_after[:3, 3] - T_before[:3, 3], rotation.log(T_after[:3, :3] @ T_before[:3, :3].T)]
    assert np.allclose(moved, correction, atol=0.01 * np.linalg.norm(correction[:3]))


def test_pose_of_the_angles_is_that_of_the_telegram() -> None:
    """What places the part is the hand: angles and pose of one instant agree, and angles 1 deg off do not."""
    cell = read_cell(CELL)
    T_part_tcp, q = somewhere(cell)
    T = np.concatenate([T_part_tcp[:3, :3].reshape(-1), T_part_tcp[:3, 3]])
    check = AxisCheck(cell.controller_chain, np.eye(4), 4e-3, T_base_tcp=cell.T_base_tcp)
    assert check(q.copy(), T, np.zeros(6), learn=True) == 0
    assert np.abs(check.offset[:3]).max() < 1e-9
    assert check(q + np.array([0.0, 0.0175, 0.0, 0.0, 0.0, 0.0]), T, np.zeros(6), learn=False) != 0


def test_sensor_reads_the_force_on_the_tool(tmp_path: Path) -> None:
    """A force on the tool, turned round onto the hand and shown by a sensor behind it, comes back as it was."""
    cell = read_cell(held_cell(tmp_path))
    T_part_tcp, q = somewhere(cell)
    sensor = flange_sensor(SensorTable(segment="sensor"), cell.chain)
    assert sensor is not None
    assert cell.T_base_tcp is not None
    reading = SensorWrench(cell.chain, sensor, None)
    loop = Loop(cell.chain, FORCE_ONLY, np.eye(4), T_base_tcp=cell.T_base_tcp)
    loop.feed(CycleInputs(T_part_tcp=T_part_tcp, q=q))
    idle = reading(q, np.zeros(6)).copy()
    w_tool = np.array([100.0, -60.0, 30.0, 1.0, 2.0, 3.0])
    on_hand_base = part_carried(cell.T_base_tcp, T_part_tcp[None]).load(w_tool[None])[0]
    R_base_sensor = reading.R_base_sensor
    f, m = R_base_sensor.T @ on_hand_base[:3], R_base_sensor.T @ on_hand_base[3:]
    p_sensor_hand = (pose.inverse(sensor.T_seg_sensor) @ carrier_to_tcp(cell.chain, sensor.segment))[:3, 3]
    shown = np.r_[f, m + np.cross(p_sensor_hand, f)]
    w = reading(q, shown).copy() - idle
    loop.on_tool(w)
    assert np.allclose(w, w_tool, atol=0.2)  # the arm bends under its own weight, by some mrad


def test_what_the_loop_cannot_do_is_refused() -> None:
    for change, key in (
        ({"output": Output.CARTESIAN}, "output"),
        ({"force": ForceMode.FUSED}, "force"),
        ({"inertia_hz": 60.0}, "inertia_hz"),
    ):
        with pytest.raises(InputError) as fault:
            require_for_held_part(replace(FORCE_ONLY, **change))
        assert key in str(fault.value)


def test_correcting_while_milling_pair(tmp_path: Path) -> None:
    """Same truth, same program: watched only, and corrected in the axes from the measured force."""
    bare = read_cell(held_cell(tmp_path))
    truth = make_truth(bare, 1, tmp_path / "truth.toml")
    bias = force_sensor(truth, 0, "sensor", hose_share=0.0).w_bias
    table = f'\n[sensor]\nsegment = "sensor"\nbias_n = {bias[:3].tolist()}\nbias_nm = {bias[3:].tolist()}\n'
    cell = held_cell(tmp_path, table + ONLINE)
    weight = {body.name: body.mass_kg for body in truth.bodies}["gripper"]
    cell.write_text(
        cell.read_text(encoding="utf-8").replace("mass_kg = 25", f"mass_kg = {weight:.4f}"), encoding="utf-8"
    )
    compensate(PROGRAM, cell, tmp_path / "plan", report=False, programmed_feed=True)
    twin = live.LiveSettings(PROGRAM, cell, tmp_path / "truth.toml", ("rsi", RSI), hose_share=0.0)
    across = {}
    for name, arm in (("watched", False), ("acted", True)):
        loop = online_session.RunSettings(
            cell, ("rsi", RSI), tmp_path / "plan" / "plan.parquet", compensated=False, arm=arm
        )
        summary = closed_loop.run(twin, tmp_path / name, loop, tmp_path / f"{name}-log", sensors=closed_loop.Sensors())
        assert "fault" not in summary["states"]
        assert ("active" in summary["states"]) == arm
        across[name] = bent_across(tmp_path / name)
    assert across["watched"] > 0.6e-3
    assert across["acted"] < 0.15 * across["watched"]


def bent_across(part: Path) -> float:
    """Median deviation square to the feed (along x) and to the tool in the full cut, less that just before, m.

    What is there before the cut is weight: the frame was measured from outside, and a force does not show it.
    """
    record = read_run(part / simulate.RUN)[0]
    cut = np.flatnonzero(np.linalg.norm(record.force_part, axis=1) > 300.0)
    aside = record.p_part_tcp[:, 1] - record.p_part_command[:, 1]
    return float(abs(np.median(aside[cut]) - aside[cut[0] - 150]))

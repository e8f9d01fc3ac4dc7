"""Own weight of an arm whose masses the cell file does not have: MuJoCo hangs the true one on its joint springs."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest
import tomli_w

from counterflex.app.identification.cell_model import model_of
from counterflex.app.inputs import setting_of
from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, InputError
from counterflex.core.progress import silent
from counterflex.core.units import MM, MRAD
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.measured import IdentifiedTable
from counterflex.files.cell.update import updated_text
from counterflex.geometry import rotation
from counterflex.identify.data.changes import TableValues
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.geometry.arm_geometry import ArmGeometry
from counterflex.identify.geometry.arm_parameters import ArmPriors, arm_model, sag_as_known, sag_of
from counterflex.identify.geometry.pose_residuals import PlacedFrame, TrackerResiduals
from counterflex.identify.kinematics.recipe import RECIPE
from counterflex.identify.recipe import Identification
from counterflex.plan.relative_motion import tool_carried
from counterflex.plan.sag_and_play import residual_sag
from counterflex.robot.elasticity.axis_sag import AxisSag, unit_turns
from counterflex.robot.elasticity.chain import ElasticChain, forward
from counterflex.robot.elasticity.drive_error import DriveErrors
from counterflex.robot.elasticity.gravity import weight_loads
from counterflex.robot.model.description import EndEffector
from derivative_check import convergence_order

RIGID = Path(__file__).resolve().parents[2] / "data" / "cells" / "rigid.toml"
NOISE_M, NOISE_RAD = 0.01 * MM, 0.02 * MRAD
STAUBLI, KUKA = "staubli_tx2_90l", "kuka_kr210_2"
MASSES = {STAUBLI: (40.0, 25.0, 14.0, 3.0, 3.0, 6.0), KUKA: (300.0, 250.0, 160.0, 40.0, 30.0, 90.0)}
SPRINGS = {STAUBLI: 1.5e5, KUKA: 2.5e6}
"""kg of the links from axis 1 on and N m/rad of axes 2 and 3 (the others ten times stiffer): not in any cell file."""
ENTRY = IdentifiedTable(
    recipe="kinematics", date="2026-01-01", data=("x",), data_sha256=("0" * 64,), counterflex="0", holdout=""
)


def _cell(folder: Path, robot: str, **more: object) -> Cell:
    tables = {**tomllib.loads(RIGID.read_text()), "robot": {"catalog": robot}, **more}
    file = folder / "cell.toml"
    file.write_text(tomli_w.dumps(tables))
    return read_cell(file)


def _hung(chain: ElasticChain, robot: str, q: Float, *, weight: bool) -> Float:
    """(m, 4, 4) poses of the TCP: MuJoCo's bodies in MuJoCo's equilibrium of joint springs and weight."""
    rng = np.random.default_rng(5)
    spec = mujoco.MjSpec()
    spec.option.gravity = [0.0, 0.0, -9.80665]
    spec.compiler.degree = False
    body = spec.worldbody
    for i in range(chain.n):
        T = chain.fixed[i].copy()
        T[:3, 3] += rng.normal(0.0, 0.1 * MM, 3)  # lengths are not quite those of the drawing
        c, s = np.cos(chain.offset[i]), np.sin(chain.offset[i])
        R = T[:3, :3] @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        body = body.add_body(pos=T[:3, 3], quat=rotation.quat_wxyz(R))
        body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 0.0, chain.sign[i]])
        after = chain.fixed[i + 1] if i + 1 < chain.n else chain.T_last_tcp
        body.mass, body.inertia = MASSES[robot][i], [0.1, 0.1, 0.1]
        body.explicitinertial = True
        body.ipos = 0.5 * after[:3, 3] + np.array([0.03, -0.02, 0.05])
    body.add_site(name="tcp", pos=chain.T_last_tcp[:3, 3])
    model = spec.compile()
    data = mujoco.MjData(model)
    spring = SPRINGS[robot] * np.array([10.0, 1.0, 1.0, 10.0, 10.0, 10.0])
    out = np.tile(np.eye(4), (len(q), 1, 1))
    for row, T in zip(q, out, strict=True):
        data.qpos[:] = row
        for _ in range(4 if weight else 1):
            mujoco.mj_forward(model, data)
            if weight:
                data.qpos[:] = row - data.qfrc_bias / spring
        mujoco.mj_forward(model, data)
        T[:3, 3] = data.site("tcp").xpos
        T[:3, :3] = data.site("tcp").xmat.reshape(3, 3) @ chain.T_last_tcp[:3, :3]
    return out


@cache
def _data(robot: str, folder: Path, *, weight: bool) -> tuple[Dataset, Dataset]:
    """Poses to fit and poses to hold out, as a tracker of 10 um sees them."""
    chain = _cell(folder, robot).controller_chain
    rng = np.random.default_rng(2)
    limits = chain.joint_limits_rad
    middle, half = limits.mean(axis=1), 0.5 * (limits[:, 1] - limits[:, 0])
    q = middle + rng.uniform(-1.0, 1.0, (90, 6)) * np.minimum(0.7 * half, 1.3)
    Ts_base_tcp = _hung(chain, robot, q, weight=weight)
    p = Ts_base_tcp[:, :3, 3] + rng.normal(0.0, NOISE_M, (90, 3))
    R = Ts_base_tcp[:, :3, :3] @ rotation.exp(rng.normal(0.0, NOISE_RAD, (90, 3)))
    R_tracker_base = rotation.exp(np.array([0.1, -0.05, 1.2]))
    arrays = {
        "q": q,
        "p_tracker_target": (p - np.array([3.0, 1.0, 0.2])) @ R_tracker_base.T,
        "R_tracker_target": R_tracker_base @ R,
    }
    sigma = {"p_tracker_target": NOISE_M, "R_tracker_target": NOISE_RAD}
    fit, held = ({k: v[rows] for k, v in arrays.items()} for rows in (slice(60), slice(60, None)))
    return of_arrays("poses", "tracker_poses", fit, sigma), of_arrays("others", "tracker_poses", held, sigma)


@cache
def _found(robot: str, folder: Path, sag: str, *, weight: bool = True) -> Identification:
    fit, held = _data(robot, folder, weight=weight)
    model = model_of(_cell(folder, robot))
    return RECIPE.identify(model, [fit], [held], {"periodic": "off", "sag": sag, "folds": 2}, silent)


def _table(found: Identification) -> TableValues | None:
    return next((c for c in found.changes if isinstance(c, TableValues) and c.table == "axis_sag"), None)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cells")


@pytest.mark.long
@pytest.mark.parametrize("robot", [STAUBLI, KUKA])
def test_poses_held_out_are_predicted_better_with_sag_of_axes_2_and_3(robot: str, folder: Path) -> None:
    without, found = _found(robot, folder, "off"), _found(robot, folder, "auto")
    mean = {name: f.headline[0].value for name, f in (("without", without), ("with", found))}
    assert found.headline[0].name == "holdout_mean_mm"
    assert mean["without"] > 0.1
    assert mean["with"] < 0.35 * mean["without"]
    assert _table(without) is None
    assert _table(found) is not None
    assert any("mean error of poses held out" in text for text in found.remarks)


def test_nothing_is_found_where_nothing_hangs(folder: Path) -> None:
    found = _found(STAUBLI, folder, "auto", weight=False)
    assert _table(found) is None
    assert any("is not determined" in text for text in found.remarks)
    assert found.headline[0].value < 0.03  # mm, of a tracker of 0.01 mm in each direction
    forced = _table(_found(STAUBLI, folder, "axes", weight=False))
    assert forced is not None
    largest = max(abs(v) for pair in forced.values.values() if isinstance(pair, list) for v in np.ravel(pair))
    assert largest < 0.1  # mrad; with its weight this arm has 1


def test_the_identified_cell_file_knows_where_the_unloaded_tool_is(folder: Path, tmp_path: Path) -> None:
    found = _found(STAUBLI, folder, "auto")
    before = _cell(folder, STAUBLI)
    new = tmp_path / "new.toml"
    new.write_text(updated_text(before, found.changes, ENTRY, tmp_path), encoding="utf-8")
    cell = read_cell(new)
    held = _data(STAUBLI, folder, weight=True)[1].values("q")
    true = _hung(before.controller_chain, STAUBLI, held, weight=True)[:, :3, 3]
    left = {}
    for name, q in (("without", held), ("with", cell.drive_errors.link_angles(held))):
        off = forward(cell.chain, q)[:, :3, 3] - true
        left[name] = float(np.mean(np.linalg.norm(off - off.mean(axis=0), axis=1)))
    assert left["with"] < 0.5 * left["without"]
    # What planning believes of the unloaded tool over the part changes by what hangs there.
    setting = setting_of(cell, chain=cell.chain)
    p_part = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, 0.2, 0.1]])
    q = held[:3]
    unknown = replace(setting, drive_errors=DriveErrors())
    relative = tool_carried(setting.T_base_part)
    change = residual_sag(p_part, q, setting, relative) - residual_sag(p_part, q, unknown, relative)
    assert np.max(np.abs(change)) > 0.1 * MM
    # Identified once more on the new file, nothing is left to find and the table stays.
    again = RECIPE.identify(
        model_of(cell), [_data(STAUBLI, folder, weight=True)[0]], [], {"periodic": "off", "folds": 2}, silent
    )
    assert _table(again) is None
    assert any("is not determined" in text for text in again.remarks)
    assert any("[axis_sag] of the cell file is applied" in text for text in again.remarks)


@pytest.mark.parametrize("gravity", [(0.0, 0.0, -9.8), (0.0, 0.0, 9.8), (4.0, -5.0, -6.0)])
def test_unit_turns_are_moments_of_weight_in_any_mounting(gravity: tuple[float, float, float], folder: Path) -> None:
    chain = _cell(folder, KUKA).controller_chain
    q = np.random.default_rng(0).uniform(-2.0, 2.0, (20, 6))
    mass, com = np.zeros(chain.n), np.zeros((chain.n, 3))
    mass[1:3], com[1:3] = (80.0, 50.0), ((0.4, 0.1, 0.2), (0.3, -0.2, 0.1))
    robot = _cell(folder, KUKA).nominal_robot
    bodies = [replace(s, mass_kg=m, p_seg_com=c) for s, m, c in zip(robot.segments, mass, com, strict=True)]
    heavy = ElasticChain.build(replace(robot, segments=tuple(bodies)), EndEffector((), np.eye(4)), gravity)
    loads = weight_loads(heavy, q)
    link3 = mass[2] * com[2, :2]
    link2 = mass[1] * com[1, :2] + mass[2] * chain.fixed[2][:2, 3]
    unit = unit_turns(heavy, q) * np.linalg.norm(gravity)
    np.testing.assert_allclose(unit[:, :4] @ [*link2, *link3], chain.sign[1] * loads[:, 1, 5], atol=1e-9)
    np.testing.assert_allclose(unit[:, 4:] @ link3, chain.sign[2] * loads[:, 2, 5], atol=1e-9)


def test_derivatives_are_exact_by_their_order_of_convergence(folder: Path) -> None:
    model = arm_model(model_of(_cell(folder, KUKA)), ArmPriors(), sag="axes")
    rng = np.random.default_rng(1)
    p, q = len(model.parameters), rng.uniform(-1.0, 1.0, (6, 6))
    T = np.tile(np.eye(4), (6, 1, 1))
    frame, target = PlacedFrame(T[0], np.arange(p, p + 6)), PlacedFrame(T[1], np.arange(p + 6, p + 12))
    arm = model.at(q)
    block = TrackerResiduals("poses", np.arange(6), np.full((6, 6), 0.1), arm, frame, target, T[:, :3, 3], T[:, :3, :3])
    x = 1e-2 * rng.normal(size=p + 12)
    assert np.all(convergence_order(block, x, np.full(p + 12, 3e-2)) > 1.8)
    assert isinstance(arm, ArmGeometry)
    keep = np.arange(6) % 2 == 0
    np.testing.assert_allclose(block.subset(keep).evaluate(x), block.evaluate(x)[keep])


def test_weight_is_never_counted_twice(folder: Path, tmp_path: Path) -> None:
    light = _cell(folder, KUKA).controller_chain
    assert (sag_of(light, "auto"), sag_as_known(light)) == ("axes", "off")
    elastic = {"catalog": KUKA, "elastic": [{"segment": "axis3", "mass_kg": 90}]}
    table = {"axis2_by_link2_mrad": [0.5, 0.0]}
    tables = {**tomllib.loads(RIGID.read_text()), "robot": elastic}
    file = tmp_path / "heavy.toml"
    file.write_text(tomli_w.dumps(tables))
    with pytest.raises(InputError, match="count twice"):
        sag_of(read_cell(file).controller_chain, "axes")
    file.write_text(tomli_w.dumps({**tables, "axis_sag": table}))
    with pytest.raises(CounterflexError, match="axis_sag.*count twice"):
        read_cell(file)
    with pytest.raises(CounterflexError, match="far too large"):
        _cell(tmp_path, KUKA, axis_sag={"axis2_by_link2_mrad": [500.0, 0.0]})


def test_commanded_angles_undo_sag(folder: Path, tmp_path: Path) -> None:
    cell = _cell(tmp_path, KUKA, axis_sag={"axis2_by_link3_mrad": [1.5, -0.3], "axis3_by_link3_mrad": [2.0, 0.1]})
    q = np.random.default_rng(4).uniform(-2.0, 2.0, (30, 6))
    errors = cell.drive_errors
    assert errors
    assert isinstance(errors.sag, AxisSag)
    np.testing.assert_allclose(errors.link_angles(errors.controller_angles(q)), q, atol=1e-12)
    moved = np.max(np.abs(errors.link_angles(q) - q), axis=0)
    assert np.all(moved[1:3] > 0.5 * MRAD)
    np.testing.assert_array_equal(moved[[0, 3, 4, 5]], 0.0)
